#include "uart.h"
#include "registers.h"

enum { ORE = 1 << 3, RXNE = 1 << 5, TXE = 1 << 7 }; /* of the status */
enum { RE = 1 << 2, TE = 1 << 3, RXNEIE = 1 << 5, TXEIE = 1 << 7, UE = 1 << 13 };

void uart_begin(uart *port, uint32_t at, uint32_t clock_hz, uint32_t baud)
{
    port->at = at;
    USART_BRR(at) = (clock_hz + baud / 2) / baud; /* sixteenths of a clock division, oversampled by 16 */
    USART_CR1(at) = UE | RXNEIE | TE | RE;
}

void uart_serve(uart *port)
{
    uint32_t before = masked();
    uint32_t status = USART_SR(port->at);
    uint8_t byte;
    if (status & (RXNE | ORE)) /* reading the byte clears both; one that finds no room is lost */
        ring_put(&port->in, (uint8_t)USART_DR(port->at));
    if (status & TXE) {
        if (ring_take(&port->out, &byte))
            USART_DR(port->at) = byte;
        else
            USART_CR1(port->at) &= ~(uint32_t)TXEIE;
    }
    unmasked(before);
}

void uart_send(uart *port, const uint8_t *bytes, size_t n)
{
    ring_put_whole(&port->out, bytes, n);
    uint32_t before = masked();
    USART_CR1(port->at) |= TXEIE;
    unmasked(before);
}
