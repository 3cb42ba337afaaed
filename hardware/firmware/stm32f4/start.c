/* From reset to main, and the table of interrupts. */
#include "board.h"
#include "registers.h"

extern uint32_t data_begin, data_end, data_image, bss_begin, bss_end, stack_top;
int main(void);

/* Nothing is left to trust: no current, until the hardware watchdog starts the board anew. */
static void fault(void)
{
    brakes_off();
    for (;;) {
    }
}

void reset(void)
{
    const uint32_t *from = &data_image;
    for (uint32_t *to = &data_begin; to < &data_end; to++)
        *to = *from++;
    for (uint32_t *to = &bss_begin; to < &bss_end; to++)
        *to = 0;
    main();
    fault();
}

#define OR_FAULT __attribute__((weak, alias("fault")))
void on_systick(void) OR_FAULT;
void on_adc(void) OR_FAULT;
void on_usart2(void) OR_FAULT;
void on_usart3(void) OR_FAULT;
void on_tim8(void) OR_FAULT;

typedef void (*handler)(void);
typedef struct {
    uint32_t *stack;
    handler exceptions[15], interrupts[IRQS];
} vector_table;

__attribute__((section(".vectors"), used)) const vector_table vectors = {
    &stack_top,
    {reset, fault, fault, fault, fault, fault, 0, 0, 0, 0, fault, fault, 0, fault, on_systick},
    {[IRQ_ADC] = on_adc, [IRQ_USART2] = on_usart2, [IRQ_USART3] = on_usart3, [IRQ_TIM8_UP] = on_tim8},
};
