"""Sending the spikes of a step into the ring buffers of their targets.

Over grids of many maps the spikes of a step are added up with the maps next to each other, then poured into the ring. A
kernel's words for one place lie in all maps far apart in the ring, so a spike by itself touches them one by one. With
the maps next to each other they are added many at a time: sums lie by place, then map, of the maps that one channel
reaches; words likewise, and in a line of a kernel in the order of the places that a source meets them at, so that all
places of a line are added in one run. Sums of words do not depend on their order, so the bits are those of spikes sent
one by one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import kernel, subkernel
from neuro.program.program import Grid, Ints, Program, Projection
from neuro_chip import tables as t

# mypy: ignore-errors


OVER = np.int32(65536)
"""What a SpiNNaker slot holds in place of more than 65535: enough to tell that it is saturated."""


@subkernel
def add(ring, place, below, word, times, capped):
    """Add a word to a slot, or to that of the inhibitory receptor."""
    # numba widens products of 32 bits to 64: cut back, since the register wraps at 32.
    amount = np.int32(word * times)
    if not capped:
        ring[place] += amount
    # SpiNNaker has a slot for each receptor, both unsigned: a negative word goes to the second as its size.
    elif amount >= 0:
        ring[place] = min(np.int32(ring[place] + amount), OVER)
    else:
        ring[place + below] = min(np.int32(ring[place + below] - amount), OVER)


@subkernel
def send(net, q, i, times, step):
    """Send a spike that source i emitted in `step` along a projection."""
    row = net.projections[q]
    target = net.pops[row[t.TARGET]]
    n = target[t.END] - target[t.BEGIN]
    mask = target[t.SLOTS] - 1  # slots are a power of two above the longest lag: none is written before it is read
    below = target[t.SLOTS] * n
    capped = target[t.RECEPTORS] == 2
    plane = row[t.PLANE]  # what arrives is marked for the population, not for the plane
    if row[t.LAYOUT] == t.DENSE:
        slot = (step + net.lags[row[t.LAG]]) & mask
        begin = target[t.RING] + plane + slot * n
        # A dense row reaches all: one flag in place of n marks.
        net.arrived_all[target[t.ARRIVED] + slot] = 1
        net.came[target[t.ARRIVED] + slot] = 1
        into = net.ring[begin : begin + n]
        if row[t.WORD_STRIDE] == 0:  # one word for all
            word = net.words[row[t.WORD]]
            for k in range(n):
                add(net.ring, begin + k, below, word, times, capped)
        elif not capped:
            words = net.words[row[t.WORD] + i * n : row[t.WORD] + (i + 1) * n]
            send_row(into, words, times)
        else:
            words = net.words[row[t.WORD] + i * n : row[t.WORD] + (i + 1) * n]
            # one pass for each sign that there is: a loop without branches runs many words at a time
            if row[t.POSITIVE]:
                send_capped(into, words, np.int32(times))
            if row[t.NEGATIVE]:
                # Times -1: words of the other sign become negative here and are cut to 0.
                send_capped(net.ring[begin + below : begin + below + n], words, np.int32(-times))
    elif row[t.LAYOUT] == t.CSR:
        first, last = net.rows[row[t.ROW] + i], net.rows[row[t.ROW] + i + 1]
        base = row[t.SYNAPSE]
        # the common case by itself: its loop takes slices and has nothing to decide for a synapse
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
            into = place + plane + (lag - row[t.FIRST_LAG]) * row[t.PLANE_STRIDE]
            add(net.ring, into, below, net.words[row[t.WORD] + e * row[t.WORD_STRIDE]], times, capped)
            net.arrived[place] = 1
            net.came[target[t.ARRIVED] + slot] = 1
    elif row[t.LAYOUT] == t.ONE_TO_ONE:
        lag = net.lags[row[t.LAG] + i * row[t.LAG_STRIDE]]
        slot = (step + lag) & mask
        place = target[t.RING] + slot * n + i
        into = place + plane + (lag - row[t.FIRST_LAG]) * row[t.PLANE_STRIDE]
        add(net.ring, into, below, net.words[row[t.WORD] + i * row[t.WORD_STRIDE]], times, capped)
        net.arrived[place] = 1
        net.came[target[t.ARRIVED] + slot] = 1
    else:
        send_grid(net, row, target, i, times, step, below, capped)


@subkernel
def send_row(into, words, times):
    """Add a row of words to neighbouring slots."""
    if times == 1:
        for k in range(into.size):
            into[k] = np.int32(into[k] + np.int32(words[k]))
    else:
        for k in range(into.size):
            into[k] = np.int32(into[k] + np.int32(words[k] * times))


@subkernel
def send_capped(into, words, times):
    """Add the words of one sign to slots that saturate."""
    # A literal 0 has 64 bits, which would widen the loop and halve the words that are done at a time.
    zero = np.int32(0)
    for k in range(into.size):
        amount = max(np.int32(words[k] * times), zero)
        into[k] = min(np.int32(into[k] + amount), OVER)


@subkernel
def send_sparse(into, arrived, targets, words):
    """Add words to scattered slots."""
    for e in range(targets.size):
        place = np.uint32(targets[e])  # unsigned: numba then looks for no index from the end
        into[place] = np.int32(into[place] + np.int32(words[e]))
        arrived[place] = 1


@subkernel
def send_grid(net, row, target, i, times, step, below, capped):
    """Add a shared kernel: every place of every map whose kernel covers the source."""
    sheet = row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH]
    channel, rest = i // sheet, i % sheet
    first = channel // row[t.DEPTH] * row[t.REACH]  # of the maps that the channel reaches
    y, x = rest // row[t.CHANNEL_WIDTH] + row[t.TOP], rest % row[t.CHANNEL_WIDTH] + row[t.LEFT]
    height, width, stride = row[t.KERNEL_HEIGHT], row[t.KERNEL_WIDTH], row[t.STRIDE]
    # the first and the last place whose kernel covers the line: ceil((y - height + 1) / stride) and y / stride
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
"""Maps that a channel reaches from which this is worth while."""


def lay_out(a: dict[str, NDArray[Any]], program: Program) -> None:
    """Room for the words of grids with the maps innermost, and for the sums of a step."""
    # Several spikes of a step reach the same places of a grid. Added up first, with the maps innermost, they cost a run
    # of neighbours each; then the sums go once into the slots, which lie by map as ids do.
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
        turn(a, part, a["projections"][q])


def places(grid: Grid) -> Ints:
    """Where the weights of one map lie among the words that `gather` adds: shape (depth x height x width,)."""
    _, depth, height, width = grid.kernels
    # A source covers neighbouring places with every stride-th column of the kernel, from the right to the left. In this
    # order these columns are neighbours, too.
    line = np.concatenate([np.arange(first, width, grid.stride)[::-1] for first in range(grid.stride)])
    found: Ints = (np.arange(depth * height)[:, np.newaxis] * width + np.argsort(line)).ravel()
    return found


def turn(a: dict[str, NDArray[Any]], part: Projection, row: Ints) -> None:
    """Take over the words of a projection, where it has room for them."""
    if row[t.GATHER] >= 0:
        assert part.grid is not None
        shape, reach = part.size // part.grid.maps, part.grid.reach
        words = a["words"][row[t.WORD] : row[t.WORD] + (part.size if row[t.WORD_STRIDE] else 1)]
        here = a["kernels"][row[t.KERNEL] : row[t.KERNEL] + part.size].reshape(-1, shape, reach)
        here[:, places(part.grid)] = (
            words.reshape(-1, reach, shape).transpose(0, 2, 1) if row[t.WORD_STRIDE] else words[0]
        )


@kernel
def write_some(mantissas, synapses, table, lowest, words, kernels, row, where):
    """Write the words of some synapses of a projection, where it has room for them by places, too.

    Args:
        mantissas: of all its synapses.
        synapses: which have changed.
        table: the word of each mantissa from `lowest` on.
        lowest: the smallest mantissa.
        words: of all projections, changed.
        kernels: likewise by places.
        row: of the projection; it is marked that there may be words of a sign.
        where: of a grid, see `places`.
    """
    reach, size = row[t.REACH], where.size
    first = end = into = 0  # the weights of a map, and where they go: neighbours are mostly of one
    for k in range(synapses.size):
        s = synapses[k]
        word = table[mantissas[s] - lowest]
        words[row[t.WORD] + s] = word
        if word > 0:
            row[t.POSITIVE] = 1
        elif word < 0:
            row[t.NEGATIVE] = 1
        if row[t.GATHER] >= 0:
            # A division for each map instead of each synapse.
            if s < first or s >= end:
                m = s // size
                first, end, into = m * size, (m + 1) * size, row[t.KERNEL] + m // reach * size * reach + m % reach
            kernels[into + where[s - first] * reach] = word


@subkernel
def may_gather(net, row, capped):
    """Whether a projection is such a grid; slots that saturate must not get both signs in one sum."""
    return row[t.LAYOUT] == t.GRID and row[t.GATHER] >= 0 and not (capped and row[t.POSITIVE] and row[t.NEGATIVE])


@subkernel
def covering(at, kernel, stride, places):
    """The first place whose kernel covers a line of the source, and one after the last."""
    return max(0, -((kernel - 1 - at) // stride)), min(places, at // stride + 1)


@subkernel
def place_in_line(x, width, stride):
    """Where the words of column x of a kernel lie in their line, see `places`."""
    first = x % stride
    before = first * (width // stride) + min(first, width % stride)
    return before + (width - 1 - first) // stride - x // stride


@subkernel
def gather(net, row, begin, first, last):
    """Add up the emitted spikes first:last of a source whose neurons begin at `begin`, and mark the places.

    Returns:
        The rows and the columns of the targets between which all of them are, each with one after the last.
    """
    sheet, width, reach = row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH], row[t.CHANNEL_WIDTH], row[t.REACH]
    kernel_height, kernel_width, stride = row[t.KERNEL_HEIGHT], row[t.KERNEL_WIDTH], row[t.STRIDE]
    rows, columns = row[t.ROWS], row[t.COLUMNS]
    top, bottom, left, right = rows, 0, columns, 0
    for k in range(first, last):
        i = net.emitted[k] - begin
        channel, rest = i // sheet, i % sheet
        y, x = rest // width + row[t.TOP], rest % width + row[t.LEFT]
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
            into = row[t.GATHER] + place * reach
            send_row(
                net.gathered[into : into + run * reach], net.kernels[word : word + run * reach], net.emitted_times[k]
            )
            mark = row[t.MARKS] + place
            net.marked[mark : mark + run] = 1
    return top, bottom, left, right


@subkernel
def pour_map(into, sums, apart):
    """Add the sums that lie `apart` from each other to neighbouring slots."""
    for p in range(into.size):
        into[p] = np.int32(into[p] + sums[p * apart])


@subkernel
def pour_capped(into, sums, apart, sign):
    """Likewise to slots that saturate."""
    for p in range(into.size):
        into[p] = min(np.int32(into[p] + np.int32(sums[p * apart] * sign)), OVER)


@subkernel
def pour(net, row, target, box, step, below, capped):
    """Add the sums to the slot in which they arrive, and clear them."""
    top, bottom, left, right = box
    rows, columns, reach = row[t.ROWS], row[t.COLUMNS], row[t.REACH]
    sheet = rows * columns
    slot = (step + net.lags[row[t.LAG]]) & (target[t.SLOTS] - 1)
    base = target[t.RING] + slot * sheet * row[t.MAPS]
    net.came[target[t.ARRIVED] + slot] = 1
    at_once = 2 * (right - left) >= columns  # what lies between the lines of the box has sums of 0
    spans = 1 if at_once else bottom - top
    # One long run with zeros between is faster than many short ones where the box is at least half as wide as the grid.
    run = right - left + (bottom - top - 1) * columns if at_once else right - left
    for span in range(spans):
        first = (top + span) * columns + left
        for group in range(row[t.MAPS] // reach):
            place = group * sheet + first
            sums = net.gathered[row[t.GATHER] + place * reach : row[t.GATHER] + (place + run) * reach]
            marks = net.marked[row[t.MARKS] + place : row[t.MARKS] + place + run]
            for m in range(reach):
                to = base + (group * reach + m) * sheet + first
                if not capped:
                    pour_map(net.ring[to + row[t.PLANE] : to + row[t.PLANE] + run], sums[m:], reach)
                elif row[t.NEGATIVE]:
                    pour_capped(net.ring[to + below : to + below + run], sums[m:], reach, np.int32(-1))
                else:
                    pour_capped(net.ring[to : to + run], sums[m:], reach, np.int32(1))
                arrived = net.arrived[to : to + run]
                for p in range(run):
                    arrived[p] |= marks[p]
            # Cleared while they are in the cache; the next step finds them empty.
            sums[:] = 0
            marks[:] = 0


@subkernel
def send_grids(net, row, begin, first, last, step):
    """Send the emitted spikes first:last of one source along a grid."""
    target = net.pops[row[t.TARGET]]
    capped = target[t.RECEPTORS] == 2
    below = target[t.SLOTS] * (target[t.END] - target[t.BEGIN])
    pour(net, row, target, gather(net, row, begin, first, last), step, below, capped)
