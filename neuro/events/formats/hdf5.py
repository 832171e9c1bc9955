"""HDF5 in the layouts of this library, DSEC, Prophesee and aertb.

This library's and DSEC's: ``/events/t``, ``x``, ``y``, ``p``; ``/t_offset``, us, is added to every time;
``/ms_to_idx[k]`` is the number of the first event at or after k ms on the file's own clock. This library writes t as
int64 us from the first event on, chunks with gzip and shuffle, and sensor size and metadata (JSON) as attributes of
``/events``; of recordings of more than 28 hours no ``ms_to_idx``.
Prophesee's: ``/CD/events``, rows x, y, p, t; the sensor as attribute ``geometry`` of the file. Files packed with
Prophesee's own ECF filter cannot be unpacked by HDF5 alone and are refused.
aertb's: ``/<class>/<sample>``, rows x, y, ts, p; a file with one sample is a recording, one with more a data set.

Names and units as in `_columns`, so that similar files are read too.

Source: DSEC's data format page (dsec.ifi.uzh.ch/data-format); Metavision's "HDF5 event file format"; aertb's
``hdf5tools.py``.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.errors import EventFileError
from neuro.events.formats._columns import Names, find_names, to_piece, unit_of
from neuro.events.formats._format import Damage, Format, Piece, Size
from neuro.events.formats._hdf5_attributes import attributes, heaps_whole
from neuro.events.formats._hdf5_chunks import FAILURES, Padded, believable, chunks_whole, one_line, place, unpackable
from neuro.events.formats._hdf5_write import write, write_sample
from neuro.events.formats._metadata import from_json
from neuro.events.formats._seek import bisected
from neuro.events.source import WHOLE, Source

MAGIC = b"\x89HDF\r\n\x1a\n"
_ROW = 13


class Hdf5:
    """An open HDF5 file with one recording; ``metadata`` is made of the attributes."""

    def __init__(self, source: Source) -> None:
        import h5py

        try:
            self._file = h5py.File(source.path or Padded(source.all().data), "r")
            self._recording = _find(self._file)
            self._heaps = heaps_whole(source.all())
            own, whole = (attributes(node, self._heaps) for node in (self._recording.node, self._file))
            self.sensor_size: Size | None = _size(own) or _size(whole)
            self.metadata: Mapping[str, Any] = _metadata(own)
        except Damage:
            raise
        except FAILURES as error:
            raise Damage(f"no whole HDF5: {one_line(error)}", None) from None

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        return self._pieces(block, None)

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """The events from some chunk on; see `Seeker`."""
        return self._pieces(block, start_us)

    def _pieces(self, block: int, start_us: int | None) -> Iterator[Piece]:
        yield from self._recording.pieces(block, start_us)
        if not self._heaps:
            raise Damage("a heap of strings is damaged; attributes with strings were left out", None)


@dataclass(slots=True)
class _Recording:
    """Four datasets, or one of rows.

    Attributes:
        node: the group or dataset with the attributes.
        names: which column is which.
        rows: the dataset of rows, None where there are four.
        offset: added to all times, us.
    """

    node: Any
    names: Names
    rows: Any
    offset: int

    def pieces(self, block: int, start_us: int | None = None) -> Iterator[Piece]:
        columns = [self.rows] if self.rows is not None else [self.node[getattr(self.names, key)] for key in "txyp"]
        shapes = {column.shape for column in columns}
        if len(shapes) != 1 or len(columns[0].shape) != 1:
            told = ", ".join(f"{column.name} {column.shape}" for column in columns)
            raise Damage(f"its columns have the shapes {told}, expected one axis and equal lengths", None)
        for column in columns:
            unpackable(column)
            believable(column)
        total, unit = columns[0].shape[0], self.names.unit
        chunk = (columns[0].chunks or (1 << 15,))[0]
        step = max(1, block // _ROW // chunk) * chunk
        at = 0 if start_us is None else self._sought(columns, step, start_us)
        while at < total or not at:
            try:
                read = self._read(columns, at, min(at + step, total))
            except FAILURES as error:
                if step > chunk:
                    step = chunk
                    continue
                raise Damage(f"event {at} on cannot be read: {one_line(error)}", place(columns[0], at)) from None
            unit = unit_of(read["t"][:chunk]) if unit is None else unit
            piece, fault = to_piece(read, unit, at, None)
            yield self._moved(piece, at)
            if fault:
                raise Damage(fault, place(columns[0], at + len(piece.t)))
            at += len(read["t"])
            if at >= total:
                return

    def _sought(self, columns: list[Any], step: int, start_us: int) -> int:
        """A multiple of a step before which all events are earlier; 0 where the times have no order."""
        unit, scale = self.names.unit or 0, 10 ** abs(self.names.unit or 0)

        def first(number: int) -> int:
            t: int = self._time(columns, number * step)
            us: int = t * scale if unit >= 0 else t // scale + 1
            return us + self.offset

        try:
            return step * bisected(first, -(-columns[0].shape[0] // step), start_us)
        except FAILURES:
            return 0

    def _time(self, columns: list[Any], event: int) -> int:
        """The time of an event as the file has it.

        Raises:
            TypeError: it is no whole number: its unit is to be seen in the first times.
        """
        value = columns[0][event]
        return operator.index(value if self.rows is None else value[self.names.t])

    def _read(self, columns: list[Any], first: int, last: int) -> dict[str, npt.NDArray[Any]]:
        for column in columns:
            chunks_whole(column, first, last)
        if self.rows is None:
            return {key: column[first:last] for key, column in zip("txyp", columns, strict=True)}
        rows = self.rows[first:last]
        return {key: rows[getattr(self.names, key)] for key in "txyp"}

    def _moved(self, piece: Piece, first: int) -> Piece:
        """A piece on the clock of the recording."""
        if not self.offset or not piece.t.size:
            return piece
        if not -(1 << 63) <= int(piece.t.min()) + self.offset <= int(piece.t.max()) + self.offset < 1 << 63:
            raise Damage(f"events {first} on: t_offset {self.offset} leads beyond 2^63 us", None)
        return Piece(piece.t + self.offset, piece.x, piece.y, piece.p)


def read_sample(dataset: Any) -> Events:
    """A sample of a data set that `write_sample` or aertb wrote.

    Args:
        dataset: an open h5py dataset of rows.

    Raises:
        EventFileError: it has no rows of events, or they cannot be read.
        ValueError: an event is impossible; the first is named.
    """
    names = find_names(dataset.dtype.names or ())
    place = f"{dataset.file.filename}:{dataset.name}"
    if names is None:
        raise EventFileError(place, f"has rows of {dataset.dtype}, expected fields ts, x, y, p")
    try:
        (piece,) = _Recording(dataset, names, dataset, 0).pieces(WHOLE)
        told = attributes(dataset, heaps=False)
        size = _size(told) or (int(piece.x.max(initial=0)) + 1, int(piece.y.max(initial=0)) + 1)
        return Events(piece.t, piece.x, piece.y, piece.p, size, _metadata(told))
    except Damage as damage:
        raise EventFileError(place, damage.what, damage.offset) from None


def _find(file: Any) -> _Recording:
    """The one recording of a file."""
    import h5py

    for group in (file.get("events"), file):
        if isinstance(group, h5py.Group) and (names := find_names(_datasets(group))):
            return _Recording(group, names, None, _offset(file, group))
    found = [node for node in _near(file) if isinstance(node, h5py.Dataset) and find_names(node.dtype.names or ())]
    found = [node for node in found if node.name == "/CD/events"] or found
    if len(found) > 1:
        told = ", ".join(node.name for node in found[:3])
        what = f"is a data set with {len(found)} recordings or more ({told}), expected one"
        raise Damage(f"{what}; neuro.events.Dataset reads it", None)
    if not found:
        told = ", ".join(list(file)[:8]) or "nothing"
        raise Damage(f"has {told}; expected /events/t, x, y, p, rows at /CD/events or /<class>/<sample>", None)
    names = find_names(found[0].dtype.names)
    assert names is not None
    return _Recording(found[0], names, found[0], 0)


def _datasets(group: Any) -> list[str]:
    import h5py

    return [name for name in group if isinstance(group.get(name), h5py.Dataset)]


def _near(file: Any, limit: int = 100) -> Iterator[Any]:
    """What lies in the file and in its groups, as far as needed to tell what it is."""
    for group in file.values():
        yield group
        for name in list(getattr(group, "keys", list)())[:limit]:
            yield group.get(name)


def _offset(file: Any, group: Any) -> int:
    for node in (file, group):
        if "t_offset" in node:
            value = node["t_offset"][()]
            if np.ndim(value) or np.asarray(value).dtype.kind not in "iu":
                raise Damage(f"t_offset is {value}, expected one whole number of us", None)
            return int(value)
    return 0


def _size(told: Mapping[str, Any]) -> Size | None:
    """The sensor that attributes tell."""
    if "sensor_size" in told:
        size = np.ravel(told["sensor_size"]).tolist()
    elif {"width", "height"} <= told.keys():
        size = [np.ravel(told[key]).tolist()[0] for key in ("width", "height")]
    elif "geometry" in told:
        size = [int(number) for number in re.findall(r"\d+", str(told["geometry"]))]
    else:
        return None
    if len(size) != 2 or not all(isinstance(n, int) and 1 <= n <= 65536 for n in size):
        raise Damage(f"its sensor is {size}, expected width and height from 1 to 65536", None)
    return size[0], size[1]


def _metadata(told: dict[str, Any]) -> dict[str, Any]:
    """Attributes as metadata; those that this library wrote as JSON as they were."""
    text = told.get("metadata", "{}")
    rest = {key: value for key, value in told.items() if key not in ("sensor_size", "metadata")}
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in rest.items()}
    return plain | (from_json(text) if isinstance(text, str) else {})


HDF5 = Format("hdf5", "HDF5", (".h5", ".hdf5"), lambda head: head.startswith(MAGIC), Hdf5, write)
"""Read and written."""

__all__ = ["HDF5", "Hdf5", "read_sample", "write", "write_sample"]
