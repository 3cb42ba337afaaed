/* Quadrature encoders at timers that count all four edges; a receiver of differential signals tells of broken wires. */
#include "board.h"
#include "pins.h"
#include "registers.h"

typedef struct {
    uint32_t timer;
    uint8_t clock; /* its bit */
    enum pin wire;
} encoder;

/* In the order A, E, B, C. */
static const encoder encoders[PHD_JOINTS] = {
    {TIM2, 0, PIN_WIRE_A}, {TIM3, 1, PIN_WIRE_E}, {TIM5, 3, PIN_WIRE_B}, {TIM4, 2, PIN_WIRE_C},
};
static uint32_t counted[PHD_JOINTS];

void encoders_begin(void)
{
    for (unsigned i = 0; i < PHD_JOINTS; i++) {
        uint32_t timer = encoders[i].timer;
        RCC_APB1ENR |= BIT(encoders[i].clock);
        TIM_CCMR1(timer) = 1 | 3 << 4 | 1 << 8 | 3 << 12; /* both inputs, each filtered over eight clocks */
        TIM_SMCR(timer) = 3;                              /* both edges of both */
        TIM_ARR(timer) = UINT32_C(0xFFFFFFFF);            /* of which TIM3 and TIM4 have 16 bits */
        TIM_CR1(timer) = 1;
    }
}

void encoders_read(phd_readings *readings)
{
    for (unsigned i = 0; i < PHD_JOINTS; i++) {
        uint32_t timer = encoders[i].timer;
        uint32_t now = TIM_CNT(timer);
        if (timer == TIM3 || timer == TIM4) /* at most 32,767 counts in a tick */
            now = counted[i] + (uint32_t)(int32_t)(int16_t)(uint16_t)(now - counted[i]);
        counted[i] = now;
        readings->counts[i] = (int32_t)now;
        readings->encoder_good[i] = !pin_is_high(encoders[i].wire);
    }
}
