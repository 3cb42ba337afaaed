#include "uart.h"
#include "registers.h"

enum { ORE = 1 << 3, RXNE = 1 << 5, TXE = 1 << 7 }; /* of the status */
enum { RE = 1 << 2, TE = 1 << 3, RXNEIE = 1 << 5, TXEIE = 1 << 7, UE = 1 << 13 };

static uint16_t after(uint16_t place)
{
    return (uint16_t)((place + 1u) % UART_RING);
}

static bool put(uart_ring *ring, uint8_t byte)
{
    uint16_t next = after(ring->head);
    if (next == ring->tail)
        return false;
    ring->bytes[ring->head] = byte;
    ring->head = next;
    return true;
}

static bool take(uart_ring *ring, uint8_t *byte)
{
    if (ring->tail == ring->head)
        return false;
    *byte = ring->bytes[ring->tail];
    ring->tail = after(ring->tail);
    return true;
}

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
    if (status & (RXNE | ORE)) { /* reading the byte clears both */
        if (!put(&port->in, (uint8_t)USART_DR(port->at)))
            port->lost++;
    }
    if (status & TXE) {
        uint8_t byte;
        if (take(&port->out, &byte))
            USART_DR(port->at) = byte;
        else
            USART_CR1(port->at) &= ~(uint32_t)TXEIE;
    }
    unmasked(before);
}

size_t uart_read(uart *port, uint8_t *bytes, size_t most)
{
    size_t n = 0;
    while (n < most && take(&port->in, &bytes[n]))
        n++;
    return n;
}

void uart_send(uart *port, const uint8_t *bytes, size_t n)
{
    size_t waiting = (size_t)(port->out.head + UART_RING - port->out.tail) % UART_RING;
    if (n >= UART_RING - waiting)
        return;
    for (size_t i = 0; i < n; i++)
        put(&port->out, bytes[i]);
    uint32_t before = masked();
    USART_CR1(port->at) |= TXEIE;
    unmasked(before);
}
