"""The cores that the spikes of each source reach, and what they bring there."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from neuro.chips.incoming import SHARED, Incoming, block_bits
from neuro.kernels.jit import kernel, subkernel
from neuro.program.program import Ints

bits_of_block = subkernel(block_bits)


@subkernel
def cores_of_source(i, rows, core_of, count, cores):
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
def is_new(i, core, sent):
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
        for k in range(cores_of_source(i, rows, core_of, count, cores)):
            core = cores[k]
            n = count[core]
            count[core] = 0
            if bits == SHARED:
                pass  # the core keeps a kernel once, which is counted apart
            elif index.size:
                blocks[core] += bits_of_block(n, bits + index[core])
            else:
                longest[core] = max(longest[core], n)
            if is_new(i, core, sent):
                sends[i] += 1
                axons_in[core] += 1


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
