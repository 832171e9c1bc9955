"""A sorted sequence of recordings, and what a recogniser needs of it: labels, parts of it, folds, the sensor."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, overload

import numpy as np
import numpy.typing as npt

from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.events._events import Events
from neuro.events.errors import EventFileWarning
from neuro.events.files import load
from neuro.events.opening import opened
from neuro.events.source import WHOLE

Ints = npt.NDArray[np.int64]


UNKNOWN = -1
"""Label of a recording whose class is not known."""


class Sample(Protocol):
    """One recording.

    Attributes:
        name: of the recording within its data set.
        path: the data set with the name behind it, for messages.
        label: index of its class, `UNKNOWN` where nothing tells it.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def label(self) -> int: ...
    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""

    def read(self) -> bytes:
        """What a fingerprint is made of: the bytes of the file or, inside another file, of the events.

        Raises:
            EventFileError: they cannot be read.
        """

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, px, and whether the file or its format tells them; if not, they are those that hold all.

        Raises:
            EventFileError: the file is damaged.
        """


@dataclass(frozen=True, slots=True)
class Kept:
    """A sample whose events are kept when they were loaded."""

    sample: Sample
    _events: dict[Any, Events] = field(default_factory=dict, repr=False)

    @property
    def name(self) -> str:
        return self.sample.name

    @property
    def path(self) -> str:
        return self.sample.path

    @property
    def label(self) -> int:
        return self.sample.label

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""
        key = sensor_size, sort, strict
        if key not in self._events:
            self._events[key] = self.sample.load(sensor_size=sensor_size, sort=sort, strict=strict)
        return self._events[key]

    def read(self) -> bytes:
        """The bytes; see `Sample`."""
        return self.sample.read()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, and whether they are told; see `Sample`."""
        return self.sample.sensor()


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording that can be loaded.

    Attributes:
        name: path inside the folder or zip, with ``/``; of a part of a file, with ``#`` and its number.
        path: the folder or zip with the name behind it, for messages.
        label: index of its class in `Recordings.classes`; `neuro.events.dataset.UNKNOWN`, -1, where nothing tells it.
        read: gives the bytes of the file.
        span_us: of a file with several recordings, the first us of this one and the one after its last.
        sensor_size: width and height that its data set is known for, px.
    """

    name: str
    path: str
    label: int
    read: Callable[[], bytes]
    span_us: tuple[int, int] | None = None
    sensor_size: tuple[int, int] | None = None

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""
        size = sensor_size or self.sensor_size
        events = load(self.read(), name=self.path, sensor_size=size, sort=sort, strict=strict)
        return events if self.span_us is None else events.between(*self.span_us)

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, px, and whether data set, file or format tell them; if not, they are those that hold all.

        Raises:
            EventFileError: the file is damaged.
        """
        if self.sensor_size is not None:
            return self.sensor_size, True
        with opened(self.read(), None, self.path) as file:
            if told := file.sensor_size:
                return told, True
            size = file.scanned(WHOLE)
            return size, size in (file.format.usual, *file.format.larger)


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
        n, labels = argument("n", n, kind="integer", at_least=2), self.labels
        argument("seed", seed, whole=True, at_least=0)
        self._check_folds(n, labels)
        rng = np.random.default_rng([int(seed), 7])
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
