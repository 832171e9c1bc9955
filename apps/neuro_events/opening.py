"""Open event files: detect the format, create the reader, check its pieces, and turn damage into `EventFileError`."""

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
from neuro_events.source import EventFileError, EventFileWarning, FileInput, Source, clear_frames, opened_source

kernels = LazyModule("neuro_events.formats._table_kernel")


class Checker:
    """Checker of the pieces of one file, which must come in order.

    Args:
        path: the file, for messages.
        size: width and height of the sensor, None for any sensor.
        strict: raise an error at an impossible event. Otherwise such events are dropped and counted.
        sort: accept times that run back, because the caller sorts the events.
        way_out: the option that chooses another sensor, for messages.
    """

    def __init__(self, path: str, size: tuple[int, int] | None, strict: bool, sort: bool, way_out: str = "") -> None:
        self.path, self.size, self._strict, self._sort, self._way_out = path, size, strict, sort, way_out
        self._last = np.iinfo(np.int64).min
        self._n_events = 0
        self._n_dropped = 0

    def highest(self, piece: Piece) -> tuple[int, int]:
        """Return the largest x and y of a piece, (-1, -1) for an empty piece."""
        if not piece.t.size:
            return -1, -1
        if piece.highest is not None:
            return piece.highest
        return _survey(piece)[0]

    def check(self, piece: Piece) -> Columns:
        """Return the columns of a piece, without impossible events.

        Raises:
            EventFileError: an event is impossible and `strict` is set. The message names the event and its byte.
        """
        arrays = piece.t, piece.x, piece.y, piece.p
        columns: tuple[npt.NDArray[Any], ...] = arrays
        empty: tuple[npt.NDArray[Any], ...] = empty_columns(0)
        for name, array, expected in zip("txyp", columns, empty, strict=True):
            if array.shape != (len(piece.t),) or array.dtype != expected.dtype:
                column = f"{name} of shape {list(array.shape)} and type {array.dtype}"
                message = f"its format gives {column}: expected {len(piece.t)} of type {expected.dtype}"
                raise EventFileError(self.path, message)
        if not piece.t.size:
            return arrays
        ordered, highest = piece.ordered, piece.highest
        if ordered is None or highest is None:
            highest, ordered = _survey(piece)
        fits = self.size is None or (highest[0] < self.size[0] and highest[1] < self.size[1])
        if not fits or not (self._sort or (ordered and piece.t[0] >= self._last)):
            arrays = self._without_impossible(piece)
        if arrays[0].size:
            self._last = int(arrays[0].max()) if self._sort else int(arrays[0][-1])
        self._n_events += piece.t.size
        return arrays

    def _without_impossible(self, piece: Piece) -> Columns:
        """Drop impossible events, or raise an error about the first one if `strict` is set."""
        width, height = self.size or (1 << 16, 1 << 16)
        off_sensor = (piece.x >= width) | (piece.y >= height)
        runs_back = np.zeros(piece.t.size, dtype=bool)
        if not self._sort:
            latest = np.maximum.accumulate(
                np.concatenate(([self._last], np.where(off_sensor, self._last, piece.t)[:-1]))
            )
            runs_back = piece.t < latest
        impossible = off_sensor | runs_back
        if self._strict:
            k = int(impossible.argmax())
            line = piece.line(k)
            place = f"event {self._n_events + k}" if line is None else f"line {line}"
            hint = self._way_out if off_sensor[k] else ""
            raise EventFileError(self.path, f"{place}: {self._fault(piece, k, off_sensor[k])}", piece.place(k), hint)
        self._n_dropped += int(impossible.sum())
        keep = ~impossible
        return piece.t[keep], piece.x[keep], piece.y[keep], piece.p[keep]

    def _fault(self, piece: Piece, k: int, is_outside: bool) -> str:
        if not is_outside:
            previous = int(piece.t[k - 1]) if k else self._last
            return f"time runs back from {previous} to {piece.t[k]} us; load(..., sort=True) sorts the events"
        assert self.size is not None
        width, height = self.size
        name, value, limit = ("x", piece.x[k], width) if piece.x[k] >= width else ("y", piece.y[k], height)
        return f"{name} is {value}, expected 0 to {limit - 1} (sensor {width}x{height})"

    def warn(self) -> None:
        """Warn about the number of dropped events."""
        if self._n_dropped:
            message = f"dropped {self._n_dropped} of {self._n_events} events: off the sensor or back in time"
            warnings.warn(f"{self.path}: {message}", EventFileWarning, stacklevel=3)


def joined(pieces: list[Columns], sort: bool) -> Columns:
    """Concatenate pieces, and sort by time if `sort` is set. Events at equal times keep their order."""
    t, x, y, p = pieces[0] if len(pieces) == 1 else joined_columns(pieces)
    if sort and np.any(t[1:] < t[:-1]):
        order = np.argsort(t, kind="stable")
        return t[order], x[order], y[order], p[order]
    return t, x, y, p


def _survey(piece: Piece) -> tuple[tuple[int, int], bool]:
    """Return the largest x and y of a non-empty piece, and whether its times never decrease."""
    x, y, ordered = kernels.survey(piece.t, piece.x, piece.y)
    return (int(x), int(y)), bool(ordered)


@dataclass(slots=True)
class Opened:
    """An open event file, used in a `with` statement, which closes the file even after an error.

    Attributes:
        source: the bytes of the file.
        reader: the decoder of its events.
        format: its format.
    """

    source: Source
    reader: Reader
    format: Format

    def __enter__(self) -> Opened:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None:
        """Close the file. The frames of an `EventFileError` are cleared, so that a stored error keeps no file open."""
        if isinstance(error, EventFileError):
            clear_frames(error)
        for part in (self.reader, self.source):
            if (close := getattr(part, "close", None)) is not None:
                close()

    @property
    def name(self) -> str:
        """Name of the file in messages."""
        return self.source.name

    @property
    def way_out(self) -> str:
        """Text about the option that chooses another sensor, or "" if the format has none."""
        return self.reader.way_out if isinstance(self.reader, Sized) else ""

    @property
    def sensor_size(self) -> tuple[int, int] | None:
        """Width and height that the file or its format states, or None.

        Raises:
            EventFileError: the stated sensor is ambiguous or impossible.
        """
        try:
            return self.reader.sensor_size
        except Damage as damage:
            raise EventFileError(self.name, damage.what, damage.offset) from None

    def pieces(self, block: int, strict: bool, start_us: int | None = None) -> Iterator[Piece]:
        """Yield the pieces of the file. Without `strict`, reading ends with a warning at damage.

        Args:
            block: approximate size of a piece, bytes.
            strict: raise an error at damage.
            start_us: a time, us. A reader that can seek skips pieces of which all events are earlier. None: read from
                the beginning.
        """
        try:
            if start_us is not None and isinstance(self.reader, Seeker):
                yield from self.reader.pieces_from(block, start_us)
            else:
                yield from self.reader.pieces(block)
        except Damage as damage:
            clear_frames(damage)
            error = EventFileError(self.name, damage.what, damage.offset)
            if strict:
                raise error from None
            warnings.warn(f"{error}; the events before it were read", EventFileWarning, stacklevel=4)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            if self.format.open.__module__.startswith("neuro."):
                raise  # a defect of this library, not of a third-party format
            message = f"its format '{self.format.name}' fails: {type(error).__name__}: {error}"
            raise EventFileError(self.name, message) from error

    def can_seek(self) -> bool:
        """Return whether the reader can start at a time without reading the events before."""
        return self.source.size is not None and isinstance(self.reader, Seeker)

    def scanned(self, block: int) -> tuple[int, int]:
        """Read the file once and return the smallest sensor that contains all events.

        Raises:
            EventFileError: the source is a pipe. The caller could not read its events a second time.
        """
        if self.source.size is None:
            message = "the file does not state its sensor, and a pipe cannot be read twice to determine the sensor"
            raise EventFileError(self.name, f"{message}: give sensor_size=(width, height), or --sensor WxH")
        checker = Checker(self.name, None, strict=False, sort=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EventFileWarning)  # the second reading reports the damage
            sizes = [checker.highest(piece) for piece in self.pieces(block, strict=False)]
        return smallest(self.format, max((x for x, _ in sizes), default=-1), max((y for _, y in sizes), default=-1))


def opened(source: FileInput, format: str | None, name: str | None, size: tuple[int, int] | None = None) -> Opened:
    """Open an event file.

    Args:
        source: a path, bytes, or an open binary file.
        format: name of the format, if neither content nor ending shows it.
        name: name for messages.
        size: width and height of the sensor from the user, px.

    Raises:
        EventFileError: no such file, an unknown format, or a damaged header.
    """
    data = opened_source(source, name)
    if isinstance(source, (str, os.PathLike)):
        record_input(source)
    try:
        file_format = find(data, format)
        reader = file_format.open(data)
        if size is not None and isinstance(reader, Sized):
            reader.use_sensor(size)
        return Opened(data, reader, file_format)
    except Damage as damage:
        clear_frames(damage)
        data.close()
        raise EventFileError(data.name, damage.what, damage.offset) from None
    except EventFileError as error:
        clear_frames(error)
        data.close()
        raise


def find(source: Source, format: str | None = None) -> Format:
    """Return the format of a file.

    If `format` is given, it is the name of the format or an ending. A place inside the file may follow the name, as in
    ``hdf5:/davis/left``. Otherwise the content decides, and if no format knows the content, the file's ending.

    Raises:
        EventFileError: no format matches.
    """
    if format is not None:
        kind, colon, place = format.partition(":") if isinstance(format, str) else ("", "", "")
        if (match := called(kind, FORMATS.values())) is None or (colon and match.inside is None):
            message = f"unknown format {format!r}, expected one of {', '.join(FORMATS)}"
            raise EventFileError(source.name, message, hint=near(kind, FORMATS))
        inside = match.inside
        return replace(match, open=lambda data: inside(data, place)) if inside and place else match
    head = source.head(HEAD)
    for guesses in (False, True):  # formats without a signature come last
        for f in FORMATS.values():
            if f.guesses == guesses and f.knows(head):
                return f
    for f in FORMATS.values():
        if source.name.lower().removesuffix(PART).endswith(f.suffixes):
            return f
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS.values())
    raise EventFileError(source.name, f"unknown kind of event file, expected one of: {titles}")


def smallest(format: Format, x: int, y: int) -> tuple[int, int]:
    """Return the width and height to assume for a file that does not state its sensor, px.

    The result is the first of the format's usual sensors that contains all events. If there is none, the result is the
    smallest possible sensor. Example: x = 33 and y = 20 in a format without usual sensors gives (34, 21).

    Args:
        format: the format.
        x: the largest column, -1 without events.
        y: the largest row, -1 without events.
    """
    candidates = (size for size in (format.usual, *format.larger) if size and x < size[0] and y < size[1])
    return next(candidates, (max(x, 0) + 1, max(y, 0) + 1))
