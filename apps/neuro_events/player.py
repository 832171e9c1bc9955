"""A source of live events that plays a recording in real time."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import is_number
from neuro_events._events import Events, empty_columns
from neuro_events.files import size_of, stream

_NONE = np.zeros(0, dtype=np.int64)
_PART = 1 << 13
"""Events of a file that are decoded at a time; decoding takes about 0.1 ms."""


class Player:
    """Player of a recording in real time, starting at the first call of `take`.

    Args:
        recording: Events, or the path of a file, which is decoded while it plays.
        speed: playing speed relative to real time; 2 plays twice as fast.
        format: format of a file, if neither content nor ending shows it.

    Attributes:
        sensor_size: width and height in px.
        received_ns: due time of each event of the last `take`, in ns of `time.monotonic_ns`.
        ended: True once all events have been returned.

    Raises:
        ModelError: the speed is not above 0, or there is no such recording.
    """

    def __init__(
        self, recording: Events | str | os.PathLike[str], speed: float = 1.0, format: str | None = None
    ) -> None:
        if not is_number(speed) or not 0 < speed < float("inf"):
            raise ModelError(f"speed = {speed!r:.60}: expected a number > 0")
        self._ns = 1000.0 / speed
        if isinstance(recording, Events):
            self.sensor_size = recording.sensor_size
            self._parts: Iterator[Events] = iter([recording])
        elif isinstance(recording, str | os.PathLike):
            self.sensor_size = size_of(recording, format=format)
            self._parts = stream(recording, format=format, sensor_size=self.sensor_size, count=_PART)
        else:
            raise ModelError(f"recording is {recording!r:.60}: expected Events or the path of a file")
        first = next((part for part in self._parts if len(part)), None)
        self.ended = first is None
        self._origin = 0 if first is None else int(first.t[0])
        self._part, self._due_ns = (
            self._with_due_times(first) if first is not None else (_none(self.sensor_size), _NONE)
        )
        self._begin: int | None = None
        self.received_ns: NDArray[np.int64] = _NONE

    def _with_due_times(self, part: Events) -> tuple[Events, NDArray[np.int64]]:
        """Return a part and the due times of its events, ns after the start."""
        return part, ((part.t - self._origin) * self._ns).astype(np.int64)

    def take(self) -> Events:
        """Return the events due since the last call. The first call starts the recording and returns no events."""
        now = time.monotonic_ns()
        if self._begin is None:
            self._begin, self.received_ns = now, _NONE
            return _none(self.sensor_size)
        parts, due_ns = [], []
        while True:
            n = int(np.searchsorted(self._due_ns, now - self._begin, side="right"))
            if n:
                parts.append(self._part[:n])
                due_ns.append(self._due_ns[:n] + self._begin)
                self._part, self._due_ns = self._part[n:], self._due_ns[n:]
            if len(self._part):
                break
            next_part = next((part for part in self._parts if len(part)), None)
            if next_part is None:
                self.ended = True
                break
            self._part, self._due_ns = self._with_due_times(next_part)
        self.received_ns = due_ns[0] if len(due_ns) == 1 else np.concatenate([_NONE, *due_ns])
        return sum(parts[1:], parts[0]) if parts else _none(self.sensor_size)


def _none(size: tuple[int, int]) -> Events:
    return Events(*empty_columns(0), size)
