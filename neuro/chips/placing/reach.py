"""Compiled loops over the cores that each source neuron of a projection reaches: what lies there, and the ways to it.

All go row by row, as synapses lie in memory, and keep no list of pairs of a source and a core. `rows` are the begin,
end and targets of `incoming.IncomingRows`, `core_of` the core of each target. `room` has a count for each core (0), a
list of cores, and for each source a bit for each core that says whether a projection before this one has
sent a spike of it there; no bits where no two projections of a source reach the same core.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from neuro.chips.placing import packing
from neuro.chips.placing.incoming import Incoming
from neuro.kernels.jit import kernel, subkernel
from neuro.program.program import Ints

# mypy: ignore-errors

SHARED = packing.SHARED
block_bits = subkernel(packing.block_bits)


@subkernel
def _count(i, rows, core_of, count, cores):
    """The cores that source i reaches, each once; returns how many there are."""
    begin, end, targets = rows
    n = 0
    for e in range(begin[i], end[i]):
        core = core_of[targets[e]]
        cores[n] = core
        n += count[core] == 0
        count[core] += 1
    return n


@subkernel
def _new(i, core, sent):
    """Whether this is the first projection of source i that sends a spike to a core."""
    if sent.size == 0:
        return True
    bit = 1 << (core & 7)
    if sent[i, core >> 3] & bit:
        return False
    sent[i, core >> 3] |= bit
    return True


@kernel
def weigh(rows, core_of, room, bits, index, sends, axons_in, blocks, longest):
    """Count what a projection brings to each core.

    Args:
        rows: see above.
        core_of: likewise.
        room: likewise.
        bits: of one synapse, without the index of its neuron.
        index: bits that tell the neurons of each core apart, none where synapses lie in rows.
        sends: cores that each source reaches, grows.
        axons_in: sources that reach each core, grows.
        blocks: bits of each core where synapses lie in blocks, grows.
        longest: is raised, else, to the most synapses that a source has onto each core.
    """
    count, cores, sent = room
    for i in range(rows[0].size):
        for k in range(_count(i, rows, core_of, count, cores)):
            core = cores[k]
            n = count[core]
            count[core] = 0
            if bits == SHARED:
                pass  # the core keeps a kernel once, which is counted apart
            elif index.size:
                blocks[core] += block_bits(n, bits + index[core])
            else:
                longest[core] = max(longest[core], n)
            if _new(i, core, sent):
                sends[i] += 1
                axons_in[core] += 1


@kernel
def between_cores(rows, core_of, room, own, traffic, pull):
    """Add one spike of each source: from its core (`own`) to each that it reaches; -1 is the host."""
    count, cores, sent = room
    for i in range(rows[0].size):
        for k in range(_count(i, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not _new(i, core, sent):
                continue
            if own[i] < 0:
                pull[core] += 1
            else:
                traffic[own[i], core] += 1


@kernel
def travel(rows, core_of, room, begins, places, found):
    """The moves of one spike of each source that is sent for each core by itself.

    `begins` has the column, the row, the chip's column and the chip's row where each source begins, `places` the same
    of each core. `found` grows by source: cores, those on the tile, columns, rows and chips that a spike moves.
    """
    count, cores, sent = room
    for i in range(rows[0].size):
        for k in range(_count(i, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not _new(i, core, sent):
                continue
            east = abs(places[0][core] - begins[0][i])
            south = abs(places[1][core] - begins[1][i])
            found[0][i] += 1
            found[1][i] += east == 0 and south == 0
            found[2][i] += east
            found[3][i] += south
            found[4][i] += abs(places[2][core] - begins[2][i]) + abs(places[3][core] - begins[3][i])


@kernel
def spread(rows, core_of, room, begin, places, reached, local, along, across):
    """Add destinations to the links that sources use: first along their row, then along columns.

    `begin` and `places` are the columns and rows of sources and of cores. Filled are the cores of each source
    (`reached`) and those on its tile (`local`), how far it goes west and east (`along`), and north and south in each
    column (`across`).
    """
    count, cores, sent = room
    for s in range(rows[0].size):
        for k in range(_count(s, rows, core_of, count, cores)):
            core = cores[k]
            count[core] = 0
            if not _new(s, core, sent):
                continue
            column = places[0][core]
            east, south = column - begin[0][s], places[1][core] - begin[1][s]
            reached[s] += 1
            local[s] += east == 0 and south == 0
            along[0, s] = max(along[0, s], east)
            along[1, s] = max(along[1, s], -east)
            across[0, s, column] = max(across[0, s, column], south)
            across[1, s, column] = max(across[1, s, column], -south)


def reached(into: Incoming, core_of: Ints, cores: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
    """Every projection with spikes, those of a source in order, and what the kernels of `reach` take of it.

    Args:
        into: all synapses.
        core_of: the core of every neuron, -1 for generators.
        cores: how many there are.

    Yields:
        the projection; its rows, the core of each of its targets, and room to count in.
    """
    held = [core_of[a:b].astype(np.int32) for a, b in zip(into.start[:-1], into.start[1:], strict=True)]
    count, listed = np.zeros((2, cores), dtype=np.int32)
    listed = np.append(listed, np.int32(0))
    on = np.zeros((len(held), cores), dtype=np.int64)
    for population, own in enumerate(held):
        on[population, own[own >= 0]] = 1
    of_each: dict[int, list[int]] = {}
    for index, rows in enumerate(into.rows):
        if rows is not None and rows.size:
            of_each.setdefault(into.begins_at[index], []).append(index)
    for source, projections in of_each.items():
        size = int(into.start[source + 1] - into.start[source])
        apart = bool(np.all(np.sum([on[into.ends_at[index]] for index in projections], axis=0) <= 1))
        sent = np.zeros((0, 0) if apart else (size, cores // 8 + 1), dtype=np.uint8)
        for index in projections:
            rows = into.rows[index]
            assert rows is not None
            yield index, ((rows.begin, rows.end, rows.targets), held[into.ends_at[index]], (count, listed, sent))
