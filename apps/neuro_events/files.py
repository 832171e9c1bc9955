"""Read and write event files: `load`, `stream` and `save`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import Kind, Unwritable, argument, file_path, output
from neuro_events._events import Events, checked_size
from neuro_events.formats import Format, Unsavable, called, written
from neuro_events.formats._format import in_order
from neuro_events.formats.table import TABLE
from neuro_events.opening import Checker, Opened, joined, opened, smallest
from neuro_events.parts import between, windows
from neuro_events.segmentation import Counts, segmented
from neuro_events.source import WHOLE, EventFileError, FileInput, check_input, with_notes

RECORDING = Kind("a recording", ask="replace=True")
BLOCK = 1 << 20
"""Bytes that `stream` reads at a time."""


def load(
    source: FileInput,
    *,
    format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    name: str | None = None,
    sort: bool = False,
    strict: bool = True,
) -> Events:
    """Read the events of a file.

    The content decides the format, or else the ending of the name. Times stay as recorded. ``metadata["t0"]`` is the
    time of the first event.

    Args:
        source: a path, the bytes of a file, or an open binary file (a member of a zip, or standard input). A named pipe
            is read like standard input; opening blocks until a writer opens the pipe.
        format: name of the format, or an ending that only this format has (such as ``"bin"``), if neither content nor
            ending shows it; see `neuro events formats`. ``"hdf5:/davis/left"`` names one recording of several in a
            file, and ``"hdf5:/events:txyp"`` also names the order of the columns.
        sensor_size: width and height, px. None: as stated by the file or the format, else the smallest sensor that
            contains all events.
        name: name of bytes or of an open file, for messages. Its ending may decide the format.
        sort: sort the events by time. Otherwise times that run back raise an error.
        strict: raise an error at damage. False returns the readable part, with an `EventFileWarning`.

    Returns:
        The events, in the order of the file unless `sort` is set.

    Raises:
        EventFileError: no such file, an unknown format, or damage; the message names the byte.
        ModelError: invalid source or sensor size, or a flag that is neither True nor False.
    """
    size = None if sensor_size is None else checked_size(sensor_size)
    sort, strict = argument("sort", sort, kind="boolean"), argument("strict", strict, kind="boolean")
    with opened(source, format, name, size) as file:
        checker = Checker(file.name, size or file.sensor_size, strict, sort, file.way_out)
        pieces = [checker.check(piece) for piece in file.pieces(WHOLE, strict)]
        if not strict:
            checker.warn()
        t, x, y, p = joined(pieces, sort)
        largest = (max((int(piece[k].max(initial=0)) for piece in pieces), default=0) for k in (1, 2))
        size = checker.size or smallest(file.format, *largest)
        metadata = {"format": file.format.name, **({"t0": int(t[0])} if t.size else {}), **file.reader.metadata}
    return Events._trusted(t, x, y, p, size, metadata)


def size_of(source: FileInput, *, format: str | None = None, name: str | None = None) -> tuple[int, int]:
    """Return the width and height of a recording's sensor, px.

    A sensor that the file or its format states is returned. Otherwise the file is read once, and the result is the
    smallest sensor that contains all events.

    Args:
        source: a path, bytes, or an open binary file.
        format: see `load`.
        name: see `load`.

    Raises:
        EventFileError: see `load`, for the part that is read.
    """
    with opened(source, format, name) as file:
        return file.sensor_size or file.scanned(BLOCK)


def stream(
    source: FileInput,
    *,
    window_us: int | None = None,
    count: int | None = None,
    start_us: int | None = None,
    stop_us: int | None = None,
    format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    name: str | None = None,
    strict: bool = True,
) -> Iterator[Events]:
    """Read a file of any size in parts, in constant memory.

    DAT, AEDAT 2.0, EVT 2.0, 2.1 and 3.0 and HDF5 on disk or as bytes are not decoded before `start_us`. Faults before
    this time are not reported, and the metadata do not count the skipped words before it. Other formats are decoded
    from the beginning. With ``strict=False`` every file is, because which events of a damaged file are dropped depends
    on all earlier events.

    Args:
        source: a path, bytes, or an open binary file such as standard input. The file is opened when the first part is
            requested.
        window_us: length of a part, us. The first part begins at the first event (or at `start_us`). A window without
            events is an empty part.
        count: events per part; the last part may be shorter. Without `window_us` and `count`, each block of the file
            gives a part.
        start_us: first time, us; earlier events are dropped.
        stop_us: end time, us; events at or after it are dropped.
        format: see `load`.
        sensor_size: see `load`.
        name: see `load`.
        strict: see `load`.

    Yields:
        Events in the order of time.

    Raises:
        ModelError: an argument is invalid, or both `window_us` and `count` are given. Raised by the call itself.
        EventFileError: see `load`, when the damage is reached; also if time runs back, or if more than 10^6 windows
            in a row have no events.
    """
    check_input(source)
    strict = argument("strict", strict, kind="boolean")
    size = None if sensor_size is None else checked_size(sensor_size)
    start = argument("start_us", start_us, kind="microseconds", optional=True)
    stop = argument("stop_us", stop_us, kind="microseconds", optional=True)
    window = argument("window_us", window_us, kind="microseconds", at_least=1, optional=True)
    if window is not None and count is not None:
        raise ModelError("window_us and count are both given, expected one of them")
    number = argument("count", count, whole=True, at_least=1, optional=True)

    def cut() -> Iterator[Events]:
        with opened(source, format, name, size) as file:
            parts = between(_parts(file, size, start, strict), start, stop)
            if window is not None:
                yield from windows(parts, window, start, file.name)
            elif number is not None:
                yield from segmented(parts, Counts(number), rest=True)
            else:
                yield from parts

    return cut()


def _parts(file: Opened, size: tuple[int, int] | None, start_us: int | None, strict: bool) -> Iterator[Events]:
    """Yield the events of a file, one part for each block. A reader that can seek may skip blocks before `start_us`."""
    size = size or file.sensor_size or file.scanned(BLOCK)
    if start_us is None or not strict or not file.can_seek():
        yield from _decoded(file, size, None, strict)
        return
    try:
        yield from _decoded(file, size, start_us, strict)
    except EventFileError:
        # Decode from the beginning, so that the error names the number of the event, and the first fault is reported.
        for _ in _decoded(file, size, None, strict):
            pass
        raise


def _decoded(file: Opened, size: tuple[int, int], start_us: int | None, strict: bool) -> Iterator[Events]:
    checker = Checker(file.name, size, strict, sort=False, way_out=file.way_out)
    for piece in file.pieces(BLOCK, strict, start_us):
        arrays = checker.check(piece)
        if arrays[0].size:
            yield Events._trusted(*arrays, size, {"format": file.format.name, **file.reader.metadata})
    if not strict:
        checker.warn()


def save(
    events: Events | Iterable[Events],
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    replace: bool = False,
    keep: bool = False,
) -> None:
    """Write events in the format of the name's ending.

    The events are written to a temporary file first, so a failure leaves no incomplete file (except with `keep`).

    Args:
        events: a recording, or its parts in order, as from `stream`.
        path: the file to write.
        format: name of the format if several share the ending, or an ending that only this format has.
        replace: replace an existing file. Recordings do not say who wrote them, so no file is replaced by default.
        keep: keep the events so far after a failure, for events that cannot be received again, such as those of a
            `Listener`. The events are written to a file whose name is `path` with ".part" at its end (and with a number
            if that file exists, as in walk.2.dat.part). This file stays if the work fails or the process is killed, and
            the error says how to read it. A format that is readable only when complete, such as HDF5 or NPZ, is written
            as CSV and converted at the end.

    Raises:
        EventFileError: no format has this ending, there are no parts, the format cannot store an event (the message
            names it), or the file cannot be written. With `keep` a note names the file with the events so far.
        ModelError: `path` is not a file name, a flag is neither True nor False, or `events` has another type.
    """
    path = file_path(path, "path")
    replace, keep = argument("replace", replace, kind="boolean"), argument("keep", keep, kind="boolean")
    file_format = writer(path, format)
    remaining = _parts_of(events)
    first = next(remaining, None)
    if first is None:
        empty = "Events([], [], [], [], (width, height)) is a recording without events"
        raise EventFileError(str(path), f"no parts to save, expected at least one: {empty}")
    parts = (part for _, part in in_order(chain([first], remaining)))
    try:
        if keep:
            _record(parts, path, file_format, replace)
        else:
            with output(path, RECORDING, replace) as part:
                _write(file_format, parts, part)
    except Unsavable as fault:
        error = EventFileError(str(path), f"cannot store event {fault.event}: {fault.what}", hint=fault.hint)
        raise with_notes(error, fault) from None
    except Unwritable as fault:
        raise with_notes(EventFileError(str(path), fault.what), fault) from None


def _record(parts: Iterator[Events], path: Path, file_format: Format, replace: bool) -> None:
    """Write parts that cannot be received again. After a failure, a note on the error names the file with the parts."""
    readable_as = file_format if file_format.grows else TABLE
    kept_file = path
    try:
        with output(path, RECORDING, replace, keep=True) as part:
            kept_file = part
            if file_format.grows:
                _write(file_format, parts, part)
            else:
                _write_at_the_end(parts, part, file_format)
    except BaseException as error:
        if kept_file != path and kept_file.exists():
            command = f"neuro events info {kept_file} --from {readable_as.name}"
            error.add_note(f"the events so far are kept: '{command}' reads {kept_file}")
        raise


def _write_at_the_end(parts: Iterator[Events], part: Path, file_format: Format) -> None:
    """Write parts in a format that is readable only when complete: as CSV first, and converted at the end."""
    metadata: dict[str, Any] = {}

    def with_metadata() -> Iterator[Events]:
        for part in parts:
            metadata.update(part.metadata)
            yield part

    _write(TABLE, with_metadata(), part)
    written_parts = stream(part, format=TABLE.name)
    first = next(written_parts, None)
    all_parts = chain([load(part, format=TABLE.name) if first is None else first], written_parts)
    with output(part, RECORDING, replace=True) as target:
        _write(file_format, (Events._trusted(e.t, e.x, e.y, e.p, e.sensor_size, metadata) for e in all_parts), target)


def _write(format: Format, parts: Iterator[Events], path: Path) -> None:
    assert format.write is not None
    format.write(parts, path)


def _parts_of(events: object) -> Iterator[Events]:
    """Yield the parts of a recording, each checked to be ``Events``."""
    if isinstance(events, Events):
        yield events
        return
    if not isinstance(events, Iterable):
        raise ModelError(f"events is {events!r:.60}, expected Events, or the parts of a recording")
    for k, part in enumerate(events):
        if not isinstance(part, Events):
            raise ModelError(f"events: part {k} is {part!r:.60}, expected Events")
        yield part


def writer(path: Path, format: str | None) -> Format:
    """Return the format to write. `format` decides if it is given, otherwise the ending of the file's name decides.

    Raises:
        EventFileError: no writable format matches.
    """
    if format is not None:
        if not isinstance(format, str) or (file_format := called(format, written())) is None:
            names = ", ".join(f.name for f in written())
            raise EventFileError(str(path), f"cannot save as format {format!r}, expected one of {names}")
        return file_format
    for f in written():
        if path.name.lower().endswith(f.suffixes):
            return f
    endings = ", ".join(dict.fromkeys(suffix for f in written() for suffix in f.suffixes))
    raise EventFileError(str(path), f"cannot save as {path.suffix!r}, expected {endings}")
