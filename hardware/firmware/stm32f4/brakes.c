/* Brake currents: TIM8 switches four amplifiers at 20 kHz, ADC1 measures in the middle of the pulses, and a loop at
 * 10 kHz sets their width. */
#include "board.h"
#include "current_loop.h"
#include "pins.h"
#include "registers.h"

enum { FULL = APB2_TIMER_HZ / 20000 / 2, SENSE_mV_A = 2000, REFERENCE_mV = 3300, STEPS = 4096 };

static volatile uint16_t asked_mA[PHD_JOINTS];
static current_loop loops[PHD_JOINTS];
static int32_t sum_mA[PHD_JOINTS], measurements; /* since the last tick */

void brakes_off(void)
{
    RCC_AHB1ENR |= BIT(B); /* it may be called before anything was set up */
    pin_set(PIN_ENABLE, false);
    RCC_APB2ENR |= BIT(1);
    for (unsigned i = 0; i < PHD_JOINTS; i++) {
        asked_mA[i] = 0;
        TIM_CCR(TIM8, i) = 0;
    }
}

void brakes_begin(void)
{
    RCC_APB2ENR |= BIT(1) | BIT(8); /* TIM8, ADC1 */
    ADC_CCR = 1 << 16;              /* 84 MHz / 4 */
    ADC_SMPR1 = 2 | 2 << 3 | 2 << 6 | 2 << 9; /* 28 clocks for channels 10 to 13 */
    ADC_JSQR = 3 << 20 | 10 | 11 << 5 | 12 << 10 | 13 << 15;
    ADC_CR1 = BIT(8) | BIT(7); /* one after the other, then an interrupt */
    ADC_CR2 = BIT(0);
    TIM_CR1(TIM8) = 1 << 5;    /* up and down */
    TIM_ARR(TIM8) = FULL;
    TIM_RCR(TIM8) = 3;         /* every second period: LOOP_HZ */
    TIM_CCMR1(TIM8) = TIM_CCMR2(TIM8) = 6 << 4 | 6 << 12; /* pulses; a new width holds at once */
    TIM_CCER(TIM8) = BIT(0) | BIT(4) | BIT(8) | BIT(12);
    TIM_EGR(TIM8) = 1;
    TIM_SR(TIM8) = 0;
    TIM_DIER(TIM8) = 1;
    TIM_BDTR(TIM8) = BIT(15);
    NVIC_PRIORITY(IRQ_ADC, 1);
    NVIC_PRIORITY(IRQ_TIM8_UP, 1);
    NVIC_PRIORITY(IRQ_USART2, 2);
    SCB_SHPR3 = UINT32_C(3) << 28; /* SysTick */
    NVIC_ENABLE(IRQ_ADC);
    NVIC_ENABLE(IRQ_TIM8_UP);
    TIM_CR1(TIM8) |= 1;
}

void on_tim8(void)
{
    TIM_SR(TIM8) = 0;
    ADC_CR2 |= BIT(22); /* measure all four */
}

void on_adc(void)
{
    ADC_SR = 0;
    for (unsigned i = 0; i < PHD_JOINTS; i++) {
        int32_t mA = (int32_t)ADC_JDR(i) * REFERENCE_mV / STEPS * 1000 / SENSE_mV_A;
        sum_mA[i] += mA;
        TIM_CCR(TIM8, i) = (uint32_t)(current_loop_step(&loops[i], asked_mA[i], mA) * (FULL / 8) / (SUPPLY_mV / 8));
    }
    measurements++;
}

void brakes_read(phd_readings *readings)
{
    uint32_t before = masked();
    for (unsigned i = 0; i < PHD_JOINTS; i++) {
        readings->current_mA[i] = (int16_t)(measurements ? sum_mA[i] / measurements : 0);
        sum_mA[i] = 0;
    }
    measurements = 0;
    unmasked(before);
}

void phd_set_currents(const uint16_t current_mA[PHD_JOINTS])
{
    uint32_t before = masked(); /* the loop does not come between */
    for (unsigned i = 0; i < PHD_JOINTS; i++) {
        asked_mA[i] = current_mA[i];
        if (current_mA[i] == 0)
            TIM_CCR(TIM8, i) = 0;
    }
    unmasked(before);
}

void brakes_enable(bool may_flow)
{
    pin_set(PIN_ENABLE, may_flow);
}
