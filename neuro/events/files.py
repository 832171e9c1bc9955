"""Read and write event files: find the format, decode, check, cut into windows."""

from __future__ import annotations

import operator
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from neuro.events._events import Events
from neuro.events.check import Arrays, Checked, joined
from neuro.events.errors import EventFileError, EventFileWarning
from neuro.events.formats import FORMATS, HEAD, Damage, Format, Piece, Reader, Unsavable
from neuro.events.formats._write import in_order
from neuro.events.source import WHOLE, Given, Source

MOST_EMPTY = 10**6
"""Windows without events between two events; more are a jump in the times of a damaged file."""

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
        source: a path, the bytes of a file, or an open binary file (of a zip, or standard input).
        format: its name, where neither content nor ending tells; see `neuro events formats`.
        sensor_size: width and height, px; None takes that of the file or the format, else the smallest that holds all.
        name: what to call bytes or an open file; its ending may tell the format.
        sort: put events in the order of time instead of refusing a file whose time runs back.
        strict: False gives what is whole of a damaged file, with an `EventFileWarning`.

    Returns:
        The events, in the order of the file.

    Raises:
        EventFileError: no such file, an unknown format, or damage; the message says at which byte.
    """
    sensor_size = _sensor(sensor_size)
    opened, reader, found = _open(source, format, name)
    checked = Checked(opened.name, sensor_size or reader.sensor_size, strict, sort)
    pieces = [checked.piece(piece) for piece in _whole(opened.name, reader, WHOLE, strict)]
    if not strict:
        checked.warn()
    t, x, y, p = joined(pieces, sort)
    size = checked.size or _default(found, pieces)
    metadata = {"format": found.name, **({"t0": int(t[0])} if t.size else {}), **reader.metadata}
    return Events._trusted(t, x, y, p, size, metadata)


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

    Args:
        source: a path, bytes, or an open binary file such as standard input.
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
        EventFileError: as for `load`, when the damage is reached; also where time runs back.
        ValueError: a window or count is not positive, or both are given.
    """
    for told, value in (("window_us", window_us), ("count", count)):
        if value is not None and (isinstance(value, bool) or int(value) != value or value < 1):
            raise ValueError(f"{told} = {value!r}: expected a whole number >= 1")
    if window_us is not None and count is not None:
        raise ValueError("window_us and count: expected one of them")
    sensor_size = _sensor(sensor_size)
    opened, reader, found = _open(source, format, name)
    size = sensor_size or reader.sensor_size or _scanned(opened, reader, found, strict)
    checked = Checked(opened.name, size, strict, sort=False)
    parts: Iterator[Events] = (
        Events._trusted(*checked.piece(piece), size, {"format": found.name, **reader.metadata})
        for piece in _whole(opened.name, reader, BLOCK, strict)
    )
    parts = _between(parts, start_us, stop_us)
    if window_us is not None:
        yield from windows(parts, int(window_us), start_us)
    elif count is not None:
        yield from batches(parts, int(count))
    else:
        yield from (part for part in parts if len(part))
    if not strict:
        checked.warn()


def _between(parts: Iterable[Events], start_us: int | None, stop_us: int | None) -> Iterator[Events]:
    for part in parts:
        if stop_us is not None and len(part) and part.t[0] >= stop_us:
            return
        first = 0 if start_us is None else int(np.searchsorted(part.t, start_us))
        last = len(part) if stop_us is None else int(np.searchsorted(part.t, stop_us))
        if first < last:
            yield part[first:last] if last - first < len(part) else part


def windows(parts: Iterable[Events], window_us: int, start_us: int | None = None) -> Iterator[Events]:
    """Cut ordered parts of a recording into windows of equal length.

    Args:
        parts: of one recording, in order.
        window_us: length of a window, us.
        start_us: where the first begins; None: at the first event.
    """
    held: list[Events] = []
    begin = start_us
    for part in parts:
        if not len(part):
            continue
        begin = int(part.t[0]) if begin is None else begin
        empty = (int(part.t[0]) - begin) // window_us
        if empty > MOST_EMPTY:
            raise EventFileError(
                "stream",
                f"{empty} windows of {window_us} us without events before {part.t[0]} us, "
                f"expected at most {MOST_EMPTY}: "
                "look for a jump in the times, or take longer windows",
            )
        while len(part) and part.t[-1] >= begin + window_us:
            cut = int(np.searchsorted(part.t, begin + window_us))
            yield together([*held, part[:cut]])
            held, part, begin = [], part[cut:], begin + window_us
        held.append(part)
    if held:
        yield together(held)


def batches(parts: Iterable[Events], count: int) -> Iterator[Events]:
    """Cut parts of a recording into parts of equally many events.

    Args:
        parts: of one recording, in order.
        count: events of a part; the last may have fewer.
    """
    held: list[Events] = []
    missing = count
    for part in parts:
        while len(part) >= missing:
            yield together([*held, part[:missing]])
            held, part, missing = [], part[missing:], count
        if len(part):
            held.append(part)
            missing -= len(part)
    if held:
        yield together(held)


def together(parts: list[Events]) -> Events:
    """Parts of one recording as one."""
    if len(parts) == 1:
        return parts[0]
    t, x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txyp")
    return Events._trusted(t, x, y, p, parts[0].sensor_size, parts[0].metadata)


def save(events: Events | Iterable[Events], path: str | os.PathLike[str], *, format: str | None = None) -> None:
    """Write events in the format that the name's ending tells.

    The file is written aside and renamed, so a failure leaves no half of one.

    Args:
        events: what to write, or the parts of one recording in order, as `stream` gives them.
        path: where to.
        format: its name, where several have the ending.

    Raises:
        EventFileError: no format has this ending, or the format cannot hold an event, which is named.
    """
    path = Path(path)
    write = _writer(path, format)
    given = iter([events]) if isinstance(events, Events) else iter(events)
    parts = (part for _, part in in_order(given))
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            part = Path(folder) / path.name
            write(parts, part)
            part.replace(path)
    except Unsavable as fault:
        raise EventFileError(str(path), f"cannot hold event {fault.event}: {fault.what}") from None
    except OSError as error:
        raise EventFileError(str(path), f"cannot write: {error.strerror}") from None


def _writer(path: Path, format: str | None):  # type: ignore[no-untyped-def]
    written = [f for f in FORMATS if f.write]
    if format is not None:
        chosen = [f for f in written if f.name == format]
        if not chosen:
            known = ", ".join(f.name for f in written)
            raise EventFileError(str(path), f"cannot save as format {format!r}, expected one of {known}")
        return chosen[0].write
    for f in written:
        if path.name.lower().endswith(f.suffixes):
            return f.write
    endings = ", ".join(dict.fromkeys(suffix for f in written for suffix in f.suffixes))
    raise EventFileError(str(path), f"cannot save as {path.suffix!r}, expected {endings}")


def _sensor(size: tuple[int, int] | None) -> tuple[int, int] | None:
    """The sensor that the user gives.

    Raises:
        ValueError: it is no width and height.
    """
    if size is None:
        return None
    try:
        width, height = (operator.index(value) for value in size)
    except (TypeError, ValueError):
        raise ValueError(f"sensor_size = {size!r}: expected width and height, two whole numbers") from None
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise ValueError(f"sensor_size = {size!r}: expected 1x1 to 65536x65536 px")
    return width, height


def _open(source: Given, format: str | None, name: str | None) -> tuple[Source, Reader, Format]:
    opened = _source(source, name)
    found = find(opened, format)
    try:
        return opened, found.open(opened), found
    except Damage as damage:
        raise EventFileError(opened.name, damage.what, damage.offset) from None


def _source(source: Given, name: str | None) -> Source:
    try:
        return Source(source, name)
    except FileNotFoundError:
        raise EventFileError(os.fspath(source), "no such file") from None  # type: ignore[arg-type]
    except IsADirectoryError:
        raise EventFileError(os.fspath(source), "is a folder, expected a file") from None  # type: ignore[arg-type]
    except OSError as error:
        raise EventFileError(os.fspath(source), f"cannot read: {error.strerror}") from None  # type: ignore[arg-type]


def find(source: Source, format: str | None = None) -> Format:
    """The format of a file: by name, else by content, else by ending.

    Raises:
        EventFileError: there is none.
    """
    known = {f.name: f for f in FORMATS}
    if format is not None:
        if format not in known:
            raise EventFileError(source.name, f"unknown format {format!r}, expected one of {', '.join(known)}")
        return known[format]
    head = source.head(HEAD)
    for f in FORMATS:
        if f.knows(head):
            return f
    for f in FORMATS:
        if source.name.lower().endswith(f.suffixes):
            return f
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS)
    raise EventFileError(source.name, f"unknown kind of event file, expected one of: {titles}")


def _whole(path: str, reader: Reader, block: int, strict: bool) -> Iterator[Piece]:
    """The pieces of a file; damage is an error or, where not strict, the end with a warning."""
    try:
        yield from reader.pieces(block)
    except Damage as damage:
        error = EventFileError(path, damage.what, damage.offset)
        if strict:
            raise error from None
        warnings.warn(f"{error}; what is before it was read", EventFileWarning, stacklevel=4)


def _scanned(source: Source, reader: Reader, found: Format, strict: bool) -> tuple[int, int]:
    """The smallest sensor that holds all events of a file, which is read twice for that."""
    if source.size is None:
        raise EventFileError(source.name, "its sensor is not told", None)
    checked = Checked(source.name, None, strict=False, sort=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EventFileWarning)  # the second time tells of damage
        sizes = [checked.highest(piece) for piece in _whole(source.name, reader, BLOCK, strict)]
    return _smallest(found, max((x for x, _ in sizes), default=-1), max((y for _, y in sizes), default=-1))


def _default(found: Format, pieces: Sequence[Arrays]) -> tuple[int, int]:
    x = max((int(piece[1].max(initial=0)) for piece in pieces), default=0)
    y = max((int(piece[2].max(initial=0)) for piece in pieces), default=0)
    return _smallest(found, x, y)


def _smallest(found: Format, x: int, y: int) -> tuple[int, int]:
    known = (size for size in (found.usual, *found.larger) if size and x < size[0] and y < size[1])
    return next(known, (max(x, 0) + 1, max(y, 0) + 1))
