/* The firmware: bytes from the host and a tick each millisecond go to the state machine, which sets the currents. */
#include "board.h"

phd_board board;

static void tick(void)
{
    phd_readings readings = {{0}, {0}, {0}, {false}, false};
    uint64_t now_us = clock_us();
    encoders_read(&readings);
    force_read(&readings);
    brakes_read(&readings);
    readings.supply_cut = supply_is_cut();
    phd_board_tick(&board, &readings, now_us);
    brakes_enable(board.state == PHD_READY || board.state == PHD_ACTIVE);
    lights_show(board.state, readings.supply_cut);
}

int main(void)
{
    brakes_off();
    clock_begin();
    supply_story story = supply_begin();
    lights_begin();
    encoders_begin();
    force_begin();
    brakes_begin();
    host_begin();
    phd_board_power_up(&board, capability(), story.starts, story.after_brown_out, clock_us());
    watchdog_begin();
    for (;;) {
        uint8_t bytes[64];
        size_t n = host_read(bytes, sizeof bytes);
        if (n > 0)
            phd_board_receive(&board, bytes, n, clock_us());
        if (tick_is_due()) {
            tick();
            watchdog_feed();
        }
        host_poll();
    }
}
