/* @about@. @mark@. */
#ifndef @NAME@_H_INCLUDED
#define @NAME@_H_INCLUDED

#include <stdint.h>

/* Neurons are numbered across all populations. A population has a first neuron and a size. */
@neurons@
#define @NAME@_MOST_OUT @most@u /* largest number of output events of a step */
#define @NAME@_STEP_NS @ns@u /* length of a step in nanoseconds */
#define @NAME@_ID @id@ /* checksum, equal in @name@.c */

#ifdef __cplusplus
extern "C" {
#endif

typedef @neuron@ @name@_neuron;

/* @event@. */
typedef struct {
    @name@_neuron neuron;
    @kind@ @field@;
} @name@_event;

/* Begin at step 0. Call this function first. */
void @name@_init(void);

/* Run one step. Reads n events of inputs in any order, writes the events of outputs in the order of neurons, and returns
 * the number of output events. Events of neurons that are not inputs are ignored. */
uint32_t @name@_step(const @name@_event *events, uint32_t n, @name@_event *out);

/* Return the voltage of a neuron after the last step, or its first state without a voltage, or 0 without a state. */
int32_t @name@_voltage(uint32_t neuron);

@trial@@learning@#ifdef __cplusplus
}
#endif

#endif
