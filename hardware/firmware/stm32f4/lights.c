/* Green: short flashes, no host yet; on, connected; quick, currents may flow; dark, a fault. Red: a fault; quick: the
 * e-stop has cut the amplifiers' supply. */
#include "board.h"
#include "pins.h"

void lights_begin(void)
{
    pin_set(PIN_LIGHT, true); /* both until the first tick */
    pin_set(PIN_RED_LIGHT, true);
}

void lights_show(uint8_t state, bool cut)
{
    static uint16_t ms;
    ms = (uint16_t)((ms + 1) % 1000);
    bool quick = ms / 100 % 2 == 0, flash = ms < 100;
    pin_set(PIN_LIGHT, state == PHD_ACTIVE ? quick : state == PHD_READY || (state != PHD_FAULT && flash));
    pin_set(PIN_RED_LIGHT, cut ? quick : state == PHD_FAULT);
}
