/* A recorded run of the emulator: events of inputs and outputs, values of signals, and digests. @mark@ */
#include "@name@.h"

#if @NAME@_ID != @id@
#error "@name@.h is of another network"
#endif

#define STEPS @steps@u

/* The events of step k, from 0, are in_ends[k] to in_ends[k + 1] - 1. reward(k) sets signals before that step. */
@data@
