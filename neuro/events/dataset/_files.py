"""The files of a folder or zip by their names; each is read when it is asked for, also in another process."""

from __future__ import annotations

import io
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from neuro.core import hdf5
from neuro.events.errors import EventFileError

Files = Mapping[str, Callable[[], bytes]]
"""Path inside the folder or zip, with ``/``, to what gives the bytes."""

ARCHIVES = (".tar", ".gz", ".tgz", ".bz2", ".xz", ".7z", ".rar")
"""Endings of archives that have to be unpacked first."""


def is_hdf5(path: str) -> bool:
    """Whether there is an HDF5 file of this name."""
    try:
        with Path(path).open("rb") if Path(path).is_file() else io.BytesIO() as file:
            return hdf5.is_hdf5(file.read(hdf5.FRONT))
    except OSError:
        return False


def files_of(where: str) -> Files:
    """All files but hidden ones.

    Args:
        where: the folder or zip.

    Raises:
        EventFileError: there is none, or it is another kind of file.
    """
    path = Path(where)
    if path.is_dir():
        inside = (Path(folder, f) for folder, _, names in os.walk(path) for f in names)
        found = {f.relative_to(path).as_posix(): f.read_bytes for f in inside}
        return {name: read for name, read in found.items() if not _hidden(name)}
    if not path.exists():
        raise EventFileError(where, "no such folder, zip or HDF5 file")
    if not path.is_file():
        raise EventFileError(where, "is neither file nor folder, expected a folder, zip or HDF5 file")
    try:
        archive = _Zip(where)
        return {name: archive.reader(name) for name in archive.names() if not _hidden(name)}
    except zipfile.BadZipFile:
        text = "is no folder, zip or HDF5 file, expected one with recordings"
        hint = "; unpack it first" if where.lower().endswith(ARCHIVES) else ""
        raise EventFileError(where, f"{text}{hint}") from None


class _Zip:
    """A zip that is open while it is used and can be sent to another process.

    A forked process opens it anew: the place in an open file is one for all processes that have inherited it.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._open: zipfile.ZipFile | None = None
        self._process = 0

    def __getstate__(self) -> str:
        return self.path

    def __setstate__(self, path: str) -> None:
        self.__init__(path)  # type: ignore[misc]

    def _zip(self) -> zipfile.ZipFile:
        if self._open is None or self._process != os.getpid():
            self._open, self._process = zipfile.ZipFile(self.path), os.getpid()
        return self._open

    def names(self) -> list[str]:
        return [info.filename for info in self._zip().infolist() if not info.is_dir()]

    def reader(self, name: str) -> Callable[[], bytes]:
        return _Member(self, name)

    def read(self, name: str) -> bytes:
        try:
            return self._zip().read(name)
        except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
            raise EventFileError(f"{self.path}/{name}", f"damaged in the zip: {error}") from None


@dataclass(frozen=True, slots=True)
class _Member:
    archive: _Zip
    name: str

    def __call__(self) -> bytes:
        return self.archive.read(self.name)


def _hidden(name: str) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in name.split("/"))


def natural(name: str) -> tuple[tuple[int, int, str], ...]:
    """A key that sorts names with their numbers by value."""
    pieces = re.split(r"(\d+)", name)
    return tuple((0, int(s), s) if s.isascii() and s.isdigit() else (1, 0, s) for s in pieces if s)
