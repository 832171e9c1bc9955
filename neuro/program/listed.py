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
    """Store of future spikes by population. It writes the spikes into the arrays of the loop.

    The arrays are `list_steps`, `list_ids`, `list_counts` and `cursor`. `cursor`, (threads + 1, populations), holds the
    index of the next listed spike for each thread, and in its last row the end of each population's spikes.

    Args:
        program: the network that runs.
        arrays: the arrays of the loop, by name.
        begins: index of the first neuron of each population among all neurons.
        threads: number of threads of the loop.
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
        self._capacity: dict[int, int] = {}
        self._write(0)

    def add(self, population: int, steps: Ints, ids: Ints, present_step: int, payloads: Ints | None = None) -> bool:
        """Add spikes after step `present_step`. Graded spikes have payloads. Return whether arrays were replaced."""
        old = self._spikes[population]
        new: tuple[Ints, ...] = (steps, ids) if payloads is None else (steps, ids, payloads)
        is_ahead = old[0] > present_step
        if is_ahead.any():
            new = tuple(np.concatenate([a[is_ahead], b]) for a, b in zip(old, new, strict=True))
        self._spikes[population] = new
        return self._put(population, _rows(*new, begin=self._begins[population]), present_step)

    def replace(self, population: int, steps: Ints, ids: Ints, present_step: int) -> bool:
        """Replace a population's spikes by sorted ones (by step, then id). Return whether arrays were replaced."""
        self._spikes[population] = (_NO_INTS,) * len(self._spikes[population])
        neurons = ids + self._begins[population]
        return self._put(population, np.column_stack([steps, neurons, np.ones_like(steps)]), present_step)

    def reserve(self, population: int, n: int, present_step: int) -> bool:
        """Allocate space for n spikes of a population. Return whether arrays were replaced."""
        if n <= self._capacity.get(population, 0):
            return False
        self._capacity[population] = 2 * n + 64
        self._write(present_step)
        return True

    def place(self, population: int) -> int:
        """Return the index of a population's first spike in the lists."""
        return self._first[population]

    def pending(self, population: int, present_step: int) -> bool:
        """Return whether some added spikes have not been emitted yet."""
        steps = self._spikes[population][0]
        return steps.size > 0 and bool((steps > present_step).any())

    def _put(self, population: int, rows: Ints, now: int) -> bool:
        """Write the rows of a population into the arrays; allocate twice the space if they do not fit.

        A closed loop adds a few spikes before each call. Replacing the arrays takes 0.5 ms, since all are relinked.
        """
        n = len(rows)
        grows = self.reserve(population, n, now)
        first = self._first[population]
        for name, column in zip(("list_steps", "list_ids", "list_counts"), rows.T, strict=True):
            self._a[name][first : first + n] = column
        self._a["cursor"][:-1, population] = first
        self._a["cursor"][-1, population] = first + n
        return grows

    def drop(self, population: int) -> None:
        """Remove the spikes of a population."""
        self._spikes[population] = (_NO_INTS,) * len(self._spikes[population])
        self._a["cursor"][:-1, population] = self._a["cursor"][-1, population]

    def _write(self, present_step: int) -> None:
        """Write all spikes after `present_step`. Equal spikes are joined."""
        cursor = np.zeros(self._cursor_shape, dtype=np.int64)
        columns, begin = [np.zeros((0, 3), dtype=np.int64)], 0
        for k, spikes in self._spikes.items():
            is_ahead = spikes[0] > present_step
            rows = _rows(*(column[is_ahead] for column in spikes), begin=self._begins[k])
            self._first[k] = begin
            cursor[:-1, k], cursor[-1, k] = begin, begin + len(rows)
            capacity = max(len(rows), self._capacity.get(k, 0))
            columns.append(np.pad(rows, ((0, capacity - len(rows)), (0, 0))))
            begin += capacity
        table = np.concatenate(columns)
        self._a["list_steps"], self._a["list_ids"], self._a["list_counts"] = (np.ascontiguousarray(c) for c in table.T)
        self._a["cursor"] = cursor

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return the spikes by population."""
        return {f"listed.{k}": np.stack(spikes) for k, spikes in self._spikes.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]], present_step: int) -> None:
        """Replace all spikes by those of a snapshot."""
        for k in self._spikes:
            self._spikes[k] = tuple(column.copy() for column in arrays[f"listed.{k}"])
        self._write(present_step)


def _rows(steps: Ints, ids: Ints, payloads: Ints | None = None, *, begin: int) -> Ints:
    """Return sorted rows (step, neuron, multiplicity or payload). Equal rows are joined."""
    if payloads is None:
        return _with_multiplicity(steps, begin + ids)
    pairs, pair_index = np.unique(np.stack([steps, begin + ids], axis=1), axis=0, return_inverse=True)
    sums = np.zeros(len(pairs), dtype=np.int64)
    np.add.at(sums, pair_index.ravel(), payloads)
    rows: Ints = np.column_stack([pairs, sums])[sums != 0]
    return rows


def _with_multiplicity(steps: Ints, neurons: Ints) -> Ints:
    """Return sorted rows (step, neuron, multiplicity). Equal rows are joined.

    Example: steps [5, 3, 5] of neurons [1, 0, 1] give (3, 0, 1) and (5, 1, 2).
    """
    begin, end, span = _extents(steps, neurons)
    if (end - begin) * span >= 1 << 63:
        pairs, counts = np.unique(np.stack([steps, neurons], axis=1), axis=0, return_counts=True)
        return np.column_stack([pairs, counts])
    rows = np.empty((3, steps.size), dtype=np.int64)
    return rows[:, : _join(np.sort((steps - begin) * span + neurons), begin, span, rows)].T


@kernel
def _extents(steps: Ints, neurons: Ints) -> tuple[int, int, int]:
    """Return the first step, the last step + 1, and the largest neuron + 1."""
    begin, end, span = 0, 0, 0
    for k in range(steps.size):
        begin = min(begin, int(steps[k])) if k else int(steps[0])
        end, span = max(end, int(steps[k]) + 1), max(span, int(neurons[k]) + 1)
    return begin, end, span


@kernel
def _join(keys: Ints, begin: int, span: int, rows: Ints) -> int:
    """Write the rows of sorted keys, `(step - begin) * span + neuron`, join equal rows, and return their number."""
    n, step, first, beyond = 0, 0, 0, 0
    for k in range(keys.size):
        if k and keys[k] == keys[k - 1]:
            rows[2, n - 1] += 1
            continue
        if keys[k] >= beyond:  # a new step; avoids a division for each key
            step = keys[k] // span
            first, beyond = step * span, step * span + span
        rows[0, n], rows[1, n], rows[2, n] = begin + step, keys[k] - first, 1
        n += 1
    return n
