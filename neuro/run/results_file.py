"""The file of results of a run that is under way: what the run gives it, part by part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from neuro.core.growing import JournaledFile
from neuro.core.hdf5 import FRONT
from neuro.core.outputs import Unwritable
from neuro.files.results import FORMAT, Results, read_file, recorded_in, write_head, write_part

_CHUNK = 1 << 16

Arrays = Mapping[str, NDArray[Any]]


class ResultsFile:
    """A file of results that grows, and takes its name when it ends.

    Args:
        part: where it is written.

    Raises:
        Unwritable: the file cannot be written, or another run writes it.
    """

    def __init__(self, part: Path) -> None:
        self._part = part
        with self._writing():
            self._disk = JournaledFile(part, FORMAT)
        self._file = h5py.File(self._disk, "w", userblock_size=FRONT)

    def begin(self, about: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Write what the run is of."""
        with self._writing():
            write_head(self._file, about, files)

    def add(self, place: str, part: Any, growing: tuple[str, ...], gzip: bool = False) -> None:
        """Make room for a part; `growing` are its arrays to which more is appended."""
        with self._writing():
            group = self._file.create_group(place)
            for word in growing:
                _growing(group, word, getattr(part, word), gzip)
            write_part(group, part)

    def append(self, place: str, arrays: Arrays) -> None:
        """Append to arrays of a part; those that are not there yet begin."""
        with self._writing():
            group = self._file.require_group(place)
            for word, array in arrays.items():
                if word not in group:
                    _growing(group, word, array[:0])
                if len(array):
                    data = group[word]
                    n = data.shape[0]
                    data.resize(n + len(array), axis=0)
                    data[n:] = array

    def update(self, attributes: Mapping[str, Mapping[str, Any]], arrays: Mapping[str, Arrays]) -> None:
        """Write attributes and whole arrays of parts anew."""
        with self._writing():
            for place, named in attributes.items():
                self._file.require_group(place).attrs.update(named)
            for place, each in arrays.items():
                for word, array in each.items():
                    self._file[place][word][...] = array

    def complete(self, place: str, part: Any) -> None:
        """Write what a part has got since `add`."""
        with self._writing():
            write_part(self._file.require_group(place), part)

    def commit(self) -> None:
        """Let all this be on the disk, where it stays whatever happens to this process.

        Raises:
            Unwritable: it cannot be written.
        """
        with self._writing():
            self._file.flush()
            self._disk.commit()

    @property
    def results(self) -> Results:
        """All that has been written."""
        return read_file(self._file, lambda: nullcontext(self._file))

    def finish(self, path: Path) -> None:
        """Commit, and give the file its name.

        Raises:
            Unwritable: it cannot be written.
        """
        self.commit()
        with self._writing():
            self._file.close()
            self._disk.commit()
            self._part.replace(path)

    def close(self) -> None:
        """Close the file; one that did not end stays as it was committed."""
        with suppress(OSError, RuntimeError):
            self._file.close()
        self._disk.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Report the first failure as soon as HDF5 is done with a call."""
        try:
            yield
            if self._disk.error is not None:
                raise self._disk.error
        except BlockingIOError:
            raise Unwritable(self._part, "another run writes it: expected another name") from None
        except OSError as error:
            what = f"cannot be written: {error.strerror or error}"
            raise Unwritable(self._part, what, recorded_in(self._part)) from None


def _growing(group: h5py.Group, word: str, empty: NDArray[Any], gzip: bool = False) -> None:
    chunk = (max(1, _CHUNK // max(1, int(np.prod(empty.shape[1:])))), *empty.shape[1:])
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if gzip else {}
    group.create_dataset(
        word, shape=empty.shape, maxshape=(None, *empty.shape[1:]), chunks=chunk, dtype=empty.dtype, **packing
    )
