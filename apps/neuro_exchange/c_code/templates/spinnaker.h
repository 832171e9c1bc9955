/* The integers of SpiNNaker 1: s16.15, products rounded down, decays of 32 bits, saturating slots of 16 bits. @mark@ */
#ifndef NEURO_SPINNAKER_H
#define NEURO_SPINNAKER_H

#include "integers.h"

/* Spikes that a neuron sends if it has several in a step: all. */
static inline uint32_t spikes(uint32_t times)
{
    return times;
}

/* Add a positive word to the slot of the excitatory receptor, and the size of a negative word to that of the inhibitory
 * receptor, `below` places further. */
static inline void add(uint16_t *slot, uint32_t below, int32_t word, uint32_t times)
{
    uint16_t *into = word < 0 ? slot + below : slot;
    uint32_t sum = *into + (uint32_t)(word < 0 ? -word : word) * times;
    *into = (uint16_t)(sum < 65535u ? sum : 65535u);
}

/* An s16.15 product, not yet wrapped to 32 bits. */
static inline int64_t product(int32_t a, int64_t b)
{
    return floor_shift(a * b, 15);
}

/* A current after a step: its rest plus the input. Each term is rounded down. */
static inline int32_t next_g(int32_t g, int64_t decay, uint16_t slot, unsigned shift, int64_t init)
{
    int64_t arrived = (int64_t)slot << shift;
    return wrap32(floor_shift(g * decay, 32) + floor_shift(arrived * init, 32));
}

/* The voltage of neurons with exponential synapses. */
static inline int32_t next_v(int32_t v, int64_t drive, int32_t r_m, int32_t v_rest, int32_t keep)
{
    int32_t alpha = wrap32(product(wrap32(drive), r_m) + v_rest);
    return wrap32(alpha - product(keep, wrap32((int64_t)alpha - v)));
}

/* The voltage of neurons with delta synapses. */
static inline int32_t next_v_delta(int32_t v, int64_t input, int32_t bias, int32_t v_rest, int32_t keep, int32_t lowest)
{
    int32_t now = wrap32(v_rest + product(wrap32((int64_t)v - v_rest), keep) + bias + input);
    return now < lowest ? lowest : now;
}

#endif
