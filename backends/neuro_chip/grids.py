"""Grids of many maps: the spikes of a step are added up with the maps next to each other, then poured into the ring.

A kernel's words for one place lie in all maps far apart in the ring, so a spike by itself touches them one by one. With
the maps next to each other they are added many at a time. Sums of words do not depend on their order, so the bits are
those of spikes sent one by one.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import inner, kernel
from neuro.program.program import Ints, Program, Projection
from neuro_chip import tables as t
from neuro_chip.deliver import add, send_row

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


def turn(a: dict[str, NDArray[Any]], part: Projection, row: Ints) -> None:
    """Take over the words of a projection, where it has room for them."""
    if row[t.GATHER] >= 0:
        assert part.grid is not None
        words = a["words"][row[t.WORD] : row[t.WORD] + (part.size if row[t.WORD_STRIDE] else 1)]
        here = a["kernels"][row[t.KERNEL] : row[t.KERNEL] + part.size].reshape(-1, part.grid.maps)
        here[:] = words.reshape(part.grid.maps, -1).T if row[t.WORD_STRIDE] else words


@kernel
def write_some(mantissas, synapses, table, lowest, words, kernels, row, size):
    """Write the words of some synapses of a projection, where it has room for them with the maps innermost, too.

    Args:
        mantissas: of all its synapses.
        synapses: which have changed.
        table: the word of each mantissa from `lowest` on.
        lowest: the smallest mantissa.
        words: of all projections, changed.
        kernels: likewise with the maps innermost.
        row: of the projection; it is told that there may be words of a sign.
        size: weights of a map.
    """
    maps = row[t.MAPS]
    for k in range(synapses.size):
        s = synapses[k]
        word = table[mantissas[s] - lowest]
        words[row[t.WORD] + s] = word
        if word > 0:
            row[t.POSITIVE] = 1
        elif word < 0:
            row[t.NEGATIVE] = 1
        if row[t.GATHER] >= 0:
            kernels[row[t.KERNEL] + s % size * maps + s // size] = word


@inner
def may_gather(net, row, capped):
    """Whether a projection is such a grid; slots that saturate must not be told of both signs in one sum."""
    return row[t.LAYOUT] == t.GRID and row[t.GATHER] >= 0 and not (capped and row[t.POSITIVE] and row[t.NEGATIVE])


@inner
def covering(at, kernel, stride, places):
    """The first place whose kernel covers a line of the source, and one after the last."""
    return max(0, -((kernel - 1 - at) // stride)), min(places, at // stride + 1)


@inner
def gather(net, row, begin, first, last):
    """Add up the emitted spikes first:last of a source whose neurons begin at `begin`, and mark the places.

    Returns:
        The rows and the columns of the targets between which all of them are, each with one after the last.
    """
    sheet, width, maps = row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH], row[t.CHANNEL_WIDTH], row[t.MAPS]
    kernel_height, kernel_width, stride, columns = (
        row[t.KERNEL_HEIGHT],
        row[t.KERNEL_WIDTH],
        row[t.STRIDE],
        row[t.COLUMNS],
    )
    reach = row[t.REACH]
    groups = maps // reach
    top, bottom, left, right = row[t.ROWS], 0, columns, 0
    for k in range(first, last):
        i = net.emitted[k] - begin
        channel, rest = i // sheet, i % sheet
        group = channel // row[t.DEPTH]
        y, x = rest // width + row[t.TOP], rest % width + row[t.LEFT]
        r_first, r_end = covering(y, kernel_height, stride, row[t.ROWS])
        c_first, c_end = covering(x, kernel_width, stride, columns)
        top, bottom, left, right = min(top, r_first), max(bottom, r_end), min(left, c_first), max(right, c_end)
        for r in range(r_first, r_end):
            line = (channel % row[t.DEPTH] * kernel_height + y - r * stride) * kernel_width + x
            for c in range(c_first, c_end):
                word = row[t.KERNEL] + (line - c * stride) * maps + group * reach
                place = r * columns + c
                into = row[t.GATHER] + place * maps + group * reach
                net.marked[row[t.MARKS] + place * groups + group] = 1
                send_row(net.gathered[into : into + reach], net.kernels[word : word + reach], net.emitted_times[k])
    return top, bottom, left, right


@inner
def pour(net, row, target, box, step, below, capped):
    """Add the sums to the slot in which they arrive, and clear them."""
    top, bottom, left, right = box
    rows, columns, maps, reach = row[t.ROWS], row[t.COLUMNS], row[t.MAPS], row[t.REACH]
    groups, sheet = maps // reach, rows * columns
    slot = (step + net.lags[row[t.LAG]]) & (target[t.SLOTS] - 1)
    base = target[t.RING] + slot * sheet * maps
    for r in range(top, bottom):
        for place in range(r * columns + left, r * columns + right):
            for group in range(groups):
                mark = row[t.MARKS] + place * groups + group
                if net.marked[mark] == 0:
                    continue
                net.marked[mark] = 0
                into = row[t.GATHER] + place * maps
                for m in range(group * reach, (group + 1) * reach):
                    to = base + m * sheet + place
                    add(net.ring, to, below, net.gathered[into + m], 1, capped)
                    net.arrived[to] = 1
                    net.gathered[into + m] = 0


@inner
def send_grids(net, row, begin, first, last, step):
    """Send the emitted spikes first:last of one source along a grid."""
    target = net.pops[row[t.TARGET]]
    capped = target[t.RECEPTORS] == 2
    below = target[t.SLOTS] * (target[t.END] - target[t.BEGIN])
    pour(net, row, target, gather(net, row, begin, first, last), step, below, capped)
