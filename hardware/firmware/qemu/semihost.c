/* What lets try_board.c run on an emulated Cortex-M with no board around it: stdin and stdout by semihosting. */
#include <stdint.h>
#include <stdlib.h>

extern uint32_t bss_begin, bss_end, stack_top;
extern void initialise_monitor_handles(void);
int main(void);
void _init(void);
void _fini(void);
void reset(void);

void _init(void)
{
}

void _fini(void)
{
}

void reset(void)
{
    for (uint32_t *to = &bss_begin; to < &bss_end; to++)
        *to = 0;
    initialise_monitor_handles();
    exit(main());
}

static void fault(void)
{
    abort();
}

typedef void (*handler)(void);
__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    handler exceptions[15];
} vectors = {&stack_top, {reset, fault, fault, fault, fault, fault}};
