/* Force: the six signals of a sensor's amplifier at an AD7606 (eight channels at once, +-10 V, 16 bits) at SPI2.
 * Where a Net F/T on the network reads the force, `capability` has no channels, and this file does nothing. */
#include "board.h"
#include "pins.h"
#include "registers.h"

enum { PATIENCE = 2000 }; /* loops: some 50 us; a converter that is not there costs this, and reads 0 */

void force_begin(void)
{
    RCC_APB1ENR |= BIT(14);
    /* master, clock high at rest, read at its falling edge, 16 bits, 42 MHz / 4, no pin of its own to select */
    SPI2_CR1 = BIT(11) | BIT(9) | BIT(8) | 1 << 3 | BIT(2) | BIT(1);
    SPI2_CR1 |= BIT(6);
    pin_set(PIN_FORCE_SELECT, true);
    pin_set(PIN_FORCE_RESET, true);
    for (volatile uint32_t n = 0; n < 100; n++) {
    }
    pin_set(PIN_FORCE_RESET, false);
}

static uint16_t word(void)
{
    SPI2_DR = 0;
    for (unsigned n = 0; !(SPI2_SR & BIT(0)); n++)
        if (n == PATIENCE)
            return 0;
    return (uint16_t)SPI2_DR;
}

void force_read(phd_readings *readings)
{
    if (capability()->force_channels == 0)
        return;
    pin_set(PIN_FORCE_CONVERT, true); /* all channels are held at this edge */
    for (volatile unsigned n = 0; n < 4; n++) {
    }
    for (unsigned n = 0; pin_is_high(PIN_FORCE_BUSY) && n < PATIENCE; n++) {
    }
    pin_set(PIN_FORCE_CONVERT, false);
    pin_set(PIN_FORCE_SELECT, false);
    for (unsigned k = 0; k < PHD_MAX_FORCE; k++)
        readings->force[k] = (int16_t)word();
    pin_set(PIN_FORCE_SELECT, true);
}
