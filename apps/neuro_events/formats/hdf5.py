"""HDF5 in the layouts of this library, DSEC, Prophesee, aertb, e2vid, M3ED, v2e and MVSEC.

This library and DSEC: ``/events/t``, ``x``, ``y``, ``p``; ``/t_offset``, us, is added to every time;
``/ms_to_idx[k]`` is the number of the first event at or after k ms on the file's own clock. This library writes t as
int64 us from the first event on, chunks with gzip and shuffle, and sensor size and metadata (JSON) as attributes of
``/events``. Recordings of more than 28 hours have no ``ms_to_idx``.
Prophesee: ``/CD/events``, rows x, y, p, t; the sensor as attribute ``geometry`` of the file. Files compressed with
Prophesee's own ECF filter cannot be decoded by HDF5 alone and are refused.
aertb: ``/<class>/<sample>``, rows x, y, ts, p. A file with one sample is a recording, with several a data set.
e2vid: ``/events/ts`` (s), ``xs``, ``ys``, ``ps``; the sensor as attribute ``sensor_resolution``, height first.
M3ED: ``/prophesee/left/t`` (us), ``x``, ``y``, ``p``; the sensor in ``calib/resolution`` beside them, width first.
v2e: the table ``/events``, t (us) x y p. MVSEC: the table ``/davis/left/events``, x y t (s) p, with p -1 or 1.

Names and units of columns are as in `_columns`, so that similar files can be read too. For columns without names see
`_hdf5_recording`, for the sensor `size_of`. Columns, rows and tables called ``event...`` are searched for in three
levels. ``format="hdf5:/davis/left"``, a path inside the file, selects one of several recordings.

Source: DSEC's data format page (dsec.ifi.uzh.ch/data-format); Metavision's "HDF5 event file format"; aertb's
``hdf5tools.py``; v2e's ``emulator.py``; published readers of M3ED and MVSEC.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule, hdf5
from neuro_events._events import EVENT, Events
from neuro_events.formats._format import Damage, Format, Piece, Size, Unsavable, as_json, from_json
from neuro_events.formats._hdf5_recording import FAILURES, Padded, find, of_rows, one_line
from neuro_events.source import WHOLE, Bytes, EventFileError, Source

h5py = LazyModule("h5py")

UNTESTED = "no recording in another layout than this library's was available"


class Hdf5:
    """A reader of a recording in an HDF5 file.

    Args:
        source: the file.
        where: group or dataset of the recording, "" if there is only one; see `_hdf5_recording.find`.

    Attributes:
        metadata: the attributes of the recording, and ``columns``, the order of columns without names.
        untested: reason why a layout was not tested on real files, "" for the layout of this library.
    """

    def __init__(self, source: Source, where: str = "") -> None:
        self._file: Any = None
        self._bytes: Any = b""
        try:
            self._file = h5py.File(source.path or Padded(source.all().data), "r")
            self._recording = find(self._file, where)
            self._bytes = source.all()
            self._heaps = heaps_are_intact(self._bytes)
            local, shared = (attributes(node, self._heaps) for node in (self._recording.node, self._file))
            self._sizes = local, shared, _calibration(self._recording.node)
            self.metadata: Mapping[str, Any] = metadata_of(local) | self._recording.column_order()
            self.untested = "" if {"sensor_size", "metadata"} <= local.keys() else UNTESTED
        except Damage:
            self.close()
            raise
        except FAILURES as error:
            self.close()
            raise Damage(f"not an intact HDF5 file: {one_line(error)}", None) from None

    def close(self) -> None:
        """Close the file completely: HDF5 would otherwise identify a new file at the same path with the open one."""
        self._bytes = b""
        if self._file is not None:
            self._file.close()

    @property
    def sensor_size(self) -> Size | None:
        """Width and height that the file states, or None.

        Raises:
            Damage: the size is impossible, or its order is ambiguous.
        """
        return next((size for facts in self._sizes if (size := size_of(facts))), None)

    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the events; see `Reader`."""
        return self._pieces(block, None)

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """Yield the events from a chunk on; see `Seeker`."""
        return self._pieces(block, start_us)

    def _pieces(self, block: int, start_us: int | None) -> Iterator[Piece]:
        yield from self._recording.pieces(block, start_us)
        if not self._heaps:
            raise Damage("a heap of strings is damaged; attributes with strings were skipped", None)
        # Only files of this library have a front with a digest.
        front = None if start_us is not None else hdf5.Front.of(bytes(self._bytes[: hdf5.FRONT]))
        if front is not None and not front.fits(lambda at, n: self._bytes[at : at + n]):
            raise Damage("damaged: the content does not match the digest", None)


def read_sample(dataset: Any) -> Events:
    """Return a sample of a data set that `write_sample` or aertb wrote.

    Args:
        dataset: an open h5py dataset of rows.

    Raises:
        EventFileError: the dataset has no rows of events, or the rows cannot be read.
        ValueError: an event is impossible; the message names the first one.
    """
    place = f"{dataset.file.filename}:{dataset.name}"
    if (recording := of_rows(dataset)) is None:
        raise EventFileError(place, f"has rows of {dataset.dtype}, expected fields ts, x, y, p")
    try:
        (piece,) = recording.pieces(WHOLE)
        facts = attributes(dataset, heaps=False)
        size = size_of(facts) or (int(piece.x.max(initial=0)) + 1, int(piece.y.max(initial=0)) + 1)
        return Events(piece.t, piece.x, piece.y, piece.p, size, metadata_of(facts))
    except Damage as damage:
        raise EventFileError(place, damage.what, damage.offset) from None


def sample_size(dataset: Any) -> Size | None:
    """Return the width and height that a sample states, or None.

    Args:
        dataset: see `read_sample`.

    Raises:
        Damage: the size is impossible, or its order is ambiguous.
    """
    return size_of(attributes(dataset, heaps=False))


def _calibration(node: Any) -> dict[str, Any]:
    """Return the sensor in ``calib/resolution`` (width, height) beside M3ED's columns, as an attribute, if any."""
    resolution = node.get("calib/resolution") if hasattr(node, "get") else None
    return {} if resolution is None or getattr(resolution, "size", 0) != 2 else {"sensor_size": resolution[()]}


NEAR = 1 << 25
"""Number of bytes at the beginning and at the end of a file that are searched for heaps: 32 MiB."""

_HEAP = re.compile(b"GCOL\x01")


def heaps_are_intact(data: Bytes) -> bool:
    """Return whether the heaps near the beginning and the end of a file are intact: the sizes of their objects add up.

    HDF5 stores strings of variable length in heaps, and its library loops forever in a heap with damaged sizes.
    Strings of variable length are therefore read only if all heaps are intact. Strings of fixed length, as in files of
    this library, are not stored in heaps.

    Source: "HDF5 File Format Specification 3.0", section III.E, "Disk Format: Level 1E - Global Heap".
    """
    areas = [data] if data.size <= 2 * NEAR else [data[:NEAR], data[-NEAR:]]
    return all(_is_filled(part[match.start() :]) for part in areas for match in _HEAP.finditer(part.data))


def _is_filled(heap: Bytes) -> bool:
    """Return whether the objects fill the heap. An object takes 16 bytes and its content. Object 0 is free space."""
    end = _number(heap, 8)
    if end > heap.size:
        return False
    at = 16
    while end - at >= 16:
        index, size = _number(heap, at) & 0xFFFF, _number(heap, at + 8)
        at += 16 + -(-size // 8) * 8 if index else size
        if index == 0 and size < 16:
            return False
    return at <= end


def _number(data: Bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 8].tobytes(), "little")


def attributes(node: Any, heaps: bool) -> dict[str, Any]:
    """Return the attributes of a group or dataset that are numbers or text.

    Args:
        node: an open h5py group or dataset.
        heaps: also read strings of variable length.
    """
    values = {}
    for name in node.attrs:
        attribute = h5py.h5a.open(node.id, name.encode())
        has_fixed_size = attribute.dtype.kind in "biufSU" and attribute.get_space().get_simple_extent_npoints() < NEAR
        if has_fixed_size or (heaps and h5py.check_string_dtype(attribute.dtype) is not None):
            value = node.attrs[name]
            values[name] = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return values


def size_of(facts: Mapping[str, Any]) -> Size | None:
    """Return the width and height of the sensor in attributes, or None.

    The attribute is ``sensor_size`` or ``geometry`` (width, height), ``width`` and ``height``, or e2vid's
    ``sensor_resolution``: height, width and optionally channels, as the shape of an image. Some tools write width
    before height. A ``sensor_resolution`` whose height exceeds its width is therefore ambiguous and refused.

    Raises:
        Damage: the size is impossible, or the order of ``sensor_resolution`` is ambiguous.

    Source: the event packagers of rpg_e2vid's and its successors' tools (``sensor_resolution`` = ``image.shape``).
    """
    if "sensor_size" in facts:
        size = np.ravel(facts["sensor_size"]).tolist()
    elif {"width", "height"} <= facts.keys():
        size = [number for key in ("width", "height") for number in np.ravel(facts[key]).tolist()[:1]]
    elif "geometry" in facts:
        size = [int(number) for number in re.findall(r"\d+", str(facts["geometry"]))]
    elif "sensor_resolution" in facts:
        size = _resolution(np.ravel(facts["sensor_resolution"]).tolist())
    else:
        return None
    if len(size) != 2 or not all(isinstance(n, int) and 1 <= n <= 65536 for n in size):
        raise Damage(f"its sensor is {size}, expected width and height from 1 to 65536", None)
    return size[0], size[1]


def _resolution(values: list[Any]) -> list[Any]:
    """Return width and height of (height, width[, channels])."""
    size = [int(n) if isinstance(n, float) and n.is_integer() else n for n in values[1::-1]]
    if len(values) not in (2, 3) or not all(isinstance(n, int) for n in size):
        raise Damage(f"sensor_resolution is {values}, expected height and width", None)
    width, height = size
    if height > width:
        hint = f"specify sensor_size=({height}, {width}) or ({width}, {height}), or --sensor WxH"
        raise Damage(f"sensor_resolution is {values}, in an unclear order of height and width: {hint}", None)
    return size


def metadata_of(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Convert attributes to metadata. Metadata that this library stored as JSON are restored."""
    text = facts.get("metadata", "{}")
    extra = {key: value for key, value in facts.items() if key not in ("sensor_size", "metadata")}
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in extra.items()}
    return plain | (from_json(text) if isinstance(text, str) else {})


def describe(target: Any, sensor_size: tuple[int, int], metadata: Any) -> None:
    """Store sensor size and metadata as attributes of a group or dataset, unless already stored."""
    if "sensor_size" not in target.attrs:
        text = as_json(metadata).encode()
        target.attrs["sensor_size"] = np.array(sensor_size, np.int64)
        target.attrs.create("metadata", text, dtype=h5py.string_dtype("utf-8", len(text)))


FORMAT = "neuro events 1"

SAMPLE = np.dtype([("ts", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
"""Row of a sample, with aertb's field names and integer times."""

CHUNK = 1 << 15
"""Number of events in a chunk; 256 KiB of times, within HDF5's cache of 1 MiB."""

INDEX_LIMIT = 10**8
"""Duration of the longest recording with an index, ms: 28 hours."""
INDEX_BLOCK = 10**6
"""Number of ms by which the index is extended at a time."""

PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}


def write(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as HDF5 in DSEC's layout; see the module's docstring.

    Raises:
        Unsavable: a time lies 2^63 us or more after the first.
    """
    # The format of HDF5 1.8 allows attributes longer than 64 KiB.
    with hdf5.new_file(path, FORMAT, libver=("v108", "v108")) as file:
        group = file.create_group("events")
        columns = {key: _column(group, key, EVENT[key]) for key in "txyp"}
        index, offset, n_written = _column(file, "ms_to_idx", np.dtype("<u8")), 0, 0
        for events in parts:
            describe(group, events.sensor_size, events.metadata)
            if not len(events):
                continue
            offset = offset if n_written else int(events.t[0])
            if int(events.t[-1]) - offset >= 1 << 63:
                raise Unsavable(f"t {events.t[-1]} lies 2^63 us or more after the first", n_written + len(events) - 1)
            t = events.t - offset
            for key, values in (("t", t), ("x", events.x), ("y", events.y), ("p", events.p)):
                _append(columns[key], values)
            if index is not None and t[-1] // 1000 >= INDEX_LIMIT:
                del file["ms_to_idx"]
                index = None
            if index is not None:
                _extend_index(index, t, n_written)
            n_written += len(events)
        file.create_dataset("t_offset", data=np.int64(offset))


def write_sample(group: Any, name: str, events: Events) -> None:
    """Write a recording into a data set as one array of rows ts, x, y, p, in aertb's layout.

    Args:
        group: the open h5py group of the recording's class.
        name: name of the sample.
        events: the recording; sensor size and metadata become attributes.

    Raises:
        ValueError: the group already has an item with this name.
    """
    rows = np.empty(len(events), SAMPLE)
    rows["ts"], rows["x"], rows["y"], rows["p"] = events.t, events.x, events.y, events.p
    chunk = max(1, min(len(rows), CHUNK))
    dataset = group.create_dataset(name, data=rows, maxshape=(None,), chunks=(chunk,), **PACKED)
    describe(dataset, events.sensor_size, events.metadata)


def _column(group: Any, name: str, kind: np.dtype[Any]) -> Any:
    return group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(CHUNK,), **PACKED)


def _append(dataset: Any, values: npt.NDArray[Any]) -> None:
    begin = dataset.shape[0]
    dataset.resize((begin + values.size,))
    dataset[begin:] = values


def _extend_index(index: Any, t: npt.NDArray[np.int64], n_before: int) -> None:
    """Extend the index, the number of the first event at or after each ms, up to the last event."""
    end = int(t[-1]) // 1000 + 1
    for begin in range(index.shape[0], end, INDEX_BLOCK):
        starts = 1000 * np.arange(begin, min(end, begin + INDEX_BLOCK), dtype=np.int64)
        _append(index, n_before + np.searchsorted(t, starts).astype(np.uint64))


HDF5 = Format("hdf5", "HDF5", (".h5", ".hdf5"), hdf5.is_hdf5, Hdf5, write, inside=Hdf5)
"""HDF5, read and written."""
