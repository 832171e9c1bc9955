/* A run that the emulator recorded: events of inputs and outputs, what sets signals, and digests. @mark@ */
#include "@name@.h"

#if @NAME@_ID != @id@
#error "@name@.h is of another network"
#endif

#define STEPS @steps@u

/* Events of step k, from 0, are number in_ends[k] to in_ends[k + 1] - 1; reward(k) sets signals before that step. */
@data@
