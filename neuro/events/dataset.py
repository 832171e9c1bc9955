"""Labelled recordings in a folder or zip: found, sorted, and loaded one at a time."""

from __future__ import annotations

import csv
import hashlib
import io
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import overload

from neuro.events._events import Events
from neuro.events.errors import EventFileError
from neuro.events.files import load
from neuro.events.formats import FORMATS

MANIFEST = "MANIFEST.csv"
MANIFEST_COLUMNS = ("file", "label", "class")


@dataclass(frozen=True, slots=True)
class Recording:
    """One recording that can be loaded.

    Attributes:
        name: path inside the folder or zip, with ``/``.
        path: the folder or zip with the name behind it, for messages.
        label: index of its class in `Recordings.classes`.
        read: gives the bytes of the file.
    """

    name: str
    path: str
    label: int
    read: Callable[[], bytes]

    def load(self, *, sensor_size: tuple[int, int] | None = None, sort: bool = False) -> Events:
        """The events; arguments and errors as of `neuro.events.load`."""
        return load(self.read(), name=self.path, sensor_size=sensor_size, sort=sort)


class Recordings(Sequence[Recording]):
    """A sorted sequence of recordings.

    Attributes:
        path: the folder or zip.
        classes: class names; the label of a recording is an index into them.
    """

    def __init__(self, path: str, items: Sequence[Recording], classes: Sequence[str]) -> None:
        self.path = path
        self.classes = tuple(classes)
        self._items = tuple(items)

    @overload
    def __getitem__(self, index: int) -> Recording: ...
    @overload
    def __getitem__(self, index: slice) -> Recordings: ...
    def __getitem__(self, index: int | slice) -> Recording | Recordings:
        if isinstance(index, slice):
            return Recordings(self.path, self._items[index], self.classes)
        return self._items[index]

    def __len__(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self._items)

    def __repr__(self) -> str:
        return f"<Recordings {len(self)} of {len(self.classes)} classes in {self.path}>"

    def fingerprint(self) -> str:
        """SHA-256 over classes, names, labels and contents: equal for equal data, wherever it lies."""
        digest = hashlib.sha256(repr(self.classes).encode())
        for item in self:
            data = item.read()
            digest.update(f"\0{item.name}\0{item.label}\0{len(data)}\0".encode())
            digest.update(data)
        return digest.hexdigest()


def recordings(
    path: str | os.PathLike[str], *, part: str | None = None, classes: Sequence[str] | None = None
) -> Recordings:
    """Find the labelled recordings of a folder or zip.

    The class of a file is the name of the folder it lies in, at any depth (``Train/<digit>/<index>.bin``).
    Files without class folders need a ``MANIFEST.csv`` beside them with the columns file, label, class.

    Args:
        path: the folder or zip.
        part: of data with folders for parts, such as ``Train`` and ``Test``, only this one; upper and
            lower case are the same. Data without such folders is taken whole.
        classes: class names in the order of their labels, of the data trained on for example; None
            takes those found: folders by name (numbers by value), those of a manifest by its labels.

    Returns:
        The recordings, sorted by name (numbers by value).

    Raises:
        EventFileError: no such path, no recording in it, a class that ``classes`` lacks, a wrong manifest.
    """
    where = os.fspath(path)
    files = _files(where)
    labelled = _by_manifest(where, files) if MANIFEST in files else None
    if labelled is None:
        labelled = _by_folder(where, files)
    names = _of_part(where, sorted(labelled, key=_natural), part)
    present = {labelled[name] for name in names}
    found = [c for c in dict.fromkeys(labelled.values()) if c in present]
    if classes is None:
        classes = found
    if missing := [c for c in found if c not in classes]:
        raise EventFileError(where, f"class {missing[0]!r} is new, expected one of {', '.join(classes)}")
    index = {c: k for k, c in enumerate(classes)}
    items = [Recording(n, f"{where}/{n}", index[labelled[n]], files[n]) for n in names]
    return Recordings(where, items, classes)


Files = Mapping[str, Callable[[], bytes]]


def _files(where: str) -> Files:
    path = Path(where)
    if path.is_dir():
        inside = (Path(folder, f) for folder, _, names in os.walk(path) for f in names)
        found = {f.relative_to(path).as_posix(): f.read_bytes for f in inside}
        return {name: read for name, read in found.items() if not _hidden(name)}
    if not path.exists():
        raise EventFileError(where, "no such folder or zip")
    try:
        archive = _Zip(where)
        return {name: archive.reader(name) for name in archive.names() if not _hidden(name)}
    except zipfile.BadZipFile:
        raise EventFileError(where, "is neither a folder nor a zip, expected one with recordings") from None


class _Zip:
    """A zip that is open while it is used and can be sent to another process."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._open: zipfile.ZipFile | None = None

    def __getstate__(self) -> str:
        return self.path

    def __setstate__(self, path: str) -> None:
        self.__init__(path)  # type: ignore[misc]

    def _zip(self) -> zipfile.ZipFile:
        if self._open is None:
            self._open = zipfile.ZipFile(self.path)
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


def _natural(name: str) -> tuple[tuple[int, int, str], ...]:
    pieces = re.split(r"(\d+)", name)
    return tuple((0, int(s), s) if s.isascii() and s.isdigit() else (1, 0, s) for s in pieces if s)


def _by_folder(where: str, files: Files) -> dict[str, str]:
    """Class of every recording, classes in order."""
    endings = tuple(suffix for f in FORMATS for suffix in f.suffixes)
    events = [name for name in files if name.lower().endswith(endings) and name != MANIFEST]
    if not events:
        raise EventFileError(where, f"no recordings, expected class folders with {' or '.join(endings)} files")
    folders = {name: PurePosixPath(name).parent.name for name in events}
    if flat := [name for name, folder in folders.items() if not folder]:
        raise EventFileError(
            where, f"{flat[0]} lies in no class folder, and there is no {MANIFEST} with "
            f"the columns {', '.join(MANIFEST_COLUMNS)}"
        )  # fmt: skip
    return dict(sorted(folders.items(), key=lambda item: _natural(item[1])))


def _by_manifest(where: str, files: Files) -> dict[str, str] | None:
    """Class of every file that the manifest lists, classes in order; None where it is not such a list."""
    rows = list(csv.DictReader(io.StringIO(files[MANIFEST]().decode("utf-8-sig", "replace"))))
    if not rows or not set(MANIFEST_COLUMNS) <= set(rows[0]):
        return None
    for line, row in enumerate(rows, 2):
        if row["file"] not in files:
            raise EventFileError(where, f"{MANIFEST} line {line}: no file {row['file']!r}")
    return {row["file"]: row["class"] for row in sorted(rows, key=lambda row: _natural(row["label"] or ""))}


def _of_part(where: str, names: Sequence[str], part: str | None) -> list[str]:
    """The files of a part, recognised by a folder above the class folder."""
    if part is None:
        return list(names)
    above = {name: [p.lower() for p in name.split("/")[:-2]] for name in names}
    if not any({"train", "test", part.lower()} & set(folders) for folders in above.values()):
        return list(names)
    inside = [name for name in names if part.lower() in above[name]]
    if not inside:
        raise EventFileError(where, f"no recordings in a folder {part!r}")
    return inside
