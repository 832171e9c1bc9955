"""Passes of rules for trials: `teach` over the inputs of one neuron, and `encourage` over the weights of some maps.

Both passes are compiled for each rule, built-in or third-party. Python calls them between trials.
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
    """Write the steps of the spikes of each neuron of a population in the steps start + 1 to end into `spikes`.

    Row k has the k-th spike of each neuron. `count` receives the number of spikes, which may exceed the number of rows.
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
def time_since_arrival(spike, delay, moment, h):
    """Return the time in ms from the arrival of an input's spike to the lesson in step `moment`."""
    # The spike of a silent input counts as infinitely late, so rules need no special case.
    return -math.inf if spike == NEVER else (moment - spike - delay) * h


@subkernel
def source_place(row, channel, y, x):
    """Return the internal place of the neuron at (channel, y, x) in the source of a grid."""
    pixel = y * row[t.CHANNEL_WIDTH] + x
    inside = row[t.CHANNELS_INSIDE]
    sheet = row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH]
    # A source that is itself the target of a grid has its maps innermost. Other sources keep the order of ids.
    return pixel * inside + channel if inside > 0 else channel * sheet + pixel


@cache
def teacher(teach):
    """Compile the pass that applies the function `teach` of a rule to all inputs of a neuron."""
    rule = compiled(teach)

    @inlined
    def teach_input(value, spikes, source, delay, moment, lesson, c, h):
        """Return the value of an input after a lesson for each of its spikes. A silent input gets one lesson."""
        value = rule(value, time_since_arrival(spikes[0, source], delay, moment, h), lesson, c)
        for k in range(1, spikes.shape[0]):
            if spikes[k, source] != NEVER:
                value = rule(value, time_since_arrival(spikes[k, source], delay, moment, h), lesson, c)
        return value

    @kernel
    def learn(view, q, values, c, spikes, moment, neuron, local, lesson, h):
        """Change the value of each input of a neuron, e.g. its weight. Return the number of inputs.

        `values` are in the order of the projection's weights. `spikes` has the steps of each input's spikes: row 0 the
        first spikes, row 1 the second spikes, ... `moment` is the step of the lesson, `neuron` the id of the neuron,
        and `local` its internal place.
        """
        net = net_of(view)
        row = net.projections[q]
        # A pass takes microseconds and runs between trials on a single thread, so a simple function covers all layouts.
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
                        # The padding of a grid has no neurons, so its weights are not taught.
                        if not (0 <= r + i < height and 0 <= s + j < width):
                            continue
                        source = source_place(row, first_channel + channel, r + i, s + j)
                        place = (channel * row[t.KERNEL_HEIGHT] + i) * row[t.KERNEL_WIDTH] + j
                        # All places of a map share the kernel, so the lesson of a neuron changes all places.
                        e = place * maps + at
                        values[e] = teach_input(values[e], spikes, source, delay, moment, lesson, c, h)
                        changed += 1
            return changed
        threads = net.edges.shape[1] - 1
        n_target = net.pops[row[t.TARGET], t.END] - net.pops[row[t.TARGET], t.BEGIN]
        for source in range(spikes.shape[1]):
            if row[t.LAYOUT] != t.CSR:
                if row[t.LAYOUT] == t.DENSE or source == local:
                    e = source * n_target + local if row[t.LAYOUT] == t.DENSE else source
                    values[e] = teach_input(values[e], spikes, source, delay, moment, lesson, c, h)
                    changed += 1
                continue
            # The rows belong to sources, so all rows are searched for the neuron. A list by target would take 8 bytes
            # per synapse, for one use per trial.
            begin = row[t.ROW] + source * threads
            for s in range(net.rows[begin], net.rows[begin + threads]):
                if net.targets[s] == local:
                    k = s - row[t.SYNAPSE]
                    own_delay = np.int64(net.delays[row[t.DELAY] + k * row[t.DELAY_STRIDE]])
                    values[k] = teach_input(values[k], spikes, source, own_delay, moment, lesson, c, h)
                    changed += 1
        return changed

    return learn


def add_to_sum(w, since, lesson, c):
    """Add a weight to the sum in `c`, and return the weight unchanged."""
    # With this function as `teach`, `learn` computes the sum of the weights of a neuron for any layout.
    c[0] += w
    return w


@cache
def grower(encourage):
    """Compile the pass that applies the function `encourage` of a rule to every weight of the chosen maps.

    The pass returns the number of these weights.
    """
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
def round_inputs(view, q, delays, local, fewest, most, h):
    """Round the delays in ms of the inputs of a neuron to steps.

    The delays in ms are not changed. If they were rounded too, small lessons would have no effect.
    """
    net = net_of(view)
    row = net.projections[q]
    for k in range(delays.shape[0]):
        if net.targets[row[t.SYNAPSE] + k] == local:
            net.delays[row[t.DELAY] + k] = nearest(delays[k], h, fewest, most)
