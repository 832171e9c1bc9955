#include <stdint.h>
#include <stdio.h>
#include "NAME.h"
int NAME_fuzz(void);
int NAME_fuzz(void)
{
    static NAME_event events[300], out[UPPER_MOST_OUT];
    uint64_t draw = 1;
    NAME_init();
    for (int step = 0; step < 50; step++) {
        uint32_t n = (uint32_t)step * 6u;
        for (uint32_t k = 0; k < n; k++) {
            draw = draw * UINT64_C(6364136223846793005) + 1442695040888963407u;
            events[k].neuron = (uint16_t)(draw >> (draw % 3 == 0 ? 33 : 61));
            events[k].FIELD = (uint16_t)(draw >> 45);
        }
        if (NAME_step(n == 0 ? NULL : events, n, out) > UPPER_MOST_OUT) return 1;
    }
    return 0;
}
