"""Kernels of a scan: neurons through a stretch of steps, spikes to the input that they become, and their adjoints.

**Neurons.** `c` has a row for each constant (see the names below) and a column for each neuron, `push` what a constant
current adds to V in each step (one row where it is the same in all). `drive` is the input, (batch, steps, neurons).
`v`, `current` and `held` are the states between two stretches, (batch, neurons). What the adjoint needs is kept where
`keep` is 1: V before the reset and what became of it; else they have one step, which is written over. A spike resets V,
and through a reset flows no gradient: what V was before no longer matters.

**Spikes** of a batch are packed: `ends[row] : ends[row + 1]` are those of a row, with `ids` and `values`; a row is one
step of one recording, of a stretch of `width` steps from step `first` on. Input and its gradient have the shape
(batch, steps, neurons). Rows are gone through by step, then neuron, so sums have the order of the reference.
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


@kernel
def pack(spikes, first, width, ends, ids, values):
    """List the spikes of a stretch that are not 0; return how many there are."""
    found = 0
    for b in range(spikes.shape[0]):
        for t in range(width):
            ends[b * width + t] = found
            # By step, then neuron, as the reference adds: sums of doubles then agree to the last bit.
            for j in range(spikes.shape[2]):
                if spikes[b, first + t, j] != 0:
                    ids[found] = j
                    values[found] = spikes[b, first + t, j]
                    found += 1
    ends[spikes.shape[0] * width] = found
    return found


@kernel
def number(spikes):
    """How many are not 0; NumPy takes four times as long."""
    found = 0
    for b in range(spikes.shape[0]):
        for t in range(spikes.shape[1]):
            for j in range(spikes.shape[2]):
                found += spikes[b, t, j] != 0
    return found


@kernel
def push_dense(ends, ids, values, first, width, weight, delay, drive):
    """Add the row of weights of each spike to the input of the step in which it arrives."""
    for b in range(drive.shape[0]):
        for t in range(width):
            # What would arrive after the end of the recording acts on nothing.
            to = first + t + delay
            if to >= drive.shape[1]:
                continue
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                source, value = ids[place], values[place]
                for i in range(drive.shape[2]):
                    drive[b, to, i] += value * weight[source, i]


@kernel
def teach_dense(ends, ids, values, first, width, grad, delay, grad_weight):
    """The adjoint of `push_dense` for the weights."""
    for b in range(grad.shape[0]):
        for t in range(width):
            to = first + t + delay
            if to >= grad.shape[1]:
                continue
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                source, value = ids[place], values[place]
                for i in range(grad.shape[2]):
                    # Only spikes that happened move a weight, so the cost is that of the forward pass.
                    grad_weight[source, i] += value * grad[b, to, i]


@kernel
def push_listed(ends, ids, values, first, width, row_ends, target, slot, delay, weight, drive):
    """The same for synapses that are listed by source, each with its delay and the place of its weight."""
    for b in range(drive.shape[0]):
        for t in range(width):
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                for e in range(row_ends[ids[place]], row_ends[ids[place] + 1]):
                    to = first + t + delay[e]
                    if to < drive.shape[1]:
                        drive[b, to, target[e]] += values[place] * weight[slot[e]]


@kernel
def teach_listed(ends, ids, values, first, width, row_ends, target, slot, delay, grad, grad_weight):
    """The adjoint of `push_listed` for the weights."""
    for b in range(grad.shape[0]):
        for t in range(width):
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                for e in range(row_ends[ids[place]], row_ends[ids[place] + 1]):
                    to = first + t + delay[e]
                    if to < grad.shape[1]:
                        grad_weight[slot[e]] += values[place] * grad[b, to, target[e]]


@kernel
def pull_listed(recordings, least, row_ends, target, slot, delay, weight, grad, grad_spikes):
    """The adjoint of `push_listed` for the spikes, all of them: those that did not happen could have.

    Here neurons have rows, of steps x recordings: a delay is a shift, and a loop along a row does several at once.
    `grad` begins where the first spike arrives after the delay `least`.
    """
    for j in range(grad_spikes.shape[0]):
        for e in range(row_ends[j], row_ends[j + 1]):
            w, i, late = weight[slot[e]], target[e], (delay[e] - least) * recordings
            # Steps are the outer part of a row and recordings the inner one, so a delay is one shift for the whole
            # batch.
            for place in range(min(grad_spikes.shape[1], grad.shape[1] - late)):
                grad_spikes[j, place] += w * grad[i, late + place]
