"""Grids of many maps: the spikes of a step are added up with the maps next to each other, then poured into the ring.

A kernel's words for one place lie in all maps far apart in the ring, so a spike by itself touches them one by one. With
the maps next to each other they are added many at a time: sums lie by place, then map, of the maps that one channel
reaches; words likewise, and in a line of a kernel in the order of the places that a source meets them at, so that all
places of a line are added in one run. Sums of words do not depend on their order, so the bits are those of spikes sent
one by one.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import inner, kernel
from neuro.program.program import Grid, Ints, Program, Projection
from neuro_chip import tables as t
from neuro_chip.deliver import OVER, send_row

FEWEST = 4
"""Maps that a channel reaches from which this is worth while."""


def lay_out(a: dict[str, NDArray[Any]], program: Program) -> None:
    """Room for the words of grids with the maps innermost, and for the sums of a step."""
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
        row: of the projection; it is told that there may be words of a sign.
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
            if s < first or s >= end:
                m = s // size
                first, end, into = m * size, (m + 1) * size, row[t.KERNEL] + m // reach * size * reach + m % reach
            kernels[into + where[s - first] * reach] = word


@inner
def may_gather(net, row, capped):
    """Whether a projection is such a grid; slots that saturate must not be told of both signs in one sum."""
    return row[t.LAYOUT] == t.GRID and row[t.GATHER] >= 0 and not (capped and row[t.POSITIVE] and row[t.NEGATIVE])


@inner
def covering(at, kernel, stride, places):
    """The first place whose kernel covers a line of the source, and one after the last."""
    return max(0, -((kernel - 1 - at) // stride)), min(places, at // stride + 1)


@inner
def place_in_line(x, width, stride):
    """Where the words of column x of a kernel lie in their line, see `places`."""
    first = x % stride
    before = first * (width // stride) + min(first, width % stride)
    return before + (width - 1 - first) // stride - x // stride


@inner
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


@inner
def pour_map(into, sums, apart):
    """Add every so-manieth sum to neighbouring slots."""
    for p in range(into.size):
        into[p] = np.int32(into[p] + sums[p * apart])


@inner
def pour_capped(into, sums, apart, sign):
    """Likewise to slots that saturate."""
    for p in range(into.size):
        into[p] = min(np.int32(into[p] + np.int32(sums[p * apart] * sign)), OVER)


@inner
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
                    pour_map(net.ring[to : to + run], sums[m:], reach)
                elif row[t.NEGATIVE]:
                    pour_capped(net.ring[to + below : to + below + run], sums[m:], reach, np.int32(-1))
                else:
                    pour_capped(net.ring[to : to + run], sums[m:], reach, np.int32(1))
                arrived = net.arrived[to : to + run]
                for p in range(run):
                    arrived[p] |= marks[p]
            sums[:] = 0
            marks[:] = 0


@inner
def send_grids(net, row, begin, first, last, step):
    """Send the emitted spikes first:last of one source along a grid."""
    target = net.pops[row[t.TARGET]]
    capped = target[t.RECEPTORS] == 2
    below = target[t.SLOTS] * (target[t.END] - target[t.BEGIN])
    pour(net, row, target, gather(net, row, begin, first, last), step, below, capped)
