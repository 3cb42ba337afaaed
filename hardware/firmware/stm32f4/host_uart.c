/* The host's port by UART: USART2, on a Nucleo the ST-LINK's port, for which the host takes this rate: both clocks divide
 * to it exactly. A sample of 69 bytes takes 0.35 ms, a command of 28 bytes 0.14 ms. Behind another adapter: 921600. */
#include "board.h"
#include "registers.h"
#include "uart.h"

enum { BAUD = 2000000 };

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

void phd_send(const uint8_t *frame, size_t n)
{
    uart_send(&port, frame, n);
}

void host_poll(void)
{
    uart_serve(&port); /* in an emulator without its interrupt; on the board it does no harm */
}
