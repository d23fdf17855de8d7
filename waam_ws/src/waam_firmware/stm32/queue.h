/* Bytes from one writer to one reader, of which either may be an interrupt. */
#ifndef WAAM_STM32_QUEUE_H
#define WAAM_STM32_QUEUE_H

#include <stdbool.h>
#include <stdint.h>

#include "counters.h"

typedef struct {
    uint8_t *bytes;
    uint32_t size;                  /* power of two */
    volatile uint32_t put, got;     /* bytes so far; they wrap */
} queue_t;

/* An empty queue in an array whose size is a power of two. */
#define QUEUE(array) {.bytes = (array), .size = sizeof(array), .put = COUNTER_START(500), .got = COUNTER_START(500)}

static inline uint32_t queue_used(const queue_t *q) { return q->put - q->got; }
static inline uint32_t queue_free(const queue_t *q) { return q->size - queue_used(q); }

static inline bool queue_put(queue_t *q, uint8_t byte)
{
    if (queue_free(q) == 0)
        return false;
    q->bytes[q->put & (q->size - 1)] = byte;
    __asm__ volatile("" ::: "memory");
    q->put++;
    return true;
}

static inline bool queue_get(queue_t *q, uint8_t *byte)
{
    if (queue_used(q) == 0)
        return false;
    *byte = q->bytes[q->got & (q->size - 1)];
    __asm__ volatile("" ::: "memory");
    q->got++;
    return true;
}

#endif
