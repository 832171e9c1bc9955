"""Learning of the kernels of grids by `stdp` and `stdp_dopa`, step by step.

A weight of a kernel is the weight of many synapses, one at each place of a map. In a step, the changes of all these
synapses are computed from the weight at the beginning of the step. The weight changes by the sum of the changes, or
by the mean over the places with a change. The new weight is clipped once, and used from the next step on. Each
synapse has its own eligibility, because dopamine differs between targets. A spike is delivered with the old weight,
because delivery comes before learning in each step.

The time of a step grows with the number of sources and targets. With dopamine it also grows with the number of synapses
at the places that have any eligibility. Weights and eligibilities have the maps innermost, so the inner loops run over
neighbours.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import compiled, kernel, subkernel
from neuro.model.synapses import modulated, pairs
from neuro_event.loop import tables as t
from neuro_event.loop.tables import net_of, plastic_of
from neuro_event.loop.trial_rules import source_place

STDP, STDP_DOPA = range(2)
"""Values of the column SHARED_RULE."""

LEFT_C, LEFT_N, LOST_C, LOST_BOTH = range(modulated.DECAYS + 4, modulated.DECAYS + 8)
"""Constants of `stdp_dopa` for a single step."""

potentiation, depression, within = map(compiled, (pairs.potentiation, pairs.depression, pairs.within))


@subkernel
def add_change(plastic, table, entry, pair, amount, step):
    """Add `amount` to the change of a weight. If the weight changes by a mean, count the place once per step."""
    if amount == 0.0:
        return
    plastic.shared_change[table[t.SHARED_ENTRY] + entry] += amount
    if table[t.SHARED_MEAN] == 1:
        place = table[t.SHARED_PLACE] + pair
        if plastic.shared_last[place] != step:
            plastic.shared_last[place] = step
            plastic.shared_places[table[t.SHARED_ENTRY] + entry] += 1


@subkernel
def add_eligibility(plastic, table, c, position, pair, amount):
    """Add `amount` to the eligibility of a synapse, whose lower bound is c_min, and mark its place as live."""
    place = table[t.SHARED_PAIR] + pair
    plastic.shared_c[place] = max(plastic.shared_c[place] + amount, c[modulated.C_MIN])
    plastic.shared_live[table[t.SHARED_POSITION] + position] = 1


@subkernel
def add_dopamine(view, table, step):
    """Increase the dopamine n of the targets by the dopamine spikes that arrive in a step."""
    net, plastic = net_of(view), plastic_of(view)
    emitted = step - table[t.SHARED_LATER]
    if emitted < 1:
        return
    row, dopamine = net.projections[table[t.SHARED_PROJECTION]], table[t.SHARED_DOPAMINE]
    target = net.pops[row[t.TARGET]]
    n, first = target[t.END] - target[t.BEGIN], table[t.SHARED_TARGET]
    slot, mask, all_doses = emitted & (net.log_ends.shape[1] - 1), net.log_ids.shape[1] - 1, 0
    for place in range(net.log_ends[0, slot, dopamine], net.log_ends[0, slot, dopamine + 1]):
        m = net.log_counts[0, place & mask]
        all_doses += m
        if table[t.SHARED_ONE_TO_ONE] == 1:
            plastic.shared_dose[first + net.order[np.int64(net.log_ids[0, place & mask])]] += m
    if all_doses == 0:
        return
    tau_n = plastic.shared_rule[table[t.SHARED_NUMBER], modulated.TAU_N]
    for i in range(n):
        m = all_doses
        if table[t.SHARED_ONE_TO_ONE] == 1:
            place = first + net.order[target[t.BEGIN] + i]
            m = plastic.shared_dose[place]
            plastic.shared_dose[place] = 0.0
        plastic.shared_n[first + i] += m / tau_n


@subkernel
def integrate(view, table, c, step):
    """Integrate the effect of dopamine over the last step, for the synapses at all places with an eligibility."""
    net, plastic = net_of(view), plastic_of(view)
    row = net.projections[table[t.SHARED_PROJECTION]]
    maps, size = row[t.MAPS], row[t.DEPTH] * row[t.KERNEL_HEIGHT] * row[t.KERNEL_WIDTH] * row[t.MAPS]
    for position in range(row[t.ROWS] * row[t.COLUMNS]):
        target_at = table[t.SHARED_TARGET] + position * maps
        if plastic.shared_live[table[t.SHARED_POSITION] + position] == 1:
            first = table[t.SHARED_PAIR] + position * size
            eligibility = plastic.shared_c[first : first + size]
            for entry in range(size):
                if eligibility[entry] != 0.0:
                    n = plastic.shared_n[target_at + entry % maps]
                    gain = n * c[modulated.TAU] * c[LOST_BOTH] - c[modulated.B] * c[modulated.TAU_C] * c[LOST_C]
                    add_change(plastic, table, entry, position * size + entry, eligibility[entry] * gain, step)
                    eligibility[entry] *= c[LEFT_C]
        for m in range(maps):
            plastic.shared_n[target_at + m] *= c[LEFT_N]


@subkernel
def learn_from_post(view, table, c, target, m, step):
    """Apply m post spikes of a target (internal place) that arrive at its synapses."""
    net, plastic = net_of(view), plastic_of(view)
    row = net.projections[table[t.SHARED_PROJECTION]]
    maps, columns = row[t.MAPS], row[t.COLUMNS]
    position, own_map = target // maps, target % maps
    y, x = position // columns * row[t.STRIDE] - row[t.TOP], position % columns * row[t.STRIDE] - row[t.LEFT]
    size, first = row[t.DEPTH] * row[t.KERNEL_HEIGHT] * row[t.KERNEL_WIDTH] * maps, own_map // row[t.REACH]
    for channel in range(row[t.DEPTH]):
        for i in range(row[t.KERNEL_HEIGHT]):
            for j in range(row[t.KERNEL_WIDTH]):
                if not (0 <= y + i < row[t.CHANNEL_HEIGHT] and 0 <= x + j < row[t.CHANNEL_WIDTH]):
                    continue
                k_plus = plastic.shared_k_plus[
                    table[t.SHARED_SOURCE] + source_place(row, first + channel, y + i, x + j)
                ]
                if k_plus == 0.0:
                    continue
                entry = ((channel * row[t.KERNEL_HEIGHT] + i) * row[t.KERNEL_WIDTH] + j) * maps + own_map
                pair = position * size + entry
                if table[t.SHARED_RULE] == STDP_DOPA:
                    add_eligibility(plastic, table, c, position, pair, m * (c[modulated.A_PLUS] * k_plus))
                else:
                    w = net.weights[row[t.WEIGHT] + entry]
                    add_change(plastic, table, entry, pair, m * potentiation(w, k_plus, c), step)
    plastic.shared_heard[table[t.SHARED_TARGET] + target] += m


@subkernel
def learn_from_pre(view, table, c, source, m, step):
    """Apply m pre spikes of a source (internal place) to its synapses. Then increase the trace of the source."""
    net, plastic = net_of(view), plastic_of(view)
    row = net.projections[table[t.SHARED_PROJECTION]]
    width, sheet = row[t.CHANNEL_WIDTH], row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH]
    maps, columns, stride, inside = row[t.MAPS], row[t.COLUMNS], row[t.STRIDE], row[t.CHANNELS_INSIDE]
    size = row[t.DEPTH] * row[t.KERNEL_HEIGHT] * row[t.KERNEL_WIDTH] * maps
    channel, pixel = (source % inside, source // inside) if inside > 0 else (source // sheet, source % sheet)
    y, x = pixel // width + row[t.TOP], pixel % width + row[t.LEFT]
    first_map, channel = channel // row[t.DEPTH] * row[t.REACH], channel % row[t.DEPTH]
    for r in range(max(0, (y - row[t.KERNEL_HEIGHT]) // stride + 1), min(row[t.ROWS], y // stride + 1)):
        for s in range(max(0, (x - row[t.KERNEL_WIDTH]) // stride + 1), min(columns, x // stride + 1)):
            place = (channel * row[t.KERNEL_HEIGHT] + y - r * stride) * row[t.KERNEL_WIDTH] + x - s * stride
            position = r * columns + s
            for own_map in range(first_map, first_map + row[t.REACH]):
                k_minus = plastic.shared_k_minus[table[t.SHARED_TARGET] + position * maps + own_map]
                if k_minus == 0.0:
                    continue
                entry = place * maps + own_map
                pair = position * size + entry
                if table[t.SHARED_RULE] == STDP_DOPA:
                    add_eligibility(plastic, table, c, position, pair, -m * (c[modulated.A_MINUS] * k_minus))
                else:
                    w = net.weights[row[t.WEIGHT] + entry]
                    add_change(plastic, table, entry, pair, m * depression(w, k_minus, c), step)
    plastic.shared_k_plus[table[t.SHARED_SOURCE] + source] += m


@subkernel
def apply_changes(view, table, c):
    """Apply the changes of a step to the weights."""
    net, plastic = net_of(view), plastic_of(view)
    row = net.projections[table[t.SHARED_PROJECTION]]
    first = table[t.SHARED_ENTRY]
    for entry in range(row[t.DEPTH] * row[t.KERNEL_HEIGHT] * row[t.KERNEL_WIDTH] * row[t.MAPS]):
        amount, places = plastic.shared_change[first + entry], plastic.shared_places[first + entry]
        plastic.shared_change[first + entry], plastic.shared_places[first + entry] = 0.0, 0
        if amount == 0.0:
            continue
        if table[t.SHARED_MEAN] == 1:
            amount /= places
        w = net.weights[row[t.WEIGHT] + entry] + amount
        if table[t.SHARED_RULE] == STDP_DOPA:
            w = min(c[modulated.W_MAX], max(c[modulated.W_MIN], w))
        else:
            w = within(w, c[pairs.W_MAX])
        net.weights[row[t.WEIGHT] + entry] = w + 0.0  # turns -0.0 into 0.0, because an input of -0.0 counts as none


@kernel
def learn_kernels(view, step, done_arrivals, arrivals_only, h):
    """Apply all learning of grids in a step: first the spikes that arrive, then the spikes that are emitted.

    Networks in which the kernels of a grid learn have one thread.
    """
    net, plastic = net_of(view), plastic_of(view)
    slot, mask = step & (net.log_ends.shape[1] - 1), net.log_ids.shape[1] - 1
    for q in range(plastic.shared_table.shape[0]):
        table, c = plastic.shared_table[q], plastic.shared_rule[q]
        row = net.projections[table[t.SHARED_PROJECTION]]
        source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
        if step > done_arrivals:
            for i in range(source[t.END] - source[t.BEGIN]):
                plastic.shared_k_plus[table[t.SHARED_SOURCE] + i] *= plastic.shared_left_plus[q]
            for i in range(target[t.END] - target[t.BEGIN]):
                target_at = table[t.SHARED_TARGET] + i
                plastic.shared_k_minus[target_at] = (
                    plastic.shared_k_minus[target_at] + plastic.shared_heard[target_at]
                ) * plastic.shared_left_minus[target_at]
                plastic.shared_heard[target_at] = 0.0
            if table[t.SHARED_RULE] == STDP_DOPA:
                integrate(view, table, c, step)
                if table[t.SHARED_DOPAMINE] >= 0:
                    add_dopamine(view, table, step)
            emitted = step - np.int64(net.delays[row[t.DELAY]])
            if emitted >= 1:
                ends = net.log_ends[0, emitted & (net.log_ends.shape[1] - 1)]
                for place in range(ends[row[t.TARGET]], ends[row[t.TARGET] + 1]):
                    local = np.int64(net.log_ids[0, place & mask]) - target[t.BEGIN]
                    learn_from_post(view, table, c, local, np.float64(net.log_counts[0, place & mask]), step)
        if arrivals_only == 1:
            continue
        for place in range(net.log_ends[0, slot, row[t.SOURCE]], net.log_ends[0, slot, row[t.SOURCE] + 1]):
            local = np.int64(net.log_ids[0, place & mask]) - source[t.BEGIN]
            learn_from_pre(view, table, c, local, np.float64(net.log_counts[0, place & mask]), step)
        apply_changes(view, table, c)
