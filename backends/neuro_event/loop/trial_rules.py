"""Rules for trials, applied to the shared kernel or the synapses of one neuron.

The two passes are compiled for each rule by itself, ours and third-party ones alike: Python calls them between trials.
"""

# mypy: ignore-errors
import math
from functools import cache

import numpy as np

from neuro.core.clock import NEVER
from neuro.kernels.jit import compiled, kernel, subkernel
from neuro.model.synapses.base import steps_of
from neuro_event.loop import tables as t
from neuro_event.loop.tables import net_of


@kernel
def first_spikes(view, pop, start, end, first):
    """Fill `first` with the step of the first spike of each neuron of a population in the steps start + 1 to end."""
    net = net_of(view)
    mask = net.log_ids.shape[1] - 1
    # Backwards: the last write of a neuron is its first spike, and nothing is compared.
    for step in range(end, start, -1):
        slot = step & (net.log_ends.shape[1] - 1)
        for thread in range(net.edges.shape[1] - 1):
            for place in range(net.log_ends[thread, slot, pop], net.log_ends[thread, slot, pop + 1]):
                first[np.int64(net.log_ids[thread, place & mask]) - net.pops[pop, t.BEGIN]] = step


@subkernel
def since(first, delay, moment, h):
    """Time in ms from the arrival of an input's first spike to the moment of a lesson."""
    # An input that stayed silent came infinitely late, so a rule needs no second case for it.
    return -math.inf if first == NEVER else (moment - first - delay) * h


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
    """The pass over the inputs of one neuron, compiled for a rule's `teach`.

    It returns how many weights the neuron has. `first` holds the step of each input's first spike, `moment` the step
    of the lesson; `neuron` is the id of the neuron, `local` its internal place.
    """
    rule = compiled(teach)

    @kernel
    def learn(view, q, c, first, moment, neuron, local, lesson, h):
        net = net_of(view)
        n_source = first.shape[0]
        row = net.projections[q]
        # A pass takes microseconds and runs between trials, on one thread: it is written for all layouts at once, not
        # for speed.
        w = net.weights
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
                        came = since(first[source], delay, moment, h)
                        place = (channel * row[t.KERNEL_HEIGHT] + i) * row[t.KERNEL_WIDTH] + j
                        # The kernel is shared: one neuron's lesson changes it for all places of its map.
                        e = row[t.WEIGHT] + place * maps + at
                        w[e] = rule(w[e], came, lesson, c)
                        changed += 1
            return changed
        threads = net.edges.shape[1] - 1
        n_target = net.pops[row[t.TARGET], t.END] - net.pops[row[t.TARGET], t.BEGIN]
        for source in range(n_source):
            if row[t.LAYOUT] == t.DENSE:
                e = row[t.WEIGHT] + source * n_target + local
                w[e] = rule(w[e], since(first[source], delay, moment, h), lesson, c)
                changed += 1
            elif row[t.LAYOUT] == t.ONE_TO_ONE:
                if source == local:
                    e = row[t.WEIGHT] + source
                    w[e] = rule(w[e], since(first[source], delay, moment, h), lesson, c)
                    changed += 1
            else:
                # Rows are by source, so all are gone through: a list by target would cost 8 bytes a synapse for
                # something that happens once a trial.
                begin = row[t.ROW] + source * threads
                for s in range(net.rows[begin], net.rows[begin + threads]):
                    if net.targets[s] == local:
                        k = s - row[t.SYNAPSE]
                        own = np.int64(net.delays[row[t.DELAY] + k * row[t.DELAY_STRIDE]])
                        e = row[t.WEIGHT] + k
                        w[e] = rule(w[e], since(first[source], own, moment, h), lesson, c)
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
    def grow(view, q, c, chosen, per_map, outside):
        net = net_of(view)
        row = net.projections[q]
        w = net.weights
        changed = 0
        if row[t.LAYOUT] == t.GRID:
            maps = row[t.MAPS]
            for place in range(row[t.DEPTH] * row[t.KERNEL_HEIGHT] * row[t.KERNEL_WIDTH]):
                for m in range(maps):
                    if chosen[m]:
                        e = row[t.WEIGHT] + place * maps + m
                        w[e] = rule(w[e], c)
                        changed += 1
            return changed
        source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
        n_source, n_target = source[t.END] - source[t.BEGIN], target[t.END] - target[t.BEGIN]
        threads = net.edges.shape[1] - 1
        for s in range(n_source):
            if row[t.LAYOUT] == t.DENSE:
                for k in range(n_target):
                    # Ids are (map, row, column), so the map is the id divided by the neurons of a map.
                    if chosen[outside[k] // per_map]:
                        e = row[t.WEIGHT] + s * n_target + k
                        w[e] = rule(w[e], c)
                        changed += 1
            elif row[t.LAYOUT] == t.ONE_TO_ONE:
                if chosen[outside[s] // per_map]:
                    w[row[t.WEIGHT] + s] = rule(w[row[t.WEIGHT] + s], c)
                    changed += 1
            else:
                first = row[t.ROW] + s * threads
                for k in range(net.rows[first], net.rows[first + threads]):
                    if chosen[outside[net.targets[k]] // per_map]:
                        e = row[t.WEIGHT] + k - row[t.SYNAPSE]
                        w[e] = rule(w[e], c)
                        changed += 1
        return changed

    return grow


@cache
def delay_teacher(teach):
    """The pass over the inputs of one neuron for a rule that changes their delays, `late`."""
    rule, nearest = compiled(teach), compiled(steps_of)

    @kernel
    def learn(view, q, c, late, fewest, most, first, moment, local, lesson, h):
        net = net_of(view)
        row = net.projections[q]
        threads = net.edges.shape[1] - 1
        changed = 0
        for source in range(first.shape[0]):
            begin = row[t.ROW] + source * threads
            for e in range(net.rows[begin], net.rows[begin + threads]):
                if net.targets[e] == local:
                    k = e - row[t.SYNAPSE]
                    came = since(first[source], np.int64(net.delays[row[t.DELAY] + k]), moment, h)
                    late[k] = rule(late[k], came, lesson, c)
                    # A delay is kept in ms with its fraction: rounded each time, small lessons would add up to nothing.
                    net.delays[row[t.DELAY] + k] = nearest(late[k], h, fewest, most)
                    changed += 1
        return changed

    return learn
