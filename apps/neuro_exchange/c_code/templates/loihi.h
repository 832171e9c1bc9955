/* The integers of Loihi 1: input of 22 bits in units of 64, wrapping u and clipped v of 24 bits. @mark@ */
#ifndef NEURO_LOIHI_H
#define NEURO_LOIHI_H

#include "integers.h"

#define V_LIMIT 0x7FFFFF

/* Spikes that a neuron sends if it has several in a step: one, since a spike is one bit. */
static inline uint32_t spikes(uint32_t times)
{
    return times != 0;
}

/* Add the word of a synapse to the input of a neuron in a step, 16 bits in units of 64. */
static inline void add(uint16_t *slot, int32_t word, uint32_t times)
{
    (void)times;
    *slot = (uint16_t)(*slot + (uint32_t)word);
}

static inline int32_t next_u(int32_t u, int32_t keep, uint16_t input)
{
    return wrap24((uint32_t)(kept(u, keep) + wrap16(input) * 64));
}

static inline int32_t next_v(int32_t v, int32_t keep, int32_t u, int32_t bias, int32_t lowest)
{
    int32_t clip = clipped(kept(v, keep) + wrap24((uint32_t)(u + bias)), -V_LIMIT, V_LIMIT);
    return clip < lowest ? lowest : clip;
}

#endif
