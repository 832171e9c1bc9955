"""Open an event file: find its format, make its reader, and take its pieces, with damage told as users see it."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from neuro.core.hints import near
from neuro.core.inputs import record_input
from neuro.events.check import Checked
from neuro.events.errors import EventFileError, EventFileWarning, let_go
from neuro.events.formats import FORMATS, HEAD, Damage, Format, Piece, Reader, Seeker, called
from neuro.events.source import Given, Source, opened_source


@dataclass(slots=True)
class Opened:
    """An open event file; it is closed with the block of a `with` statement, also by an error.

    Attributes:
        source: its bytes.
        reader: of its events.
        format: what it is.
    """

    source: Source
    reader: Reader
    format: Format

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None:
        """Close the file. A kept error about it keeps its frames, but not what they hold of the file."""
        if isinstance(error, EventFileError):
            let_go(error)
        _close(self.reader, self.source)

    @property
    def name(self) -> str:
        """The file, as messages call it."""
        return self.source.name

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        """Width and height that the file or its format tells, None where neither does.

        Raises:
            EventFileError: the file tells it in a way that may mean two things, or an impossible one.
        """
        try:
            return self.reader.sensor_size
        except Damage as damage:
            raise EventFileError(self.name, damage.what, damage.offset) from None

    def pieces(self, block: int, strict: bool, start_us: int | None = None) -> Iterator[Piece]:
        """The pieces of the file; damage is an error or, where not strict, the end with a warning.

        Args:
            block: bytes of a piece, about.
            strict: whether damage is an error.
            start_us: None: from the beginning; else, where the reader can, from a piece on before which all is earlier.
        """
        try:
            if start_us is not None and isinstance(self.reader, Seeker):
                yield from self.reader.pieces_from(block, start_us)
            else:
                yield from self.reader.pieces(block)
        except Damage as damage:
            let_go(damage)
            error = EventFileError(self.name, damage.what, damage.offset)
            if strict:
                raise error from None
            warnings.warn(f"{error}; what is before it was read", EventFileWarning, stacklevel=4)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            if self.format.open.__module__.startswith("neuro."):
                raise  # a fault of ours
            what = f"its format '{self.format.name}' fails: {type(error).__name__}: {error}"
            raise EventFileError(self.name, what) from error

    def can_seek(self) -> bool:
        """Whether the events from some time on can be had without those before."""
        return self.source.size is not None and isinstance(self.reader, Seeker)

    def scanned(self, block: int) -> tuple[int, int]:
        """The smallest sensor that holds all events of the file, which is read twice for that.

        Raises:
            EventFileError: it can be read only once.
        """
        if self.source.size is None:
            what = "its sensor is not told, and it cannot be read twice to look for it"
            raise EventFileError(self.name, f"{what}: give sensor_size=(width, height), or --sensor WxH")
        checked = Checked(self.name, None, strict=False, sort=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EventFileWarning)  # damage is told the second time
            sizes = [checked.highest(piece) for piece in self.pieces(block, strict=False)]
        return smallest(self.format, max((x for x, _ in sizes), default=-1), max((y for _, y in sizes), default=-1))


def opened(source: Given, format: str | None, name: str | None) -> Opened:
    """Open a file.

    Args:
        source: a path, bytes, or an open binary file.
        format: its name, where neither content nor ending tells.
        name: what to call it.

    Raises:
        EventFileError: there is no such file, it is of no known kind, or its header is damaged.
    """
    data = opened_source(source, name)
    if isinstance(source, (str, os.PathLike)):
        record_input(source)
    try:
        found = find(data, format)
        return Opened(data, found.open(data), found)
    except Damage as damage:
        let_go(damage)
        data.close()
        raise EventFileError(data.name, damage.what, damage.offset) from None
    except EventFileError as error:
        let_go(error)
        data.close()
        raise


def _close(*parts: Any) -> None:
    for part in parts:
        close = getattr(part, "close", None)
        if close is not None:
            close()


def find(source: Source, format: str | None = None) -> Format:
    """The format of a file: by name (or ending) where given, else by content, else by the ending of the file's name.

    A name may go on with a place inside the file, as ``hdf5:/davis/left``.

    Raises:
        EventFileError: there is none.
    """
    if format is not None:
        kind, colon, place = format.partition(":") if isinstance(format, str) else ("", "", "")
        if (found := called(kind, FORMATS.values())) is None or (colon and found.inside is None):
            known = ", ".join(FORMATS)
            message = f"unknown format {format!r}, expected one of {known}"
            raise EventFileError(source.name, message, hint=near(kind, FORMATS))
        inside = found.inside
        return replace(found, open=lambda data: inside(data, place)) if inside and place else found
    head = source.head(HEAD)
    for guesses in (False, True):
        for f in FORMATS.values():
            if f.guesses == guesses and f.knows(head):
                return f
    for f in FORMATS.values():
        if source.name.lower().endswith(f.suffixes):
            return f
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS.values())
    raise EventFileError(source.name, f"unknown kind of event file, expected one of: {titles}")


def smallest(found: Format, x: int, y: int) -> tuple[int, int]:
    """The sensor of a file that tells none: one that is usual in its format, else the smallest that holds all.

    Args:
        found: the format.
        x: the largest column, -1 without events.
        y: the largest row.
    """
    known = (size for size in (found.usual, *found.larger) if size and x < size[0] and y < size[1])
    return next(known, (max(x, 0) + 1, max(y, 0) + 1))
