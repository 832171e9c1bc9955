"""Kernels of what travels: spikes to the input that they become, and the adjoints of that.

Spikes of a batch are packed: `ends[row] : ends[row + 1]` are those of a row, with `ids` and `values`; a row is one
step of one recording, of a stretch of `width` steps from step `first` on. Input and its gradient have the shape
(batch, steps, neurons). Rows are gone through by step, then neuron, so sums have the order of the reference.
"""

# mypy: ignore-errors
from neuro.kernels.jit import kernel


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
