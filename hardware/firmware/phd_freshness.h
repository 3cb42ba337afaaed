/* Which commands a board may still obey: newer than the last one, and not held up on their way (docs/protocol.md,
 * "Commands"). The two clocks need not agree, and may drift apart by 1 ms each second: only differences count. */
#ifndef PHD_FRESHNESS_H
#define PHD_FRESHNESS_H

#include "phd_frames.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PHD_LATE_US UINT32_C(50000) /* a command that took this much longer than the quickest of late is not obeyed */
PHD_ASSERT_U32(late_us, PHD_LATE_US, 50000);

enum phd_age { PHD_FRESH, PHD_OLD, PHD_LATE };

/* The memory of one connection; all zero at its beginning. */
typedef struct {
    bool taken, timed;           /* any command taken in; any command's way timed */
    uint32_t last;               /* sequence of the last command taken in: the board sets it, and `taken` */
    uint64_t board_us, host_us;  /* both clocks at the command that was quickest of late */
} phd_freshness;

/* What a command is; changes nothing but the memory of how long commands take. */
enum phd_age phd_freshness_judge(phd_freshness *freshness, uint32_t sequence, uint64_t host_us, uint64_t now_us);

#ifdef __cplusplus
}
#endif

#endif
