/* Loihi's learning engine: traces of 7 bits, sums of products in 16 bits, and random rounding by keyed draws. @mark@ */
#ifndef NEURO_LEARNING_H
#define NEURO_LEARNING_H

#include "integers.h"

/* 1 if a random draw rounds the fraction rest / below up. */
static inline int32_t drawn_up(uint64_t base, uint32_t index, uint32_t rest, uint32_t below)
{
    return (draw(base, index) >> 32) * below >> 32 < rest;
}

/* A trace after a step, which leaves numerator / denominator of it. */
static inline uint8_t faded(uint8_t trace, uint32_t numerator, uint32_t denominator, uint64_t base, uint32_t index)
{
    uint32_t size = trace * numerator, rest = size % denominator;
    return (uint8_t)(size / denominator + (rest != 0 && drawn_up(base, index, rest, denominator)));
}

static inline uint8_t raised(uint8_t trace, uint32_t impulse)
{
    return (uint8_t)(trace + impulse < 127u ? trace + impulse : 127u);
}

static inline int32_t limited(int64_t x)
{
    return x > 32767 ? 32767 : x < -32768 ? -32768 : (int32_t)x;
}

/* Add a product, shifted towards 0, to a sum. */
static inline int32_t summed(int32_t sum, int64_t product, int shift)
{
    int64_t size = product < 0 ? -product : product;
    size = shift < 0 ? size >> -shift : size << shift;
    return limited(sum + limited(product < 0 ? -size : size));
}

/* Round a change in units of 1 / 128 to a multiple of 2^grain at random. */
static inline int32_t rounded(int32_t change, unsigned grain, uint64_t base, uint32_t index)
{
    int32_t whole = (int32_t)floor_shift(change, grain + 7u);
    uint32_t step = 128u << grain, rest = (uint32_t)change & (step - 1u);
    return (whole + (rest != 0 && drawn_up(base, index, rest, step))) * (1 << grain);
}

/* Round it away from 0 to an integer, then towards 0 to a multiple of 2^grain. */
static inline int32_t rounded_away(int32_t change, unsigned grain)
{
    int32_t size = ((change < 0 ? -change : change) + 127) >> 7 >> grain << grain;
    return change < 0 ? -size : size;
}

/* The word of a mantissa, which a spike adds. */
static inline int32_t word_of(int32_t mantissa, unsigned grain, int exponent)
{
    int32_t size = (mantissa < 0 ? -mantissa : mantissa) >> grain << grain, kept = mantissa < 0 ? -size : size;
    int32_t shifted = exponent < 0 ? (int32_t)floor_shift(kept, (unsigned)-exponent) : kept * (1 << exponent);
    return clipped(shifted, -32767, 32767);
}

#endif
