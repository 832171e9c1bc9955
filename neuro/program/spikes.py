"""Storage of recorded spikes, for backends with compiled loops."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.memory import free_memory
from neuro.program.backend import Spikes
from neuro.program.program import Ints, Population, Program

Part = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]
_NAMES = ("record.steps", "record.ids", "record.counts")
_NO_INTS = np.zeros(0, dtype=np.int64)


class RecordedSpikes:
    """Chunks, oldest first. A chunk has a part for each thread: (steps, neurons, multiplicity) sorted by step."""

    def __init__(self) -> None:
        self._chunks: list[list[Part]] = []

    def take(self, parts: Iterable[Part]) -> None:
        """Add a copy of the spikes that the loop recorded."""
        chunk = [(steps.copy(), ids.copy(), counts.copy()) for steps, ids, counts in parts if steps.size]
        if chunk:
            self._chunks.append(chunk)

    def spikes(self, begin: int, end: int, since: int, ids_at: Ints | None = None) -> Spikes:
        """Return the spikes of the neurons from begin to end with step > since, by step, then id.

        Args:
            begin: index of the population's first neuron among all neurons.
            end: index after its last neuron.
            since: the last step to leave out.
            ids_at: the id of the neuron at each place, where neurons are reordered.
        """
        parts: list[Part] = []
        for chunk in reversed(self._chunks):
            if max(int(steps[-1]) for steps, _, _ in chunk) <= since:
                break
            parts += [_spikes_of(part, begin, end, since) for part in reversed(chunk)]
        parts = [part for part in reversed(parts) if part[0].size]
        if not parts:
            return Spikes(_NO_INTS, _NO_INTS, _NO_INTS)
        steps, neurons, counts = parts[0] if len(parts) == 1 else _joined(parts)
        ids = neurons.astype(np.int64) - begin
        if ids_at is not None:
            ids = ids_at[ids]
        if ids_at is not None or len(parts) > 1:
            order = np.lexsort((ids, steps))
            steps, ids, counts = steps[order], ids[order], counts[order]
        return Spikes(steps, ids, counts.astype(np.int64, copy=False))

    def forget(self, before: int) -> None:
        """Drop spikes with step <= before."""
        chunks = [[_after(part, before) for part in chunk if part[0][-1] > before] for chunk in self._chunks]
        self._chunks = [chunk for chunk in chunks if chunk]

    def nbytes(self) -> int:
        """Return the size of the stored spikes in bytes."""
        return sum(array.nbytes for chunk in self._chunks for part in chunk for array in part)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all spikes in one chunk."""
        empty = (_NO_INTS, np.zeros(0, np.int32), _NO_INTS)
        steps, ids, counts = _joined([empty, *(part for chunk in self._chunks for part in chunk)])
        order = np.lexsort((ids, steps))
        return dict(zip(_NAMES, (steps[order], ids[order], counts[order]), strict=True))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Replace all spikes by those of a snapshot."""
        steps, ids, counts = (arrays[name] for name in _NAMES)
        self._chunks = []
        self.take([(steps, ids.astype(np.int32), counts.astype(np.int64))])


def too_many(part: Population) -> ModelError:
    """Return the error for a population with a neuron whose spikes overflow a 64-bit count."""
    return ModelError(
        f"population '{part.name}': a neuron sent 2^63 spikes or more, in a step or in total: expected fewer",
        where=part.origin,
        hint="check the connections: a loop of parrot neurons can multiply spikes in every round",
    )


def one_by_one(name: str, multiplicity: Ints, *columns: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Repeat each entry of the columns by its multiplicity, e.g. ids [4, 7] with multiplicity [1, 2]: [4, 7, 7].

    Raises:
        ModelError: the repeated columns do not fit into memory.
    """
    if not multiplicity.size or multiplicity.max() == 1:
        return columns
    number, free = sum(multiplicity.tolist()), free_memory()
    n_bytes = 16 * len(columns) * number
    if free is not None and n_bytes > free:
        raise ModelError(
            f"spikes of '{name}': a list of {number:,} spikes needs {n_bytes:,} bytes: expected at most {free:,}, the "
            "free memory",
            hint="sim.counts() has the number of spikes; in results, `multiplicity` counts them per neuron and step",
        )
    return tuple(np.repeat(column, multiplicity) for column in columns)


def _spikes_of(part: Part, begin: int, end: int, since: int) -> Part:
    """Return the spikes of a part that belong to one population and are later than a step."""
    steps, neurons, counts = part
    keep = (neurons >= begin) & (neurons < end)
    if steps[0] <= since:
        keep &= steps > since
    return steps[keep], neurons[keep], counts[keep]


def _after(part: Part, before: int) -> Part:
    """Return the spikes of a part that are later than a step."""
    first = int(np.searchsorted(part[0], before, side="right"))
    return part if first == 0 else (part[0][first:].copy(), part[1][first:].copy(), part[2][first:].copy())


def _joined(parts: list[Part]) -> Part:
    steps, neurons, counts = zip(*parts, strict=True)
    return np.concatenate(steps), np.concatenate(neurons), np.concatenate(counts)


def carrying(part: Population, spikes: Spikes) -> Spikes:
    """Return recorded spikes of a population, with the stored numbers as payloads if the population is graded."""
    if not part.model.graded:
        return spikes
    return Spikes(spikes.steps, spikes.ids, np.ones_like(spikes.multiplicity), spikes.multiplicity.astype(np.int32))


def nothing_listed(program: Program, threads: int = 1) -> dict[str, Ints]:
    """Return the arrays of `neuro.program.listed` for a program without listed populations."""
    lists = dict.fromkeys(("list_steps", "list_ids", "list_counts"), _NO_INTS)
    return {**lists, "cursor": np.zeros((threads + 1, len(program.populations)), dtype=np.int64)}
