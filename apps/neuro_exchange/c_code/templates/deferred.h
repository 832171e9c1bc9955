/* SpiNNaker's plastic synapses: s4.11 and s16.15; each product is rounded down, and sums wrap. @mark@ */
#ifndef NEURO_DEFERRED_H
#define NEURO_DEFERRED_H

#include "integers.h"

/* The low 16 bits, signed. */
static inline int32_t half(int32_t x)
{
    return wrap16((uint16_t)x);
}

/* An s4.11 product. */
static inline int32_t fine(int32_t a, int32_t b)
{
    return (int32_t)floor_shift(half(a) * half(b), 11u);
}

/* An s16.15 product. */
static inline int32_t coarse(int64_t a, int64_t b)
{
    return wrap32(floor_shift(a * b, 15u));
}

/* The product of a number in s16.15 and a number in s4.11. */
static inline int32_t times_fine(int64_t a, int32_t b)
{
    return coarse(a, (int64_t)b * 16);
}

/* An integer of a signal that may be half-way between two levels; `upper` has the bits of those it rounds up to. */
typedef struct {
    int32_t value, halves;
    uint64_t upper;
} tie;

/* a / b for b > 0, rounded down. */
static inline int32_t floor_div(int32_t a, int32_t b)
{
    return a / b - (a % b < 0);
}

/* The share left after some ticks, from a table with an entry per 2^shift ticks; 0 beyond its end. */
static inline int32_t left(const uint16_t *table, uint32_t size, unsigned shift, uint32_t ticks)
{
    return ticks >> shift < size ? table[ticks >> shift] : 0;
}

#endif
