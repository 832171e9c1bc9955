"""Kernels of neurons: a population through a stretch of steps, and its adjoint.

`c` has a row for each constant (see the names below) and a column for each neuron, `push` what a constant current
adds to V in each step (one row where it is the same in all). `drive` is the input, (batch, steps, neurons).
`v`, `current` and `held` are the states between two stretches, (batch, neurons). What the adjoint needs is kept where
`keep` is 1: V before the reset and what became of it; else they have one step, which is written over.

A spike resets V, and through a reset flows no gradient: what V was before no longer matters.
"""

# mypy: ignore-errors
from functools import cache

from neuro.kernels.jit import compiled, inlined, kernel

E_L, P33, V_TH, V_RESET, REFRACTORY, V_MIN, P32, P11 = range(8)
"""Rows of `c`; `V_MIN` is of `iaf_psc_delta`, `P32` and `P11` of `iaf_psc_exp`."""
CONSTANTS = 8
FREE, LOW, HELD = range(3)
"""What became of V in a step: it moved, was held from below by V_min, or was refractory."""


@cache
def through_spikes(at):
    """The kernel of a surrogate, `Surrogate.at`: what the gradients of the spikes of a stretch are for V."""
    derivative = compiled(at, inlined)

    @kernel
    def through_spikes(first, last, c, potential, slope, grad_spikes, grad):
        for b in range(grad.shape[0]):
            for t in range(first, last):
                for i in range(grad.shape[2]):
                    # In units of the distance from reset to threshold: one slope of a surrogate then fits neurons of
                    # any scale.
                    width = c[V_TH, i] - c[V_RESET, i]
                    x = (potential[b, t, i] - c[V_TH, i]) / width
                    grad[b, t, i] = grad_spikes[b, t, i] * derivative(x, slope) / width

    return through_spikes


@kernel
def delta(drive, push, first, last, c, v, held, keep, potential, spikes, fate):
    """`iaf_psc_delta` in steps first <= t < last."""
    for b in range(drive.shape[0]):
        for t in range(first, last):
            at, row = t * keep, min(t, push.shape[0] - 1)
            for i in range(drive.shape[2]):
                left, old = held[b, i], v[b, i]
                new = c[E_L, i] + c[P33, i] * (old - c[E_L, i]) + push[row, i] + drive[b, t, i]
                low = new < c[V_MIN, i]
                new = c[V_MIN, i] if low else new
                # Selections, not branches: the loop over neurons is vectorised.
                new = old if left > 0 else new
                fires = new >= c[V_TH, i]
                potential[b, at, i] = new
                fate[b, at, i] = HELD if left > 0 else (LOW if low else FREE)
                spikes[b, t, i] = fires
                v[b, i] = c[V_RESET, i] if fires else new
                # V before the reset is what the adjoint and a probe of potentials need; V itself is kept after it.
                held[b, i] = c[REFRACTORY, i] if fires else left - (left > 0)


@kernel
def delta_adjoint(first, last, c, spikes, fate, grad_potential, carry, grad):
    """The adjoint of `delta`: from the gradient of V before the reset to that of the input.

    `grad` holds at first what `through_spikes` left there, `grad_potential` what else there is.
    `carry` is the gradient of V after the last step of the stretch, and then of V before its first.
    """
    # Of the array's type: a literal has 64 bits, and would widen a pass in 32.
    zero = c.dtype.type(0)
    for b in range(spikes.shape[0]):
        for t in range(last - 1, first - 1, -1):
            at = min(t, grad_potential.shape[1] - 1)
            for i in range(spikes.shape[2]):
                # A spike resets V, so what follows does not depend on V before it.
                here = carry[b, i] if spikes[b, t, i] == 0 else zero
                here += grad_potential[b, at, i] + grad[b, t, i]
                moved = here if fate[b, t, i] == FREE else zero
                grad[b, t, i] = moved
                carry[b, i] = c[P33, i] * moved if fate[b, t, i] != HELD else here


@kernel
def exp(drive, push, first, last, c, v, current, held, keep, potential, spikes, fate):
    """`iaf_psc_exp` with one time constant of its currents: V with the current before, then the input."""
    for b in range(drive.shape[0]):
        for t in range(first, last):
            at, row = t * keep, min(t, push.shape[0] - 1)
            for i in range(drive.shape[2]):
                left, old = held[b, i], v[b, i]
                new = c[E_L, i] + c[P33, i] * (old - c[E_L, i]) + c[P32, i] * current[b, i] + push[row, i]
                new = old if left > 0 else new
                current[b, i] = current[b, i] * c[P11, i] + drive[b, t, i]
                fires = new >= c[V_TH, i]
                potential[b, at, i] = new
                fate[b, at, i] = HELD if left > 0 else FREE
                spikes[b, t, i] = fires
                v[b, i] = c[V_RESET, i] if fires else new
                held[b, i] = c[REFRACTORY, i] if fires else left - (left > 0)


@kernel
def exp_adjoint(first, last, c, spikes, fate, grad_potential, carry, carry_current, grad):
    """The adjoint of `exp`; `carry_current` is that of the current, as `carry` is that of V."""
    zero = c.dtype.type(0)
    for b in range(spikes.shape[0]):
        for t in range(last - 1, first - 1, -1):
            at = min(t, grad_potential.shape[1] - 1)
            for i in range(spikes.shape[2]):
                here = carry[b, i] if spikes[b, t, i] == 0 else zero
                here += grad_potential[b, at, i] + grad[b, t, i]
                moved = here if fate[b, t, i] == FREE else zero
                # Input adds to the current after V has moved: its gradient is that of the current at the end of the
                # step.
                grad[b, t, i] = carry_current[b, i]
                carry_current[b, i] = c[P11, i] * carry_current[b, i] + c[P32, i] * moved
                carry[b, i] = c[P33, i] * moved if fate[b, t, i] == FREE else here
