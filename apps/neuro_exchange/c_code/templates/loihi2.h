/* The integers of Loihi 2: input, sums and states of 32 bits, which wrap; u of 24 bits; v, which is clipped. @mark@ */
#ifndef NEURO_LOIHI2_H
#define NEURO_LOIHI2_H

#include "integers.h"

#define V_LIMIT 0x7FFFFF

/* Spikes that a neuron sends if it has several in a step: all. */
static inline uint32_t spikes(uint32_t times)
{
    return times;
}

static inline int32_t plus(int32_t a, int32_t b)
{
    return wrap32((int64_t)a + b);
}

static inline int32_t minus(int32_t a, int32_t b)
{
    return wrap32((int64_t)a - b);
}

/* x * 2^n. */
static inline int32_t scaled(uint32_t x, unsigned n)
{
    return wrap32((int64_t)(x << n));
}

/* Add the word of a synapse times the payload, which has the bits of a signed number. */
static inline void add(uint32_t *slot, int32_t word, uint32_t payload)
{
    *slot += (uint32_t)word * payload;
}

/* Shift the sums of a step down, add them to the slots, and clear the sums. */
static inline void pour(uint32_t *into, uint32_t *sums, uint32_t n, int wraps, unsigned shift)
{
    for (uint32_t i = 0; i < n; i++) {
        into[i] += (uint32_t)floor_shift(wraps ? wrap24(sums[i]) : wrap32(sums[i]), shift);
        sums[i] = 0;
    }
}

/* Wraps as in lava: 2^23 instead of -2^23. */
static inline int32_t next_u(int32_t u, int32_t keep, uint32_t input)
{
    int32_t now = wrap24((uint32_t)kept(u, keep) + (input << 6));
    return now < -V_LIMIT ? -now : now;
}

static inline int32_t next_v(int32_t v, int32_t keep, int32_t u, int32_t bias)
{
    return clipped(plus(plus(kept(v, keep), u), bias), -V_LIMIT, V_LIMIT);
}

/* The part of a value's change to y that is sent; the rest is the residue. With `sum`, the sum of all changes since the
 * last message is compared with the threshold instead of the change. */
static inline uint32_t encoded(int32_t *act, int32_t *residue, int32_t *sum, int32_t y, int32_t threshold, unsigned exponent)
{
    int32_t change = plus(minus(y, *act), *residue), seen = sum ? plus(*sum, change) : change;
    int32_t sent = (seen < 0 ? minus(0, seen) : seen) >= threshold ? change : 0;
    if (sum) *sum = sent == 0 ? seen : 0;
    *residue = minus(change, sent);
    *act = y;
    return (uint32_t)floor_shift(sent, exponent);
}

/* The input if it exceeds the threshold, else 0. */
static inline uint32_t passed(int32_t input, int32_t threshold, int negative)
{
    int32_t size = negative && input < 0 ? minus(0, input) : input;
    return size > threshold ? (uint32_t)input : 0u;
}

/* value * factor / 4096, rounded towards 0, for factors of either sign. */
static inline int32_t share(int32_t value, int32_t factor)
{
    return factor < 0 ? -kept(value, -factor) : kept(value, factor);
}

static inline int32_t limited(int64_t x)
{
    return x < -V_LIMIT ? -V_LIMIT : x > V_LIMIT ? V_LIMIT : (int32_t)x;
}

/* Rotate the state of a resonator, and add the input; sums are limited, not wrapped. */
static inline void turn(int32_t *real, int32_t *imag, int32_t cosine, int32_t sine, int32_t to_real, int32_t to_imag)
{
    int32_t x = minus(share(*real, cosine), share(*imag, sine)), y = plus(share(*real, sine), share(*imag, cosine));
    *real = limited((int64_t)x + to_real);
    *imag = limited((int64_t)y + to_imag);
}

#endif
