"""Read and write event files: find the format, decode, check."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

import numpy as np

from neuro.events._events import Events, first_fault
from neuro.events.errors import EventFileError
from neuro.events.formats import FORMATS, Damage, Decoded, Format, Unsavable

Source = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO


def load(
    source: Source,
    *,
    format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    name: str | None = None,
    sort: bool = False,
) -> Events:
    """Read the events of a file.

    The format is found by how the file begins, else by the ending of its name.

    Args:
        source: a path, the bytes of a file, or an open binary file (of a zip, for example).
        format: its name, where neither content nor ending tells: ``nmnist``, ``aedat2``.
        sensor_size: width and height, px; None takes the format's (see `neuro.events.formats`).
        name: what to call bytes or an open file; its ending may tell the format.
        sort: put events in the order of time instead of refusing a file whose time runs back.

    Returns:
        The events, in the order of the file.

    Raises:
        EventFileError: no such file, an unknown format, or damage; the message says at which byte.
    """
    path, data = _contents(source, name)
    reader = _find(path, data, format)
    try:
        found = reader.read(data, sensor_size)
    except Damage as damage:
        raise EventFileError(path, damage.what, damage.offset) from None
    if sort:
        found = _sorted(found)
    if fault := first_fault(found.t, found.x, found.y, found.p, found.sensor_size):
        k, what = fault
        hint = "; load(..., sort=True) sorts the events" if what.startswith("time") else ""
        raise EventFileError(path, f"event {k}: {what}{hint}", int(found.offsets[k]))
    metadata = {"format": reader.name, **found.metadata}
    return Events(found.t, found.x, found.y, found.p, found.sensor_size, metadata)


def save(events: Events, path: str | os.PathLike[str]) -> None:
    """Write events in the format that the name's ending tells; now ``.bin``.

    The file is written aside and renamed, so a failure leaves no half of one.

    Args:
        events: what to write.
        path: where to.

    Raises:
        EventFileError: no format has this ending, or the format cannot hold an event, which is named.
    """
    path = Path(path)
    writers = {suffix: f.write for f in FORMATS if f.write for suffix in f.suffixes}
    write = writers.get(path.suffix.lower())
    if write is None:
        raise EventFileError(str(path), f"cannot save as {path.suffix!r}, expected {', '.join(writers)}")
    try:
        data = write(events)
    except Unsavable as fault:
        raise EventFileError(str(path), f"cannot hold event {fault.event}: {fault.what}") from None
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        aside.write_bytes(data)
        aside.replace(path)
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise EventFileError(str(path), f"cannot write: {error.strerror}") from None


def _contents(source: Source, name: str | None) -> tuple[str, bytes]:
    if isinstance(source, bytes | bytearray | memoryview):
        return name or "<bytes>", bytes(source)
    if isinstance(source, str | os.PathLike):
        path = os.fspath(source)
        try:
            return path, Path(path).read_bytes()
        except FileNotFoundError:
            raise EventFileError(path, "no such file") from None
        except IsADirectoryError:
            raise EventFileError(path, "is a folder, expected a file") from None
        except OSError as error:
            raise EventFileError(path, f"cannot read: {error.strerror}") from None
    own = getattr(source, "name", None)
    return name or (own if isinstance(own, str) else "<file>"), source.read()


def _find(path: str, data: bytes, format: str | None) -> Format:
    known = {f.name: f for f in FORMATS}
    if format is not None:
        if format not in known:
            raise EventFileError(path, f"unknown format {format!r}, expected one of {', '.join(known)}")
        return known[format]
    for f in FORMATS:
        if f.magic and data.startswith(f.magic):
            return f
    for f in FORMATS:
        if path.lower().endswith(f.suffixes):
            return f
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS)
    raise EventFileError(path, f"unknown kind of event file, expected one of: {titles}")


def _sorted(found: Decoded) -> Decoded:
    order = np.argsort(found.t, kind="stable")
    t, x, y, p, offsets = (a[order] for a in (found.t, found.x, found.y, found.p, found.offsets))
    return Decoded(t, x, y, p, found.sensor_size, offsets, found.metadata)
