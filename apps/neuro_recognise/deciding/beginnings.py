"""What the beginnings of recordings show: looked at once for all moments, and kept in files of a hundred recordings.

```
/                  attribute: format
/K/NAME/values     an array of all recordings at moment K, one after the other
/K/NAME/shape      (recordings, dimensions) of each
```
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import hdf5, make_folder
from neuro.events import Recordings
from neuro.events.dataset import Sample
from neuro_recognise.kept import write_evidence
from neuro_recognise.method import Method
from neuro_recognise.shown import Evidence, Features, Ints

__all__ = ["Beginnings", "beginnings"]

FORMAT = "neuro recognise beginnings 1"
AT_ONCE = 100
"""Recordings in a file, all of whose moments are in memory while it is made."""


def beginnings(method: Method, recording: Sample, times_us: Ints) -> list[Evidence]:
    """What a recording shows until each time.

    Raises:
        EventFileError: it is damaged.
        ModelError: it does not fit the method; it is named.
    """
    events = recording.load()
    try:
        return method.observe_until(events, times_us.tolist())
    except ModelError as error:
        raise error.at(None, recording.path) from None


class Beginnings:
    """What all recordings show, moment by moment.

    Args:
        method: its settings decide what is looked at.
        data: labelled recordings.
        times_us: how long the beginnings are.
        folder: for the files; what is there already is not looked at again.
    """

    def __init__(self, method: Method, data: Recordings, times_us: Ints, folder: Path) -> None:
        self._method, self._data, self._times = method, data, times_us
        self._files = [folder / f"{first:08d}.h5" for first in range(0, len(data), AT_ONCE)]
        self._folder = folder

    def look(self) -> Iterator[int]:
        """Look at what is not there yet; gives the number of recordings that are done, after each hundred.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: one does not fit the method; it is named.
            Unwritable: a file cannot be written.
        """
        make_folder(self._folder)
        for k, file in enumerate(self._files):
            part = self._data[AT_ONCE * k : AT_ONCE * (k + 1)]
            if not hdf5.is_whole(file, FORMAT):
                _write(file, [beginnings(self._method, item, self._times) for item in part])
            yield AT_ONCE * k + len(part)

    def at(self, moment: int) -> Features:
        """What beginnings so long show, in memory."""
        evidence = [one for file in self._files for one in _read(file, moment)]
        return Features(evidence, self._data.labels, tuple(item.name for item in self._data), self._data.classes)

    def remove(self) -> None:
        """They are no longer needed."""
        for file in self._files:
            file.unlink(missing_ok=True)
        if self._folder.exists():
            self._folder.rmdir()


def _write(file: Path, of_recordings: Sequence[Sequence[Evidence]]) -> None:
    with hdf5.writing(file, FORMAT, replace=True) as out:
        for moment, evidence in enumerate(zip(*of_recordings, strict=True)):
            write_evidence(out.create_group(str(moment)), evidence)


def _read(file: Path, moment: int) -> list[Evidence]:
    with hdf5.reading(file, FORMAT) as kept:
        arrays = {name: _apart(group["shape"][()], group["values"][()]) for name, group in kept[str(moment)].items()}
    return [dict(zip(arrays, parts, strict=True)) for parts in zip(*arrays.values(), strict=True)]


def _apart(shapes: Ints, values: Any) -> list[Any]:
    """Arrays again, each of its shape."""
    ends = np.cumsum(shapes.prod(axis=1))
    return [part.reshape(shape) for part, shape in zip(np.split(values, ends[:-1]), shapes, strict=True)]
