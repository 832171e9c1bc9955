"""Listed spikes that an engine still has to emit, for backends with compiled loops."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import kernel
from neuro.program.program import Ints, Program

_NO_INTS = np.zeros(0, dtype=np.int64)


class ListedSpikes:
    """Keeps the spikes to come by population and writes them into the arrays that the loop reads.

    These are `list_steps`, `list_ids` and `list_counts`, and `cursor` (threads + 1, populations): the next listed spike
    for each thread; its last row holds the ends.

    Args:
        program: what runs.
        arrays: of the loop, by name.
        begins: the first neuron of each population among all.
        threads: of the loop.
    """

    def __init__(
        self, program: Program, arrays: MutableMapping[str, NDArray[Any]], begins: Sequence[int], threads: int = 1
    ) -> None:
        self._a, self._begins = arrays, begins
        self._cursor_shape = (threads + 1, len(program.populations))
        self._spikes: dict[int, tuple[Ints, ...]] = {
            k: (p.spike_steps, p.spike_ids, *((p.spike_payloads,) if p.model.graded else ()))
            for k, p in enumerate(program.populations)
            if p.kind == "listed"
        }
        self._first: dict[int, int] = {}
        self._room: dict[int, int] = {}
        self._write(0)

    def add(self, population: int, steps: Ints, ids: Ints, now: int, payloads: Ints | None = None) -> bool:
        """Add spikes after step `now`, with payloads where they are graded; return whether arrays were replaced."""
        old = self._spikes[population]
        new: tuple[Ints, ...] = (steps, ids) if payloads is None else (steps, ids, payloads)
        ahead = old[0] > now
        if ahead.any():
            new = tuple(np.concatenate([one[ahead], other]) for one, other in zip(old, new, strict=True))
        self._spikes[population] = new
        return self._put(population, _rows(*new, begin=self._begins[population]), now)

    def replace(self, population: int, steps: Ints, ids: Ints, now: int) -> bool:
        """Let these, sorted by step, then id, be all that a population has; return whether arrays were replaced."""
        self._spikes[population] = (_NO_INTS,) * len(self._spikes[population])
        neurons = ids + self._begins[population]
        return self._put(population, np.column_stack([steps, neurons, np.ones_like(steps)]), now)

    def reserve(self, population: int, n: int, now: int) -> bool:
        """Have room for n spikes of a population; return whether arrays were replaced."""
        if n <= self._room.get(population, 0):
            return False
        self._room[population] = 2 * n + 64
        self._write(now)
        return True

    def place(self, population: int) -> int:
        """Where the spikes of a population are listed."""
        return self._first[population]

    def pending(self, population: int, now: int) -> bool:
        """Whether spikes that were added are still to come."""
        steps = self._spikes[population][0]
        return steps.size > 0 and bool((steps > now).any())

    def _put(self, population: int, rows: Ints, now: int) -> bool:
        """Let the loop read rows of a population, where they have room; else make twice the room for it."""
        # A closed loop brings some spikes before each call: to replace arrays takes 0.5 ms, as all are linked anew.
        n = len(rows)
        grows = self.reserve(population, n, now)
        first = self._first[population]
        for name, column in zip(("list_steps", "list_ids", "list_counts"), rows.T, strict=True):
            self._a[name][first : first + n] = column
        self._a["cursor"][:-1, population] = first
        self._a["cursor"][-1, population] = first + n
        return grows

    def drop(self, population: int) -> None:
        """Forget the spikes of a population."""
        self._spikes[population] = (_NO_INTS,) * len(self._spikes[population])
        self._a["cursor"][:-1, population] = self._a["cursor"][-1, population]

    def _write(self, now: int) -> None:
        """Write all spikes after step `now`, equal ones joined."""
        cursor = np.zeros(self._cursor_shape, dtype=np.int64)
        columns, at = [np.zeros((0, 3), dtype=np.int64)], 0
        for k, spikes in self._spikes.items():
            ahead = spikes[0] > now
            rows = _rows(*(column[ahead] for column in spikes), begin=self._begins[k])
            self._first[k] = at
            cursor[:-1, k], cursor[-1, k] = at, at + len(rows)
            room = max(len(rows), self._room.get(k, 0))
            columns.append(np.pad(rows, ((0, room - len(rows)), (0, 0))))
            at += room
        table = np.concatenate(columns)
        self._a["list_steps"], self._a["list_ids"], self._a["list_counts"] = (np.ascontiguousarray(c) for c in table.T)
        self._a["cursor"] = cursor

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """The spikes by population."""
        return {f"listed.{k}": np.stack(spikes) for k, spikes in self._spikes.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]], now: int) -> None:
        """Take over a snapshot."""
        for k in self._spikes:
            self._spikes[k] = tuple(column.copy() for column in arrays[f"listed.{k}"])
        self._write(now)


def _rows(steps: Ints, ids: Ints, payloads: Ints | None = None, *, begin: int) -> Ints:
    """Rows (step, neuron, multiplicity or payload), sorted; equal ones joined."""
    if payloads is None:
        return _with_multiplicity(steps, begin + ids)
    pairs, which = np.unique(np.stack([steps, begin + ids], axis=1), axis=0, return_inverse=True)
    sums = np.zeros(len(pairs), dtype=np.int64)
    np.add.at(sums, which.ravel(), payloads)
    rows: Ints = np.column_stack([pairs, sums])[sums != 0]
    return rows


def _with_multiplicity(steps: Ints, neurons: Ints) -> Ints:
    """Rows (step, neuron, multiplicity), sorted; equal ones joined."""
    begin, end, span = _extents(steps, neurons)
    if (end - begin) * span >= 1 << 63:
        pairs, counts = np.unique(np.stack([steps, neurons], axis=1), axis=0, return_counts=True)
        return np.column_stack([pairs, counts])
    rows = np.empty((3, steps.size), dtype=np.int64)
    return rows[:, : _join(np.sort((steps - begin) * span + neurons), begin, span, rows)].T


@kernel
def _extents(steps: Ints, neurons: Ints) -> tuple[int, int, int]:
    """The first step, the one after the last, and the neuron after the last."""
    begin, end, span = 0, 0, 0
    for k in range(steps.size):
        begin = min(begin, int(steps[k])) if k else int(steps[0])
        end, span = max(end, int(steps[k]) + 1), max(span, int(neurons[k]) + 1)
    return begin, end, span


@kernel
def _join(keys: Ints, begin: int, span: int, rows: Ints) -> int:
    """Write rows of sorted keys, `(step - begin) * span + neuron`, equal ones joined; return how many they are."""
    n, step, first, beyond = 0, 0, 0, 0
    for k in range(keys.size):
        if k and keys[k] == keys[k - 1]:
            rows[2, n - 1] += 1
            continue
        if keys[k] >= beyond:  # of a later step: most divisions are spared
            step = keys[k] // span
            first, beyond = step * span, step * span + span
        rows[0, n], rows[1, n], rows[2, n] = begin + step, keys[k] - first, 1
        n += 1
    return n
