#include "pins.h"
#include "registers.h"

typedef struct {
    uint8_t port, number, mode, function, pull;
} pin_wiring;

static const pin_wiring wiring[PIN_COUNT] = {
#define PIN(name, port, number, mode, function, pull, place, wired) {port, number, mode, function, pull},
    PINS(PIN)
#undef PIN
};

/* In a register of two bits a pin. */
static void set_pair(volatile uint32_t *at, uint8_t number, uint32_t value)
{
    *at = (*at & ~(UINT32_C(3) << (2 * number))) | value << (2 * number);
}

void pins_begin(void)
{
    RCC_AHB1ENR |= BIT(A) | BIT(B) | BIT(C) | BIT(D);
    for (unsigned i = 0; i < PIN_COUNT; i++) {
        const pin_wiring *pin = &wiring[i];
        volatile uint32_t *function = &GPIO_AFR(pin->port, pin->number >= 8);
        uint32_t shift = 4u * (pin->number % 8u);
        *function = (*function & ~(UINT32_C(15) << shift)) | (uint32_t)pin->function << shift;
        set_pair(&GPIO_PUPDR(pin->port), pin->number, pin->pull);
        set_pair(&GPIO_OSPEEDR(pin->port), pin->number, 2); /* fast */
        set_pair(&GPIO_MODER(pin->port), pin->number, pin->mode);
    }
}

void pin_set(enum pin pin, bool high)
{
    GPIO_BSRR(wiring[pin].port) = BIT(wiring[pin].number) << (high ? 0 : 16);
}

bool pin_is_high(enum pin pin)
{
    return GPIO_IDR(wiring[pin].port) >> wiring[pin].number & 1;
}
