/* Comparison with a recorded run of the emulator: every spike in every step, and a digest of all states. @mark@ */
#include "@name@_run.h"

#include <stdio.h>

uint64_t @name@_digest(uint64_t *spikes);

static @name@_event out[@NAME@_MOST_OUT + 1u];

#ifdef NEURO_COUNT
/* QEMU's clock advances by 1 ns per instruction (-icount shift=0). The board's SysTick timer counts it at 25 MHz. */
#define CONTROL (*(volatile uint32_t *)0xE000E010u)
#define RELOAD (*(volatile uint32_t *)0xE000E014u)
#define CURRENT (*(volatile uint32_t *)0xE000E018u)
#define INSTRUCTIONS 40u

/* Energy per instruction: 28 to 79 uA/MHz at 3.3 V (STM32L412, a Cortex-M4, ST DS12469: with SMPS, with LDO) are 92 to
 * 261 pJ per cycle. Assumed: 1 to 2 cycles per instruction, which QEMU does not count. */
#define LEAST_PJ 92u
#define MOST_PJ 521u

static uint64_t instructions, most_instructions;

static void start_clock(void)
{
    RELOAD = 0xFFFFFFu;
    CURRENT = 0;
    CONTROL = 5u;
}

static void count_instructions(void)
{
    uint64_t found = (uint64_t)((0xFFFFFFu - CURRENT) & 0xFFFFFFu) * INSTRUCTIONS;
    instructions += found;
    most_instructions = found > most_instructions ? found : most_instructions;
}
#else
static void start_clock(void)
{
}

static void count_instructions(void)
{
}
#endif

static int differs(uint32_t step, const char *what)
{
    printf("@name@: step %lu: %s differ\n", (unsigned long)step + 1ul, what);
    return 1;
}

int @name@_test(void);

int @name@_test(void)
{
    unsigned long sent = 0;
    @name@_init();
    for (uint32_t step = 0; step < STEPS; step++) {
        uint64_t spikes, states;
        uint32_t first = in_ends[step], n, at = out_ends[step];
        reward(step);
        start_clock();
        n = @name@_step(in_events + first, in_ends[step + 1u] - first, out);
        count_instructions();
        if (n != out_ends[step + 1u] - at) return differs(step, "numbers of output spikes");
        for (uint32_t k = 0; k < n; k++) {
            if (out[k].neuron != out_events[at + k].neuron || out[k].@field@ != out_events[at + k].@field@) {
                return differs(step, "output spikes");
            }
        }
        states = @name@_digest(&spikes);
        if (spikes != spike_digests[step]) return differs(step, "spikes");
        if (states != state_digests[step]) return differs(step, "states");
        sent += n;
    }
    printf("@name@: %lu steps equal, %lu output spikes\n", (unsigned long)STEPS, sent);
#ifdef NEURO_COUNT
    printf("@name@: %lu instructions per step, %lu at most\n", (unsigned long)(instructions / STEPS),
           (unsigned long)most_instructions);
    printf("@name@: estimate: %lu to %lu nJ per step, with %u to %u pJ per instruction\n",
           (unsigned long)(instructions / STEPS * LEAST_PJ / 1000u), (unsigned long)(instructions / STEPS * MOST_PJ / 1000u),
           LEAST_PJ, MOST_PJ);
#endif
    return 0;
}

#ifndef NEURO_NO_MAIN
int main(void)
{
    return @name@_test();
}
#endif
