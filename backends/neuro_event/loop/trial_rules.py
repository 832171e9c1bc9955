"""Rules for trials, applied to the shared kernel or the synapses of one neuron.

The two passes are compiled for each rule by itself, ours and third-party ones alike: Python calls them between trials.
"""

# mypy: ignore-errors
import math
from functools import cache

import numpy as np

from neuro.core.clock import NEVER
from neuro.kernels.jit import compiled, inlined, kernel, subkernel
from neuro.model.synapses.base import steps_of
from neuro_event.loop import tables as t
from neuro_event.loop.tables import net_of


@kernel
def spikes_of(view, pop, start, end, spikes, count):
    """Fill `spikes` with the steps of the spikes of each neuron of a population in the steps start + 1 to end.

    Row k has the k-th spike of each neuron; `count` becomes how many it has, though there be fewer rows.
    """
    net = net_of(view)
    mask = net.log_ids.shape[1] - 1
    for step in range(start + 1, end + 1):
        slot = step & (net.log_ends.shape[1] - 1)
        for thread in range(net.edges.shape[1] - 1):
            for place in range(net.log_ends[thread, slot, pop], net.log_ends[thread, slot, pop + 1]):
                neuron = np.int64(net.log_ids[thread, place & mask]) - net.pops[pop, t.BEGIN]
                before = count[neuron]
                count[neuron] += np.int64(net.log_counts[thread, place & mask])
                for k in range(before, min(count[neuron], spikes.shape[0])):
                    spikes[k, neuron] = step


nearest = compiled(steps_of)


@subkernel
def since(spike, delay, moment, h):
    """Time in ms from the arrival of an input's spike to the moment of a lesson."""
    # An input that stayed silent came infinitely late, so a rule needs no second case for it.
    return -math.inf if spike == NEVER else (moment - spike - delay) * h


@subkernel
def source_place(row, channel, y, x):
    """The internal place of a neuron in the source of a grid."""
    pixel = y * row[t.CHANNEL_WIDTH] + x
    inside = row[t.CHANNELS_INSIDE]
    sheet = row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH]
    # Grids have their maps innermost inside this backend, inputs keep the order of their ids.
    return pixel * inside + channel if inside > 0 else channel * sheet + pixel


@cache
def teacher(teach):
    """The pass over the inputs of one neuron, compiled for a rule's `teach`."""
    rule = compiled(teach)

    @inlined
    def act(value, spikes, source, delay, moment, lesson, c, h):
        """An input's value after each of its spikes has taught it; a silent input is taught once."""
        value = rule(value, since(spikes[0, source], delay, moment, h), lesson, c)
        for k in range(1, spikes.shape[0]):
            if spikes[k, source] != NEVER:
                value = rule(value, since(spikes[k, source], delay, moment, h), lesson, c)
        return value

    @kernel
    def learn(view, q, values, c, spikes, moment, neuron, local, lesson, h):
        """Change the value of each input of a neuron, e.g. its weight; return how many there are.

        `values` are laid out as the weights of the projection are. `spikes` holds the steps of each input's spikes that
        teach, a row for its first, its second, ..., `moment` the step of the lesson; `neuron` is the id of the neuron,
        `local` its internal place.
        """
        net = net_of(view)
        row = net.projections[q]
        # A pass takes microseconds and runs between trials, on one thread: it is written for all layouts at once, not
        # for speed.
        delay = np.int64(net.delays[row[t.DELAY]])
        changed = 0
        if row[t.LAYOUT] == t.GRID:
            columns, maps = row[t.COLUMNS], row[t.MAPS]
            at = neuron // (row[t.ROWS] * columns)
            r = neuron // columns % row[t.ROWS] * row[t.STRIDE] - row[t.TOP]
            s = neuron % columns * row[t.STRIDE] - row[t.LEFT]
            height, width = row[t.CHANNEL_HEIGHT], row[t.CHANNEL_WIDTH]
            first_channel = at // row[t.REACH]
            for channel in range(row[t.DEPTH]):
                for i in range(row[t.KERNEL_HEIGHT]):
                    for j in range(row[t.KERNEL_WIDTH]):
                        # Padding has no neuron: its weights are not taught by places at the border.
                        if not (0 <= r + i < height and 0 <= s + j < width):
                            continue
                        source = source_place(row, first_channel + channel, r + i, s + j)
                        place = (channel * row[t.KERNEL_HEIGHT] + i) * row[t.KERNEL_WIDTH] + j
                        # The kernel is shared: one neuron's lesson changes it for all places of its map.
                        e = place * maps + at
                        values[e] = act(values[e], spikes, source, delay, moment, lesson, c, h)
                        changed += 1
            return changed
        threads = net.edges.shape[1] - 1
        n_target = net.pops[row[t.TARGET], t.END] - net.pops[row[t.TARGET], t.BEGIN]
        for source in range(spikes.shape[1]):
            if row[t.LAYOUT] != t.CSR:
                if row[t.LAYOUT] == t.DENSE or source == local:
                    e = source * n_target + local if row[t.LAYOUT] == t.DENSE else source
                    values[e] = act(values[e], spikes, source, delay, moment, lesson, c, h)
                    changed += 1
                continue
            # Rows are by source, so all are gone through: a list by target would cost 8 bytes a synapse for something
            # that happens once a trial.
            begin = row[t.ROW] + source * threads
            for s in range(net.rows[begin], net.rows[begin + threads]):
                if net.targets[s] == local:
                    k = s - row[t.SYNAPSE]
                    own = np.int64(net.delays[row[t.DELAY] + k * row[t.DELAY_STRIDE]])
                    values[k] = act(values[k], spikes, source, own, moment, lesson, c, h)
                    changed += 1
        return changed

    return learn


def added(w, since, lesson, c):
    """Add a weight to the sum in `c`, and leave it."""
    # A `teach` that sums: `learn` then serves to read the summed weight of a neuron, with the places that it knows.
    c[0] += w
    return w


@cache
def grower(encourage):
    """The pass over every weight of the chosen maps, compiled for a rule's `encourage`; it returns how many."""
    rule = compiled(encourage)

    @kernel
    def grow(weights, map_of, chosen, c):
        changed = 0
        for e in range(weights.shape[0]):
            if chosen[map_of[e]]:
                weights[e] = rule(weights[e], c)
                changed += 1
        return changed

    return grow


@kernel
def round_inputs(view, q, late, local, fewest, most, h):
    """Round the delays in ms of the inputs of a neuron to steps.

    A delay is kept in ms with its fraction: rounded each time, small lessons would add up to nothing.
    """
    net = net_of(view)
    row = net.projections[q]
    for k in range(late.shape[0]):
        if net.targets[row[t.SYNAPSE] + k] == local:
            net.delays[row[t.DELAY] + k] = nearest(late[k], h, fewest, most)
