"""Recordings wherever they lie, as a sorted sequence: labels, parts of it, folds, the sensor."""

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
"""Label of a recording whose class is not known."""


class Sample(Protocol):
    """One recording.

    Attributes:
        name: of the recording within its data set.
        path: the data set with the name behind it, for messages.
        label: index of its class, `UNKNOWN` where it is unknown.
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

    def stamp(self) -> str:
        """Return a text that differs after the content has changed, found without reading the recording if possible."""

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, px, and whether the file or its format states them; if not, they are those that hold all.

        Raises:
            EventFileError: the file is damaged.
        """


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording that can be loaded.

    Attributes:
        name: path inside the folder or zip, with ``/``; of a part of a file, with ``#`` and its number.
        path: the folder or zip with the name behind it, for messages.
        label: index of its class in `Recordings.classes`; `neuro.events.dataset.UNKNOWN`, -1, where it is unknown.
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

    def stamp(self) -> str:
        """Return the stamp of `read` where it has one, else a digest of the bytes; see `Sample`."""
        stamp: Callable[[], str] | None = getattr(self.read, "stamp", None)
        return stamp() if stamp else hashlib.sha256(self.read()).hexdigest()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, px, and whether data set, file or format tell them; if not, they are those that hold all.

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
    """A sorted sequence of recordings, each read when it is asked for.

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
        """(recordings,) int64, the label of each; `neuro.events.dataset.UNKNOWN`, -1, where the class is unknown."""
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
        none is stated: then the field is what events reach, and other recordings of the same camera may not fit.

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
    """Why the largest sensor may not be what was recorded with; sizes, whether they are stated, and names."""
    untold = [name for _, stated, name in found if not stated]
    if untold:
        return f"{len(untold)} of {len(found)} recordings do not tell their sensor, such as {untold[0]}"
    names = {size: name for size, _, name in reversed(found)}
    if len(names) == 1:
        return ""
    (small, first), (large, last) = min(names.items()), max(names.items())
    return f"sensors differ, such as {_by(small)} of {first} and {_by(large)} of {last}"


def _by(size: tuple[int, int]) -> str:
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
    """Find the labelled recordings of a folder, a zip or an HDF5 file, or take a single recording.

    The layouts of well-known data sets are recognised, see `neuro.events.dataset.LAYOUTS`. In any other, the class of
    a file is the name of the folder it lies in, at any depth (``Train/<digit>/<index>.bin``), and files without class
    folders need a ``MANIFEST.csv`` beside them with the columns file, label, class. An HDF5 file has
    ``/<class>/<sample>``, as `neuro.events.Dataset.to_hdf5` and ``neuro events tohdf5`` write it. Files may be of any
    format that `neuro.events.load` reads, also of several. A single recording has the class of ``label``. An NPZ
    file of ``images`` (n, height, width) uint8 and ``labels`` (n,) has a recording for each picture, with as many
    events of a pixel as its grey level.

    Args:
        path: the folder, zip, HDF5 file or recording.
        part: of data with parts, such as ``Train`` and ``Test``, only this one; upper and lower case are the same.
        classes: class names in the order of their labels, of the data trained on for example; None
            takes those found: folders by name (numbers by value), those of a manifest by its labels.
        layout: name of the layout of a folder or zip; None finds it.
        ending: only files of a folder or zip whose names end so, such as ``bin``.
        whole: whether data without parts stands for any part, and data that has only one for the other, which a
            warning says; if not, only ``Train`` and its like stand for themselves.
        label: name of the class of a single recording; None: its label is -1, `neuro.events.dataset.UNKNOWN`.

    Returns:
        The recordings, sorted by name (numbers by value). None is read yet, so a damaged one is reported when it is
        loaded, by an `EventFileError` with its path.

    Raises:
        EventFileError: no such path, no recording in it, a class that ``classes`` lacks, a wrong manifest.
        ModelError: `path` is no name of a file; an option that this kind of data cannot have.
    """
    record_input(file_path(path, "path"))
    where = os.fspath(path)
    asked = {"layout": layout, "ending": ending, "part": None if whole else part}
    if is_hdf5(where) and holds_samples(where):
        _refuse(where, "an HDF5 file", asked | {"layout": None if layout == "hdf5" else layout, "label": label})
        known, samples = stored_samples(where, classes)
        return Recordings(where, samples, known, "hdf5")
    if is_pictures(where):
        _refuse(where, "an NPZ file of pictures", asked | {"label": label})
        known, stills = pictures(where, classes)
        return Recordings(where, stills, known, "pictures")
    if _is_recording(where):
        _refuse(where, "a single recording", asked)
        return _single(Path(path), where, classes, label)
    _refuse(where, "no single recording", {"label": label})
    return labelled(where, part, classes, layout, ending, whole)


def _refuse(where: str, kind: str, asked: Mapping[str, str | None]) -> None:
    """Refuse what has no meaning for a kind of data."""
    for name, value in asked.items():
        if value is not None:
            raise ModelError(f"{name}={value!r}: expected None, since {where} is {kind}")


def _is_recording(where: str) -> bool:
    """Whether there is a file of a known format, which no zip of recordings is.

    Raises:
        EventFileError: there is a file of no known kind.
    """
    if not Path(where).is_file():
        return False
    with opened_source(where, None) as source:
        try:
            find(source)
        except EventFileError:
            if zipfile.is_zipfile(where) or where.lower().endswith(ARCHIVES):
                return False
            raise
    return True


def _single(path: Path, where: str, classes: Sequence[str] | None, label: str | None) -> Recordings:
    known = tuple(classes if classes is not None else () if label is None else (label,))
    if label is not None and label not in known:
        raise EventFileError(where, f"class {label!r} is new, expected one of {', '.join(known)}")
    number = UNKNOWN if label is None else known.index(label)
    return Recordings(where, [Recording(path.name, where, number, FileContent(path))], known, "recording")


PARTS = ("train", "test")
"""Parts by which data is known to have some."""


def labelled(
    where: str,
    part: str | None,
    classes: Sequence[str] | None,
    layout: str | None,
    ending: str | None,
    whole: bool,
) -> Recordings:
    """The recordings of a folder or zip; arguments and errors as of `neuro.events.recordings`."""
    files = files_of(where)
    if ending is not None:
        tail = f".{ending.lower().lstrip('.')}"
        files = {name: read for name, read in files.items() if name.lower().endswith((tail, ".csv", ".txt"))}
    chosen = layout_of(where, files, layout)
    items = [item for item in chosen.find(where, files) if ending is None or item.file.lower().endswith(tail)]
    if not items:
        raise EventFileError(where, f"no recordings with names that end in {tail}")
    classes_in_order = list(dict.fromkeys(item.label for item in items))
    items = _of_part(where, chosen, sorted(items, key=lambda item: natural(item.name)), part, whole)
    present = {item.label for item in items}
    found = [c for c in classes_in_order if c in present]
    if classes is None:
        classes = found
    if missing := [c for c in found if c not in classes]:
        raise EventFileError(where, f"class {missing[0]!r} is new, expected one of {', '.join(classes)}")
    index = {c: k for k, c in enumerate(classes)}
    size = chosen.sensor_size
    made = [Recording(i.name, f"{where}/{i.name}", index[i.label], files[i.file], i.span_us, size) for i in items]
    return Recordings(where, made, classes, chosen.name)


def _of_part(where: str, layout: Layout, items: list[LayoutItem], part: str | None, whole: bool) -> list[LayoutItem]:
    """The items of a part."""
    if part is None:
        return items
    wanted = part.lower()
    if inside := [item for item in items if layout.in_part(item, wanted)]:
        return inside
    found = {name: [item for item in items if layout.in_part(item, name)] for name in PARTS}
    only = [name for name in PARTS if len(found[name]) == len(items)]
    if only and whole:
        warnings.warn(f"{where}: has only the part '{only[0]}', taken for {part!r}", EventFileWarning, stacklevel=4)
        return items
    if any(found.values()):
        raise EventFileError(where, f"no recordings in a folder {part!r}")
    if whole or is_part(Path(where).resolve().stem, wanted):
        return items
    raise EventFileError(where, f"has no parts, expected one named {part!r}; split() divides it")
