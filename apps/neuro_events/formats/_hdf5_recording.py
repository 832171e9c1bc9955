"""The recording of an HDF5 file among all else that lies in it: four datasets, one of rows, or a table without names.

Tables in HDF5: (n, 4) numbers without names, of which the order of columns has to be found.

Known by place and type: v2e's ``/events`` (or ``/event``) of uint32 is t x y p, t in us; MVSEC's
``/davis/<side>/events`` of floating point is x y t p, t in s. Another table is t x y p, x y t p or x y p t: the one
that its first rows allow, with whole coordinates, polarities -1, 0 or 1, and times that do not run back. So is a table
in a known place that does not hold what it should. Where more than one order is left, the file is refused.

Source: v2e's ``emulator.py`` (``dvs_h5``: uint32, times 10^6, -1 written as 0); the page and readers of MVSEC.
"""

from __future__ import annotations

import io
import itertools
import math
import operator
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events.formats._columns import SECONDS, US, Names, find_names, fits, to_piece, unit_of
from neuro_events.formats._format import Damage, Piece, extra
from neuro_events.formats._reading import bisect_blocks

h5py = LazyModule("h5py")

_ROW = 13


@dataclass(slots=True)
class OpenRecording:
    """Four datasets, or one of rows.

    Attributes:
        node: the open group or dataset, which has the attributes.
        datasets: those of t, x, y and p; or the one of rows.
        keys: which field or column of a row is t, x, y and p; () where there are four datasets.
        unit: power of ten by which a time becomes us, None where the times have to be looked at.
        offset: added to all times, us.
    """

    node: Any
    datasets: tuple[Any, ...]
    keys: tuple[str | int, ...]
    unit: int | None
    offset: int = 0

    def told(self) -> dict[str, str]:
        """The order of columns without names, as metadata."""
        if not self.keys or isinstance(self.keys[0], str):
            return {}
        return {"columns": " ".join("txyp"[self.keys.index(k)] for k in range(len(self.keys)))}

    def pieces(self, block: int, start_us: int | None = None) -> Iterator[Piece]:
        """The events; see `neuro.events.formats.Reader` and `Seeker`."""
        total, chunk = self._checked(), (self.datasets[0].chunks or (1 << 15,))[0]
        unit, step = self.unit, max(1, block // _ROW // chunk) * chunk
        at = 0 if start_us is None else self._sought(step, start_us)
        checks = [chunks_check(dataset) for dataset in self.datasets]
        while at < total or not at:
            try:
                read = self._read(at, min(at + step, total), checks)
            except FAILURES as error:
                if step > chunk:
                    step = chunk
                    continue
                raise Damage(f"event {at} on cannot be read: {one_line(error)}", place(self.datasets[0], at)) from None
            unit = unit_of(read["t"][:chunk]) if unit is None else unit
            piece, fault = to_piece(read, unit, at, None)
            yield self._moved(piece, at)
            if fault:
                raise Damage(fault, place(self.datasets[0], at + len(piece.t)))
            at += len(read["t"])
            if at >= total:
                return

    def _checked(self) -> int:
        """The number of events, if the datasets can hold so many."""
        shapes = {dataset.shape for dataset in self.datasets}
        axes = 2 if self.keys and isinstance(self.keys[0], int) else 1
        if len(shapes) != 1 or len(self.datasets[0].shape or ()) != axes:
            listed = ", ".join(f"{dataset.name} {dataset.shape}" for dataset in self.datasets)
            raise Damage(f"its columns have the shapes {listed}, expected one axis and equal lengths", None)
        for dataset in self.datasets:
            unpackable(dataset)
            believable(dataset)
        return len(self.datasets[0])

    def _sought(self, step: int, start_us: int) -> int:
        """A multiple of a step before which all events are earlier; 0 where the times have no order."""
        unit, scale = self.unit or 0, 10 ** abs(self.unit or 0)

        def first(number: int) -> int:
            t = self._time(number * step)
            us: int = t * scale if unit >= 0 else t // scale + 1
            return us + self.offset

        try:
            return step * bisect_blocks(first, -(-len(self.datasets[0]) // step), start_us)
        except FAILURES:
            return 0

    def _time(self, event: int) -> int:
        """The time of an event as the file has it.

        Raises:
            TypeError: it is no whole number: its unit is to be seen in the first times.
        """
        value = self.datasets[0][event]
        return operator.index(value[self.keys[0]] if self.keys else value)

    def _read(self, first: int, last: int, checks: list[Callable[[int, int], None]]) -> dict[str, npt.NDArray[Any]]:
        for check in checks:
            check(first, last)
        read = [dataset[first:last] for dataset in self.datasets]
        columns = [read[0][:, key] if isinstance(key, int) else read[0][key] for key in self.keys] or read
        return dict(zip("txyp", columns, strict=True))

    def _moved(self, piece: Piece, first: int) -> Piece:
        """A piece on the clock of the recording."""
        if not self.offset or not piece.t.size:
            return piece
        if not -(1 << 63) <= int(piece.t.min()) + self.offset <= int(piece.t.max()) + self.offset < 1 << 63:
            raise Damage(f"events {first} on: t_offset {self.offset} leads beyond 2^63 us", None)
        return Piece(piece.t + self.offset, piece.x, piece.y, piece.p)


def of_columns(group: Any, names: Names, offset: int) -> OpenRecording:
    """Four datasets of a group."""
    return OpenRecording(group, tuple(group[name] for name in _keys(names)), (), names.unit, offset)


def of_rows(dataset: Any) -> OpenRecording | None:
    """A dataset of rows with named fields, None where they are no events."""
    names = find_names(dataset.dtype.names or ())
    return None if names is None else OpenRecording(dataset, (dataset,), _keys(names), names.unit)


def of_table(dataset: Any, order: str = "") -> OpenRecording:
    """A dataset of rows without names.

    Args:
        dataset: one that `is_table`.
        order: of its columns, such as "txyp"; "" finds it.

    Raises:
        Damage: the order cannot be found.
    """
    found = order or order_of_table(dataset)
    return OpenRecording(dataset, (dataset,), tuple(found.index(name) for name in "txyp"), unit_of_table(dataset))


def _keys(names: Names) -> tuple[str, ...]:
    return names.t, names.x, names.y, names.p


ORDERS = ("txyp", "xytp", "xypt")
"""Of columns in the tables that are known; see `order_of_table`."""
ROWS = 1 << 16
"""Rows by which the order is found."""

_V2E = re.compile(r"/events?")
_MVSEC = re.compile(r"/davis/[^/]+/events")


def is_table(node: Any) -> bool:
    """Whether an open h5py dataset has four columns of numbers."""
    shape = getattr(node, "shape", None) or ()
    return list(shape[1:]) == [4] and node.dtype.kind in "iuf"


def order_of_table(table: Any) -> str:
    """The order of the columns of a table, as one of `ORDERS`.

    Args:
        table: an open h5py dataset that `is_table`.

    Raises:
        Damage: no order fits or several do, or the table cannot be read.
    """
    rows, likely = _first(table), _known(table)
    possible = [one for one in ORDERS if fits(rows, one, in_time=False)]
    certain = [one for one in possible if fits(rows, one, in_time=True)] or possible
    if likely in certain:
        return likely
    if len(certain) == 1 or not len(rows):
        return certain[0]
    if not certain:
        what = "expected t x y p, x y t p or x y p t, with whole coordinates and polarities -1, 0 or 1"
        raise Damage(f"{table.name} has rows such as {rows[0].tolist()}, {what}", None)
    names = " and ".join(" ".join(one) for one in certain)
    name = f"hdf5:{table.name}:{certain[0]}"
    hint = f"name the order, as in format={name!r} or --from {name}"
    raise Damage(f"the rows of {table.name} can be {names}: {hint}", None)


def unit_of_table(table: Any) -> int | None:
    """The power of ten by which the times of a table become us, None where they have to be looked at."""
    if table.dtype.kind != "f":
        return US
    return SECONDS if _MVSEC.fullmatch(table.name) else None


def _known(table: Any) -> str:
    """The order that place and type of a table tell, "" where they tell none."""
    if table.dtype == np.uint32 and _V2E.fullmatch(table.name):
        return "txyp"
    return "xytp" if table.dtype.kind == "f" and _MVSEC.fullmatch(table.name) else ""


def _first(table: Any) -> Any:
    """The first rows; those of the first chunk, where the ones behind it cannot be read."""
    unpackable(table)
    believable(table)
    counts = [ROWS, min(ROWS, (table.chunks or (ROWS,))[0])]
    for count in counts:
        try:
            chunks_whole(table, 0, min(count, len(table)))
            return table[:count]
        except FAILURES as error:
            fault = error
    raise Damage(f"event 0 on cannot be read: {one_line(fault)}", place(table, 0))


DEPTH = 3
"""Levels of a file that are looked at: ``/davis/left/events``."""
LIMIT = 100
"""Most members of a group, below the first level, that are looked at to tell what a file is."""


def find(file: Any, where: str = "") -> OpenRecording:
    """The recording of a file.

    Args:
        file: an open h5py file.
        where: the group or dataset, such as ``/davis/left``, where there are several; ``:txyp`` behind it tells the
            order of the columns of a table.

    Raises:
        Damage: there is none, or more than one; or part of it is kept in another file.
    """
    recording = _find(file, where)
    for dataset in recording.datasets:
        if not _own(file, dataset):
            raise Damage(f"{dataset.name} is kept in another file, expected all of a recording in one", None)
    return recording


def member(group: Any, name: str) -> Any:
    """What a name in an open h5py group leads to, None where nothing is there.

    Raises:
        Damage: it cannot be followed, as a link to itself.
    """
    try:
        return group.get(name)
    except FAILURES as error:
        place = name if name.startswith("/") else f"{group.name.rstrip('/')}/{name}"
        raise Damage(f"{place} cannot be opened: {one_line(error)}", None) from None


def _own(file: Any, dataset: Any) -> bool:
    """Whether a dataset has its items in this file: links and storage may name any other that the user can read."""
    from h5py import h5o

    return (
        not (dataset.is_virtual or dataset.external) and h5o.get_info(dataset.id).fileno == h5o.get_info(file.id).fileno
    )


def _find(file: Any, where: str) -> OpenRecording:
    place, order = _parted(where)
    if place:
        return _at(file, place, order)
    for group in (member(file, "events"), file):
        if names := _columns(group):
            return of_columns(group, names, _offset(file, group))
    found = list(_candidates(file))
    found = [node for node in found if node.name == "/CD/events"] or found
    if not found:
        members = ", ".join(list(file)[:8]) or "nothing"
        raise Damage(f"has {members}; expected /events/t, x, y, p, rows at /CD/events or /<class>/<sample>", None)
    if len(found) > 1:
        raise Damage(_several(found), None)
    return _recording(file, found[0], order)


def _parted(where: str) -> tuple[str, str]:
    """A place, and the order of columns behind it."""
    place, _, order = where.rpartition(":")
    return (place, order) if sorted(order) == sorted("txyp") else (where, "")


def _at(file: Any, place: str, order: str) -> OpenRecording:
    """The recording at a place, or below it."""
    node = member(file, place)
    if isinstance(node, h5py.Group) and not _columns(node):
        found = list(_candidates(node))
        if len(found) > 1:
            raise Damage(_several(found), None)
        node = found[0] if found else node
    elif isinstance(node, h5py.Dataset) and not _rows(node) and not is_table(node):
        raise Damage(f"{node.name} has items of {node.dtype} in shape {node.shape}, expected rows of events", None)
    if node is None or (isinstance(node, h5py.Group) and not _columns(node)):
        names = ", ".join(one.name for one in islice(_candidates(file), 4))
        raise Damage(f"has no recording at {place}, expected {names or 'another file: it has none'}", None)
    return _recording(file, node, order)


def _recording(file: Any, node: Any, order: str) -> OpenRecording:
    if names := _columns(node):
        return of_columns(node, names, _offset(file, node))
    return of_rows(node) or of_table(node, order)


def _several(found: list[Any]) -> str:
    message = f"{len(found)} recordings or more ({', '.join(node.name for node in found[:3])}), expected one"
    if all(_rows(node) for node in found):
        return f"is a data set with {message}; neuro.events.Dataset reads it"
    name = f"hdf5:{found[0].name}"
    return f"has {message}: name it, as in format={name!r} or --from {name}"


def _candidates(group: Any, depth: int = DEPTH) -> Iterator[Any]:
    """What can be a recording below a group: groups with columns, rows, and tables that are called events."""
    for name in list(group)[: None if depth == DEPTH else LIMIT]:
        node = member(group, name)
        if isinstance(node, h5py.Dataset):
            if _rows(node) or (is_table(node) and name.lower().startswith("event")):
                yield node
        elif isinstance(node, h5py.Group) and depth > 1:
            if _columns(node):
                yield node
            else:
                yield from _candidates(node, depth - 1)


def _rows(node: Any) -> bool:
    return find_names(node.dtype.names or ()) is not None if hasattr(node, "dtype") else False


def _columns(group: Any) -> Names | None:
    """Which datasets of a group are columns of events, if it is one and they are there."""
    if not isinstance(group, h5py.Group):
        return None
    return find_names(name for name in group if isinstance(member(group, name), h5py.Dataset))


def _offset(file: Any, group: Any) -> int:
    for node in (file, group):
        if "t_offset" in node:
            value = node["t_offset"][()]
            if np.ndim(value) or np.asarray(value).dtype.kind not in "iu":
                raise Damage(f"t_offset is {value}, expected one whole number of us", None)
            return int(value)
    return 0


ECF = 36559
"""Prophesee's registered filter number."""

SWELL = 1100
"""Most bytes that one byte of a file unpacks to; 1032 of gzip, which is the most that HDF5's own filters reach."""

FAILURES = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError, OverflowError)
"""What h5py raises for a damaged file."""

SHUFFLE, FLETCHER = 2, 3
"""Filters that keep the length, but for a check sum of 4 bytes of the latter."""


class Padded(io.BytesIO):
    """Bytes as a file; what HDF5 asks for beyond its end is 0, since h5py leaves there what was in memory."""

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer."""
        count = super().readinto(buffer)
        buffer[count:] = bytes(len(buffer) - count)
        return count


def unpackable(dataset: Any) -> None:
    """Refuse a dataset that is packed in a way which is not known here.

    Args:
        dataset: an open h5py dataset.

    Raises:
        Damage: it is.
    """
    plist = dataset.id.get_create_plist()
    for k in range(plist.get_nfilters()):
        number = plist.get_filter(k)[0]
        if h5py.h5z.filter_avail(number):
            continue
        if number == ECF:
            text = "is packed with Prophesee's ECF filter, which HDF5 alone cannot unpack"
            raise Damage(f"{dataset.name} {text}: use the RAW file, or export it with Metavision's tools", None)
        extra("hdf5plugin", f"{dataset.name}, packed with HDF5 filter {number},")
        if not h5py.h5z.filter_avail(number):
            raise Damage(f"{dataset.name} is packed with HDF5 filter {number}, which is not known", None)


def believable(dataset: Any) -> None:
    """Refuse a dataset whose length cannot be: it would fill the memory.

    Args:
        dataset: an open h5py dataset.

    Raises:
        Damage: it is longer than what is stored of it can be when unpacked, or cannot be looked at.
    """
    try:
        stored = min(dataset.id.get_storage_size(), dataset.file.id.get_filesize())
        size = dataset.size * dataset.dtype.itemsize
    except FAILURES as error:
        raise Damage(f"{dataset.name} cannot be read: {one_line(error)}", None) from None
    if size > SWELL * stored:
        raise Damage(f"{dataset.name} has {dataset.size} items, which {stored} bytes cannot hold", None)


def chunks_whole(dataset: Any, first: int, last: int) -> None:
    """Refuse chunks that are not packed and not as long as they should be.

    Args:
        dataset: an open h5py dataset.
        first: number of an item along the first axis.
        last: number after the last item.

    Raises:
        ValueError: there is one.
    """
    if dataset.chunks is None:
        return
    fault = _fault(dataset)
    long, *wide = dataset.chunks
    rows = range(first // long * long, last, long)
    for at in itertools.product(rows, *map(range, itertools.repeat(0), dataset.shape[1:], wide)):
        if text := fault(dataset.id.get_chunk_info_by_coord(at)):
            raise ValueError(text)


def chunks_check(dataset: Any) -> Callable[[int, int], None]:
    """As `chunks_whole`, for a dataset that is read in many parts.

    To find one chunk HDF5 goes through all before it, so all are looked at once, where nothing is damaged.
    """
    if dataset.chunks is None:
        return lambda first, last: None
    fault, faults = _fault(dataset), []
    try:
        dataset.id.chunk_iter(lambda chunk: faults.append(text) if (text := fault(chunk)) else None)
    except FAILURES:
        return partial(chunks_whole, dataset)
    return partial(chunks_whole, dataset) if faults else lambda first, last: None


def _fault(dataset: Any) -> Callable[[Any], str]:
    """Tells what is wrong with the length of a chunk of a dataset, "" where nothing is."""
    filters = dataset.id.get_create_plist()
    kinds = [filters.get_filter(k)[0] for k in range(filters.get_nfilters())]
    size = math.prod(dataset.chunks) * dataset.dtype.itemsize

    def fault(chunk: Any) -> str:
        used = [kind for k, kind in enumerate(kinds) if not chunk.filter_mask >> k & 1]
        expected = size + 4 * used.count(FLETCHER)
        if chunk.byte_offset is not None and set(used) <= {SHUFFLE, FLETCHER} and chunk.size != expected:
            return f"a chunk of {dataset.name} has {chunk.size} bytes, expected {expected}"
        return ""

    return fault


def place(dataset: Any, item: int) -> int | None:
    """Where the (first) chunk of an item begins in the file, None where that is not known or beyond its end."""
    try:
        found: int | None = dataset.id.get_chunk_info_by_coord((item, *(0 for _ in dataset.shape[1:]))).byte_offset
        return found if found is not None and found < dataset.file.id.get_filesize() else None
    except FAILURES:
        return None


def one_line(error: BaseException) -> str:
    """The text of an error."""
    return " ".join(str(error).split())
