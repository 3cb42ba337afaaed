/* What the firmware (main.c) asks of a board: a file for each part, in the board's folder. Another board is another
 * folder. Nothing here waits for longer than a fraction of a tick, but `_begin`. */
#ifndef BOARD_H
#define BOARD_H

#include "phd_board.h"

extern phd_board board; /* the state machine; main.c has it */

/* First of all, before clock and memory are set up any further: no current. */
void brakes_off(void);

/* Clock, pins, the timer of the tick. */
void clock_begin(void);
uint64_t clock_us(void);  /* since power-up; never steps */
bool tick_is_due(void);   /* true once for each tick */

typedef struct {
    uint32_t starts;       /* another value at every power-up */
    bool after_brown_out;  /* the supply had fallen, and power was not just switched on */
} supply_story;
supply_story supply_begin(void);
bool supply_is_cut(void);  /* the e-stop has opened the amplifiers' supply: the firmware only reports it */

const phd_capability *capability(void); /* what the board is made of and wired to */

void encoders_begin(void);
void encoders_read(phd_readings *readings); /* counts, encoder_good */
void force_begin(void);
void force_read(phd_readings *readings);    /* force */
void brakes_begin(void);
void brakes_read(phd_readings *readings);   /* current_mA */
void brakes_enable(bool may_flow);          /* the amplifiers' inhibit, beside the currents: phd_set_currents */

/* The host's port, which has phd_send as well. */
void host_begin(void);
size_t host_read(uint8_t *bytes, size_t most);
void host_poll(void);

void watchdog_begin(void); /* hardware: it resets the processor if it is not fed for 10 ms */
void watchdog_feed(void);

void lights_begin(void);
void lights_show(uint8_t state, bool cut);

#endif
