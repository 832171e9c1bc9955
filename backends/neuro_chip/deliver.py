"""Sending the spikes of a step to the ring buffers of their targets.

On a grid with many maps, the spikes of a step are first summed in a separate array, and the sums are then added to the
ring. In the ring the neurons at one place of different maps are far apart, so that a single spike would write them one
by one. In the array the sums of a place are neighbours: the sums are sorted by place, then by map, so that a spike adds
to all maps in one run. The words of the kernels are sorted in the same way. Within a line of a kernel, words are sorted
by the place to which a source sends them, so that a whole line is one run. Sums of words do not depend on the order, so
the bits equal those of spikes sent one by one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import kernel, subkernel
from neuro.program.program import Grid, Ints, Program, Projection
from neuro_chip import tables as t

# mypy: ignore-errors


FULL_SLOT = np.int32(65536)
"""Content of a saturated slot of SpiNNaker, whose largest value is 65535."""


@subkernel
def add(ring, place, below, word, times, capped):
    """Add a word to a slot; if slots saturate, add a negative word to the slot of the inhibitory receptor.

    `below` is the distance from a slot to the slot of the inhibitory receptor.
    """
    # numba widens products of 32 bits to 64, but the register wraps at 32.
    amount = np.int32(word * times)
    if not capped:
        ring[place] += amount
    # SpiNNaker has an unsigned slot for each receptor: the magnitude of a negative word goes to the second slot.
    elif amount >= 0:
        ring[place] = min(np.int32(ring[place] + amount), FULL_SLOT)
    else:
        ring[place + below] = min(np.int32(ring[place + below] - amount), FULL_SLOT)


@subkernel
def send(net, q, i, times, step):
    """Send a spike that source i emitted in `step` along a projection."""
    row = net.projections[q]
    target = net.pops[row[t.TARGET]]
    n = target[t.END] - target[t.BEGIN]
    mask = target[t.SLOTS] - 1  # the number of slots exceeds the longest lag, so no slot is written before it is read
    below = target[t.SLOTS] * n
    capped = target[t.RECEPTORS] == 2
    plane = row[t.PLANE]  # offset in the ring; `arrived` has no planes
    if row[t.LAYOUT] == t.DENSE:
        slot = (step + net.lags[row[t.LAG]]) & mask
        begin = target[t.RING] + plane + slot * n
        # A dense row reaches all targets: one flag replaces n marks.
        net.arrived_all[target[t.ARRIVED] + slot] = 1
        net.came[target[t.ARRIVED] + slot] = 1
        slots = net.ring[begin : begin + n]
        if row[t.WORD_STRIDE] == 0:  # one word for all synapses
            word = net.words[row[t.WORD]]
            for k in range(n):
                add(net.ring, begin + k, below, word, times, capped)
        elif not capped:
            words = net.words[row[t.WORD] + i * n : row[t.WORD] + (i + 1) * n]
            send_row(slots, words, times)
        else:
            words = net.words[row[t.WORD] + i * n : row[t.WORD] + (i + 1) * n]
            # One pass per sign: a loop without branches is vectorised.
            if row[t.POSITIVE]:
                send_capped(slots, words, np.int32(times))
            if row[t.NEGATIVE]:
                # With negative `times` excitatory words become negative, and are clipped to 0.
                send_capped(net.ring[begin + below : begin + below + n], words, np.int32(-times))
    elif row[t.LAYOUT] == t.CSR:
        first, last = net.rows[row[t.ROW] + i], net.rows[row[t.ROW] + i + 1]
        base = row[t.SYNAPSE]
        # The common case has a loop over slices without branches.
        if row[t.LAG_STRIDE] == 0 and not capped and times == 1 and row[t.WORD_STRIDE] == 1:
            slot = (step + net.lags[row[t.LAG]]) & mask
            begin = target[t.RING] + slot * n
            net.came[target[t.ARRIVED] + slot] = 1
            send_sparse(
                net.ring[begin + plane : begin + plane + n],
                net.arrived[begin : begin + n],
                net.targets[base + first : base + last],
                net.words[row[t.WORD] + first : row[t.WORD] + last],
            )
            return
        for e in range(first, last):
            lag = net.lags[row[t.LAG] + e * row[t.LAG_STRIDE]]
            slot = (step + lag) & mask
            place = target[t.RING] + slot * n + net.targets[base + e]
            slots = place + plane + (lag - row[t.FIRST_LAG]) * row[t.PLANE_STRIDE]
            add(net.ring, slots, below, net.words[row[t.WORD] + e * row[t.WORD_STRIDE]], times, capped)
            net.arrived[place] = 1
            net.came[target[t.ARRIVED] + slot] = 1
    elif row[t.LAYOUT] == t.ONE_TO_ONE:
        lag = net.lags[row[t.LAG] + i * row[t.LAG_STRIDE]]
        slot = (step + lag) & mask
        place = target[t.RING] + slot * n + i
        slots = place + plane + (lag - row[t.FIRST_LAG]) * row[t.PLANE_STRIDE]
        add(net.ring, slots, below, net.words[row[t.WORD] + i * row[t.WORD_STRIDE]], times, capped)
        net.arrived[place] = 1
        net.came[target[t.ARRIVED] + slot] = 1
    else:
        send_grid(net, row, target, i, times, step, below, capped)


@subkernel
def send_row(slots, words, times):
    """Add a row of words to neighbouring slots."""
    if times == 1:
        for k in range(slots.size):
            slots[k] = np.int32(slots[k] + np.int32(words[k]))
    else:
        for k in range(slots.size):
            slots[k] = np.int32(slots[k] + np.int32(words[k] * times))


@subkernel
def send_capped(slots, words, times):
    """Add the words of one sign to slots that saturate."""
    # A literal 0 has 64 bits, which would widen the loop and halve the words per vector.
    zero = np.int32(0)
    for k in range(slots.size):
        amount = max(np.int32(words[k] * times), zero)
        slots[k] = min(np.int32(slots[k] + amount), FULL_SLOT)


@subkernel
def send_sparse(slots, arrived, targets, words):
    """Add words to scattered slots."""
    for e in range(targets.size):
        place = np.uint32(targets[e])  # unsigned, so that numba does not check for indices from the end
        slots[place] = np.int32(slots[place] + np.int32(words[e]))
        arrived[place] = 1


@subkernel
def send_grid(net, row, target, i, times, step, below, capped):
    """Send a spike along a shared kernel: to every place of every map whose kernel covers the source."""
    sheet = row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH]
    channel, position = i // sheet, i % sheet
    first = channel // row[t.DEPTH] * row[t.REACH]  # the first map that the channel reaches
    y, x = position // row[t.CHANNEL_WIDTH] + row[t.TOP], position % row[t.CHANNEL_WIDTH] + row[t.LEFT]
    height, width, stride = row[t.KERNEL_HEIGHT], row[t.KERNEL_WIDTH], row[t.STRIDE]
    # First and last row and column of the places whose kernels cover (y, x), e.g. rows ceil((y - height + 1) / stride)
    # to floor(y / stride).
    r_first, r_last = max(0, -((height - 1 - y) // stride)), min(row[t.ROWS] - 1, y // stride)
    c_first, c_last = max(0, -((width - 1 - x) // stride)), min(row[t.COLUMNS] - 1, x // stride)
    n = target[t.END] - target[t.BEGIN]
    slot = (step + net.lags[row[t.LAG]]) & (target[t.SLOTS] - 1)
    net.came[target[t.ARRIVED] + slot] = 1
    for m in range(first, first + row[t.REACH]):
        kernel = row[t.WORD] + (m * row[t.DEPTH] + channel % row[t.DEPTH]) * height * width * row[t.WORD_STRIDE]
        for r in range(r_first, r_last + 1):
            line = kernel + (y - r * stride) * width * row[t.WORD_STRIDE]
            base = target[t.RING] + slot * n + (m * row[t.ROWS] + r) * row[t.COLUMNS]
            for c in range(c_first, c_last + 1):
                word = net.words[line + (x - c * stride) * row[t.WORD_STRIDE]]
                add(net.ring, base + row[t.PLANE] + c, below, word, times, capped)
                net.arrived[base + c] = 1


# mypy: disable-error-code="no-untyped-def,no-untyped-call"


FEWEST = 4
"""Smallest number of maps per channel for which summing first is faster."""


def lay_out(a: dict[str, NDArray[Any]], program: Program) -> None:
    """Add the arrays for the words of grids, sorted by place and map, and for the sums of a step."""
    # Several spikes of a step reach the same places of a grid. `gather` adds each spike to sums that are sorted by
    # place, then by map. `pour` adds each sum once to its slot; slots are sorted by map, then by place, like ids.
    kernels = places = marks = 0
    for row, part in zip(a["projections"], program.projections, strict=True):
        row[t.GATHER] = t.NONE
        if part.grid is not None and part.grid.reach >= FEWEST:
            sheet = part.grid.rows * part.grid.columns
            row[[t.KERNEL, t.GATHER, t.MARKS]] = kernels, places, marks
            kernels += part.size
            places += sheet * part.grid.maps
            marks += sheet * (part.grid.maps // part.grid.reach)
    a["kernels"] = np.zeros(kernels, dtype=a["words"].dtype)
    a["gathered"], a["marked"] = np.zeros(places, dtype=np.int32), np.zeros(marks, dtype=np.uint8)
    for q, part in enumerate(program.projections):
        copy_words(a, part, a["projections"][q])


def places(grid: Grid) -> Ints:
    """Return the index of each weight of a map among the sorted words that `gather` adds, (depth*height*width,)."""
    _, depth, height, width = grid.kernels
    # A source reaches neighbouring places by every stride-th column of the kernel, from right to left. Example: with
    # width 5 and stride 2 by columns 4, 2, 0 or 3, 1. The words are stored in this order.
    line = np.concatenate([np.arange(first, width, grid.stride)[::-1] for first in range(grid.stride)])
    positions: Ints = (np.arange(depth * height)[:, np.newaxis] * width + np.argsort(line)).ravel()
    return positions


def copy_words(a: dict[str, NDArray[Any]], part: Projection, row: Ints) -> None:
    """Copy the words of a projection to the arrays sorted by place and map, if the projection has such arrays."""
    if row[t.GATHER] >= 0:
        assert part.grid is not None
        shape, reach = part.size // part.grid.maps, part.grid.reach
        words = a["words"][row[t.WORD] : row[t.WORD] + (part.size if row[t.WORD_STRIDE] else 1)]
        sorted_words = a["kernels"][row[t.KERNEL] : row[t.KERNEL] + part.size].reshape(-1, shape, reach)
        sorted_words[:, places(part.grid)] = (
            words.reshape(-1, reach, shape).transpose(0, 2, 1) if row[t.WORD_STRIDE] else words[0]
        )


@kernel
def write_some(mantissas, synapses, table, lowest, words, kernels, row, where):
    """Write the words of some synapses of a projection, and copy them to the sorted arrays if the projection has any.

    Args:
        mantissas: mantissas of all its synapses.
        synapses: indices of the changed synapses.
        table: the word of each mantissa from `lowest` on.
        lowest: the smallest mantissa.
        words: output, words of all projections.
        kernels: output, words sorted by place and map.
        row: row of the projection; columns POSITIVE and NEGATIVE are set if there are such words.
        where: for a grid, the result of `places`.
    """
    reach, size = row[t.REACH], where.size
    first = end = dest = 0  # bounds of a map's weights, and their destination; neighbours are mostly in one map
    for k in range(synapses.size):
        s = synapses[k]
        word = table[mantissas[s] - lowest]
        words[row[t.WORD] + s] = word
        if word > 0:
            row[t.POSITIVE] = 1
        elif word < 0:
            row[t.NEGATIVE] = 1
        if row[t.GATHER] >= 0:
            # One division per map instead of one per synapse.
            if s < first or s >= end:
                m = s // size
                first, end, dest = m * size, (m + 1) * size, row[t.KERNEL] + m // reach * size * reach + m % reach
            kernels[dest + where[s - first] * reach] = word


@subkernel
def may_gather(net, row, capped):
    """Return whether the spikes of a projection are summed in separate arrays before the ring.

    Slots that saturate must not get both signs in one sum.
    """
    return row[t.LAYOUT] == t.GRID and row[t.GATHER] >= 0 and not (capped and row[t.POSITIVE] and row[t.NEGATIVE])


@subkernel
def covering(at, kernel, stride, places):
    """Return the first and the end of the places whose kernels cover position `at` of the source, along one axis."""
    return max(0, -((kernel - 1 - at) // stride)), min(places, at // stride + 1)


@subkernel
def place_in_line(x, width, stride):
    """Return the position of the words of column x within their line of a kernel, see `places`."""
    first = x % stride
    before = first * (width // stride) + min(first, width % stride)
    return before + (width - 1 - first) // stride - x // stride


@subkernel
def gather(net, row, begin, first, last):
    """Sum the emitted spikes first:last of a source whose neurons begin at `begin`, and mark the reached places.

    Returns:
        the box of all reached targets: first row and end, first column and end.
    """
    sheet, width, reach = row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH], row[t.CHANNEL_WIDTH], row[t.REACH]
    kernel_height, kernel_width, stride = row[t.KERNEL_HEIGHT], row[t.KERNEL_WIDTH], row[t.STRIDE]
    rows, columns = row[t.ROWS], row[t.COLUMNS]
    top, bottom, left, right = rows, 0, columns, 0
    for k in range(first, last):
        i = net.emitted[k] - begin
        channel, position = i // sheet, i % sheet
        y, x = position // width + row[t.TOP], position % width + row[t.LEFT]
        r_first, r_end = covering(y, kernel_height, stride, rows)
        c_first, c_end = covering(x, kernel_width, stride, columns)
        if r_first >= r_end or c_first >= c_end:
            continue
        top, bottom, left, right = min(top, r_first), max(bottom, r_end), min(left, c_first), max(right, c_end)
        base = channel // row[t.DEPTH] * rows * columns + c_first
        column, run = place_in_line(x - c_first * stride, kernel_width, stride), c_end - c_first
        for r in range(r_first, r_end):
            line = (channel * kernel_height + y - r * stride) * kernel_width + column
            word, place = row[t.KERNEL] + line * reach, base + r * columns
            spot = row[t.GATHER] + place * reach
            send_row(
                net.gathered[spot : spot + run * reach], net.kernels[word : word + run * reach], net.emitted_times[k]
            )
            mark = row[t.MARKS] + place
            net.marked[mark : mark + run] = 1
    return top, bottom, left, right


@subkernel
def pour_map(slots, sums, stride):
    """Add sums with a stride to neighbouring slots."""
    for p in range(slots.size):
        slots[p] = np.int32(slots[p] + sums[p * stride])


@subkernel
def pour_capped(slots, sums, stride, sign):
    """Add sums with a stride to neighbouring slots that saturate."""
    for p in range(slots.size):
        slots[p] = min(np.int32(slots[p] + np.int32(sums[p * stride] * sign)), FULL_SLOT)


@subkernel
def pour(net, row, target, box, step, below, capped):
    """Add the sums in a box to the slot in which they arrive, and clear them."""
    top, bottom, left, right = box
    rows, columns, reach = row[t.ROWS], row[t.COLUMNS], row[t.REACH]
    sheet = rows * columns
    slot = (step + net.lags[row[t.LAG]]) & (target[t.SLOTS] - 1)
    base = target[t.RING] + slot * sheet * row[t.MAPS]
    net.came[target[t.ARRIVED] + slot] = 1
    # If the box is at least half as wide as the grid, one long run is faster than many short runs. The long run
    # includes sums beside the box, which are 0.
    is_one_run = 2 * (right - left) >= columns
    spans = 1 if is_one_run else bottom - top
    run = right - left + (bottom - top - 1) * columns if is_one_run else right - left
    for span in range(spans):
        first = (top + span) * columns + left
        for group in range(row[t.MAPS] // reach):
            place = group * sheet + first
            sums = net.gathered[row[t.GATHER] + place * reach : row[t.GATHER] + (place + run) * reach]
            marks = net.marked[row[t.MARKS] + place : row[t.MARKS] + place + run]
            for m in range(reach):
                ring_at = base + (group * reach + m) * sheet + first
                if not capped:
                    pour_map(net.ring[ring_at + row[t.PLANE] : ring_at + row[t.PLANE] + run], sums[m:], reach)
                elif row[t.NEGATIVE]:
                    pour_capped(net.ring[ring_at + below : ring_at + below + run], sums[m:], reach, np.int32(-1))
                else:
                    pour_capped(net.ring[ring_at : ring_at + run], sums[m:], reach, np.int32(1))
                arrived = net.arrived[ring_at : ring_at + run]
                for p in range(run):
                    arrived[p] |= marks[p]
            # Cleared for the next step while they are in the cache.
            sums[:] = 0
            marks[:] = 0


@subkernel
def send_grids(net, row, begin, first, last, step):
    """Send the emitted spikes first:last of one source along a grid."""
    target = net.pops[row[t.TARGET]]
    capped = target[t.RECEPTORS] == 2
    below = target[t.SLOTS] * (target[t.END] - target[t.BEGIN])
    pour(net, row, target, gather(net, row, begin, first, last), step, below, capped)
