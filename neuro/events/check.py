"""What a recording must satisfy, looked at once: events on the sensor, time that does not run back."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events.errors import EventFileError, EventFileWarning
from neuro.events.formats._format import Piece

Arrays = tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8]]

_TYPES = np.int64, np.uint16, np.uint16, np.uint8


class Checked:
    """Checks the pieces of one file in order.

    Args:
        path: the file, for messages.
        size: width and height of the sensor, None where any will do.
        strict: whether an impossible event is an error; otherwise it is left out and counted.
        sort: whether time may run back, since the events will be sorted.
    """

    def __init__(self, path: str, size: tuple[int, int] | None, strict: bool, sort: bool) -> None:
        self.path, self.size, self._strict, self._sort = path, size, strict, sort
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

    def piece(self, piece: Piece) -> Arrays:
        """The events of a piece that can be.

        Raises:
            EventFileError: one cannot, and `strict` is set; the first is named with its byte.
        """
        arrays = piece.t, piece.x, piece.y, piece.p
        given: tuple[npt.NDArray[Any], ...] = arrays
        for name, array, kind in zip("txyp", given, _TYPES, strict=True):
            if array.shape != (len(piece.t),) or array.dtype != kind:
                found = f"{name} of shape {list(array.shape)} and type {array.dtype}"
                what = f"its format gives {found}: expected {len(piece.t)} of type {np.dtype(kind)}"
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

    def _mended(self, piece: Piece) -> Arrays:
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
            raise EventFileError(self.path, f"{where}: {self._fault(piece, k, off[k])}", piece.place(k))
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


def joined(pieces: list[Arrays], sort: bool) -> Arrays:
    """Pieces as one, sorted by time if asked; events of one time keep their order."""
    if len(pieces) == 1:
        t, x, y, p = pieces[0]
    else:
        kinds = (np.int64, np.uint16, np.uint16, np.uint8)
        columns = [np.concatenate([np.zeros(0, kind), *(piece[k] for piece in pieces)]) for k, kind in enumerate(kinds)]
        t, x, y, p = columns
    if sort and np.any(t[1:] < t[:-1]):
        order = np.argsort(t, kind="stable")
        t, x, y, p = t[order], x[order], y[order], p[order]
    return t, x, y, p


def _survey(piece: Piece) -> tuple[tuple[int, int], bool]:
    """Largest x and y of a piece with events, and whether its time does not run back."""
    from neuro.events._kernels import survey

    x, y, ordered = survey(piece.t, piece.x, piece.y)
    return (int(x), int(y)), bool(ordered)
