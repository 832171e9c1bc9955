"""Read and write event files: decode, check, cut into windows."""

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
from neuro_events.opening import Checked, Opened, joined, opened, smallest
from neuro_events.parts import between, windows
from neuro_events.segmentation import Counts, segmented
from neuro_events.source import WHOLE, EventFileError, Given, check_given, with_notes

RECORDING = Kind("a recording", ask="replace=True")
BLOCK = 1 << 20
"""Bytes that `stream` reads at a time."""


def load(
    source: Given,
    *,
    format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    name: str | None = None,
    sort: bool = False,
    strict: bool = True,
) -> Events:
    """Read the events of a file.

    The format is found by what the file holds, else by the ending of its name. Times stay as they are recorded;
    ``metadata["t0"]`` is that of the first event.

    Args:
        source: a path, the bytes of a file, or an open binary file (of a zip, or standard input). A named pipe is
            read as standard input is, and waited for until someone writes into it.
        format: its name or its own ending (as ``"bin"``), where neither content nor ending shows it; see
            `neuro events formats`. ``"hdf5:/davis/left"`` is one recording of a file with several, and
            ``"hdf5:/events:txyp"`` tells the order of columns, too.
        sensor_size: width and height, px; None takes that of the file or the format, else the smallest that holds all.
        name: what to call bytes or an open file; its ending may tell the format.
        sort: put events in the order of time instead of refusing a file whose time runs back.
        strict: False gives what is whole of a damaged file, with an `EventFileWarning`.

    Returns:
        The events, in the order of the file.

    Raises:
        EventFileError: no such file, an unknown format, or damage; the message says at which byte.
        ModelError: the source or the sensor size is none, or a flag neither True nor False.
    """
    size = None if sensor_size is None else checked_size(sensor_size)
    sort, strict = argument("sort", sort, kind="boolean"), argument("strict", strict, kind="boolean")
    with opened(source, format, name, size) as file:
        checked = Checked(file.name, size or file.sensor_size, strict, sort, file.way_out)
        pieces = [checked.piece(piece) for piece in file.pieces(WHOLE, strict)]
        if not strict:
            checked.warn()
        t, x, y, p = joined(pieces, sort)
        largest = (max((int(piece[k].max(initial=0)) for piece in pieces), default=0) for k in (1, 2))
        size = checked.size or smallest(file.format, *largest)
        metadata = {"format": file.format.name, **({"t0": int(t[0])} if t.size else {}), **file.reader.metadata}
    return Events._trusted(t, x, y, p, size, metadata)


def size_of(source: Given, *, format: str | None = None, name: str | None = None) -> tuple[int, int]:
    """Width and height of a recording's sensor, px.

    Those that the file or its format states, else the smallest that holds all events, for which it is read once.

    Args:
        source: a path, bytes, or an open binary file.
        format: as for `load`.
        name: as for `load`.

    Raises:
        EventFileError: as for `load`, for what is read.
    """
    with opened(source, format, name) as file:
        return file.sensor_size or file.scanned(BLOCK)


def stream(
    source: Given,
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

    A file on the disk or bytes in DAT, AEDAT 2.0, EVT 2.0, 2.1 and 3.0 or HDF5 are not decoded before `start_us`, so a
    fault there is not seen, and words left out there are not counted in the metadata. Others are, as is any file with
    ``strict=False``: what is left out of a damaged file depends on all that is before.

    Args:
        source: a path, bytes, or an open binary file such as standard input. It is opened when the first part is asked
            for.
        window_us: parts of so many us, the first beginning at the first event (or at `start_us`); a window without
            events is an empty part.
        count: parts of so many events, the last may be shorter. With neither, parts are as the file gives them.
        start_us: leave out what is before.
        stop_us: leave out what is at this time or later.
        format: as for `load`.
        sensor_size: as for `load`.
        name: as for `load`.
        strict: as for `load`.

    Yields:
        events in the order of time.

    Raises:
        ModelError: at once, where an argument is wrong, or both `window_us` and `count` are given.
        EventFileError: as for `load`, when the damage is reached; also where time runs back, and where more than 10^6
            windows in a row have no events.
    """
    check_given(source)
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
    """The parts of a file as they come, not those that can be left out before a time."""
    size = size or file.sensor_size or file.scanned(BLOCK)
    if start_us is None or not strict or not file.can_seek():
        yield from _decoded(file, size, None, strict)
        return
    try:
        yield from _decoded(file, size, start_us, strict)
    except EventFileError:
        # What is wrong is reported as if all had been read: with the number of its event, and the first fault first.
        for _ in _decoded(file, size, None, strict):
            pass
        raise


def _decoded(file: Opened, size: tuple[int, int], start_us: int | None, strict: bool) -> Iterator[Events]:
    checked = Checked(file.name, size, strict, sort=False, way_out=file.way_out)
    for piece in file.pieces(BLOCK, strict, start_us):
        arrays = checked.piece(piece)
        if arrays[0].size:
            yield Events._trusted(*arrays, size, {"format": file.format.name, **file.reader.metadata})
    if not strict:
        checked.warn()


def save(
    events: Events | Iterable[Events],
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    replace: bool = False,
    keep: bool = False,
) -> None:
    """Write events in the format of the name's ending.

    The file takes its name when it is whole, so a failure leaves no half of one, except with `keep`.

    Args:
        events: what to write, or the parts of one recording in order, as `stream` gives them.
        path: where to.
        format: its name, where several have the ending; or the ending that only it has.
        replace: whether to replace a file that has this name. Recordings bear no mark of their writer, so none is
            replaced only if `replace` says so.
        keep: for events that cannot be had again, as those of a `Listener`. They are written to `path` with ".part" at
            its end (with a number, as walk.2.dat.part, if there is such a file), part by part. The file stays there if
            the work fails or the process is killed, and the error says how to read it. A format that is no recording
            until it is complete, as HDF5 and NPZ, is written as CSV and converted at the end.

    Raises:
        EventFileError: no format has this ending, there is not one part, the format cannot hold an event, which
            is named, or the file cannot be written; with `keep` a note says where the events up to then are.
        ModelError: `path` is no name of a file, a flag neither True nor False, or `events` something else.
    """
    path = file_path(path, "path")
    replace, keep = argument("replace", replace, kind="boolean"), argument("keep", keep, kind="boolean")
    chosen = writer(path, format)
    given = _parts_of(events)
    first = next(given, None)
    if first is None:
        empty = "a recording without events is one, Events([], [], [], [], (width, height))"
        raise EventFileError(str(path), f"no parts to save, expected at least one: {empty}")
    parts = (part for _, part in in_order(chain([first], given)))
    try:
        if keep:
            _record(parts, path, chosen, replace)
        else:
            with output(path, RECORDING, replace) as part:
                _write(chosen, parts, part)
    except Unsavable as fault:
        error = EventFileError(str(path), f"cannot hold event {fault.event}: {fault.what}", hint=fault.hint)
        raise with_notes(error, fault) from None
    except Unwritable as fault:
        raise with_notes(EventFileError(str(path), fault.what), fault) from None


def _record(parts: Iterator[Events], path: Path, chosen: Format, replace: bool) -> None:
    """Write parts that cannot be had again. A failure leaves what came before, and notes on the error where it is."""
    grown, kept = chosen if chosen.grows else TABLE, path
    try:
        with output(path, RECORDING, replace, keep=True) as part:
            kept = part
            if chosen.grows:
                _write(chosen, parts, part)
            else:
                _write_at_the_end(parts, part, chosen)
    except BaseException as error:
        if kept != path and kept.exists():
            error.add_note(f"what came before is kept: 'neuro events info {kept} --from {grown.name}' reads {kept}")
        raise


def _write_at_the_end(parts: Iterator[Events], part: Path, chosen: Format) -> None:
    """Write parts in a format that is no recording until it is complete; up to then the file is CSV."""
    metadata: dict[str, Any] = {}

    def noted() -> Iterator[Events]:
        for each in parts:
            metadata.update(each.metadata)
            yield each

    _write(TABLE, noted(), part)
    again = stream(part, format=TABLE.name)
    first = next(again, None)
    whole = chain([load(part, format=TABLE.name) if first is None else first], again)
    with output(part, RECORDING, replace=True) as target:
        _write(chosen, (Events._trusted(e.t, e.x, e.y, e.p, e.sensor_size, metadata) for e in whole), target)


def _write(format: Format, parts: Iterator[Events], path: Path) -> None:
    assert format.write is not None
    format.write(parts, path)


def _parts_of(events: object) -> Iterator[Events]:
    """The parts of a recording, each looked at."""
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
    """The format to write: by its name, else by the ending of the file's name.

    Raises:
        EventFileError: there is none that can be written.
    """
    if format is not None:
        if not isinstance(format, str) or (chosen := called(format, written())) is None:
            known = ", ".join(f.name for f in written())
            raise EventFileError(str(path), f"cannot save as format {format!r}, expected one of {known}")
        return chosen
    for f in written():
        if path.name.lower().endswith(f.suffixes):
            return f
    endings = ", ".join(dict.fromkeys(suffix for f in written() for suffix in f.suffixes))
    raise EventFileError(str(path), f"cannot save as {path.suffix!r}, expected {endings}")
