"""Kernels of a scan: neurons through a stretch of steps, delivery of spikes to the input, and the adjoints of both.

**Neurons.** `c` has a row for each constant (see the names below) and a column for each neuron. `push` is the potential
that external currents add in each step, with one row if it is constant. `drive` is the input, (batch, steps, neurons).
`v`, `current` and `refractory` (remaining steps) are the states between two stretches, (batch, neurons). If `keep` is
1, the arrays for the adjoint, V before the reset and `fate`, have all steps; else they have one step that is
overwritten. No gradient flows through a reset: the V before it no longer matters.

**Spikes** of a batch are packed: the spikes of a row are `ends[row] : ends[row + 1]` in `ids` and `values`. A row is
one step of one recording. The packed stretch has `width` steps per recording and begins at step `first`. Input and its
gradient have the shape (batch, steps, neurons). Rows are read by step, then neuron, so that sums have the order of the
reference.

Example: for 1 recording of 2 steps, neuron 4 fires in step 0, neurons 0 and 2 fire in step 1:
`ends` = [0, 1, 3], `ids` = [4, 0, 2], `values` = [1, 1, 1].
"""

# mypy: ignore-errors
from functools import cache

from neuro.kernels.jit import compiled, inlined, kernel

E_L, P33, V_TH, V_RESET, REFRACTORY, V_MIN, P32, P11 = range(8)
"""Rows of `c`. Only `iaf_psc_delta` has `V_MIN`; only `iaf_psc_exp` has `P32` and `P11`."""
CONSTANTS = 8
FREE, LOW, HELD = range(3)
"""Values of `fate`, for V in a step: integrated, clipped at V_min, or constant in the refractory period."""


@cache
def through_spikes(at):
    """Return the kernel that multiplies the gradients of the spikes of a stretch with a surrogate, `Surrogate.at`."""
    derivative = compiled(at, inlined)

    @kernel
    def through_spikes(first, last, c, potential, slope, grad_spikes, grad):
        for b in range(grad.shape[0]):
            for t in range(first, last):
                for i in range(grad.shape[2]):
                    # x is in units of the distance from reset to threshold, so one slope of a surrogate fits neurons
                    # of any scale.
                    width = c[V_TH, i] - c[V_RESET, i]
                    x = (potential[b, t, i] - c[V_TH, i]) / width
                    grad[b, t, i] = grad_spikes[b, t, i] * derivative(x, slope) / width

    return through_spikes


@kernel
def delta(drive, push, first, last, c, v, refractory, keep, potential, spikes, fate):
    """Run `iaf_psc_delta` in steps first <= t < last."""
    for b in range(drive.shape[0]):
        for t in range(first, last):
            at, row = t * keep, min(t, push.shape[0] - 1)
            for i in range(drive.shape[2]):
                remaining, old = refractory[b, i], v[b, i]
                new = c[E_L, i] + c[P33, i] * (old - c[E_L, i]) + push[row, i] + drive[b, t, i]
                low = new < c[V_MIN, i]
                new = c[V_MIN, i] if low else new
                # Selections, not branches: the loop over neurons is vectorised.
                new = old if remaining > 0 else new
                fires = new >= c[V_TH, i]
                potential[b, at, i] = new
                fate[b, at, i] = HELD if remaining > 0 else (LOW if low else FREE)
                spikes[b, t, i] = fires
                # `potential` has V before the reset, for the adjoint and for probes. `v` has V after the reset.
                v[b, i] = c[V_RESET, i] if fires else new
                refractory[b, i] = c[REFRACTORY, i] if fires else remaining - (remaining > 0)


@kernel
def delta_adjoint(first, last, c, spikes, fate, grad_potential, carry, grad):
    """Apply the adjoint of `delta`: from the gradient of V before the reset to the gradient of the input.

    On entry `grad` holds the gradient through the spikes, from `through_spikes`; `grad_potential` is added to it.
    `carry` is the gradient of V after the last step of the stretch, and on return the gradient before its first step.
    """
    # A literal 0.0 has 64 bits and would widen a pass in 32 bits.
    zero = c.dtype.type(0)
    for b in range(spikes.shape[0]):
        for t in range(last - 1, first - 1, -1):
            at = min(t, grad_potential.shape[1] - 1)
            for i in range(spikes.shape[2]):
                # A spike resets V, so later steps do not depend on V before the spike.
                upstream = carry[b, i] if spikes[b, t, i] == 0 else zero
                upstream += grad_potential[b, at, i] + grad[b, t, i]
                integrated = upstream if fate[b, t, i] == FREE else zero
                grad[b, t, i] = integrated
                carry[b, i] = c[P33, i] * integrated if fate[b, t, i] != HELD else upstream


@kernel
def exp(drive, push, first, last, c, v, current, refractory, keep, potential, spikes, fate):
    """Run `iaf_psc_exp` with one synaptic time constant: V integrates the old current, then the input is added."""
    for b in range(drive.shape[0]):
        for t in range(first, last):
            at, row = t * keep, min(t, push.shape[0] - 1)
            for i in range(drive.shape[2]):
                remaining, old = refractory[b, i], v[b, i]
                new = c[E_L, i] + c[P33, i] * (old - c[E_L, i]) + c[P32, i] * current[b, i] + push[row, i]
                new = old if remaining > 0 else new
                current[b, i] = current[b, i] * c[P11, i] + drive[b, t, i]
                fires = new >= c[V_TH, i]
                potential[b, at, i] = new
                fate[b, at, i] = HELD if remaining > 0 else FREE
                spikes[b, t, i] = fires
                v[b, i] = c[V_RESET, i] if fires else new
                refractory[b, i] = c[REFRACTORY, i] if fires else remaining - (remaining > 0)


@kernel
def exp_adjoint(first, last, c, spikes, fate, grad_potential, carry, carry_current, grad):
    """Apply the adjoint of `exp`; `carry_current` is the gradient of the current, as `carry` is the gradient of V."""
    zero = c.dtype.type(0)
    for b in range(spikes.shape[0]):
        for t in range(last - 1, first - 1, -1):
            at = min(t, grad_potential.shape[1] - 1)
            for i in range(spikes.shape[2]):
                upstream = carry[b, i] if spikes[b, t, i] == 0 else zero
                upstream += grad_potential[b, at, i] + grad[b, t, i]
                integrated = upstream if fate[b, t, i] == FREE else zero
                # Input adds to the current after V is integrated, so the gradient of the input is the gradient of the
                # current at the end of the step.
                grad[b, t, i] = carry_current[b, i]
                carry_current[b, i] = c[P11, i] * carry_current[b, i] + c[P32, i] * integrated
                carry[b, i] = c[P33, i] * integrated if fate[b, t, i] == FREE else upstream


@kernel
def pack(spikes, first, width, ends, ids, values):
    """List the nonzero spikes of a stretch; return their number."""
    count = 0
    for b in range(spikes.shape[0]):
        for t in range(width):
            ends[b * width + t] = count
            # The reference adds by step, then neuron. The same order makes sums of doubles bit-identical.
            for j in range(spikes.shape[2]):
                if spikes[b, first + t, j] != 0:
                    ids[count] = j
                    values[count] = spikes[b, first + t, j]
                    count += 1
    ends[spikes.shape[0] * width] = count
    return count


@kernel
def number(spikes):
    """Return the number of nonzero elements; NumPy needs four times as long."""
    count = 0
    for b in range(spikes.shape[0]):
        for t in range(spikes.shape[1]):
            for j in range(spikes.shape[2]):
                count += spikes[b, t, j] != 0
    return count


@kernel
def push_dense(ends, ids, values, first, width, weight, delay, drive):
    """Add the row of weights of each spike to the input of the step in which the spike arrives."""
    for b in range(drive.shape[0]):
        for t in range(width):
            # Spikes that arrive after the end of the recording have no effect.
            arrival = first + t + delay
            if arrival >= drive.shape[1]:
                continue
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                source, value = ids[place], values[place]
                for i in range(drive.shape[2]):
                    drive[b, arrival, i] += value * weight[source, i]


@kernel
def teach_dense(ends, ids, values, first, width, grad, delay, grad_weight):
    """Apply the adjoint of `push_dense` for the weights."""
    for b in range(grad.shape[0]):
        for t in range(width):
            arrival = first + t + delay
            if arrival >= grad.shape[1]:
                continue
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                source, value = ids[place], values[place]
                for i in range(grad.shape[2]):
                    # Only spikes contribute to the gradient of a weight, so the cost equals the forward pass.
                    grad_weight[source, i] += value * grad[b, arrival, i]


@kernel
def push_listed(ends, ids, values, first, width, row_ends, target, slot, delay, weight, drive):
    """Add the weight of each synapse that a spike reaches to the input; each listed synapse has its own delay."""
    for b in range(drive.shape[0]):
        for t in range(width):
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                for e in range(row_ends[ids[place]], row_ends[ids[place] + 1]):
                    arrival = first + t + delay[e]
                    if arrival < drive.shape[1]:
                        drive[b, arrival, target[e]] += values[place] * weight[slot[e]]


@kernel
def teach_listed(ends, ids, values, first, width, row_ends, target, slot, delay, grad, grad_weight):
    """Apply the adjoint of `push_listed` for the weights."""
    for b in range(grad.shape[0]):
        for t in range(width):
            for place in range(ends[b * width + t], ends[b * width + t + 1]):
                for e in range(row_ends[ids[place]], row_ends[ids[place] + 1]):
                    arrival = first + t + delay[e]
                    if arrival < grad.shape[1]:
                        grad_weight[slot[e]] += values[place] * grad[b, arrival, target[e]]


@kernel
def pull_listed(recordings, least, row_ends, target, slot, delay, weight, grad, grad_spikes):
    """Apply the adjoint of `push_listed` for the spikes.

    Steps without a spike have a gradient, too, because an additional spike would change the loss. Arrays have a row per
    neuron, of steps x recordings, so a delay is a shift along the row and the loop vectorises. `grad` begins at the
    first step that a spike with the delay `least` reaches.
    """
    for j in range(grad_spikes.shape[0]):
        for e in range(row_ends[j], row_ends[j + 1]):
            w, i, shift = weight[slot[e]], target[e], (delay[e] - least) * recordings
            # In a row steps are outer and recordings inner, so a delay is one shift for the whole batch.
            for place in range(min(grad_spikes.shape[1], grad.shape[1] - shift)):
                grad_spikes[j, place] += w * grad[i, shift + place]
