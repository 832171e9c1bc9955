"""Recordings that are played: a file, or events of a program, given part by part and from any time on."""

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
"""Single events are checked when they become `Events`, not cut to the width of a record."""


class Played(Protocol):
    """A recording."""

    @property
    def sensor_size(self) -> Size | None:
        """Width and height in px, None where they are unknown before it is played."""

    @property
    def again(self) -> bool:
        """Whether it can be played several times."""

    @property
    def identity(self) -> str:
        """What distinguishes it from another."""

    def first(self) -> int | None:
        """The time of the first event, us; None where that is not known before it is played.

        Raises:
            EventFileError: the recording has no events.
        """

    @property
    def no_sensor(self) -> str:
        """Why no sensor is known, where none is."""

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """Its events in the order of time; those before `start_us` may be left out.

        Arrays, which tell no sensor, are taken to be of the smallest one of at least `least` that holds them.
        """


@dataclass(frozen=True, slots=True)
class OfFile:
    """A file, of which nothing is kept in memory."""

    path: str
    format: str | None
    sensor_size: Size
    again: bool = True
    no_sensor: str = ""

    @property
    def identity(self) -> str:
        """Its bytes and the sensor: it may be moved."""
        return f"file of {os.path.getsize(self.path)} bytes, {self.sensor_size}"

    def first(self) -> int:
        """The time of the first event."""
        part = next(stream(self.path, format=self.format, sensor_size=self.sensor_size, count=1), None)
        if part is None:
            raise EventFileError(self.path, "has no events")
        return int(part.t[0])

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """Its events; formats that can be sought are not decoded before `start_us`."""
        return stream(self.path, format=self.format, sensor_size=self.sensor_size, start_us=start_us)


def of_file(path: str | os.PathLike[str], format: str | None = None) -> OfFile:
    """A file that is played.

    Raises:
        EventFileError: there is no such file, it is of no known kind, or its header is damaged.
    """
    return OfFile(os.fspath(path), format, size_of(path, format=format))


@dataclass(frozen=True, slots=True, repr=False)
class OfEvents:
    """Events in memory, whole or in parts: `Events`, or structured arrays, which tell no sensor."""

    kind: ClassVar[str] = "recording"
    no_sensor: ClassVar[str] = "its events are an array, which has no sensor"
    whole: Sequence[Events | NDArray[Any]]
    again: bool = True

    def __repr__(self) -> str:
        size = self.sensor_size
        return f"{sum(map(len, self.whole)):,} events" + (f" of {size[0]}x{size[1]} px" if size else "")

    @property
    def sensor_size(self) -> Size | None:
        """That of the first part that has one."""
        return next((part.sensor_size for part in self.whole if isinstance(part, Events)), None)

    @property
    def identity(self) -> str:
        """Their number and the sensor."""
        return f"{sum(map(len, self.whole))} events, {self.sensor_size}"

    def first(self) -> int:
        """The time of the first event."""
        part = next((part for part in self.whole if len(part)), None)
        if part is None:
            raise ModelError("its recording has no events: expected at least one")
        return int(part.t[0] if isinstance(part, Events) else part["t"][0])

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """The parts, looked at as they are given."""
        return _in_order(iter(self.whole), least)


@dataclass(slots=True, eq=False, repr=False)
class OfIterator:
    """Parts that a program makes while they are played: by an iterator, once, or by a function that makes one."""

    kind: ClassVar[str] = "recording"
    make: Callable[[], Iterable[Events]]
    again: bool
    sensor_size: Size | None = None
    identity: str = "events of an iterator"
    no_sensor: str = "no sensor is known before it is played"
    _begun: bool = field(default=False, init=False)

    def __repr__(self) -> str:
        return "an iterator of events"

    def first(self) -> None:
        """Not known."""

    def parts(self, start_us: int | None = None, least: Size = (1, 1)) -> Iterator[Events]:
        """The parts, looked at as they are given."""
        if self._begun and not self.again:
            hint = "give Events, a list of them, or a function that makes an iterator"
            raise ModelError("its events come from an iterator, which was begun already", hint=hint)
        self._begun = True
        made = self.make()
        if not isinstance(made, Iterable):
            raise ModelError(f"its function gave {made!r:.60}: expected an iterator of Events")
        return _in_order(iter(made), least)


def played(given: Any) -> Played:
    """What a program gives as a recording.

    Args:
        given: Events, a structured array of them, single `Event`s, a list or an iterator of any of these, or a function
            that makes an iterator.

    Raises:
        ModelError: it is none of these.
    """
    if isinstance(given, OfEvents | OfIterator):
        return given
    if isinstance(given, Events | np.ndarray | Event):
        return OfEvents((_part(given),))
    if isinstance(given, list | tuple | deque):
        if given and all(isinstance(each, Event) for each in given):
            return OfEvents((np.array([tuple(each) for each in given], dtype=_WIDE),))
        return OfEvents(tuple(_part(part) for part in given))
    if isinstance(given, Iterator):
        return OfIterator(lambda: given, again=False)
    if callable(given):
        return OfIterator(given, again=True)
    raise _no_events(given)


def of_records(records: Any, least: Size) -> Events:
    """A structured array with t, x, y and p as events.

    Args:
        records: the array.
        least: width and height in px of the sensor, which is larger where an event lies beyond.

    Raises:
        ModelError: an event cannot be.
    """
    t, x, y, p = (records[name] for name in "txyp")
    size = max(least[0], int(x.max(initial=0)) + 1), max(least[1], int(y.max(initial=0)) + 1)
    return Events(t, x, y, p, size)


def _in_order(parts: Iterator[Any], least: Size) -> Iterator[Events]:
    try:
        yield from (part for _, part in in_order(_events(part, least) for part in parts))
    except Unsavable as fault:
        raise ModelError(f"event {fault.event}: {fault.what}") from None


def _events(given: Any, least: Size) -> Events:
    part = _part(given)
    return part if isinstance(part, Events) else of_records(part, least)


def _part(given: Any) -> Events | NDArray[Any]:
    """Events, a structured array of them, or one event."""
    if isinstance(given, Event):
        return np.array([tuple(given)], dtype=_WIDE)
    if isinstance(given, Events):
        return given
    names = (given.dtype.names or ()) if isinstance(given, np.ndarray) else ()
    if not set(EVENT.names or ()) <= set(names) or given.ndim != 1:
        raise _no_events(given)
    return given  # type: ignore[no-any-return]


def _no_events(given: object) -> ModelError:
    found = f"an array of {given.dtype}" if isinstance(given, np.ndarray) else f"{given!r:.60}"
    wanted = "expected Events, or an array with the fields t, x, y and p, or an iterator of such"
    hint = "write file=" if isinstance(given, str | os.PathLike) else ""
    return ModelError(f"events: found {found}: {wanted}", hint=hint)
