/* @about@. @mark@. */
#include "@name@.h"
#include "@chip@.h"
@learning@
#if @NAME@_ID != @id@
#error "@name@.h is of another network"
#endif

@memory@

static @name@_event *out_at;

#ifdef NEURO_DIGEST
static uint64_t sent;
#endif

static void emit(uint32_t neuron, uint32_t times, int out)
{
#ifdef NEURO_DIGEST
    sent += mix((uint64_t)neuron << 32 | times);
#endif
    if (out) {
        out_at->neuron = (@name@_neuron)neuron;
        out_at->@field@ = @value@;
        out_at++;
    }
}

@functions@
