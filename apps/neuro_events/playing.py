"""Recordings as input of an event camera: a file or events of a program, read part by part from any start time."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro_events._events import EVENT, Event, Events
from neuro_events.files import size_of, stream
from neuro_events.formats import Unsavable, in_order
from neuro_events.source import EventFileError

Size = tuple[int, int]
_WIDE = [(name, np.int64) for name in "txyp"]
"""Fields of single events as int64, so that values out of range reach the check of `Events` instead of wrapping."""


class Played(Protocol):
    """A recording that an event camera can play."""

    @property
    def sensor_size(self) -> Size | None:
        """Width and height in px, None if unknown before the recording is played."""

    @property
    def repeatable(self) -> bool:
        """True if the recording can be played several times."""

    @property
    def identity(self) -> str:
        """Text that differs between different recordings."""

    def first(self) -> int | None:
        """Return the time of the first event, us, or None if unknown before the recording is played.

        Raises:
            EventFileError: the recording has no events.
        """

    @property
    def no_sensor(self) -> str:
        """Reason why the sensor size is unknown."""

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """Yield the events in the order of time. Events before `start_us` may be omitted.

        If the events are arrays, which state no sensor, the sensor is the smallest that contains the events and has at
        least `least` px.
        """


@dataclass(frozen=True, slots=True)
class OfFile:
    """A file that is read while it plays, in constant memory."""

    path: str
    format: str | None
    sensor_size: Size
    repeatable: bool = True
    no_sensor: str = ""

    @property
    def identity(self) -> str:
        """Size of the file and its sensor. The path is not part of the identity, since a file may be moved."""
        return f"file of {os.path.getsize(self.path)} bytes, {self.sensor_size}"

    def first(self) -> int:
        """Return the time of the first event, us."""
        part = next(stream(self.path, format=self.format, sensor_size=self.sensor_size, count=1), None)
        if part is None:
            raise EventFileError(self.path, "has no events")
        return int(part.t[0])

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """Yield the events. Formats that can seek are not decoded before `start_us`."""
        return stream(self.path, format=self.format, sensor_size=self.sensor_size, start_us=start_us)


def of_file(path: str | os.PathLike[str], format: str | None = None) -> OfFile:
    """Return a file as a recording.

    Raises:
        EventFileError: no such file, an unknown format, or a damaged header.
    """
    return OfFile(os.fspath(path), format, size_of(path, format=format))


@dataclass(frozen=True, slots=True, repr=False)
class OfEvents:
    """Events in memory: one or more parts, each ``Events`` or a structured array, which states no sensor."""

    kind: ClassVar[str] = "recording"
    no_sensor: ClassVar[str] = "its events are an array, which has no sensor"
    stored_parts: Sequence[Events | NDArray[Any]]
    repeatable: bool = True

    def __repr__(self) -> str:
        size = self.sensor_size
        return f"{sum(map(len, self.stored_parts)):,} events" + (f" of {size[0]}x{size[1]} px" if size else "")

    @property
    def sensor_size(self) -> Size | None:
        """Sensor of the first part that states one."""
        return next((part.sensor_size for part in self.stored_parts if isinstance(part, Events)), None)

    @property
    def identity(self) -> str:
        """Number of events and the sensor."""
        return f"{sum(map(len, self.stored_parts))} events, {self.sensor_size}"

    def first(self) -> int:
        """Return the time of the first event, us."""
        part = next((part for part in self.stored_parts if len(part)), None)
        if part is None:
            raise ModelError("its recording has no events: expected at least one")
        return int(part.t[0] if isinstance(part, Events) else part["t"][0])

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """Yield the parts, each checked when it is requested."""
        return _in_order(iter(self.stored_parts), least)


@dataclass(slots=True, eq=False, repr=False)
class OfIterator:
    """Parts that a program makes while they play: an iterator, which plays once, or a function that makes iterators."""

    kind: ClassVar[str] = "recording"
    make: Callable[[], Iterable[Events]]
    repeatable: bool
    sensor_size: Size | None = None
    identity: str = "events of an iterator"
    no_sensor: str = "no sensor is known before playback"
    _is_started: bool = field(default=False, init=False)

    def __repr__(self) -> str:
        return "an iterator of events"

    def first(self) -> None:
        """Return None, since the first event is unknown before the iterator runs."""

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """Yield the parts, each checked when it is requested."""
        if self._is_started and not self.repeatable:
            hint = "give Events, a list of them, or a function that makes an iterator"
            raise ModelError("its events come from an iterator, which can be played only once", hint=hint)
        self._is_started = True
        iterable = self.make()
        if not isinstance(iterable, Iterable):
            raise ModelError(f"its function gave {iterable!r:.60}: expected an iterator of Events")
        return _in_order(iter(iterable), least)


def played(events: Any) -> Played:
    """Convert events of a program to a recording.

    Args:
        events: Events, a structured array, single `Event`s, a list or an iterator of any of these, or a function that
            makes an iterator.

    Raises:
        ModelError: `events` is none of these.
    """
    if isinstance(events, OfEvents | OfIterator):
        return events
    if isinstance(events, Events | np.ndarray | Event):
        return OfEvents((_part(events),))
    if isinstance(events, list | tuple | deque):
        if events and all(isinstance(event, Event) for event in events):
            return OfEvents((np.array([tuple(event) for event in events], dtype=_WIDE),))
        return OfEvents(tuple(_part(part) for part in events))
    if isinstance(events, Iterator):
        return OfIterator(lambda: events, repeatable=False)
    if callable(events):
        return OfIterator(events, repeatable=True)
    raise _no_events(events)


def of_records(records: Any, least: Size) -> Events:
    """Convert a structured array with t, x, y and p to events.

    Args:
        records: the array.
        least: smallest width and height of the sensor, px. The sensor grows if an event lies beyond.

    Raises:
        ModelError: an event is impossible.
    """
    t, x, y, p = (records[name] for name in "txyp")
    size = max(least[0], int(x.max(initial=0)) + 1), max(least[1], int(y.max(initial=0)) + 1)
    return Events(t, x, y, p, size)


def _in_order(parts: Iterator[Any], smallest: Size) -> Iterator[Events]:
    try:
        yield from (part for _, part in in_order(_events(part, smallest) for part in parts))
    except Unsavable as fault:
        raise ModelError(f"event {fault.event}: {fault.what}") from None


def _events(events: Any, smallest: Size) -> Events:
    part = _part(events)
    return part if isinstance(part, Events) else of_records(part, smallest)


def _part(events: Any) -> Events | NDArray[Any]:
    """Return events or a structured array unchanged. Convert a single `Event` to a structured array."""
    if isinstance(events, Event):
        return np.array([tuple(events)], dtype=_WIDE)
    if isinstance(events, Events):
        return events
    names = (events.dtype.names or ()) if isinstance(events, np.ndarray) else ()
    if not set(EVENT.names or ()) <= set(names) or events.ndim != 1:
        raise _no_events(events)
    return events  # type: ignore[no-any-return]


def _no_events(value: object) -> ModelError:
    description = f"an array of {value.dtype}" if isinstance(value, np.ndarray) else f"{value!r:.60}"
    expected = "expected Events, or an array with the fields t, x, y and p, or an iterator of such"
    hint = "write file=" if isinstance(value, str | os.PathLike) else ""
    return ModelError(f"events: found {description}: {expected}", hint=hint)
