"""The spikes kept for reading, moved out of the loop's buffers in chunks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.backend import Spikes
from neuro.program import Program
from neuro_event.layout import Place


class Record:
    """Chunks of (steps, neurons, multiplicity), each sorted by step, oldest first."""

    def __init__(self, program: Program, places: list[Place]) -> None:
        self._names = [(p.name, p.records) for p in program.populations]
        self._places = places
        self._chunks: list[tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int32]]] = []

    def drain(self, net: Any) -> None:
        """Take over what the loop has recorded."""
        parts = []
        for thread in range(net["rec_at"].shape[0]):
            n = int(net["rec_at"][thread, 0])
            if n:
                parts.append(
                    (
                        net["rec_steps"][thread, :n].copy(),
                        net["rec_ids"][thread, :n].copy(),
                        net["rec_counts"][thread, :n].copy(),
                    )
                )
                net["rec_at"][thread, 0] = 0
        if len(parts) == 1:
            self._chunks.append(parts[0])
        elif parts:
            steps, ids, counts = (np.concatenate(c) for c in zip(*parts, strict=True))
            order = np.lexsort((ids, steps))
            self._chunks.append((steps[order], ids[order], counts[order]))

    def spikes(self, population: int, since: int) -> Spikes:
        """Spikes of a population with step > since, by step, then id."""
        place = self._places[population]
        found = []
        for steps, neurons, counts in reversed(self._chunks):
            if steps[-1] <= since:
                break
            keep = (neurons >= place.begin) & (neurons < place.end)
            if steps[0] <= since:
                keep &= steps > since
            found.append((steps[keep], neurons[keep], counts[keep]))
        if not found:
            nothing = np.zeros(0, dtype=np.int64)
            return Spikes(nothing, nothing, np.zeros(0, dtype=np.int32))
        steps, neurons, counts = (
            found[0] if len(found) == 1 else tuple(np.concatenate(c) for c in zip(*reversed(found), strict=True))
        )
        ids = neurons.astype(np.int64) - place.begin
        if place.inside is not None:
            ids = place.outside[ids]
            order = np.lexsort((ids, steps))
            return Spikes(steps[order], ids[order], counts[order])
        return Spikes(steps, ids, counts)

    def forget(self, before: int) -> None:
        """Drop spikes with step <= before."""
        kept = []
        for steps, neurons, counts in self._chunks:
            if steps[0] > before:
                kept.append((steps, neurons, counts))
            elif steps[-1] > before:
                keep = steps > before
                kept.append((steps[keep], neurons[keep], counts[keep]))
        self._chunks = kept

    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for chunk in self._chunks for array in chunk)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """All chunks joined."""
        empty = (np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0, np.int32))
        joined = [np.concatenate(c) for c in zip(empty, *self._chunks, strict=True)]
        return {"record.steps": joined[0], "record.ids": joined[1], "record.counts": joined[2]}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        steps = arrays["record.steps"]
        chunk = (steps.copy(), arrays["record.ids"].astype(np.int32), arrays["record.counts"].astype(np.int32))
        self._chunks = [chunk] if steps.size else []
