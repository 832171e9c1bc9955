"""Samples in an HDF5 file that is laid out ``/<class>/<sample>``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.hdf5 import check, has_format
from neuro.events._events import Events
from neuro.events.dataset._layouts import natural
from neuro.events.errors import EventFileError
from neuro.events.formats._format import Damage
from neuro.events.formats._hdf5_chunks import FAILURES, one_line
from neuro.events.formats._hdf5_recording import member

FORMAT = "neuro event data set 1"
CLASSES = "classes"
"""Attribute of the file: names in the order of their labels, as JSON."""
NUMBER = "number"
"""Attribute of a sample: its number in the data set that it was made of."""


def opened(path: str, whole: bool = False) -> Any:
    """An open HDF5 file.

    Args:
        path: of the file.
        whole: whether it was checked before.

    Raises:
        EventFileError: it is no whole HDF5 file, or not what this package wrote.
    """
    import h5py

    try:
        if not whole:
            check(Path(path))
        return h5py.File(path, "r")
    except ModelError as error:
        raise EventFileError(path, error.message.removeprefix(f"{Path(path)}: "), hint=error.hint) from None
    except OSError as error:
        raise EventFileError(path, f"no whole HDF5: {error}") from None


class _File:
    """An HDF5 file that is opened when it is used, and anew in another process, which need not check it again."""

    def __init__(self, path: str, whole: bool = False) -> None:
        self.path, self._whole = path, whole
        self._open: Any = None

    def __getstate__(self) -> tuple[str, bool]:
        return self.path, self._whole

    def __setstate__(self, state: tuple[str, bool]) -> None:
        self.__init__(*state)  # type: ignore[misc]

    @property
    def file(self) -> Any:
        if self._open is None:
            self._open = opened(self.path, self._whole)
            self._whole = True
        return self._open

    def close(self) -> None:
        """Close the file until it is used again."""
        if self._open is not None:
            self._open.close()
            self._open = None


@dataclass(frozen=True, slots=True)
class StoredSample:
    """A sample of an HDF5 file.

    Attributes:
        name: ``class/sample``.
        path: the file with the name behind it, for messages.
        label: index of its class.
    """

    name: str
    path: str
    label: int
    _place: int
    _file: _File

    @property
    def number(self) -> int:
        """Its number in the data set that the file was made of; by name in a file of another library."""
        with self._told():
            return int(self._file.file[self.name].attrs.get(NUMBER, self._place))

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False, strict: bool = True) -> Events:
        """The events; arguments and errors as of `neuro.events.load`. Samples have no damage that could be left out."""
        from neuro.events.formats.hdf5 import read_sample

        with self._told():
            events = read_sample(self._file.file[self.name])
            if sensor_size is None or sensor_size == events.sensor_size:
                return events
            return Events(events.t, events.x, events.y, events.p, sensor_size, events.metadata)

    def read(self) -> bytes:
        """Sensor and events as bytes; see `Sample`."""
        events = self.load()
        return repr(events.sensor_size).encode() + events.records().tobytes()

    def sensor(self) -> tuple[tuple[int, int], bool]:
        """Width and height, and whether they are stated; see `Sample`."""
        from neuro.events.formats.hdf5 import sample_size

        with self._told():
            size = sample_size(self._file.file[self.name])
        return (size, True) if size else (self.load().sensor_size, False)

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Tell what is wrong with the sample as an `EventFileError` that names it; the file is closed then."""
        try:
            yield
        except (Damage, EventFileError) as error:
            self._file.close()
            raise EventFileError(self.path, error.what, error.offset) from None
        except FAILURES as error:
            self._file.close()
            raise EventFileError(self.path, one_line(error)) from None


def stored_samples(path: str, classes: Sequence[str] | None = None) -> tuple[tuple[str, ...], tuple[StoredSample, ...]]:
    """The classes and samples of a file, sorted by class and name (numbers by value).

    Args:
        path: the HDF5 file.
        classes: names in the order of their labels; None takes those that the file states, else its groups by name.

    Raises:
        EventFileError: it has no samples, or a class that ``classes`` lacks.
    """
    holder = _File(path)
    with _damage_told(holder):
        return _listed(holder, path, classes)


def holds_samples(path: str) -> bool:
    """Whether an HDF5 file is a data set; if not, it may be a recording.

    Raises:
        EventFileError: it is no whole HDF5 file.
    """
    if has_format(Path(path), FORMAT):
        return True
    holder = _File(path)
    with _damage_told(holder):
        found = any(True for _ in _names(holder.file))
    holder.close()
    return found


@contextmanager
def _damage_told(holder: _File) -> Iterator[None]:
    """Report what is wrong with a file as an `EventFileError` that names it; the file is closed then."""
    try:
        yield
    except FAILURES as error:
        holder.close()
        if isinstance(error, EventFileError):
            raise
        what = error.what if isinstance(error, Damage) else f"no whole HDF5: {one_line(error)}"
        raise EventFileError(holder.path, what) from None


def _names(file: Any) -> Iterator[tuple[str, str]]:
    """Class and name of each sample."""
    import h5py

    if "CD/events" in file:  # Prophesee's place for the events of a recording, see `neuro.events.formats.hdf5`
        return
    own = CLASSES in file.attrs  # then all are samples; to open each of 10,000 takes seconds
    for group in sorted((name for name in file if isinstance(member(file, name), h5py.Group)), key=natural):
        members = file[group]
        yield from ((group, name) for name in sorted(members, key=natural) if own or _has_rows(member(members, name)))


def _listed(
    holder: _File, path: str, classes: Sequence[str] | None
) -> tuple[tuple[str, ...], tuple[StoredSample, ...]]:
    file = holder.file
    names = list(_names(file))
    if not names:
        raise EventFileError(path, "holds no samples, expected /<class>/<sample> with rows ts, x, y, p")
    groups = list(dict.fromkeys(group for group, _ in names))
    known = tuple(classes if classes is not None else _named(file, groups))
    if missing := [group for group in groups if group not in known]:
        raise EventFileError(path, f"class {missing[0]!r} is new, expected one of {', '.join(known)}")
    samples = (
        StoredSample(f"{group}/{name}", f"{path}/{group}/{name}", known.index(group), k, holder)
        for k, (group, name) in enumerate(names)
    )
    return known, tuple(samples)


def _has_rows(node: Any) -> bool:
    return getattr(getattr(node, "dtype", None), "names", None) is not None


def _named(file: Any, groups: Sequence[str]) -> Sequence[str]:
    text = file.attrs.get(CLASSES)
    try:
        names = json.loads(text) if isinstance(text, str) else groups
    except ValueError:
        names = groups
    return names if isinstance(names, list) and set(groups) <= set(names) else groups
