"""The spikes kept for reading, moved out of the loop's buffers in chunks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.backend import Spikes
from neuro.program.program import Ints

Chunk = tuple[Ints, Ints, Ints]


class Record:
    """Chunks of (steps, neurons counted through all populations, multiplicity), oldest first."""

    def __init__(self) -> None:
        self._chunks: list[Chunk] = []

    def take(self, steps: Ints, ids: Ints, times: Ints) -> None:
        """Add what the loop has recorded."""
        if steps.size:
            self._chunks.append((steps.copy(), ids.copy(), times.copy()))

    def spikes(self, begin: int, end: int, since: int) -> Spikes:
        """Spikes of the neurons from begin to end with step > since."""
        found = []
        for steps, ids, times in self._chunks:
            if steps[-1] > since:
                keep = (ids >= begin) & (ids < end) & (steps > since)
                found.append((steps[keep], ids[keep] - begin, times[keep]))
        if not found:
            nobody = np.zeros(0, dtype=np.int64)
            return Spikes(nobody, nobody, np.zeros(0, dtype=np.int32))
        steps, ids, times = (np.concatenate(column) for column in zip(*found, strict=True))
        return Spikes(steps, ids, times.astype(np.int32))

    def forget(self, before: int) -> None:
        """Drop spikes with step <= before."""
        kept = [tuple(column[chunk[0] > before] for column in chunk) for chunk in self._chunks if chunk[0][-1] > before]
        self._chunks = [(steps, ids, times) for steps, ids, times in kept]

    def nbytes(self) -> int:
        """Bytes held."""
        return sum(column.nbytes for chunk in self._chunks for column in chunk)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """All chunks joined."""
        empty = (np.zeros(0, dtype=np.int64),) * 3
        columns = [np.concatenate(column) for column in zip(empty, *self._chunks, strict=True)]
        return dict(zip(("record.steps", "record.ids", "record.times"), columns, strict=True))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        self._chunks = []
        self.take(arrays["record.steps"], arrays["record.ids"], arrays["record.times"])
