"""Find and read a recording in an HDF5 file: four datasets, one dataset of rows, or a table without names.

A table is (n, 4) numbers without names, whose order of columns must be determined. Two orders are known by place and
type: v2e's ``/events`` (or ``/event``) of uint32 is t x y p, t in us; MVSEC's ``/davis/<side>/events`` of floating
point is x y t p, t in s. Any other table is t x y p, x y t p or x y p t, whichever fits the first rows: whole
coordinates, polarities -1, 0 or 1, and times that never run back. The same applies to a table in a known place whose
rows do not fit. If several orders fit, the file is refused.

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
    """A recording in an open file: four datasets of columns, or one dataset of rows.

    Attributes:
        node: the open group or dataset with the attributes.
        datasets: the datasets of t, x, y and p, or one dataset of rows.
        keys: field or column of a row for t, x, y and p; () for four datasets.
        unit: exponent of the unit of time (see `_columns.UNITS`), None if the first times decide.
        offset: added to all times, us.
    """

    node: Any
    datasets: tuple[Any, ...]
    keys: tuple[str | int, ...]
    unit: int | None
    offset: int = 0

    def column_order(self) -> dict[str, str]:
        """Return the order of columns without names, as metadata."""
        if not self.keys or isinstance(self.keys[0], str):
            return {}
        return {"columns": " ".join("txyp"[self.keys.index(k)] for k in range(len(self.keys)))}

    def pieces(self, block: int, start_us: int | None = None) -> Iterator[Piece]:
        """Yield the events; see `neuro.events.formats.Reader` and `Seeker`."""
        total, chunk = self._checked_length(), (self.datasets[0].chunks or (1 << 15,))[0]
        unit, step = self.unit, max(1, block // _ROW // chunk) * chunk
        at = 0 if start_us is None else self._seek(step, start_us)
        checks = [chunk_checker(dataset) for dataset in self.datasets]
        while at < total or not at:
            try:
                columns = self._read(at, min(at + step, total), checks)
            except FAILURES as error:
                if step > chunk:
                    step = chunk
                    continue
                message = f"the events from {at} on cannot be read: {one_line(error)}"
                raise Damage(message, place(self.datasets[0], at)) from None
            unit = unit_of(columns["t"][:chunk]) if unit is None else unit
            piece, fault = to_piece(columns, unit, at, None)
            yield self._with_offset(piece, at)
            if fault:
                raise Damage(fault, place(self.datasets[0], at + len(piece.t)))
            at += len(columns["t"])
            if at >= total:
                return

    def _checked_length(self) -> int:
        """Return the number of events, after a check that the datasets can contain as many."""
        shapes = {dataset.shape for dataset in self.datasets}
        axes = 2 if self.keys and isinstance(self.keys[0], int) else 1
        if len(shapes) != 1 or len(self.datasets[0].shape or ()) != axes:
            shapes_text = ", ".join(f"{dataset.name} {dataset.shape}" for dataset in self.datasets)
            raise Damage(f"its columns have the shapes {shapes_text}, expected one axis and equal lengths", None)
        for dataset in self.datasets:
            check_filters(dataset)
            check_length(dataset)
        return len(self.datasets[0])

    def _seek(self, step: int, start_us: int) -> int:
        """Return the number of an event, a multiple of `step`. All events before it are earlier than `start_us`.

        The result is 0 if the times are not in order.
        """
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
        """Return the stored time of an event.

        Raises:
            TypeError: the time is not a whole number, so its unit depends on the first times.
        """
        value = self.datasets[0][event]
        return operator.index(value[self.keys[0]] if self.keys else value)

    def _read(self, first: int, last: int, checks: list[Callable[[int, int], None]]) -> dict[str, npt.NDArray[Any]]:
        for check in checks:
            check(first, last)
        data = [dataset[first:last] for dataset in self.datasets]
        columns = [data[0][:, key] if isinstance(key, int) else data[0][key] for key in self.keys] or data
        return dict(zip("txyp", columns, strict=True))

    def _with_offset(self, piece: Piece, first: int) -> Piece:
        """Add the recording's offset to the times of a piece."""
        if not self.offset or not piece.t.size:
            return piece
        if not -(1 << 63) <= int(piece.t.min()) + self.offset <= int(piece.t.max()) + self.offset < 1 << 63:
            raise Damage(f"the events from {first} on: t_offset {self.offset} leads beyond 2^63 us", None)
        return Piece(piece.t + self.offset, piece.x, piece.y, piece.p)


def of_columns(group: Any, names: Names, offset: int) -> OpenRecording:
    """Return the recording in four datasets of a group."""
    return OpenRecording(group, tuple(group[name] for name in _keys(names)), (), names.unit, offset)


def of_rows(dataset: Any) -> OpenRecording | None:
    """Return the recording in a dataset of rows with named fields, or None if the fields are not those of events."""
    names = find_names(dataset.dtype.names or ())
    return None if names is None else OpenRecording(dataset, (dataset,), _keys(names), names.unit)


def of_table(dataset: Any, order: str = "") -> OpenRecording:
    """Return the recording in a dataset of rows without names.

    Args:
        dataset: a dataset for which `is_table` is True.
        order: order of its columns, such as "txyp". "": determined from the rows.

    Raises:
        Damage: the order cannot be determined.
    """
    column_order = order or order_of_table(dataset)
    return OpenRecording(
        dataset, (dataset,), tuple(column_order.index(name) for name in "txyp"), unit_of_table(dataset)
    )


def _keys(names: Names) -> tuple[str, ...]:
    return names.t, names.x, names.y, names.p


ORDERS = ("txyp", "xytp", "xypt")
"""Orders of columns in tables; see `order_of_table`."""
ROWS = 1 << 16
"""Number of rows that determine the order."""

_V2E = re.compile(r"/events?")
_MVSEC = re.compile(r"/davis/[^/]+/events")


def is_table(node: Any) -> bool:
    """Return whether a node is an h5py dataset with four columns of numbers."""
    shape = getattr(node, "shape", None) or ()
    return list(shape[1:]) == [4] and node.dtype.kind in "iuf"


def order_of_table(table: Any) -> str:
    """Return the order of the columns of a table, one of `ORDERS`.

    Args:
        table: an open h5py dataset for which `is_table` is True.

    Raises:
        Damage: no order or several orders fit, or the table cannot be read.
    """
    rows, likely = _first_rows(table), _usual_order(table)
    possible_orders = [order for order in ORDERS if fits(rows, order, in_time=False)]
    certain_orders = [order for order in possible_orders if fits(rows, order, in_time=True)] or possible_orders
    if likely in certain_orders:
        return likely
    if len(certain_orders) == 1 or not len(rows):
        return certain_orders[0]
    if not certain_orders:
        message = "expected t x y p, x y t p or x y p t, with whole coordinates and polarities -1, 0 or 1"
        raise Damage(f"{table.name} has rows such as {rows[0].tolist()}, {message}", None)
    names = " or ".join(" ".join(order) for order in certain_orders)
    name = f"hdf5:{table.name}:{certain_orders[0]}"
    hint = f"name the order, as in format={name!r} or --from {name}"
    raise Damage(f"the rows of {table.name} may be {names}: {hint}", None)


def unit_of_table(table: Any) -> int | None:
    """Return the exponent of the unit of a table's times (see `_columns.UNITS`), None if the first times decide."""
    if table.dtype.kind != "f":
        return US
    return SECONDS if _MVSEC.fullmatch(table.name) else None


def _usual_order(table: Any) -> str:
    """Return the order that is known for the place and type of a table, or ""."""
    if table.dtype == np.uint32 and _V2E.fullmatch(table.name):
        return "txyp"
    return "xytp" if table.dtype.kind == "f" and _MVSEC.fullmatch(table.name) else ""


def _first_rows(table: Any) -> Any:
    """Return the first rows, or only the rows of the first chunk if later chunks cannot be read."""
    check_filters(table)
    check_length(table)
    counts = [ROWS, min(ROWS, (table.chunks or (ROWS,))[0])]
    for count in counts:
        try:
            check_chunks(table, 0, min(count, len(table)))
            return table[:count]
        except FAILURES as error:
            fault = error
    raise Damage(f"the events from 0 on cannot be read: {one_line(fault)}", place(table, 0))


DEPTH = 3
"""Number of levels to search. Example: ``/davis/left/events`` has three levels."""
LIMIT = 100
"""Number of members of a group to search, below the first level."""


def find(file: Any, where: str = "") -> OpenRecording:
    """Find the recording of a file.

    Args:
        file: an open h5py file.
        where: group or dataset, such as ``/davis/left``, if there are several; ``:txyp`` after it states the order of a
            table's columns.

    Raises:
        Damage: no recording or several, or part of the recording is stored in another file.
    """
    recording = _find(file, where)
    for dataset in recording.datasets:
        if not _is_stored_in(file, dataset):
            raise Damage(f"{dataset.name} is stored in another file, expected a recording in one file", None)
    return recording


def member(group: Any, name: str) -> Any:
    """Return the target of a name in an open h5py group, or None.

    Raises:
        Damage: the target cannot be opened, e.g. a link to itself.
    """
    try:
        return group.get(name)
    except FAILURES as error:
        place = name if name.startswith("/") else f"{group.name.rstrip('/')}/{name}"
        raise Damage(f"{place} cannot be opened: {one_line(error)}", None) from None


def _is_stored_in(file: Any, dataset: Any) -> bool:
    """Return whether a dataset is stored in this file. A link or external storage may refer to any file on the disk."""
    from h5py import h5o

    return (
        not (dataset.is_virtual or dataset.external) and h5o.get_info(dataset.id).fileno == h5o.get_info(file.id).fileno
    )


def _find(file: Any, where: str) -> OpenRecording:
    place, order = _split_place(where)
    if place:
        return _at(file, place, order)
    for group in (member(file, "events"), file):
        if names := _columns(group):
            return of_columns(group, names, _offset(file, group))
    candidates = list(_candidates(file))
    candidates = [node for node in candidates if node.name == "/CD/events"] or candidates
    if not candidates:
        members = ", ".join(list(file)[:8]) or "nothing"
        raise Damage(f"has {members}; expected /events/t, x, y, p, rows at /CD/events or /<class>/<sample>", None)
    if len(candidates) > 1:
        raise Damage(_several(candidates), None)
    return _recording(file, candidates[0], order)


def _split_place(where: str) -> tuple[str, str]:
    """Split "/path:txyp" into the path and the order of columns, "" without an order."""
    place, _, order = where.rpartition(":")
    return (place, order) if sorted(order) == sorted("txyp") else (where, "")


def _at(file: Any, place: str, order: str) -> OpenRecording:
    """Return the recording at a place, or the only recording below this place."""
    node = member(file, place)
    if isinstance(node, h5py.Group) and not _columns(node):
        candidates = list(_candidates(node))
        if len(candidates) > 1:
            raise Damage(_several(candidates), None)
        node = candidates[0] if candidates else node
    elif isinstance(node, h5py.Dataset) and not _has_rows(node) and not is_table(node):
        raise Damage(f"{node.name} has items of {node.dtype} in shape {node.shape}, expected rows of events", None)
    if node is None or (isinstance(node, h5py.Group) and not _columns(node)):
        names = ", ".join(candidate.name for candidate in islice(_candidates(file), 4))
        raise Damage(f"has no recording at {place}, expected {names or 'another file: it has none'}", None)
    return _recording(file, node, order)


def _recording(file: Any, node: Any, order: str) -> OpenRecording:
    if names := _columns(node):
        return of_columns(node, names, _offset(file, node))
    return of_rows(node) or of_table(node, order)


def _several(nodes: list[Any]) -> str:
    message = f"{len(nodes)} recordings or more ({', '.join(node.name for node in nodes[:3])}), expected one"
    if all(_has_rows(node) for node in nodes):
        return f"is a data set with {message}; neuro.events.Dataset reads it"
    name = f"hdf5:{nodes[0].name}"
    return f"has {message}: name it, as in format={name!r} or --from {name}"


def _candidates(group: Any, depth: int = DEPTH) -> Iterator[Any]:
    """Yield the possible recordings in a group: groups with columns, rows, and tables called events."""
    for name in list(group)[: None if depth == DEPTH else LIMIT]:
        node = member(group, name)
        if isinstance(node, h5py.Dataset):
            if _has_rows(node) or (is_table(node) and name.lower().startswith("event")):
                yield node
        elif isinstance(node, h5py.Group) and depth > 1:
            if _columns(node):
                yield node
            else:
                yield from _candidates(node, depth - 1)


def _has_rows(node: Any) -> bool:
    return find_names(node.dtype.names or ()) is not None if hasattr(node, "dtype") else False


def _columns(group: Any) -> Names | None:
    """Return the datasets of a group that are columns of events, or None."""
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

LARGEST_RATIO = 1100
"""Largest ratio of unpacked to stored size. HDF5's own filters reach at most 1032, with gzip."""

FAILURES = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError, OverflowError)
"""Errors that h5py raises for a damaged file."""

SHUFFLE, FLETCHER = 2, 3
"""Filters that do not change the size of a chunk, except that `FLETCHER` adds a checksum of 4 bytes."""


class Padded(io.BytesIO):
    """Bytes as a file. Reads beyond the end return zeros, since h5py would otherwise expose old memory."""

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer, and fill the rest with zeros."""
        count = super().readinto(buffer)
        buffer[count:] = bytes(len(buffer) - count)
        return count


def check_filters(dataset: Any) -> None:
    """Check that the filters of a dataset are available.

    Args:
        dataset: an open h5py dataset.

    Raises:
        Damage: a filter is not available.
    """
    plist = dataset.id.get_create_plist()
    for k in range(plist.get_nfilters()):
        number = plist.get_filter(k)[0]
        if h5py.h5z.filter_avail(number):
            continue
        if number == ECF:
            text = "is compressed with Prophesee's ECF filter, which HDF5 alone cannot decode"
            raise Damage(f"{dataset.name} {text}: use the RAW file, or export it with Metavision's tools", None)
        extra("hdf5plugin", f"{dataset.name}, compressed with HDF5 filter {number},")
        if not h5py.h5z.filter_avail(number):
            raise Damage(f"{dataset.name} is compressed with the unknown HDF5 filter {number}", None)


def check_length(dataset: Any) -> None:
    """Check that the length of a dataset is possible, since a damaged length would fill the memory.

    Args:
        dataset: an open h5py dataset.

    Raises:
        Damage: the stored bytes cannot contain as many items, or the dataset cannot be read.
    """
    try:
        stored_bytes = min(dataset.id.get_storage_size(), dataset.file.id.get_filesize())
        size = dataset.size * dataset.dtype.itemsize
    except FAILURES as error:
        raise Damage(f"{dataset.name} cannot be read: {one_line(error)}", None) from None
    if size > LARGEST_RATIO * stored_bytes:
        raise Damage(f"{dataset.name} has {dataset.size} items, too many for its {stored_bytes} bytes", None)


def check_chunks(dataset: Any, first: int, last: int) -> None:
    """Check the sizes of chunks that are not compressed.

    Args:
        dataset: an open h5py dataset.
        first: first item along the first axis.
        last: end (exclusive) of the items.

    Raises:
        ValueError: a chunk has a wrong size.
    """
    if dataset.chunks is None:
        return
    fault = _chunk_fault(dataset)
    height, *widths = dataset.chunks
    rows = range(first // height * height, last, height)
    for at in itertools.product(rows, *map(range, itertools.repeat(0), dataset.shape[1:], widths)):
        if text := fault(dataset.id.get_chunk_info_by_coord(at)):
            raise ValueError(text)


def chunk_checker(dataset: Any) -> Callable[[int, int], None]:
    """Return `check_chunks` for a dataset that is read in many parts.

    HDF5 iterates over all earlier chunks to find one. All chunks are therefore checked at once; if they are intact, the
    returned function does nothing.
    """
    if dataset.chunks is None:
        return lambda first, last: None
    fault, faults = _chunk_fault(dataset), []
    try:
        dataset.id.chunk_iter(lambda chunk: faults.append(text) if (text := fault(chunk)) else None)
    except FAILURES:
        return partial(check_chunks, dataset)
    return partial(check_chunks, dataset) if faults else lambda first, last: None


def _chunk_fault(dataset: Any) -> Callable[[Any], str]:
    """Return a function from a chunk of a dataset to the fault of its size, "" if none."""
    filters = dataset.id.get_create_plist()
    kinds = [filters.get_filter(k)[0] for k in range(filters.get_nfilters())]
    size = math.prod(dataset.chunks) * dataset.dtype.itemsize

    def fault(chunk: Any) -> str:
        applied = [kind for k, kind in enumerate(kinds) if not chunk.filter_mask >> k & 1]
        expected = size + 4 * applied.count(FLETCHER)
        if chunk.byte_offset is not None and set(applied) <= {SHUFFLE, FLETCHER} and chunk.size != expected:
            return f"a chunk of {dataset.name} has {chunk.size} bytes, expected {expected}"
        return ""

    return fault


def place(dataset: Any, item: int) -> int | None:
    """Return the byte at which the chunk with an item begins, None if unknown or beyond the end of the file."""
    try:
        offset: int | None = dataset.id.get_chunk_info_by_coord((item, *(0 for _ in dataset.shape[1:]))).byte_offset
        return offset if offset is not None and offset < dataset.file.id.get_filesize() else None
    except FAILURES:
        return None


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line."""
    return " ".join(str(error).split())
