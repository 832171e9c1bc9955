"""Convert an event file to another format in constant memory, also from standard input and to standard output."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, cast

from neuro_events._events import Events
from neuro_events.files import load, save, stream, writer
from neuro_events.formats import Format, Unsavable, called, held, written
from neuro_events.source import EventFileError, FileInput

STANDARD = "-"
"""Name for standard input and standard output."""

STREAMED = ("csv", "txt", "nmnist", "event_stream", "dat", "evt2", "evt3", "aedat2")
"""Formats that can be written to a pipe part by part. Output in another format is first written to a temporary file."""

INPUT, OUTPUT = "<standard input>", "<standard output>"

Report = Callable[[int], None]
Path_ = str | os.PathLike[str]


def convert(
    source: Path_,
    target: Path_,
    *,
    from_format: str | None = None,
    to_format: str | None = None,
    sensor_size: tuple[int, int] | None = None,
    strict: bool = True,
    report: Report | None = None,
    replace: bool = False,
    keep: bool = False,
) -> int:
    """Convert an event file to another format.

    Args:
        source: the file, ``-`` for standard input.
        target: the file to write, ``-`` for standard output.
        from_format: name of the source's format, if neither content nor ending shows it.
        to_format: name of the target's format, if the ending does not decide it.
        sensor_size: width and height, px. None: as stated by the file, else the smallest sensor that contains all
            events.
        strict: raise an error at damage. False converts the readable part, with an `EventFileWarning`.
        report: called with the number of events written so far.
        replace: see `neuro.events.save`.
        keep: see `neuro.events.save`.

    Returns:
        Number of events.

    Raises:
        EventFileError: the file is damaged or unknown, or the target's format cannot store an event.
    """
    return write(read(source, from_format, sensor_size, strict), target, to_format, report, replace, keep)


def read(
    source: Path_, format: str | None = None, sensor_size: tuple[int, int] | None = None, strict: bool = True
) -> Iterator[Events]:
    """Yield the parts of a recording. A file without events gives one empty part.

    Args:
        source: the file, ``-`` for standard input.
        format: name of the format, if neither content nor ending shows it.
        sensor_size: see `neuro.events.load`.
        strict: see `neuro.events.load`.

    Raises:
        EventFileError: see `neuro.events.stream`; also if standard input has no events.
    """
    file, name = named_input(source)
    parts = stream(file, format=format, sensor_size=sensor_size, name=name, strict=strict)
    first = next(parts, None)
    if first is not None:
        yield from chain([first], parts)
    elif name is not None:
        raise EventFileError(name, "has no events")
    else:
        yield load(source, format=format, sensor_size=sensor_size, strict=strict)


def comes_once(source: Path_) -> bool:
    """Return whether a recording can be read only once: standard input, or a named pipe."""
    return os.fspath(source) == STANDARD or not os.path.isfile(source)


def named_input(source: Path_) -> tuple[FileInput, str | None]:
    """Return the input for `load` and `stream`, and the input's name for messages (None: the file's own name)."""
    return (sys.stdin.buffer, INPUT) if os.fspath(source) == STANDARD else (source, None)


def write(
    parts: Iterable[Events],
    target: Path_,
    format: str | None = None,
    report: Report | None = None,
    replace: bool = False,
    keep: bool = False,
    left_out: Callable[[int], None] | None = None,
) -> int:
    """Write the parts of a recording.

    Args:
        parts: the parts, in order.
        target: the file, ``-`` for standard output.
        format: name of the format, if the ending does not decide it.
        report: called with the number of events written so far.
        replace: see `neuro.events.save`.
        keep: see `neuro.events.save`.
        left_out: called with the number of events in a part that the format cannot store. None: such an event is an
            error.

    Returns:
        Number of events.

    Raises:
        EventFileError: see `neuro.events.save`; also for standard output without a format.
    """
    n_written = 0
    is_standard = os.fspath(target) == STANDARD
    if not is_standard:
        file_format = writer(Path(target), format)
    elif format is None or (match := called(format, written())) is None:
        message = "the format is missing" if format is None else f"cannot write format {format!r}"
        raise EventFileError(OUTPUT, f"{message}, expected one of {', '.join(f.name for f in written())}")
    else:
        file_format = match

    def counted() -> Iterator[Events]:
        nonlocal n_written
        for part in parts if left_out is None else held(parts, file_format, left_out):
            yield part
            n_written += len(part)
            if report is not None:
                report(n_written)

    if is_standard:
        _write_out(counted(), file_format)
    else:
        save(counted(), target, format=format, replace=replace, keep=keep)
    return n_written


def _write_out(parts: Iterator[Events], file_format: Format) -> None:
    assert file_format.write is not None
    sys.stdout.flush()
    try:
        if file_format.name in STREAMED:
            file_format.write(parts, cast(Path, _StandardOutput()))
            return
        with tempfile.TemporaryDirectory() as folder:
            temporary = Path(folder) / "complete"
            file_format.write(parts, temporary)
            with temporary.open("rb") as file:
                shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.flush()
    except Unsavable as fault:
        raise EventFileError(OUTPUT, f"cannot store event {fault.event}: {fault.what}", hint=fault.hint) from None
    except OSError as error:
        if isinstance(error, BrokenPipeError) or error.filename is not None:
            raise
        raise EventFileError(OUTPUT, f"cannot write: {error.strerror}") from None


class _StandardOutput:
    """Standard output with the methods of a path that a writer uses.

    The path /dev/stdout cannot be used, because opening it would empty a file to which the shell appends.
    """

    def open(self, mode: str) -> _StandardOutput:
        return self

    def __enter__(self) -> _StandardOutput:
        return self

    def __exit__(self, *error: Any) -> None:
        sys.stdout.flush()

    def write(self, data: Any) -> int:
        return sys.stdout.buffer.write(data)

    def flush(self) -> None:
        sys.stdout.buffer.flush()
