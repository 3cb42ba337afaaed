/* Bytes that wait: one puts in, another takes out, and neither need wait for the other. */
#ifndef RING_H
#define RING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { RING_BYTES = 1024 };

typedef struct {
    volatile uint16_t head, tail; /* whoever puts in moves the head, whoever takes out the tail */
    uint8_t bytes[RING_BYTES];
} ring;

static inline size_t ring_waiting(const ring *of)
{
    return (size_t)(of->head + RING_BYTES - of->tail) % RING_BYTES;
}

static inline bool ring_put(ring *to, uint8_t byte)
{
    uint16_t next = (uint16_t)((to->head + 1u) % RING_BYTES);
    if (next == to->tail)
        return false;
    to->bytes[to->head] = byte;
    to->head = next;
    return true;
}

static inline bool ring_take(ring *from, uint8_t *byte)
{
    if (from->tail == from->head)
        return false;
    *byte = from->bytes[from->tail];
    from->tail = (uint16_t)((from->tail + 1u) % RING_BYTES);
    return true;
}

/* All bytes or none. */
static inline void ring_put_whole(ring *to, const uint8_t *bytes, size_t n)
{
    if (n < RING_BYTES - ring_waiting(to))
        for (size_t i = 0; i < n; i++)
            ring_put(to, bytes[i]);
}

static inline size_t ring_take_most(ring *from, uint8_t *bytes, size_t most)
{
    size_t n = 0;
    while (n < most && ring_take(from, &bytes[n]))
        n++;
    return n;
}

#endif
