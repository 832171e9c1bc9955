"""Open an event file: find its format, make its reader, take its pieces, check them; damage as users see it."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.apps import PART, LazyModule, near, record_input
from neuro_events._events import Columns, empty_columns, joined_columns
from neuro_events.formats import FORMATS, HEAD, Damage, Format, Piece, Reader, Seeker, Sized, called
from neuro_events.source import EventFileError, EventFileWarning, Given, Source, let_go, opened_source

kernels = LazyModule("neuro_events.formats._table_kernel")


class Checked:
    """Checks the pieces of one file in order.

    Args:
        path: the file, for messages.
        size: width and height of the sensor, None where any will do.
        strict: whether an impossible event is an error; otherwise it is left out and counted.
        sort: whether time may run back, since the events will be sorted.
        way_out: the option that chooses another sensor, for messages.
    """

    def __init__(self, path: str, size: tuple[int, int] | None, strict: bool, sort: bool, way_out: str = "") -> None:
        self.path, self.size, self._strict, self._sort, self._way_out = path, size, strict, sort, way_out
        self._last = np.iinfo(np.int64).min
        self._seen = 0
        self._dropped = 0

    def highest(self, piece: Piece) -> tuple[int, int]:
        """Largest x and y of a piece, (-1, -1) of an empty one."""
        if not piece.t.size:
            return -1, -1
        if piece.highest is not None:
            return piece.highest
        return _survey(piece)[0]

    def piece(self, piece: Piece) -> Columns:
        """The events of a piece that can be.

        Raises:
            EventFileError: one cannot, and `strict` is set; the first is named with its byte.
        """
        arrays = piece.t, piece.x, piece.y, piece.p
        given: tuple[npt.NDArray[Any], ...] = arrays
        kinds: tuple[npt.NDArray[Any], ...] = empty_columns(0)
        for name, array, expected in zip("txyp", given, kinds, strict=True):
            if array.shape != (len(piece.t),) or array.dtype != expected.dtype:
                found = f"{name} of shape {list(array.shape)} and type {array.dtype}"
                what = f"its format gives {found}: expected {len(piece.t)} of type {expected.dtype}"
                raise EventFileError(self.path, what)
        if not piece.t.size:
            return arrays
        ordered, highest = piece.ordered, piece.highest
        if ordered is None or highest is None:
            highest, ordered = _survey(piece)
        fits = self.size is None or (highest[0] < self.size[0] and highest[1] < self.size[1])
        if not fits or not (self._sort or (ordered and piece.t[0] >= self._last)):
            arrays = self._mended(piece)
        if arrays[0].size:
            self._last = int(arrays[0].max()) if self._sort else int(arrays[0][-1])
        self._seen += piece.t.size
        return arrays

    def _mended(self, piece: Piece) -> Columns:
        """Leave out what cannot be, or tell of the first such event."""
        width, height = self.size or (1 << 16, 1 << 16)
        off = (piece.x >= width) | (piece.y >= height)
        back = np.zeros(piece.t.size, dtype=bool)
        if not self._sort:
            before = np.maximum.accumulate(np.concatenate(([self._last], np.where(off, self._last, piece.t)[:-1])))
            back = piece.t < before
        bad = off | back
        if self._strict:
            k = int(bad.argmax())
            line = piece.line(k)
            where = f"event {self._seen + k}" if line is None else f"line {line}"
            hint = self._way_out if off[k] else ""
            raise EventFileError(self.path, f"{where}: {self._fault(piece, k, off[k])}", piece.place(k), hint)
        self._dropped += int(bad.sum())
        keep = ~bad
        return piece.t[keep], piece.x[keep], piece.y[keep], piece.p[keep]

    def _fault(self, piece: Piece, k: int, off: bool) -> str:
        if not off:
            before = int(piece.t[k - 1]) if k else self._last
            return f"time runs back from {before} to {piece.t[k]} us; load(..., sort=True) sorts the events"
        assert self.size is not None
        width, height = self.size
        name, value, limit = ("x", piece.x[k], width) if piece.x[k] >= width else ("y", piece.y[k], height)
        return f"{name} is {value}, expected 0 to {limit - 1} (sensor {width}x{height})"

    def warn(self) -> None:
        """Tell how many events were left out."""
        if self._dropped:
            text = f"{self.path}: {self._dropped} of {self._seen} events off the sensor or back in time were left out"
            warnings.warn(text, EventFileWarning, stacklevel=3)


def joined(pieces: list[Columns], sort: bool) -> Columns:
    """Pieces as one, sorted by time if asked; events of one time keep their order."""
    t, x, y, p = pieces[0] if len(pieces) == 1 else joined_columns(pieces)
    if sort and np.any(t[1:] < t[:-1]):
        order = np.argsort(t, kind="stable")
        return t[order], x[order], y[order], p[order]
    return t, x, y, p


def _survey(piece: Piece) -> tuple[tuple[int, int], bool]:
    """Largest x and y of a piece with events, and whether its time does not run back."""
    x, y, ordered = kernels.survey(piece.t, piece.x, piece.y)
    return (int(x), int(y)), bool(ordered)


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
        for part in (self.reader, self.source):
            if (close := getattr(part, "close", None)) is not None:
                close()

    @property
    def name(self) -> str:
        """The file, as messages call it."""
        return self.source.name

    @property
    def way_out(self) -> str:
        """The option that chooses another sensor, "" where the format has none."""
        return self.reader.way_out if isinstance(self.reader, Sized) else ""

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        """Width and height that the file or its format states, None where neither does.

        Raises:
            EventFileError: the file states it in a way that may mean two things, or an impossible one.
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
            what = "its sensor is not stated, and it cannot be read twice to look for it"
            raise EventFileError(self.name, f"{what}: give sensor_size=(width, height), or --sensor WxH")
        checked = Checked(self.name, None, strict=False, sort=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EventFileWarning)  # damage is reported the second time
            sizes = [checked.highest(piece) for piece in self.pieces(block, strict=False)]
        return smallest(self.format, max((x for x, _ in sizes), default=-1), max((y for _, y in sizes), default=-1))


def opened(source: Given, format: str | None, name: str | None, size: tuple[int, int] | None = None) -> Opened:
    """Open a file.

    Args:
        source: a path, bytes, or an open binary file.
        format: its name, where neither content nor ending shows it.
        name: what to call it.
        size: width and height of the sensor that the user gives, px.

    Raises:
        EventFileError: there is no such file, it is of no known kind, or its header is damaged.
    """
    data = opened_source(source, name)
    if isinstance(source, (str, os.PathLike)):
        record_input(source)
    try:
        found = find(data, format)
        reader = found.open(data)
        if size is not None and isinstance(reader, Sized):
            reader.use_sensor(size)
        return Opened(data, reader, found)
    except Damage as damage:
        let_go(damage)
        data.close()
        raise EventFileError(data.name, damage.what, damage.offset) from None
    except EventFileError as error:
        let_go(error)
        data.close()
        raise


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
        if source.name.lower().removesuffix(PART).endswith(f.suffixes):
            return f
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS.values())
    raise EventFileError(source.name, f"unknown kind of event file, expected one of: {titles}")


def smallest(found: Format, x: int, y: int) -> tuple[int, int]:
    """The sensor of a file that states none: one that is usual in its format, else the smallest that holds all.

    Args:
        found: the format.
        x: the largest column, -1 without events.
        y: the largest row.
    """
    known = (size for size in (found.usual, *found.larger) if size and x < size[0] and y < size[1])
    return next(known, (max(x, 0) + 1, max(y, 0) + 1))
