#include "phd_board.h"

enum phd_age phd_freshness_judge(phd_freshness *freshness, uint32_t sequence, uint64_t host_us, uint64_t now_us)
{
    uint32_t step = sequence - freshness->last;
    if (freshness->taken && (step == 0 || step >= 0x80000000u))
        return PHD_OLD;
    uint64_t late = 0; /* us: how much longer it took than the quickest of late */
    bool quickest = true;
    if (freshness->timed) {
        uint64_t gone = now_us - freshness->board_us;
        gone -= gone / 1000; /* the least rises by 1 ms each second */
        if (host_us >= freshness->host_us) {
            uint64_t host_gone = host_us - freshness->host_us;
            late = gone > host_gone ? gone - host_gone : 0;
        } else { /* the host's clock says that it was sent before the quickest one */
            uint64_t back = freshness->host_us - host_us;
            late = back > PHD_LATE_US ? back : gone + back;
        }
        quickest = late == 0;
    }
    if (quickest) {
        freshness->timed = true;
        freshness->board_us = now_us;
        freshness->host_us = host_us;
    }
    return late > PHD_LATE_US ? PHD_LATE : PHD_FRESH;
}
