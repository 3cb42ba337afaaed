/* The current of one brake: a proportional and integral loop in whole numbers, for a supply that is switched.
 * A coil is driven one way only, and its current dies away by itself. */
#ifndef CURRENT_LOOP_H
#define CURRENT_LOOP_H

#include <stdint.h>

enum { LOOP_HZ = 10000 };

/* Assumed: a brake's coil of 8 ohm and 20 mH (2.5 ms) at 24 V. No more voltage than 16 ohm would need: where a broken
 * wire measures no current, a coil of 8 ohm gets at most twice what was asked for. */
enum { SUPPLY_mV = 24000, LARGEST_OHM = 16, LOOP_P_mV_A = 20000, LOOP_I_uV_mA = 800 };

typedef struct {
    int32_t integral_uV;
} current_loop;

/* One step: mV to give now, of SUPPLY_mV, on average. asked_mA: at most 32,767. */
int32_t current_loop_step(current_loop *loop, int32_t asked_mA, int32_t measured_mA);

#endif
