"""The listed spikes of the spike_generators, and those of trials and injections: the host sends them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.backend import Spikes
from neuro.program.program import Ints, Program
from neuro_chip import tables as t

_NOTHING = np.zeros(0, dtype=np.int64)
_COLUMNS = ("list_steps", "list_ids", "list_times")


class Listed:
    """Keeps the spikes to come by population and writes them into the arrays that the loop reads."""

    def __init__(self, program: Program, arrays: dict[str, NDArray[Any]]) -> None:
        self._a = arrays
        self._spikes = {
            k: (p.spike_steps, p.spike_ids) for k, p in enumerate(program.populations) if p.kind == "listed"
        }
        self._begin: dict[int, int] = {}
        self._room: dict[int, int] = {}
        self._write(0)

    def add(self, population: int, steps: Ints, ids: Ints, now: int) -> None:
        """Add spikes after step `now`."""
        old_steps, old_ids = self._spikes[population]
        ahead = old_steps > now
        self._spikes[population] = (np.concatenate([old_steps[ahead], steps]), np.concatenate([old_ids[ahead], ids]))
        self._write(now)

    def make_room(self, population: int, n: int, now: int) -> tuple[int, bool]:
        """Drop all that a population has; where n spikes of it may be listed, and whether arrays were replaced."""
        replaced = bool(self._spikes[population][0].size) or n > self._room.get(population, 0)
        if replaced:
            self._spikes[population] = (_NOTHING, _NOTHING)
            self._room[population] = 2 * n + 64
            self._write(now)
        return self._begin[population], replaced

    def drop(self, population: int) -> None:
        """Forget the spikes of a population."""
        self._spikes[population] = (_NOTHING, _NOTHING)
        self._a["cursor"][population, 0] = self._a["cursor"][population, 1]

    def _write(self, now: int) -> None:
        """Write all spikes after step `now`, equal ones joined."""
        columns = [np.zeros((0, 3), dtype=np.int64)]
        at = 0
        for k, (steps, ids) in self._spikes.items():
            ahead = steps > now
            rows = _joined(steps[ahead], ids[ahead] + int(self._a["pops"][k, t.BEGIN]))
            self._begin[k] = at
            self._a["cursor"][k] = at, at + len(rows)
            room = max(len(rows), self._room.get(k, 0))
            at += room
            columns.append(np.pad(rows, ((0, room - len(rows)), (0, 0))))
        table = np.concatenate(columns)
        for name, column in zip(_COLUMNS, table.T, strict=True):
            self._a[name] = np.ascontiguousarray(column)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """The spikes by population."""
        return {f"listed.{k}": np.stack([steps, ids]) for k, (steps, ids) in self._spikes.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]], now: int) -> None:
        """Take over a snapshot."""
        for k in self._spikes:
            steps, ids = arrays[f"listed.{k}"]
            self._spikes[k] = (steps.copy(), ids.copy())
        self._write(now)


def _joined(steps: Ints, neurons: Ints) -> NDArray[np.int64]:
    """Rows (step, neuron, multiplicity), sorted; equal ones joined."""
    order = np.lexsort((neurons, steps))
    steps, neurons = steps[order], neurons[order]
    other = np.ones(steps.size + 1, dtype=np.bool_)
    np.logical_or(steps[1:] != steps[:-1], neurons[1:] != neurons[:-1], out=other[1:-1])
    ends = np.flatnonzero(other if steps.size else other[:0])
    first = ends[:-1]
    return np.column_stack((steps[first], neurons[first], np.diff(ends)))


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
