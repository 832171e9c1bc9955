"""The spikes kept for reading, moved out of the loop's buffers in chunks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.backend import Spikes
from neuro.program.program import Ints, Program
from neuro_event.building import layout
from neuro_event.building.arrays import EventArrays
from neuro_event.building.layout import PopulationPlace
from neuro_event.loop import tables as t

Part = tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]


class RecordedSpikes:
    """Chunks, oldest first; a chunk has a part for each thread: (steps, neurons, multiplicity) by step."""

    def __init__(self, program: Program, places: list[PopulationPlace]) -> None:
        self._places = places
        self._chunks: list[list[Part]] = []

    def drain(self, net: Any) -> None:
        """Take over what the loop has recorded."""
        parts = []
        for thread in range(net["rec_at"].shape[0]):
            n = int(net["rec_at"][thread, 0])
            if n:
                steps, ids, counts = (net[name][thread, :n].copy() for name in ("rec_steps", "rec_ids", "rec_counts"))
                parts.append((steps, ids, counts))
                net["rec_at"][thread, 0] = 0
        if parts:
            self._chunks.append(parts)

    def clear(self, net: Any) -> None:
        """Drop all spikes."""
        net["rec_at"][:, 0] = 0
        self._chunks.clear()

    def spikes(self, population: int, since: int) -> Spikes:
        """Spikes of a population with step > since, by step, then id."""
        place = self._places[population]
        found: list[Part] = []
        for chunk in reversed(self._chunks):
            if max(int(steps[-1]) for steps, _, _ in chunk) <= since:
                break
            found += [_chosen(part, place, since) for part in reversed(chunk)]
        found = [part for part in reversed(found) if part[0].size]
        if not found:
            nothing = np.zeros(0, dtype=np.int64)
            return Spikes(nothing, nothing, np.zeros(0, dtype=np.int32))
        steps, neurons, counts = found[0] if len(found) == 1 else _joined(found)
        ids = neurons.astype(np.int64) - place.begin
        if place.inside is not None:
            ids = place.outside[ids]
        if place.inside is not None or len(found) > 1:
            order = np.lexsort((ids, steps))
            steps, ids, counts = steps[order], ids[order], counts[order]
        return Spikes(steps, ids, counts)

    def forget(self, before: int) -> None:
        """Drop spikes with step <= before."""
        kept = [[_after(part, before) for part in chunk if part[0][-1] > before] for chunk in self._chunks]
        self._chunks = [chunk for chunk in kept if chunk]

    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for chunk in self._chunks for part in chunk for array in part)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """All chunks joined."""
        empty = (np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0, np.int32))
        steps, ids, counts = _joined([empty, *(part for chunk in self._chunks for part in chunk)])
        order = np.lexsort((ids, steps))
        return {"record.steps": steps[order], "record.ids": ids[order], "record.counts": counts[order]}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        steps = arrays["record.steps"]
        part = (steps.copy(), arrays["record.ids"].astype(np.int32), arrays["record.counts"].astype(np.int32))
        self._chunks = [[part]] if steps.size else []


def _chosen(part: Part, place: PopulationPlace, since: int) -> Part:
    """Those spikes of a part that are of one population and after a step."""
    steps, neurons, counts = part
    keep = (neurons >= place.begin) & (neurons < place.end)
    if steps[0] <= since:
        keep &= steps > since
    return steps[keep], neurons[keep], counts[keep]


def _after(part: Part, before: int) -> Part:
    """Those spikes of a part that are after a step."""
    first = int(np.searchsorted(part[0], before, side="right"))
    return part if first == 0 else (part[0][first:].copy(), part[1][first:].copy(), part[2][first:].copy())


def _joined(parts: list[Part]) -> Part:
    steps, neurons, counts = zip(*parts, strict=True)
    return np.concatenate(steps), np.concatenate(neurons), np.concatenate(counts)


_NOTHING = np.zeros(0, dtype=np.int64)


class ListedSpikes:
    """Keeps the spikes to come by population and writes them into the arrays that the loop reads."""

    def __init__(self, arrays: EventArrays) -> None:
        self._a = arrays
        self._spikes: dict[int, tuple[Ints, Ints]] = {
            k: (p.spike_steps, p.spike_ids)
            for k, p in enumerate(arrays.program.populations)
            if layout.kind(p) == t.LISTED
        }
        self._begin: dict[int, int] = {}
        self._room: dict[int, int] = {}
        self._write(0)

    def add(self, population: int, steps: Ints, ids: Ints, now: int) -> bool:
        """Add spikes after step `now`; tell whether arrays were replaced."""
        old_steps, old_ids = self._spikes[population]
        ahead = old_steps > now
        if ahead.any():
            steps, ids = np.concatenate([old_steps[ahead], steps]), np.concatenate([old_ids[ahead], ids])
        self._spikes[population] = steps, ids
        rows = _with_multiplicity(steps, self._a.places[population].begin + ids)
        return self._put(population, rows, now)

    def replace(self, population: int, steps: Ints, ids: Ints, now: int) -> bool:
        """Let these, sorted by step, then id, be all that a population has; tell whether arrays were replaced."""
        self._spikes[population] = (_NOTHING, _NOTHING)
        neurons = ids + self._a.places[population].begin
        return self._put(population, np.column_stack([steps, neurons, np.ones_like(steps)]), now)

    def reserve(self, population: int, n: int, now: int) -> bool:
        """Have room for n spikes of a population; tell whether arrays were replaced."""
        if n <= self._room.get(population, 0):
            return False
        self._room[population] = 2 * n + 64
        self._write(now)
        return True

    def place(self, population: int) -> int:
        """Where the spikes of a population are listed."""
        return self._begin[population]

    def pending(self, population: int, now: int) -> bool:
        """Whether spikes that were added are still to come."""
        steps = self._spikes[population][0]
        return steps.size > 0 and bool((steps > now).any())

    def _put(self, population: int, rows: Ints, now: int) -> bool:
        """Let the loop read rows of a population, where they have room; else make twice the room for it."""
        # A closed loop brings some spikes before each call: to replace arrays takes 0.5 ms, as all are linked anew.
        n = len(rows)
        grows = self.reserve(population, n, now)
        net, first = self._a.net, self._begin[population]
        for name, column in zip(("list_steps", "list_ids", "list_counts"), rows.T, strict=True):
            net[name][first : first + n] = column
        net["cursor"][:-1, population] = first
        net["cursor"][-1, population] = first + n
        return grows

    def drop(self, population: int) -> None:
        """Forget what `replace` gave a population and was not emitted."""
        self._a.net["cursor"][:-1, population] = self._a.net["cursor"][-1, population]

    def _write(self, now: int) -> None:
        """Write all spikes after step `now`, equal ones joined."""
        net = self._a.net
        threads = net["edges"].shape[1] - 1
        net["cursor"] = np.zeros((threads + 1, len(self._a.program.populations)), dtype=np.int64)
        columns, at = [np.zeros((0, 3), dtype=np.int64)], 0
        for k, (steps, ids) in self._spikes.items():
            ahead = steps > now
            rows = _with_multiplicity(steps[ahead], self._a.places[k].begin + ids[ahead])
            self._begin[k] = at
            net["cursor"][:-1, k] = at
            net["cursor"][-1, k] = at + rows.shape[0]
            room = max(rows.shape[0], self._room.get(k, 0))
            columns.append(np.pad(rows, ((0, room - rows.shape[0]), (0, 0))))
            at += room
        table = np.concatenate(columns)
        net["list_steps"], net["list_ids"], net["list_counts"] = (np.ascontiguousarray(c) for c in table.T)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """The spikes by population."""
        return {f"listed.{k}": np.stack([steps, ids]) for k, (steps, ids) in self._spikes.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]], now: int) -> None:
        """Take over a snapshot."""
        for k in self._spikes:
            steps, ids = arrays[f"listed.{k}"]
            self._spikes[k] = (steps.copy(), ids.copy())
        self._write(now)


def _with_multiplicity(steps: Ints, neurons: Ints) -> Ints:
    """Rows (step, neuron, multiplicity), sorted; equal ones joined."""
    if steps.size == 0:
        return np.zeros((0, 3), dtype=np.int64)
    begin, span = int(steps.min()), int(neurons.max()) + 1
    if (int(steps.max()) - begin + 1) * span >= 1 << 63:
        pairs, counts = np.unique(np.stack([steps, neurons], axis=1), axis=0, return_counts=True)
        return np.column_stack([pairs, counts])
    keys, counts = np.unique((steps - begin) * span + neurons, return_counts=True)  # several times faster
    return np.column_stack([keys // span + begin, keys % span, counts])
