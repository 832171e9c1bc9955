"""The spikes kept for reading, moved out of the loop's buffers in chunks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.backend import Spikes
from neuro.program.program import Program
from neuro_event.layout import Place

Part = tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]


class Record:
    """Chunks, oldest first; a chunk has a part for each thread: (steps, neurons, multiplicity) by step."""

    def __init__(self, program: Program, places: list[Place]) -> None:
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


def _chosen(part: Part, place: Place, since: int) -> Part:
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
