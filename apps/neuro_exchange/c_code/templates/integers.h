/* Two's complement integers in portable C99, without signed overflow and shifts of negative numbers, which C does not
 * define. Types of exact width are two's complement by the standard. Compilers turn each function into a few
 * instructions. @mark@ */
#ifndef NEURO_INTEGERS_H
#define NEURO_INTEGERS_H

#include <stdint.h>
#include <string.h>

/* x / 2^n, rounded down. */
static inline int64_t floor_shift(int64_t x, unsigned n)
{
    return x >= 0 ? x >> n : ~(~x >> n);
}

/* The low 32 bits, signed. */
static inline int32_t wrap32(int64_t x)
{
    uint32_t low = (uint32_t)x;
    return low <= 0x7FFFFFFFu ? (int32_t)low : (int32_t)(low - 0x80000000u) - 0x7FFFFFFF - 1;
}

/* The low 24 bits, signed. */
static inline int32_t wrap24(uint32_t x)
{
    return (int32_t)((x & 0xFFFFFFu) ^ 0x800000u) - 0x800000;
}

/* A register of 16 bits, signed. */
static inline int32_t wrap16(uint16_t x)
{
    return (int32_t)((uint32_t)x ^ 0x8000u) - 0x8000;
}

static inline int32_t clipped(int32_t x, int32_t low, int32_t high)
{
    return x < low ? low : x > high ? high : x;
}

/* Add several spikes to a slot that counts spikes; it saturates. */
static inline void count(uint16_t *slot, uint32_t times)
{
    uint32_t sum = *slot + times;
    *slot = (uint16_t)(sum < 65535u ? sum : 65535u);
}

/* The slot of a ring that is read `lag` < slots steps from now. */
static inline uint32_t later(uint32_t now, uint32_t lag, uint32_t slots)
{
    uint32_t at = now + lag;
    return at < slots ? at : at - slots;
}

/* value * share / 4096, rounded towards 0. */
static inline int32_t kept(int32_t value, int32_t share)
{
    int32_t size = value < 0 ? -value : value;
    int32_t result = (size >> 12) * share + (((size & 4095) * share) >> 12);
    return value < 0 ? -result : result;
}

/* The finaliser of SplitMix64 (Steele, Lea & Flood, OOPSLA 2014): for keyed random draws and digests of states. */
static inline uint64_t mix(uint64_t z)
{
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

/* The base of all draws of a part in a step. */
static inline uint64_t step_word(uint64_t key, uint64_t step)
{
    return mix(key + step * UINT64_C(0x9E3779B97F4A7C15));
}

/* The draw of a neuron or synapse, 64 bits. */
static inline uint64_t draw(uint64_t base, uint64_t index)
{
    return mix(base + index * UINT64_C(0xD1B54A32D192ED03));
}

/* Add number x, at position `place`, to a digest of a sequence of numbers. */
static inline void digest(uint64_t *sum, uint32_t *place, int32_t x)
{
    *sum += mix((uint64_t)*place << 32 | (uint32_t)x);
    *place += 1;
}

#endif
