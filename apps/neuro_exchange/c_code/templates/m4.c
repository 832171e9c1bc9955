/* Start of the test on the board mps2-an386 of QEMU: the stack and the entry point. @mark@ */
#include <stdint.h>

extern void _start(void); /* of newlib, which calls main */

extern uint32_t stack_top;

static void stop(void)
{
    for (;;) {
    }
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    handler reset, others[14];
} vectors = {&stack_top, _start, {stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop, stop}};
