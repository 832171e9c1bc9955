/* @about@. @mark@. */
#ifndef @NAME@_H_INCLUDED
#define @NAME@_H_INCLUDED

#include <stdint.h>

/* Neurons are counted through all populations: each has a first neuron and a size. */
@neurons@
#define @NAME@_MOST_OUT @most@u /* events that a step may give */
#define @NAME@_STEP_NS @ns@u /* a step, in nanoseconds */
#define @NAME@_ID @id@ /* that of @name@.c */

#ifdef __cplusplus
extern "C" {
#endif

typedef @neuron@ @name@_neuron;

/* @event@. */
typedef struct {
    @name@_neuron neuron;
    @kind@ @field@;
} @name@_event;

/* Begin at step 0. Call it first. */
void @name@_init(void);

/* One step. Reads the spikes that inputs send in it, n events in any order, and writes those of outputs, in order of
 * neurons; returns their number. Events of neurons that are no input are passed over. */
uint32_t @name@_step(const @name@_event *events, uint32_t n, @name@_event *out);

/* The first state register of a neuron after the last step, its voltage where it has one; 0 of what has no state. */
int32_t @name@_voltage(uint32_t neuron);

@trial@@learning@#ifdef __cplusplus
}
#endif

#endif
