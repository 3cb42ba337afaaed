/* The host's port by UART: USART2, on a Nucleo the ST-LINK's port. A sample of 69 bytes takes 0.75 ms, a command of 28
 * bytes 0.30 ms: a current comes two ticks after its sample. By USB it is one. */
#include "board.h"
#include "registers.h"
#include "uart.h"

enum { BAUD = 921600 };

static uart port;

void on_usart2(void)
{
    uart_serve(&port);
}

void host_begin(void)
{
    RCC_APB1ENR |= BIT(17);
    uart_begin(&port, USART2, APB1_HZ, BAUD);
    NVIC_ENABLE(IRQ_USART2);
}

size_t host_read(uint8_t *bytes, size_t most)
{
    return ring_take_most(&port.in, bytes, most);
}

void host_send(const uint8_t *frame, size_t n)
{
    uart_send(&port, frame, n);
}

void host_poll(void)
{
    uart_serve(&port); /* in an emulator without its interrupt; on the board it does no harm */
}
