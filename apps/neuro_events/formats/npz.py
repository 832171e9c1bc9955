"""NPZ of NumPy: arrays t, x, y and p, or a structured array with the fields t, x, y and p.

Names and units are as in `_columns`. ``sensor_size`` (width, height), or ``width`` and ``height``, are read if present.
The arrays are read in parts side by side, so that a file of any size needs little memory. Arrays of Python objects are
refused, because reading them can run code.

The writer stores ``t`` (int64, us), ``x``, ``y`` (uint16), ``p`` (uint8), ``sensor_size`` and ``metadata`` (JSON),
without compression.

Source: NumPy's "A simple file format for NumPy arrays".
"""

from __future__ import annotations

import io
import math
import shutil
import tempfile
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from neuro_events._events import EVENT, Events
from neuro_events.formats._columns import Names, find_names, to_piece, unit_of
from neuro_events.formats._format import Damage, Format, Piece, Size, as_json, from_json
from neuro_events.source import Source

ROW = EVENT.itemsize
SMALL = 1 << 16
"""Largest number of items in an array other than a column of events."""

FAILURES = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    ValueError,
    RuntimeError,
    NotImplementedError,
    tokenize.TokenError,
)


class _Member:
    """An array in the archive, read in order."""

    def __init__(self, archive: zipfile.ZipFile, name: str) -> None:
        self.name = name
        self.place = archive.getinfo(name).header_offset
        self._file: IO[bytes] = archive.open(name)
        version = np.lib.format.read_magic(self._file)
        header_readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        if version not in header_readers:
            raise ValueError(f"its arrays have the unknown version {version}")
        self.shape, fortran, self.dtype = header_readers[version](self._file)
        if fortran and len(self.shape) > 1:
            raise ValueError(f"array {name[:-4]} is stored by columns")

    def take(self, count: int) -> npt.NDArray[Any]:
        """Return the next items along the first axis."""
        if self.dtype.hasobject:
            raise ValueError(f"array {self.name[:-4]} holds Python objects, expected numbers")
        shape = (count, *self.shape[1:])
        size = math.prod(shape) * self.dtype.itemsize
        data = self._file.read(size)
        if len(data) < size:
            raise EOFError(f"array {self.name[:-4]} ends early")
        return np.frombuffer(data, self.dtype).reshape(shape)

    def read_small(self) -> npt.NDArray[Any]:
        """Return the complete array, which must be small."""
        if math.prod(self.shape) > SMALL:
            raise ValueError(f"array {self.name[:-4]} is too long")
        shape, self.shape = self.shape, self.shape or (1,)
        return self.take(self.shape[0]).reshape(shape)


class Npz:
    """A reader of NPZ files."""

    def __init__(self, source: Source) -> None:
        self._source = source
        try:
            with self._archive() as archive:
                self._names, self._members = _columns(archive)
                self.sensor_size: Size | None = _size(archive)
                self.metadata: Mapping[str, Any] = _metadata(archive)
        except FAILURES as error:
            raise Damage(f"not an intact NPZ: {error}", None) from None

    @contextmanager
    def _archive(self) -> Iterator[zipfile.ZipFile]:
        """Open the archive. The file is closed at the end, even if a member of the archive is still open."""
        path = self._source.path
        with path.open("rb") if path else io.BytesIO(self._source.all().data) as file, zipfile.ZipFile(file) as archive:
            yield archive

    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the events; see `Reader`."""
        self._n_read = 0
        try:
            with self._archive() as archive:
                yield from self._read(archive, block)
        except FAILURES as error:
            if isinstance(error, Damage):
                raise
            raise Damage(f"the events from {self._n_read} on cannot be read: {error}", None) from None

    def _read(self, archive: zipfile.ZipFile, block: int) -> Iterator[Piece]:
        """Read the columns side by side, block by block."""
        unit = self._names.unit
        members = [_Member(archive, f"{name}.npy") for name in self._members]
        lengths = {member.shape for member in members}
        if len(lengths) != 1 or len(members[0].shape) != 1:
            shapes = ", ".join(f"{m.name[:-4]} {m.shape}" for m in members)
            raise ValueError(f"its arrays have the shapes {shapes}, expected one axis and equal lengths")
        total = members[0].shape[0]
        while True:
            count = min(max(1, block // ROW), total - self._n_read)
            if len(members) == 1:
                records = members[0].take(count)
                columns = {key: records[getattr(self._names, key)] for key in "txyp"}
            else:
                columns = {key: member.take(count) for key, member in zip("txyp", members, strict=True)}
            unit = unit_of(columns["t"]) if unit is None else unit
            piece, fault = to_piece(columns, unit, self._n_read, members[0].place)
            yield piece
            if fault:
                raise Damage(fault, members[0].place)
            self._n_read += count
            if self._n_read >= total:
                return


def _arrays(archive: zipfile.ZipFile) -> list[str]:
    return [name[:-4] for name in archive.namelist() if name.endswith(".npy")]


def _columns(archive: zipfile.ZipFile) -> tuple[Names, list[str]]:
    """Return the names of the columns, and of the arrays that contain the columns: four arrays, or one of records."""
    arrays = _arrays(archive)
    if names := find_names(arrays):
        return names, [names.t, names.x, names.y, names.p]
    for name in arrays:
        if (fields := _Member(archive, name + ".npy").dtype.names) and (names := find_names(fields)):
            return names, [name]
    raise ValueError(f"has the arrays {', '.join(arrays) or 'none'}, expected t, x, y and p")


def _size(archive: zipfile.ZipFile) -> Size | None:
    arrays = set(_arrays(archive))
    if "sensor_size" in arrays:
        values = _Member(archive, "sensor_size.npy").read_small().ravel()
    elif {"width", "height"} <= arrays:
        values = np.array([_Member(archive, f"{n}.npy").read_small().item() for n in ("width", "height")])
    else:
        return None
    if values.shape != (2,) or values.dtype.kind not in "iu" or not np.all((values >= 1) & (values <= 65536)):
        raise ValueError(f"sensor_size is {values.tolist()}, expected width and height from 1 to 65536")
    return int(values[0]), int(values[1])


def _metadata(archive: zipfile.ZipFile) -> dict[str, Any]:
    if "metadata" not in _arrays(archive):
        return {}
    member = _Member(archive, "metadata.npy")
    return from_json(str(member.read_small())) if member.dtype.kind == "U" else {}


def write(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as NPZ. The columns go to temporary files first, because an NPZ begins with their length."""
    size, metadata, total = (1, 1), {}, 0
    with ExitStack() as stack:
        columns = {key: stack.enter_context(tempfile.TemporaryFile(dir=path.parent)) for key in "txyp"}
        for events in parts:
            size, metadata = events.sensor_size, dict(events.metadata)
            for key, file in columns.items():
                file.write(np.ascontiguousarray(getattr(events, key), EVENT[key]).data)
            total += len(events)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for key, file in columns.items():
                with archive.open(f"{key}.npy", "w", force_zip64=True) as member:
                    descr = np.lib.format.dtype_to_descr(EVENT[key])
                    header = {"descr": descr, "fortran_order": False, "shape": (total,)}
                    np.lib.format.write_array_header_1_0(member, header)
                    file.seek(0)
                    shutil.copyfileobj(file, member, 1 << 20)
            for key, value in (("sensor_size", np.array(size, np.int64)), ("metadata", np.array(as_json(metadata)))):
                with archive.open(f"{key}.npy", "w") as member:
                    np.lib.format.write_array(member, value, allow_pickle=False)


def _knows(head: bytes) -> bool:
    """Return whether a zip archive begins with an array."""
    length = int.from_bytes(head[26:28], "little")
    return head.startswith(b"PK\x03\x04") and head[30 : 30 + length].endswith(b".npy")


NPZ = Format("npz", "NumPy NPZ", (".npz",), _knows, Npz, write)
"""NPZ, read and written."""
