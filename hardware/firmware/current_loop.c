#include "current_loop.h"

int32_t current_loop_step(current_loop *loop, int32_t asked_mA, int32_t measured_mA)
{
    if (asked_mA <= 0) { /* zero is zero, whatever is measured */
        loop->integral_uV = 0;
        return 0;
    }
    int32_t most_mV = asked_mA * LARGEST_OHM < SUPPLY_mV ? asked_mA * LARGEST_OHM : SUPPLY_mV;
    int32_t error_mA = asked_mA - measured_mA;
    int32_t integral_uV = loop->integral_uV + LOOP_I_uV_mA * error_mA;
    int32_t mV = LOOP_P_mV_A * error_mA / 1000 + integral_uV / 1000;
    if (mV > most_mV)
        mV = most_mV; /* it gives what it can, and the integral waits, as it does at nothing */
    else if (mV < 0)
        mV = 0;
    else
        loop->integral_uV = integral_uV;
    return mV;
}
