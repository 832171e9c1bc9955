"""A sorted sequence of recordings, and what a recogniser needs of it: labels, parts of it, folds, the sensor."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterator, Sequence
from typing import overload

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.events import _arguments
from neuro.events.dataset._sample import UNKNOWN, Sample
from neuro.events.errors import EventFileWarning

Ints = npt.NDArray[np.int64]


class Recordings(Sequence[Sample]):
    """A sorted sequence of recordings, each read when it is asked for.

    Attributes:
        path: the folder, zip or file.
        classes: class names; the label of a recording is an index into them.
        layout: name of the layout, see `neuro.events.dataset.LAYOUTS`; ``"hdf5"`` for an HDF5 file of recordings,
            ``"recording"`` for a single one.
    """

    def __init__(self, path: str, items: Sequence[Sample], classes: Sequence[str], layout: str = "") -> None:
        self.path = path
        self.classes = tuple(classes)
        self.layout = layout
        self._items = tuple(items)

    @overload
    def __getitem__(self, index: int) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> Recordings: ...
    def __getitem__(self, index: int | slice) -> Sample | Recordings:
        if isinstance(index, slice):
            return Recordings(self.path, self._items[index], self.classes, self.layout)
        return self._items[index]

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[Sample]:
        return iter(self._items)

    def __repr__(self) -> str:
        return f"<Recordings {len(self)} of {len(self.classes)} classes in {self.path}>"

    @property
    def labels(self) -> Ints:
        """(recordings,) int64, the label of each; `neuro.events.dataset.UNKNOWN`, -1, where nothing tells the class."""
        return np.array([item.label for item in self], np.int64)

    def take(self, indices: npt.ArrayLike) -> Recordings:
        """Some of the recordings, in the order given.

        Args:
            indices: (n,) whole numbers; below 0 they count from the end.

        Raises:
            ModelError: they are something else (a mask needs `numpy.flatnonzero`), or there is no such recording.
        """
        chosen = np.asarray(indices)
        if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "iu"):
            hint = "numpy.flatnonzero(mask) gives the indices of a mask" if chosen.dtype == bool else ""
            raise ModelError(f"take({indices!r:.60}): expected indices, whole numbers in one axis", hint=hint)
        absent = chosen[(chosen < -len(self)) | (chosen >= len(self))]
        if absent.size:
            raise ModelError(f"take: index {absent[0]}, expected {-len(self)} to {len(self) - 1}: {self!r}")
        return Recordings(self.path, [self._items[int(k)] for k in chosen], self.classes, self.layout)

    def folds(self, n: int, *, seed: int) -> list[tuple[Ints, Ints]]:
        """Divide the recordings for cross-validation, with the same share of each class in every fold.

        Args:
            n: number of folds, >= 2.
            seed: which recordings lie in which fold, >= 0.

        Returns:
            For each fold the indices to learn from and those to test on, both ascending. Each recording is tested on
            once; sizes of folds, and numbers of a class in them, differ by at most one.

        Raises:
            ModelError: a class has fewer recordings than there are folds, or a recording no class.
        """
        n, seed, labels = _arguments.whole("n", n, 2), _arguments.whole("seed", seed, 0), self.labels
        self._check_folds(n, labels)
        rng = np.random.default_rng([seed, 7])
        order = np.concatenate([rng.permutation(np.flatnonzero(labels == k)) for k in np.unique(labels)] or [labels])
        fold = np.empty(len(self), np.int64)
        fold[order] = np.arange(len(self)) % n
        return [(np.flatnonzero(fold != k), np.flatnonzero(fold == k)) for k in range(n)]

    def _check_folds(self, n: int, labels: Ints) -> None:
        for label, count in zip(*np.unique(labels, return_counts=True), strict=True):
            if label == UNKNOWN:
                first = next(item.path for item in self if item.label == UNKNOWN)
                raise ModelError(f"folds({n}): the class of {first} is unknown, expected one for each")
            if count < n:
                has = f"class '{self.classes[label]}' has {count} recording{'s' if count > 1 else ''}"
                hint = "one of each class lies in every fold"
                raise ModelError(f"folds({n}): {has}, expected at least {n}", hint=hint)

    def sensor_size(self, *, setting: str = "sensor_size=(width, height), or --sensor WxH") -> tuple[int, int]:
        """Width and height of the field that holds all recordings, px: the largest that any has.

        Files that tell their sensor are opened for it, others read. A warning says where sensors differ, and where
        none is told: then the field is what events reach, and other recordings of the same camera may not fit.

        Args:
            setting: what users set to have another, as the warning calls it.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: there is no recording.
        """
        if not self:
            raise ModelError(f"{self!r}: has no recording, expected at least one to find the sensor")
        found = [(*item.sensor(), item.name) for item in self]
        width, height = (max(size[axis] for size, _, _ in found) for axis in (0, 1))
        if what := _doubt(found):
            text = f"{self.path}: {what}: {_by((width, height))} is taken, which holds all; {setting} gives another"
            warnings.warn(text, EventFileWarning, stacklevel=2)
        return width, height

    def fingerprint(self) -> str:
        """SHA-256 over classes, names, labels and contents: equal for equal data, wherever it lies.

        All recordings are read, one at a time. An HDF5 file differs from the folder that it was made of, since its
        recordings have other names.

        Raises:
            EventFileError: a recording cannot be read.
        """
        digest = hashlib.sha256(repr(self.classes).encode())
        for item in self:
            data = item.read()
            digest.update(f"\0{item.name}\0{item.label}\0{len(data)}\0".encode())
            digest.update(data)
        return digest.hexdigest()


def _doubt(found: Sequence[tuple[tuple[int, int], bool, str]]) -> str:
    """Why the largest sensor may not be what was recorded with; sizes, whether they are told, and names."""
    untold = [name for _, told, name in found if not told]
    if untold:
        return f"{len(untold)} of {len(found)} recordings do not tell their sensor, such as {untold[0]}"
    names = {size: name for size, _, name in reversed(found)}
    if len(names) == 1:
        return ""
    (small, first), (large, last) = min(names.items()), max(names.items())
    return f"sensors differ, such as {_by(small)} of {first} and {_by(large)} of {last}"


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
