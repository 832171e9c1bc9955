"""What the recordings of a data set show, computed once and kept in files of a few hundred recordings each.

A file is whole or not there, so a kill costs only what was being computed. What other code observed is not used. Each
array of each recording is read when it is asked for:

```
/NAME/shape     (recordings, axes) of the arrays of this name
/NAME/values    these arrays, flat, one after the other
```
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from neuro import ModelError
from neuro.apps import Unwritable, hdf5
from neuro.events import Events, Recordings
from neuro.events.dataset import Sample
from neuro_recognise.code import code_of
from neuro_recognise.method import Method
from neuro_recognise.shown import Array, Evidence, Features, Ints, Lazy, unlabelled

FORMAT = "neuro recognise evidence 1"


def keep(file: Path, evidence: Sequence[Evidence]) -> None:
    """Write a file, in the place of whatever is there.

    Raises:
        OSError: its folder cannot be made.
        Unwritable: the file cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with hdf5.writing(file, FORMAT, replace=True) as out:
        write_evidence(out, evidence)


def write_evidence(group: Any, evidence: Sequence[Evidence]) -> None:
    """Write evidence of some recordings, at least one, into a group of HDF5, a group for each name."""
    for name in evidence[0]:
        arrays = [one[name] for one in evidence]
        group[f"{name}/shape"] = np.array([array.shape for array in arrays], np.int64)
        group[f"{name}/values"] = np.concatenate([array.ravel() for array in arrays])


class KeptAnswers(Lazy[Evidence]):
    """The recordings of a file, which is opened when one of them is asked for.

    Args:
        file: as `keep` wrote it.
        n: recordings in it.
    """

    def __init__(self, file: Path, n: int) -> None:
        self.file, self._n = file, n

    def __len__(self) -> int:
        return self._n

    def item(self, k: int) -> Evidence:
        """The arrays of a recording, each read when it is asked for."""
        return _One(self, k)


class _One(Mapping[str, Array]):
    """The arrays of one recording."""

    def __init__(self, of: KeptAnswers, number: int) -> None:
        self._of, self._number = of, number

    def __getitem__(self, name: str) -> Array:
        return _opened(self._of).read(name, self._number)

    def __iter__(self) -> Iterator[str]:
        return iter(_opened(self._of).places)

    def __len__(self) -> int:
        return len(_opened(self._of).places)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where the arrays of a name lie in a file.

    Attributes:
        offset: of the first byte.
        dtype: of the values.
        shapes: (recordings, axes).
        begins: (recordings + 1,) number of the first value of each.
    """

    offset: int
    dtype: np.dtype[np.generic]
    shapes: Ints
    begins: Ints


class _File:
    """An open file, which stays what it was where another takes its name.

    HDF5 takes ten times as long for so little, so it is asked only where the arrays lie.
    """

    def __init__(self, path: Path) -> None:
        with hdf5.reading(path, FORMAT) as kept:
            self.places = {name: _place(group) for name, group in kept.items()}
        self._path, self._number = path, os.open(path, os.O_RDONLY)

    def read(self, name: str, k: int) -> Array:
        """The array of a recording.

        Raises:
            ModelError: the file is damaged.
        """
        place = self.places[name]
        values = np.empty(place.shapes[k], place.dtype)
        begin = place.offset + int(place.begins[k]) * place.dtype.itemsize
        if values.size and os.preadv(self._number, [values.data], begin) != values.nbytes:
            raise ModelError(f"{self._path}: damaged {FORMAT}: it ends too early")
        return values

    def __del__(self) -> None:
        if hasattr(self, "_number"):
            os.close(self._number)


@lru_cache(maxsize=64)
def _opened(kept: KeptAnswers) -> _File:
    return _File(kept.file)


def _place(group: Mapping[str, Any]) -> _Place:
    shapes, values = group["shape"][()], group["values"]
    begins = np.concatenate(([0], np.cumsum(shapes.prod(axis=1)))).astype(np.int64)
    return _Place(values.id.get_offset() or 0, values.dtype, shapes, begins)


AT_ONCE = 500
"""Recordings in a file."""

Report = Callable[[int, int], None]
T = TypeVar("T")


def observed(method: Method, recordings: Iterable[Events], classes: Sequence[str]) -> Features:
    """What some recordings without labels show, in memory.

    Raises:
        ModelError: one does not fit the method.
    """
    return unlabelled([method.observe(events) for events in recordings], tuple(classes))


def seen_of(recording: Sample, look: Callable[[Events], T]) -> T:
    """What a function makes of the events of a recording.

    Raises:
        EventFileError: the recording is damaged.
        ModelError: it does not fit the method; it is named.
    """
    events = recording.load()
    try:
        return look(events)
    except ModelError as error:
        raise error.at(None, recording.path) from None


def observe(
    method: Method, data: Recordings, *, fingerprint: str = "", cache: Path | None = None, report: Report | None = None
) -> Features:
    """What a data set shows, from where it was kept or computed now.

    Args:
        method: its settings decide what is looked at.
        data: labelled recordings.
        fingerprint: of the data, where it is known already; to find it all recordings are read.
        cache: folder in which results are kept, one folder for each contents, settings and code; None takes the
            user's cache. Where it cannot be written everything stays in memory.
        report: called with how many recordings are done, and of how many.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: one does not fit the method; it is named.
    """
    folder = _folder(method, fingerprint or data.fingerprint(), cache)
    parts: list[Sequence[Evidence]] = []
    for first in range(0, len(data), AT_ONCE):
        file = folder / f"{first:08d}.h5"
        wanted = min(AT_ONCE, len(data) - first)
        if not hdf5.is_whole(file, FORMAT):
            parts.append(_computed(method, data, first, wanted, report))
            with contextlib.suppress(OSError, Unwritable):
                keep(file, parts[-1])
                parts[-1] = KeptAnswers(file, wanted)
        else:
            parts.append(KeptAnswers(file, wanted))
        if report:
            report(first + wanted, len(data))
    return Features(_Joined(parts), data.labels, tuple(item.name for item in data), data.classes)


def _computed(method: Method, data: Recordings, first: int, n: int, report: Report | None) -> list[Evidence]:
    found: list[Evidence] = []
    for item in data[first : first + n]:
        found.append(seen_of(item, method.observe))
        if report:
            report(first + len(found), len(data))
    return found


def _folder(method: Method, fingerprint: str, cache: Path | None) -> Path:
    import platformdirs

    key = f"{method.called()} {json.dumps(method.observing(), sort_keys=True)} {code_of(method)} {fingerprint}"
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    return (cache or platformdirs.user_cache_path("neuro") / "recognise") / name


class _Joined(Lazy[Evidence]):
    """Files of `AT_ONCE` recordings as one sequence."""

    def __init__(self, parts: Sequence[Sequence[Evidence]]) -> None:
        self._parts = parts

    def __len__(self) -> int:
        return sum(map(len, self._parts))

    def item(self, k: int) -> Evidence:
        """That of a file."""
        part, place = divmod(k, AT_ONCE)
        return self._parts[part][place]
