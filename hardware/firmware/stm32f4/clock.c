/* 168 MHz from 8 MHz that come from outside (the Nucleo's ST-LINK), 48 MHz of them for USB; a tick by SysTick. */
#include "board.h"
#include "pins.h"
#include "registers.h"

enum { TICK = CORE_HZ / PHD_SAMPLE_HZ, CLOCKS_A_US = CORE_HZ / 1000000, PATIENCE = 1000000 };

static volatile uint32_t ticks, turns; /* of the timer since power-up; of `ticks` */

void on_systick(void)
{
    if (++ticks == 0)
        turns++;
}

/* Wait until the bits of a register are set; a clock that never comes leaves the lights dark and the brakes off. */
static void until(volatile uint32_t *at, uint32_t bits)
{
    for (uint32_t n = 0; !EMULATED && (*at & bits) != bits; n++)
        while (n >= PATIENCE)
            brakes_off();
}

void clock_begin(void)
{
    RCC_APB1ENR |= BIT(28); /* power control */
    PWR_CR |= BIT(14) | BIT(15); /* for the highest clocks */
    RCC_CR |= BIT(18); /* a clock, and no crystal */
    RCC_CR |= BIT(16);
    until(&RCC_CR, BIT(17));
    RCC_PLLCFGR = 8 | 336 << 6 | 0 << 16 | BIT(22) | 7 << 24 | 2 << 28; /* / 8 * 336 / 2; / 7: 48 MHz */
    RCC_CR |= BIT(24);
    until(&RCC_CR, BIT(25));
    FLASH_ACR = 5 | BIT(8) | BIT(9) | BIT(10); /* wait states; prefetch, caches */
    RCC_CFGR = 5 << 10 | 4 << 13 | 2; /* APB1 / 4, APB2 / 2, from the PLL */
    until(&RCC_CFGR, 2 << 2);
    pins_begin();
    SYST_RVR = TICK - 1;
    SYST_CVR = 0;
    SYST_CSR = 7;
}

uint64_t clock_us(void)
{
    uint32_t before = masked();
    uint64_t whole = (uint64_t)turns << 32 | ticks;
    uint32_t left = SYST_CVR;
    if (SCB_ICSR & BIT(26)) { /* it has gone round, and was not counted yet */
        whole++;
        left = SYST_CVR;
    }
    unmasked(before);
    return whole * PHD_TICK_US + (TICK - 1 - left) / CLOCKS_A_US;
}

bool tick_is_due(void)
{
    static uint32_t done;
    if (done == ticks)
        return false;
    done++; /* none is left out, however late */
    return true;
}
