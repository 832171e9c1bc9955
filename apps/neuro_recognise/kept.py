"""Evidence of some recordings in a file, of which each array of each recording is read when it is asked for.

```
/NAME/shape     (recordings, axes) of the arrays of this name
/NAME/values    these arrays, flat, one after the other
```
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, overload

import numpy as np

from neuro import ModelError
from neuro.apps import hdf5
from neuro_recognise.shown import Array, Evidence, Ints

__all__ = ["KeptAnswers", "is_kept", "keep", "write_evidence"]

FORMAT = "neuro recognise evidence 1"


def is_kept(file: Path) -> bool:
    """Whether there is such a file, whole."""
    return hdf5.is_whole(file, FORMAT)


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


class KeptAnswers(Sequence[Evidence]):
    """The recordings of a file, which is opened when one of them is asked for.

    Args:
        file: as `keep` wrote it.
        n: recordings in it.
    """

    def __init__(self, file: Path, n: int) -> None:
        self.file, self._n = file, n

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, index: int) -> Evidence: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Evidence]: ...
    def __getitem__(self, index: int | slice) -> Evidence | Sequence[Evidence]:
        chosen = range(self._n)[index]
        return _One(self, chosen) if isinstance(chosen, int) else [_One(self, k) for k in chosen]


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
