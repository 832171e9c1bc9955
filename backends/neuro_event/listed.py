"""The listed spikes of the spike_generators, and those of trials and injections."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Ints
from neuro_event import layout, tables as t
from neuro_event.arrays import Arrays

_NOTHING = np.zeros(0, dtype=np.int64)


class Listed:
    """Keeps the spikes to come by population and writes them into the arrays that the loop reads."""

    def __init__(self, arrays: Arrays) -> None:
        self._a = arrays
        self._spikes: dict[int, tuple[Ints, Ints]] = {
            k: (p.spike_steps, p.spike_ids)
            for k, p in enumerate(arrays.program.populations)
            if layout.kind(p) == t.LISTED
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

    def replace(self, population: int, steps: Ints, ids: Ints, now: int) -> bool:
        """Let these, sorted by step, then id, be all that a population has; tell whether arrays were replaced."""
        n = steps.size
        rewritten = False
        if self._spikes[population][0].size or n > self._room.get(population, 0):
            self._spikes[population] = (_NOTHING, _NOTHING)
            self._room[population] = 2 * n + 64
            self._write(now)
            rewritten = True
        net, first = self._a.net, self._begin[population]
        net["list_steps"][first : first + n] = steps
        net["list_ids"][first : first + n] = ids + self._a.places[population].begin
        net["list_counts"][first : first + n] = 1
        net["cursor"][:-1, population] = first
        net["cursor"][-1, population] = first + n
        return rewritten

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
            rows = _joined(steps[ahead], self._a.places[k].begin + ids[ahead])
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


def _joined(steps: Ints, neurons: Ints) -> Ints:
    """Rows (step, neuron, multiplicity), sorted; equal ones joined."""
    if steps.size == 0:
        return np.zeros((0, 3), dtype=np.int64)
    begin, span = int(steps.min()), int(neurons.max()) + 1
    if (int(steps.max()) - begin + 1) * span >= 1 << 63:
        pairs, counts = np.unique(np.stack([steps, neurons], axis=1), axis=0, return_counts=True)
        return np.column_stack([pairs, counts])
    keys, counts = np.unique((steps - begin) * span + neurons, return_counts=True)  # several times faster
    return np.column_stack([keys // span + begin, keys % span, counts])
