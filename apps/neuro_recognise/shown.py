"""What recordings show: arrays by name for each, with labels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeAlias, TypeVar, overload

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[Any]
Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]

Evidence: TypeAlias = Mapping[str, Array]
"""What a recording shows: arrays by name, the same names for all recordings."""

T = TypeVar("T")


class Lazy(Sequence[T]):
    """A sequence whose items are made when they are asked for.

    Args:
        size: the number of items.
        item: makes that of a number from 0 on; other processes can be given one that can be pickled.
    """

    def __init__(self, size: int, item: Callable[[int], T]) -> None:
        self._size, self.item = size, item

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[T]: ...
    def __getitem__(self, index: int | slice) -> T | Sequence[T]:
        chosen = range(len(self))[index]
        return self.item(chosen) if isinstance(chosen, int) else [self.item(k) for k in chosen]


@dataclass(frozen=True, slots=True, eq=False)
class Ragged:
    """Arrays of several recordings, one after the other.

    Attributes:
        values: of all recordings.
        offsets: (recordings + 1,) recording i has ``values[offsets[i]:offsets[i + 1]]``.
    """

    values: Array
    offsets: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """What recordings show, with their labels.

    Attributes:
        evidence: of each recording.
        labels: (recordings,) indices into `classes`, -1 where unknown.
        names: of the recordings.
        classes: names.
    """

    evidence: Sequence[Evidence]
    labels: Ints
    names: tuple[str, ...]
    classes: tuple[str, ...]

    def __len__(self) -> int:
        """The number of recordings."""
        return len(self.evidence)

    def take(self, chosen: Iterable[int] | Array) -> Features:
        """Some of the recordings, in the order given."""
        indices = np.asarray(chosen if isinstance(chosen, np.ndarray) else list(chosen), np.int64)
        names = tuple(self.names[k] for k in indices)
        evidence = Lazy(len(indices), partial(_taken, self.evidence, indices))
        return replace(self, evidence=evidence, labels=self.labels[indices], names=names)

    def batches(self, size: int) -> Iterator[Features]:
        """All recordings, so many at a time; of none one empty batch."""
        for first in range(0, max(len(self), 1), size):
            yield self.take(range(first, min(first + size, len(self))))

    def column(self, name: str) -> Ragged:
        """One array of all recordings, in memory."""
        parts = [one[name] for one in self.evidence]
        lengths = [len(part) for part in parts]
        values = np.concatenate(parts) if parts else np.empty(0)
        return Ragged(values, np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int64))

    def duration_s(self) -> float | None:
        """Return how long the recordings last together, s, by their ``lasts`` in us; None where one has none."""
        if not all("lasts" in one for one in self.evidence):
            return None
        return float(self.column("lasts").values.sum()) * 1e-6

    def stacked(self, name: str) -> Array:
        """One array of all recordings that is equally large for all, (recordings, ...), in memory."""
        return np.stack([one[name] for one in self.evidence])


def unlabelled(evidence: Sequence[Evidence], classes: tuple[str, ...]) -> Features:
    """What recordings show whose classes are not known."""
    return Features(evidence, np.full(len(evidence), -1, np.int64), tuple(map(str, range(len(evidence)))), classes)


def _taken(evidence: Sequence[Evidence], indices: Ints, k: int) -> Evidence:
    return evidence[int(indices[k])]
