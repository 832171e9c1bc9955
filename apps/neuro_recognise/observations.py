"""What the recordings of a data set show, computed once and kept in files of a few hundred recordings each.

A file is whole or not there, so a kill costs only what was being computed. What other code observed is not used.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import overload

import numpy as np

from neuro import ModelError
from neuro.apps import Unwritable
from neuro.events import Events, Recordings
from neuro_recognise.code import code_of
from neuro_recognise.kept import KeptAnswers, is_kept, keep
from neuro_recognise.method import Method
from neuro_recognise.shown import Evidence, Features

__all__ = ["observe", "observed"]

AT_ONCE = 500
"""Recordings in a file."""

Report = Callable[[int, int], None]


def observed(method: Method, recordings: Iterable[Events], classes: Sequence[str]) -> Features:
    """What some recordings without labels show, in memory.

    Raises:
        ModelError: one does not fit the method.
    """
    evidence = [method.observe(events) for events in recordings]
    names = tuple(str(k) for k in range(len(evidence)))
    return Features(evidence, np.full(len(evidence), -1, np.int64), names, tuple(classes))


def observe(
    method: Method,
    data: Recordings,
    *,
    fingerprint: str = "",
    cache: Path | None = None,
    report: Report | None = None,
) -> Features:
    """What a data set shows, from where it was kept or computed now.

    Args:
        method: its settings decide what is looked at.
        data: labelled recordings.
        fingerprint: of the data, where it is known already; to find it all recordings are read.
        cache: folder in which results are kept, one folder for each contents, settings and code; None takes the
            user's cache. Where it cannot be written everything stays in memory.
        report: is told how many recordings are done, and of how many.

    Raises:
        EventFileError: a recording is damaged.
        ModelError: one does not fit the method; it is named.
    """
    folder = _folder(method, fingerprint or data.fingerprint(), cache)
    parts: list[Sequence[Evidence]] = []
    for first in range(0, len(data), AT_ONCE):
        file = folder / f"{first:08d}.h5"
        wanted = min(AT_ONCE, len(data) - first)
        if not is_kept(file):
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
        events = item.load()
        try:
            found.append(method.observe(events))
        except ModelError as error:
            raise error.at(None, item.path) from None
        if report:
            report(first + len(found), len(data))
    return found


def _folder(method: Method, fingerprint: str, cache: Path | None) -> Path:
    import platformdirs

    key = f"{method.called()} {json.dumps(method.observing(), sort_keys=True)} {code_of(method)} {fingerprint}"
    name = hashlib.sha256(key.encode()).hexdigest()[:32]
    return (cache or platformdirs.user_cache_path("neuro") / "recognise") / name


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
