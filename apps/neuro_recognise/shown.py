"""Evidence of recordings, with labels. Evidence is named arrays that a method computes from a recording's events."""

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
"""Arrays by name that a method computes from the events of one recording. All recordings have the same names."""

T = TypeVar("T")


class Lazy(Sequence[T]):
    """A sequence whose items are computed on access and not stored.

    Args:
        size: number of items.
        item: function from an index (0 ... size - 1) to the item. It must be picklable if the sequence goes to
            another process.
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
        indices = range(len(self))[index]
        return self.item(indices) if isinstance(indices, int) else [self.item(k) for k in indices]


@dataclass(frozen=True, slots=True, eq=False)
class Ragged:
    """Arrays of several recordings, concatenated.

    Attributes:
        values: values of all recordings.
        offsets: (recordings + 1,) indices; the values of recording i are ``values[offsets[i]:offsets[i + 1]]``.
    """

    values: Array
    offsets: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Evidence of recordings, with their labels.

    Attributes:
        evidence: evidence of each recording.
        labels: (recordings,) indices into `classes`, -1 if unknown.
        names: names of the recordings.
        classes: names of the classes.
    """

    evidence: Sequence[Evidence]
    labels: Ints
    names: tuple[str, ...]
    classes: tuple[str, ...]

    def __len__(self) -> int:
        """The number of recordings."""
        return len(self.evidence)

    def take(self, chosen: Iterable[int] | Array) -> Features:
        """Return the recordings at these indices, in this order."""
        indices = np.asarray(chosen if isinstance(chosen, np.ndarray) else list(chosen), np.int64)
        names = tuple(self.names[k] for k in indices)
        evidence = Lazy(len(indices), partial(_evidence_at, self.evidence, indices))
        return replace(self, evidence=evidence, labels=self.labels[indices], names=names)

    def batches(self, size: int) -> Iterator[Features]:
        """Yield all recordings in batches of `size`; without recordings, yield one empty batch."""
        for first in range(0, max(len(self), 1), size):
            yield self.take(range(first, min(first + size, len(self))))

    def column(self, name: str) -> Ragged:
        """Load the array `name` of every recording into memory, and concatenate these arrays."""
        parts = [item[name] for item in self.evidence]
        lengths = [len(part) for part in parts]
        values = np.concatenate(parts) if parts else np.empty(0)
        return Ragged(values, np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int64))

    def duration_s(self) -> float | None:
        """Return the sum of ``lasts`` (us) over the recordings, in s; None if a recording has no ``lasts``."""
        total = self.total("lasts")
        return None if total is None else total * 1e-6

    def total(self, name: str) -> float | None:
        """Return the sum of the array `name` over all recordings; None if a recording lacks the array."""
        return float(self.column(name).values.sum()) if all(name in item for item in self.evidence) else None

    def stacked(self, name: str) -> Array:
        """Load an array that has the same shape in every recording, and stack it to (recordings, ...)."""
        return np.stack([item[name] for item in self.evidence])


def unlabelled(evidence: Sequence[Evidence], classes: tuple[str, ...]) -> Features:
    """Return evidence as features without labels: every label is -1, and names are indices."""
    return Features(evidence, np.full(len(evidence), -1, np.int64), tuple(map(str, range(len(evidence)))), classes)


def _evidence_at(evidence: Sequence[Evidence], indices: Ints, k: int) -> Evidence:
    return evidence[int(indices[k])]
