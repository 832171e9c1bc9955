"""The cores that the sources of each projection reach, population by population."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from neuro.chips.placing.incoming import Incoming
from neuro.program.program import Ints


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
