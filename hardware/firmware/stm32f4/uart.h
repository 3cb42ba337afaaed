/* A serial port with a ring for each direction. */
#ifndef UART_H
#define UART_H

#include "ring.h"

typedef struct {
    uint32_t at; /* its registers */
    ring in, out;
} uart;

void uart_begin(uart *port, uint32_t at, uint32_t clock_hz, uint32_t baud);
void uart_send(uart *port, const uint8_t *bytes, size_t n); /* all or nothing */
void uart_serve(uart *port); /* from its interrupt, and at any other time */

#endif
