"""Sequences of labelled recordings: listing, parts, folds, and one sensor size for all recordings."""

from __future__ import annotations

import hashlib
import os
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, overload

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import argument, file_path, record_input
from neuro_events._events import Events
from neuro_events.dataset._layouts import (
    ARCHIVES,
    FileContent,
    Layout,
    LayoutItem,
    files_of,
    is_hdf5,
    is_part,
    layout_of,
    natural,
)
from neuro_events.dataset._pictures import is_pictures, pictures
from neuro_events.dataset._store import holds_samples, stored_samples
from neuro_events.files import load
from neuro_events.opening import find, opened
from neuro_events.source import WHOLE, EventFileError, EventFileWarning, opened_source

Ints = npt.NDArray[np.int64]


UNKNOWN = -1
"""Label of a recording of unknown class."""


class Sample(Protocol):
    """A labelled recording.

    Attributes:
        name: name of the recording within its data set.
        path: path of the data set followed by the name, for messages.
        label: index of its class, `UNKNOWN` if unknown.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def label(self) -> int: ...
    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """Return the events; arguments and errors as for `neuro.events.load`."""

    def read(self) -> bytes:
        """Return the bytes for a fingerprint: the bytes of the file, or of the events if the file has many recordings.

        Raises:
            EventFileError: the content cannot be read.
        """

    def stamp(self) -> str:
        """Return a text that differs after a change of the content, without reading the recording if possible."""

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Return the width and height, px, and True if the file or the format states the size.

        If neither does, the size is the smallest sensor that contains all events.

        Raises:
            EventFileError: the file is damaged.
        """


@dataclass(frozen=True, slots=True)
class Recording:
    """A recording in a file of a folder or zip.

    Attributes:
        name: path inside the folder or zip, with ``/``. If the file has several recordings, ``#`` and a number follow.
        path: path of the folder or zip followed by the name, for messages.
        label: index of its class in `Recordings.classes`; `neuro.events.dataset.UNKNOWN`, -1, if unknown.
        read: function that returns the bytes of the file.
        span_us: first us and end (exclusive) of the recording in a file with several recordings. None: all events.
        sensor_size: width and height that all recordings of the data set have, px. None: see `sensor`.
    """

    name: str
    path: str
    label: int
    read: Callable[[], bytes]
    span_us: tuple[int, int] | None = None
    sensor_size: tuple[int, int] | None = None

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """Return the events; arguments and errors as for `neuro.events.load`."""
        size = sensor_size or self.sensor_size
        events = load(self.read(), name=self.path, sensor_size=size, sort=sort, strict=strict)
        return events if self.span_us is None else events.between(*self.span_us)

    def stamp(self) -> str:
        """Return the stamp of `read` if `read` has this method, else a digest of the bytes; see `Sample`."""
        stamp: Callable[[], str] | None = getattr(self.read, "stamp", None)
        return stamp() if stamp else hashlib.sha256(self.read()).hexdigest()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Return the width and height, px, and whether the data set, the file or the format states them.

        If none does, the size is the smallest sensor that contains all events.

        Raises:
            EventFileError: the file is damaged.
        """
        if self.sensor_size is not None:
            return self.sensor_size, True
        with opened(self.read(), None, self.path) as file:
            if stated := file.sensor_size:
                return stated, True
            size = file.scanned(WHOLE)
            return size, size in (file.format.usual, *file.format.larger)


class Recordings(Sequence[Sample]):
    """A sorted sequence of recordings, each read on access.

    Attributes:
        path: the folder, zip or file.
        classes: class names; the label of a recording is an index into them.
        layout: name of the layout, see `neuro.events.dataset.LAYOUTS`; ``"hdf5"`` for an HDF5 file of recordings,
            ``"pictures"`` for an NPZ file of grey pictures, ``"recording"`` for a single recording.
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
        """Label of each recording, (recordings,) int64; `neuro.events.dataset.UNKNOWN`, -1, for an unknown class."""
        return np.array([item.label for item in self], np.int64)

    def take(self, indices: npt.ArrayLike) -> Recordings:
        """Return some of the recordings, in the given order.

        Args:
            indices: (n,) whole numbers; negative numbers count from the end.

        Raises:
            ModelError: `indices` are not whole numbers (for a mask use `numpy.flatnonzero`), or one is out of range.
        """
        places = np.asarray(indices)
        if places.ndim != 1 or (places.size and places.dtype.kind not in "iu"):
            hint = "numpy.flatnonzero(mask) gives the indices of a mask" if places.dtype == bool else ""
            raise ModelError(f"take({indices!r:.60}): expected indices, whole numbers in one axis", hint=hint)
        absent = places[(places < -len(self)) | (places >= len(self))]
        if absent.size:
            raise ModelError(f"take: index {absent[0]}, expected {-len(self)} to {len(self) - 1}: {self!r}")
        return Recordings(self.path, [self._items[int(k)] for k in places], self.classes, self.layout)

    def folds(self, n: int, *, seed: int) -> list[tuple[Ints, Ints]]:
        """Divide the recordings for cross-validation, with the same share of each class in every fold.

        Args:
            n: number of folds, >= 2.
            seed: seed of the random assignment, >= 0.

        Returns:
            For each fold the indices for training and the indices for testing, both ascending. Each recording is tested
            once. The sizes of two folds, and their numbers of recordings of a class, differ by at most one.

        Raises:
            ModelError: a class has fewer recordings than there are folds, or the class of a recording is unknown.
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
                shortage = f"class '{self.classes[label]}' has {count} recording{'s' if count > 1 else ''}"
                hint = "every fold needs at least one recording of each class"
                raise ModelError(f"folds({n}): {shortage}, expected at least {n}", hint=hint)

    def sensor_size(self, *, setting: str = "sensor_size=(width, height), or --sensor WxH") -> tuple[int, int]:
        """Return the width and height of the largest sensor of the recordings, px.

        Files that state their sensor are only opened, others are read. There is a warning if sensors differ, or if a
        recording does not state its sensor. In the second case the size is the smallest that contains the events of
        these recordings; further recordings of the same camera may exceed it.

        Args:
            setting: name of the user's setting for another size, for the warning.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: there are no recordings.
        """
        if not self:
            raise ModelError(f"{self!r}: has no recording, expected at least one to determine the sensor")
        sensors = [(*item.sensor(), item.name) for item in self]
        width, height = (max(size[axis] for size, _, _ in sensors) for axis in (0, 1))
        if doubt := _sensor_doubt(sensors):
            text = f"{self.path}: {doubt}: assuming {_size_text((width, height))}, which contains every event"
            warnings.warn(f"{text}; {setting} sets another", EventFileWarning, stacklevel=2)
        return width, height

    def fingerprint(self) -> str:
        """Return a SHA-256 digest of classes, names, labels and contents, equal for equal data at any path.

        All recordings are read, one at a time. An HDF5 file and its source folder have different digests, since the
        names of the recordings differ.

        Raises:
            EventFileError: a recording cannot be read.
        """
        digest = hashlib.sha256(repr(self.classes).encode())
        for item in self:
            data = item.read()
            digest.update(f"\0{item.name}\0{item.label}\0{len(data)}\0".encode())
            digest.update(data)
        return digest.hexdigest()


def _sensor_doubt(sensors: Sequence[tuple[tuple[int, int], bool, str]]) -> str:
    """Return the reason why the largest sensor may be wrong, or "" if it is certain.

    Args:
        sensors: for each recording its sensor size, True if the file states the size, and its name.
    """
    unstated = [name for _, stated, name in sensors if not stated]
    if unstated:
        return f"{len(unstated)} of {len(sensors)} recordings do not state their sensor, such as {unstated[0]}"
    names = {size: name for size, _, name in reversed(sensors)}
    if len(names) == 1:
        return ""
    (small, first), (large, last) = min(names.items()), max(names.items())
    return f"sensors differ, such as {_size_text(small)} of {first} and {_size_text(large)} of {last}"


def _size_text(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def recordings(
    path: str | os.PathLike[str],
    *,
    part: str | None = None,
    classes: Sequence[str] | None = None,
    layout: str | None = None,
    ending: str | None = None,
    whole: bool = True,
    label: str | None = None,
) -> Recordings:
    """List the labelled recordings of a folder, a zip or an HDF5 file, or a single recording.

    The layouts of well-known data sets are detected, see `neuro.events.dataset.LAYOUTS`. Otherwise the class of a file
    is the name of its folder, at any depth (``Train/<digit>/<index>.bin``), and files without class folders need a
    ``MANIFEST.csv`` with the columns file, label, class. An HDF5 file has ``/<class>/<sample>``, as
    `neuro.events.Dataset.to_hdf5` and ``neuro events tohdf5`` write it. Files may have any format that
    `neuro.events.load` reads, and the formats may differ. A single recording has the class ``label``. An NPZ file of
    ``images`` (n, height, width) uint8 and ``labels`` (n,) has one recording per picture, with one event per grey level
    of a pixel.

    Args:
        path: the folder, zip, HDF5 file or recording.
        part: part of the data, such as ``Train`` or ``Test``, in any case. None: all.
        classes: class names in the order of their labels, for example those of the training data. None: the classes of
            the data: folders sorted by name (numbers by value), or the classes of a manifest sorted by their labels.
        layout: name of the layout of a folder or zip. None: detected.
        ending: ending of the files of a folder or zip to list, such as ``bin``. None: all.
        whole: accept data without parts as any part. Accept data with only one part as the other part, with a warning.
            False: only data of the requested part are accepted.
        label: class name of a single recording. None: its label is -1, `neuro.events.dataset.UNKNOWN`.

    Returns:
        The recordings, sorted by name (numbers by value). A recording is read on access, so its `load` reports damage,
        with an `EventFileError` that names its path.

    Raises:
        EventFileError: no such path, no recordings, a class that is not in ``classes``, or an invalid manifest.
        ModelError: `path` is not a file name, or an option does not apply to this kind of data.
    """
    record_input(file_path(path, "path"))
    place = os.fspath(path)
    options = {"layout": layout, "ending": ending, "part": None if whole else part}
    if is_hdf5(place) and holds_samples(place):
        _refuse_options(
            place, "an HDF5 file", options | {"layout": None if layout == "hdf5" else layout, "label": label}
        )
        class_names, samples = stored_samples(place, classes)
        return Recordings(place, samples, class_names, "hdf5")
    if is_pictures(place):
        _refuse_options(place, "an NPZ file of pictures", options | {"label": label})
        class_names, stills = pictures(place, classes)
        return Recordings(place, stills, class_names, "pictures")
    if _is_recording(place):
        _refuse_options(place, "a single recording", options)
        return _single_recording(Path(path), place, classes, label)
    _refuse_options(place, "not a single recording", {"label": label})
    return list_recordings(place, part, classes, layout, ending, whole)


def _refuse_options(place: str, kind: str, options: Mapping[str, str | None]) -> None:
    """Raise an error about options that do not apply to a kind of data."""
    for name, value in options.items():
        if value is not None:
            raise ModelError(f"{name}={value!r}: expected None, since {place} is {kind}")


def _is_recording(place: str) -> bool:
    """Return whether the path is a file of a known event format. A zip of recordings is not.

    Raises:
        EventFileError: the file is of an unknown kind.
    """
    if not Path(place).is_file():
        return False
    with opened_source(place, None) as source:
        try:
            find(source)
        except EventFileError:
            if zipfile.is_zipfile(place) or place.lower().endswith(ARCHIVES):
                return False
            raise
    return True


def _single_recording(path: Path, place: str, classes: Sequence[str] | None, label: str | None) -> Recordings:
    class_names = tuple(classes if classes is not None else () if label is None else (label,))
    if label is not None and label not in class_names:
        raise EventFileError(place, f"class {label!r} is new, expected one of {', '.join(class_names)}")
    number = UNKNOWN if label is None else class_names.index(label)
    return Recordings(place, [Recording(path.name, place, number, FileContent(path))], class_names, "recording")


PARTS = ("train", "test")
"""Names of parts that identify data with parts."""


def list_recordings(
    where: str,
    part: str | None,
    classes: Sequence[str] | None,
    layout: str | None,
    ending: str | None,
    whole: bool,
) -> Recordings:
    """List the recordings of a folder or zip; arguments and errors as for `neuro.events.recordings`."""
    files = files_of(where)
    if ending is not None:
        tail = f".{ending.lower().lstrip('.')}"
        files = {name: read for name, read in files.items() if name.lower().endswith((tail, ".csv", ".txt"))}
    data_layout = layout_of(where, files, layout)
    items = [item for item in data_layout.find(where, files) if ending is None or item.file.lower().endswith(tail)]
    if not items:
        raise EventFileError(where, f"no recordings with names that end in {tail}")
    classes_in_order = list(dict.fromkeys(item.label for item in items))
    items = _items_of_part(where, data_layout, sorted(items, key=lambda item: natural(item.name)), part, whole)
    labels = {item.label for item in items}
    present_classes = [c for c in classes_in_order if c in labels]
    if classes is None:
        classes = present_classes
    if absent := [c for c in present_classes if c not in classes]:
        raise EventFileError(where, f"class {absent[0]!r} is new, expected one of {', '.join(classes)}")
    index = {c: k for k, c in enumerate(classes)}
    size = data_layout.sensor_size
    members = [Recording(i.name, f"{where}/{i.name}", index[i.label], files[i.file], i.span_us, size) for i in items]
    return Recordings(where, members, classes, data_layout.name)


def _items_of_part(
    place: str, layout: Layout, items: list[LayoutItem], part: str | None, is_whole: bool
) -> list[LayoutItem]:
    """Return the items of a part."""
    if part is None:
        return items
    name_of_part = part.lower()
    if members := [item for item in items if layout.in_part(item, name_of_part)]:
        return members
    lists = {name: [item for item in items if layout.in_part(item, name)] for name in PARTS}
    matches = [name for name in PARTS if len(lists[name]) == len(items)]
    if matches and is_whole:
        warnings.warn(f"{place}: has only the part '{matches[0]}', used as {part!r}", EventFileWarning, stacklevel=4)
        return items
    if any(lists.values()):
        raise EventFileError(place, f"no recordings in a folder {part!r}")
    if is_whole or is_part(Path(place).resolve().stem, name_of_part):
        return items
    raise EventFileError(place, f"has no parts, expected one named {part!r}; split() divides it")
