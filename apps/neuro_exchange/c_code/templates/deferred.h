/* SpiNNaker's plastic synapses: s4.11 and s16.15, each product rounded down by itself, and sums that wrap. @mark@ */
#ifndef NEURO_DEFERRED_H
#define NEURO_DEFERRED_H

#include "integers.h"

/* The low 16 bits. */
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

/* A number in s16.15 times one in s4.11. */
static inline int32_t times_fine(int64_t a, int32_t b)
{
    return coarse(a, (int64_t)b * 16);
}

/* A number of a signal that may be as near to two levels, and where it takes the upper one. */
typedef struct {
    int32_t value, halves;
    uint64_t upper;
} tie;

/* a / b of b > 0, rounded down. */
static inline int32_t floor_div(int32_t a, int32_t b)
{
    return a / b - (a % b < 0);
}

/* What a table leaves after some ticks, which it has by blocks of 2^shift; nothing beyond its end. */
static inline int32_t left(const uint16_t *table, uint32_t size, unsigned shift, uint32_t ticks)
{
    return ticks >> shift < size ? table[ticks >> shift] : 0;
}

#endif
