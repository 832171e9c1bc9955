"""What the recordings of a data set show, computed once and kept in files of a few hundred recordings each.

A file is whole or not there, so a kill costs only what was being computed, and what is not asked for is not in memory.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import overload

import numpy as np

from neuro.apps import Unwritable, hdf5
from neuro.events import EventFileError, Events, Recordings
from neuro_recognise.method import Method
from neuro_recognise.shown import Array, Evidence, Shown

__all__ = ["observe", "observed"]

VERSION = 1
"""Of the code that observes: another number, and what was kept before is not used."""
FORMAT = "neuro recognise evidence 1"
AT_ONCE = 500
"""Recordings in a file."""

Report = Callable[[int, int], None]


def observed(method: Method, recordings: Iterable[Events], classes: Sequence[str]) -> Shown:
    """What some recordings without labels show, in memory.

    Raises:
        ModelError: one does not fit the method.
    """
    evidence = [method.observe(events) for events in recordings]
    names = tuple(str(k) for k in range(len(evidence)))
    return Shown(evidence, np.full(len(evidence), -1, np.int64), names, tuple(classes))


def observe(method: Method, data: Recordings, *, cache: Path | None = None, report: Report | None = None) -> Shown:
    """What a data set shows, from where it was kept or computed now.

    Args:
        method: its settings decide what is looked at.
        data: labelled recordings.
        cache: folder in which results are kept, one folder for each contents and settings; None takes the user's
            cache. Where it cannot be written everything stays in memory.
        report: is told how many recordings are done, and of how many.

    Raises:
        EventFileError: a recording is damaged or does not fit the method.
    """
    folder = _folder(method, data, cache)
    parts: list[Sequence[Evidence]] = []
    for first in range(0, len(data), AT_ONCE):
        file = folder / f"{first:08d}.h5"
        wanted = min(AT_ONCE, len(data) - first)
        if not hdf5.has_format(file, FORMAT):
            parts.append(_computed(method, data, first, wanted, report))
            with contextlib.suppress(OSError, Unwritable):
                _write(file, parts[-1])
                parts[-1] = _Kept(file, wanted)
        else:
            parts.append(_Kept(file, wanted))
        if report:
            report(first + wanted, len(data))
    return Shown(_Joined(parts), data.labels, tuple(item.name for item in data), data.classes)


def _computed(method: Method, data: Recordings, first: int, n: int, report: Report | None) -> list[Evidence]:
    found: list[Evidence] = []
    for item in data[first : first + n]:
        try:
            found.append(method.observe(item.load()))
        except EventFileError:
            raise
        except ValueError as error:
            raise EventFileError(item.path, str(error)) from None
        if report:
            report(first + len(found), len(data))
    return found


def _folder(method: Method, data: Recordings, cache: Path | None) -> Path:
    import platformdirs

    key = f"{VERSION} {method.called()} {json.dumps(method.observing(), sort_keys=True)} {data.fingerprint()}"
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    return (cache or platformdirs.user_cache_path("neuro") / "recognise") / name


def _write(file: Path, evidence: Sequence[Evidence]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with hdf5.writing(file, FORMAT, replace=True) as out:
        for name in evidence[0]:
            arrays = [one[name] for one in evidence]
            group = out.create_group(name)
            group["shape"] = np.array([array.shape for array in arrays], np.int64)
            group["values"] = np.concatenate([array.ravel() for array in arrays])


class _Kept(Sequence[Evidence]):
    """The recordings of a file, which is read when one of them is asked for."""

    def __init__(self, file: Path, n: int) -> None:
        self._file, self._n = file, n

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, index: int) -> Evidence: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Evidence]: ...
    def __getitem__(self, index: int | slice) -> Evidence | Sequence[Evidence]:
        return _read(self._file)[index]


@lru_cache(maxsize=2)
def _read(file: Path) -> list[Evidence]:
    """All recordings of a file."""
    with hdf5.reading(file, FORMAT) as kept:
        arrays: dict[str, list[Array]] = {}
        for name, group in kept.items():
            shapes, values = group["shape"][()], group["values"][()]
            ends = np.cumsum(shapes.prod(axis=1))
            arrays[name] = [
                part.reshape(shape) for part, shape in zip(np.split(values, ends[:-1]), shapes, strict=True)
            ]
    n = len(next(iter(arrays.values())))
    return [{name: of[k] for name, of in arrays.items()} for k in range(n)]


class _Joined(Sequence[Evidence]):
    """Files of `AT_ONCE` recordings as one sequence."""

    def __init__(self, parts: Sequence[Sequence[Evidence]]) -> None:
        self._parts = parts

    def __len__(self) -> int:
        return sum(map(len, self._parts))

    @overload
    def __getitem__(self, index: int) -> Evidence: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Evidence]: ...
    def __getitem__(self, index: int | slice) -> Evidence | Sequence[Evidence]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        part, place = divmod(index if index >= 0 else len(self) + index, AT_ONCE)
        return self._parts[part][place]
