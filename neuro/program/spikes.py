"""Spikes that an engine recorded, for backends with compiled loops."""

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
    """Chunks, oldest first; a chunk has a part for each thread: (steps, neurons, multiplicity) by step."""

    def __init__(self) -> None:
        self._chunks: list[list[Part]] = []

    def take(self, parts: Iterable[Part]) -> None:
        """Add a copy of what the loop has recorded."""
        chunk = [(steps.copy(), ids.copy(), counts.copy()) for steps, ids, counts in parts if steps.size]
        if chunk:
            self._chunks.append(chunk)

    def spikes(self, begin: int, end: int, since: int, ids_at: Ints | None = None) -> Spikes:
        """Spikes of the neurons from begin to end with step > since, by step, then id.

        Args:
            begin: the first neuron of the population among all.
            end: one after its last.
            since: the last step to leave out.
            ids_at: the id at each place of the population, where this is not the place itself.
        """
        found: list[Part] = []
        for chunk in reversed(self._chunks):
            if max(int(steps[-1]) for steps, _, _ in chunk) <= since:
                break
            found += [_chosen(part, begin, end, since) for part in reversed(chunk)]
        found = [part for part in reversed(found) if part[0].size]
        if not found:
            return Spikes(_NO_INTS, _NO_INTS, _NO_INTS)
        steps, neurons, counts = found[0] if len(found) == 1 else _joined(found)
        ids = neurons.astype(np.int64) - begin
        if ids_at is not None:
            ids = ids_at[ids]
        if ids_at is not None or len(found) > 1:
            order = np.lexsort((ids, steps))
            steps, ids, counts = steps[order], ids[order], counts[order]
        return Spikes(steps, ids, counts.astype(np.int64, copy=False))

    def forget(self, before: int) -> None:
        """Drop spikes with step <= before."""
        kept = [[_after(part, before) for part in chunk if part[0][-1] > before] for chunk in self._chunks]
        self._chunks = [chunk for chunk in kept if chunk]

    def nbytes(self) -> int:
        """Bytes held."""
        return sum(array.nbytes for chunk in self._chunks for part in chunk for array in part)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """All chunks joined."""
        empty = (_NO_INTS, np.zeros(0, np.int32), _NO_INTS)
        steps, ids, counts = _joined([empty, *(part for chunk in self._chunks for part in chunk)])
        order = np.lexsort((ids, steps))
        return dict(zip(_NAMES, (steps[order], ids[order], counts[order]), strict=True))

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        steps, ids, counts = (arrays[name] for name in _NAMES)
        self._chunks = []
        self.take([(steps, ids.astype(np.int32), counts.astype(np.int64))])


def too_many(part: Population) -> ModelError:
    """Return the error of a population one of whose neurons sent more spikes than 64 bits count."""
    return ModelError(
        f"population '{part.name}': a neuron sent 2^63 spikes or more, in a step or in all: expected fewer",
        where=part.origin,
        hint="of parrot neurons that reach each other the spikes multiply in every round",
    )


def one_by_one(name: str, multiplicity: Ints, *columns: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """List several spikes of a neuron in a step as often.

    Raises:
        ModelError: the memory does not hold so many.
    """
    if not multiplicity.size or multiplicity.max() == 1:
        return columns
    number, free = sum(multiplicity.tolist()), free_memory()
    needed = 16 * len(columns) * number
    if free is not None and needed > free:
        raise ModelError(
            f"spikes of '{name}': {number:,} spikes one by one need {needed:,} bytes: expected at most {free:,}, which "
            "are free",
            hint="sim.counts() has their number; in results `multiplicity` has that of each neuron and step",
        )
    return tuple(np.repeat(column, multiplicity) for column in columns)


def _chosen(part: Part, begin: int, end: int, since: int) -> Part:
    """Those spikes of a part that are of one population and after a step."""
    steps, neurons, counts = part
    keep = (neurons >= begin) & (neurons < end)
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


def carrying(part: Population, found: Spikes) -> Spikes:
    """Recorded spikes of a population, whose numbers are payloads where it is graded."""
    if not part.model.graded:
        return found
    return Spikes(found.steps, found.ids, np.ones_like(found.multiplicity), found.multiplicity.astype(np.int32))


def nothing_listed(program: Program, threads: int = 1) -> dict[str, Ints]:
    """The arrays of `neuro.program.listed` for a program none of whose populations is listed."""
    lists = dict.fromkeys(("list_steps", "list_ids", "list_counts"), _NO_INTS)
    return {**lists, "cursor": np.zeros((threads + 1, len(program.populations)), dtype=np.int64)}
