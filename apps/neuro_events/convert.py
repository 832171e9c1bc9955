"""From one event file to another, in constant memory; also from standard input and to standard output."""

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
from neuro_events.source import EventFileError, Given

STANDARD = "-"
"""Standard input, or standard output."""

STREAMED = ("csv", "txt", "nmnist", "event_stream", "dat", "evt2", "evt3", "aedat2")
"""Formats that a pipe takes part by part; others are written to a temporary file first."""

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
    """Write the events of a file in another format.

    Args:
        source: the file, ``-`` for standard input.
        target: the file to write, ``-`` for standard output.
        from_format: its name, where neither content nor ending shows it.
        to_format: its name, where the ending does not tell.
        sensor_size: width and height, px; None takes those that the file states, else the smallest that holds all.
        strict: False takes what is whole of a damaged file, with an `EventFileWarning`.
        report: called with the number of events written so far.
        replace: as for `neuro.events.save`.
        keep: as for `neuro.events.save`.

    Returns:
        Number of events.

    Raises:
        EventFileError: the file is damaged or unknown, or the format cannot hold an event.
    """
    return write(read(source, from_format, sensor_size, strict), target, to_format, report, replace, keep)


def read(
    source: Path_, format: str | None = None, sensor_size: tuple[int, int] | None = None, strict: bool = True
) -> Iterator[Events]:
    """The parts of a recording; one at least.

    Args:
        source: the file, ``-`` for standard input.
        format: its name, where neither content nor ending shows it.
        sensor_size: as for `neuro.events.load`.
        strict: as for `neuro.events.load`.

    Raises:
        EventFileError: as for `neuro.events.stream`; or standard input has no events.
    """
    file, name = given(source)
    parts = stream(file, format=format, sensor_size=sensor_size, name=name, strict=strict)
    first = next(parts, None)
    if first is not None:
        yield from chain([first], parts)
    elif name is not None:
        raise EventFileError(name, "has no events")
    else:
        yield load(source, format=format, sensor_size=sensor_size, strict=strict)


def comes_once(source: Path_) -> bool:
    """Return whether a recording cannot be read again: standard input, or a named pipe."""
    return os.fspath(source) == STANDARD or not os.path.isfile(source)


def given(source: Path_) -> tuple[Given, str | None]:
    """What `load` and `stream` take for a path or ``-``, and what to call it; None: as it is called."""
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
        parts: in order.
        target: the file, ``-`` for standard output.
        format: its name, where the ending does not tell.
        report: called with the number of events written so far.
        replace: as for `neuro.events.save`.
        keep: as for `neuro.events.save`.
        left_out: called with the number of events of a part for which the format has no room; None: one is an error.

    Returns:
        Number of events.

    Raises:
        EventFileError: as for `neuro.events.save`; or standard output without a format.
    """
    done = 0
    to_output = os.fspath(target) == STANDARD
    if not to_output:
        chosen = writer(Path(target), format)
    elif format is None or (named := called(format, written())) is None:
        message = "to no format" if format is None else f"as format {format!r}"
        known = ", ".join(f.name for f in written())
        raise EventFileError(OUTPUT, f"cannot write {message}, expected one of {known}")
    else:
        chosen = named

    def counted() -> Iterator[Events]:
        nonlocal done
        for part in parts if left_out is None else held(parts, chosen, left_out):
            yield part
            done += len(part)
            if report is not None:
                report(done)

    if to_output:
        _write_out(counted(), chosen)
    else:
        save(counted(), target, format=format, replace=replace, keep=keep)
    return done


def _write_out(parts: Iterator[Events], chosen: Format) -> None:
    assert chosen.write is not None
    sys.stdout.flush()
    try:
        if chosen.name in STREAMED:
            chosen.write(parts, cast(Path, _StandardOutput()))
            return
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / "whole"
            chosen.write(parts, whole)
            with whole.open("rb") as file:
                shutil.copyfileobj(file, sys.stdout.buffer)
        sys.stdout.flush()
    except Unsavable as fault:
        raise EventFileError(OUTPUT, f"cannot hold event {fault.event}: {fault.what}", hint=fault.hint) from None
    except OSError as error:
        if isinstance(error, BrokenPipeError) or error.filename is not None:
            raise
        raise EventFileError(OUTPUT, f"cannot write: {error.strerror}") from None


class _StandardOutput:
    """Standard output in the place of a path that a writer opens.

    The name /dev/stdout will not do: opening it would empty a file to which the shell appends.
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
