/* A serial port with a ring for each direction. */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { UART_RING = 1024 }; /* bytes, a power of 2 */

typedef struct {
    volatile uint16_t head, tail; /* written by whoever puts in; by whoever takes out */
    uint8_t bytes[UART_RING];
} uart_ring;

typedef struct {
    uint32_t at;           /* its registers */
    uart_ring in, out;
    volatile uint32_t lost; /* bytes that came and found no room */
} uart;

void uart_begin(uart *port, uint32_t at, uint32_t clock_hz, uint32_t baud);
size_t uart_read(uart *port, uint8_t *bytes, size_t most);
void uart_send(uart *port, const uint8_t *bytes, size_t n); /* all or nothing */
void uart_serve(uart *port); /* from its interrupt, and at any other time */

#endif
