"""HDF5 in the layouts of this library, DSEC, Prophesee, aertb, e2vid, M3ED, v2e and MVSEC.

This library's and DSEC's: ``/events/t``, ``x``, ``y``, ``p``; ``/t_offset``, us, is added to every time;
``/ms_to_idx[k]`` is the number of the first event at or after k ms on the file's own clock. This library writes t as
int64 us from the first event on, chunks with gzip and shuffle, and sensor size and metadata (JSON) as attributes of
``/events``; of recordings of more than 28 hours no ``ms_to_idx``.
Prophesee's: ``/CD/events``, rows x, y, p, t; the sensor as attribute ``geometry`` of the file. Files packed with
Prophesee's own ECF filter cannot be unpacked by HDF5 alone and are refused.
aertb's: ``/<class>/<sample>``, rows x, y, ts, p; a file with one sample is a recording, one with more a data set.
e2vid's: ``/events/ts`` (s), ``xs``, ``ys``, ``ps``; the sensor as attribute ``sensor_resolution``, height first.
M3ED's: ``/prophesee/left/t`` (us), ``x``, ``y``, ``p``; the sensor in ``calib/resolution`` beside them, width first.
v2e's: the table ``/events``, t (us) x y p. MVSEC's: the table ``/davis/left/events``, x y t (s) p, with p -1 or 1.

Names and units of columns as in `_columns`, so that similar files are read too; the order of those without names as in
`_hdf5_table`, the sensor as in `_hdf5_attributes`. Columns, rows and tables called ``event...`` are looked for in three
levels. Of a file with several recordings one is read with ``format="hdf5:/davis/left"``, a path inside the file.

Source: DSEC's data format page (dsec.ifi.uzh.ch/data-format); Metavision's "HDF5 event file format"; aertb's
``hdf5tools.py``; v2e's ``emulator.py``; published readers of M3ED and MVSEC.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from neuro.core.hdf5 import FRONT, Front, is_hdf5
from neuro.events._events import Events
from neuro.events.errors import EventFileError
from neuro.events.formats._format import Damage, Format, Piece, Size
from neuro.events.formats._hdf5_attributes import attributes, heaps_whole, metadata_of, size_of
from neuro.events.formats._hdf5_chunks import FAILURES, Padded, one_line
from neuro.events.formats._hdf5_find import find
from neuro.events.formats._hdf5_recording import of_rows
from neuro.events.formats._hdf5_write import write, write_sample
from neuro.events.source import WHOLE, Source

UNTESTED = "no recording in another layout than this library's was at hand"


class Hdf5:
    """An open HDF5 file with one recording, or one of several.

    Args:
        source: the file.
        where: the group or dataset of the recording, "" where there is only one; see `_hdf5_find.find`.

    Attributes:
        metadata: made of the attributes; ``columns`` is the order of those that have no names.
        untested: why a layout was not tried on real files, "" for this library's own.
    """

    def __init__(self, source: Source, where: str = "") -> None:
        import h5py

        self._file: Any = None
        self._bytes: Any = b""
        try:
            self._file = h5py.File(source.path or Padded(source.all().data), "r")
            self._recording = find(self._file, where)
            self._bytes = source.all()
            self._heaps = heaps_whole(self._bytes)
            own, whole = (attributes(node, self._heaps) for node in (self._recording.node, self._file))
            self._sizes = own, whole, _calibration(self._recording.node)
            self.metadata: Mapping[str, Any] = metadata_of(own) | self._recording.told()
            self.untested = "" if {"sensor_size", "metadata"} <= own.keys() else UNTESTED
        except Damage:
            self.close()
            raise
        except FAILURES as error:
            self.close()
            raise Damage(f"no whole HDF5: {one_line(error)}", None) from None

    def close(self) -> None:
        """Close all that is open of the file: HDF5 would take what is written to its place for the same file."""
        self._bytes = b""
        if self._file is not None:
            self._file.close()

    @property
    def sensor_size(self) -> Size | None:
        """Width and height that the file tells, None where it does not.

        Raises:
            Damage: they are impossible, or may be height and width.
        """
        return next((size for told in self._sizes if (size := size_of(told))), None)

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
        if start_us is None and not self._is_whole():
            raise Damage("damaged: it is not what was written", None)

    def _is_whole(self) -> bool:
        """Whether a file that this library wrote is what was written; of others nothing is known."""
        front = Front.of(bytes(self._bytes[:FRONT]))
        return front is None or front.fits(lambda at, n: self._bytes[at : at + n])


def read_sample(dataset: Any) -> Events:
    """A sample of a data set that `write_sample` or aertb wrote.

    Args:
        dataset: an open h5py dataset of rows.

    Raises:
        EventFileError: it has no rows of events, or they cannot be read.
        ValueError: an event is impossible; the first is named.
    """
    place = f"{dataset.file.filename}:{dataset.name}"
    if (recording := of_rows(dataset)) is None:
        raise EventFileError(place, f"has rows of {dataset.dtype}, expected fields ts, x, y, p")
    try:
        (piece,) = recording.pieces(WHOLE)
        told = attributes(dataset, heaps=False)
        size = size_of(told) or (int(piece.x.max(initial=0)) + 1, int(piece.y.max(initial=0)) + 1)
        return Events(piece.t, piece.x, piece.y, piece.p, size, metadata_of(told))
    except Damage as damage:
        raise EventFileError(place, damage.what, damage.offset) from None


def sample_size(dataset: Any) -> Size | None:
    """Width and height that a sample tells, None where it does not.

    Args:
        dataset: as for `read_sample`.

    Raises:
        Damage: they are impossible, or may be height and width.
    """
    return size_of(attributes(dataset, heaps=False))


def _calibration(node: Any) -> dict[str, Any]:
    """The sensor beside M3ED's columns: ``calib/resolution``, width and height."""
    resolution = node.get("calib/resolution") if hasattr(node, "get") else None
    return {} if resolution is None or getattr(resolution, "size", 0) != 2 else {"sensor_size": resolution[()]}


HDF5 = Format("hdf5", "HDF5", (".h5", ".hdf5"), is_hdf5, Hdf5, write, inside=Hdf5)
"""Read and written."""

__all__ = ["HDF5", "Hdf5", "read_sample", "sample_size", "write", "write_sample"]
