"""Interface of a file format.

A reader yields the events of a file in pieces, so that a file of any size is read in constant memory, and the pieces
before a damage can be used. The same reader serves `load`, which requests one piece, and `stream`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from neuro.apps import install
from neuro_events._events import Events
from neuro_events.source import Source

Size = tuple[int, int]


class Damage(ValueError):
    """Damage of a file, raised by a reader after all intact pieces.

    ``what`` describes the damage at byte ``offset`` of the data. The offset is None if no single byte is at fault, as
    in a file that another library decodes.
    """

    def __init__(self, what: str, offset: int | None) -> None:
        super().__init__(what, offset)
        self.what = what
        self.offset = offset


class Unsavable(ValueError):
    """Error of a writer about an event that the format cannot store.

    ``event`` is the number of the event in the recording, ``what`` is the reason, and ``hint`` is a remedy.
    """

    def __init__(self, what: str, event: int, hint: str = "") -> None:
        super().__init__(what, event, hint)
        self.what = what
        self.event = event
        self.hint = hint


def no_place(event: int) -> int | None:
    """Return None, for formats in which the byte or line of an event is unknown."""
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Consecutive events of a file, not yet checked against the sensor.

    Attributes:
        t: (n,) int64, us.
        x, y: (n,) uint16, px.
        p: (n,) uint8, 1 = ON.
        highest: largest x and y, (-1, -1) without events. None: not determined.
        ordered: True if time never runs back within the piece. None: not determined.
        place: function from the index of an event to the byte at which the event begins, or to None.
        line: function from the index of an event to its line number in a text file, or to None.
    """

    t: npt.NDArray[np.int64]
    x: npt.NDArray[np.uint16]
    y: npt.NDArray[np.uint16]
    p: npt.NDArray[np.uint8]
    highest: tuple[int, int] | None = None
    ordered: bool | None = None
    place: Callable[[int], int | None] = no_place
    line: Callable[[int], int | None] = no_place


class Reader(Protocol):
    """A reader of an open file.

    A reader of several layouts may have an attribute ``untested``, as `Format` has.

    Attributes:
        sensor_size: width and height that the file or the format states, or None; may raise `Damage`.
        metadata: other properties that the file states, by name.
    """

    @property
    def sensor_size(self) -> Size | None: ...
    @property
    def metadata(self) -> Mapping[str, Any]: ...
    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the events from the beginning, in pieces of about ``block`` bytes.

        Raises:
            Damage: after the last intact piece.
        """


@runtime_checkable
class Seeker(Reader, Protocol):
    """A reader that can start at a later time in a file on disk or in memory. For other sources `stream` reads all."""

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """Yield pieces as `pieces` does, but omit pieces before a time where the file allows it.

        Args:
            block: see `pieces`.
            start_us: the time, us. In an intact file all omitted events are earlier.

        Raises:
            Damage: see `pieces`, for the part that is read.
        """


@runtime_checkable
class Sized(Protocol):
    """A reader of files that may come from several sensors and do not state their sensor.

    Attributes:
        way_out: text about the option that chooses the sensor, for messages.
    """

    way_out: str

    def use_sensor(self, size: Size) -> None:
        """Decode the file as a recording of this sensor. Called first, if the user specifies a size.

        Raises:
            Damage: no sensor of the format has this size.
        """


@dataclass(frozen=True, slots=True)
class Format:
    """A file format.

    Attributes:
        name: value of ``load(..., format=name)``.
        title: name for messages.
        suffixes: endings of file names, lower case, with the dot.
        knows: function that returns True if the first bytes of a file (up to `HEAD`) are of this format. A format
            without a signature returns False and is detected by its suffixes.
        open: function that creates a reader; raises `Damage` if the header is damaged.
        write: function that writes the parts of one recording to a new path; raises `Unsavable`. None: read only.
        usual: sensor to assume if the file states none and all events fit.
        larger: sensors to try after `usual`, in this order.
        inside: function like `open` for one of several recordings in a file. The second argument is the place of the
            recording: the part after the colon in ``load(..., format="hdf5:/davis/left")``. None: a file of this format
            holds one recording.
        guesses: True if `knows` has no signature to check, as for plain text. Such formats are tried last.
        holds: function of the events and of the time of the event before them (None at the beginning). It returns (n,)
            bool, True for the events that `write` can store. None: all events can be stored.
        grows: True if the output of `write` is a readable recording at any time, so that a killed process leaves one.
        untested: reason why the format was tested only on files made from its specification. "" if it was tested on
            real files.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    knows: Callable[[bytes], bool]
    open: Callable[[Source], Reader]
    write: Callable[[Iterator[Events], Path], None] | None = None
    untested: str = ""
    usual: Size | None = None
    larger: tuple[Size, ...] = ()
    inside: Callable[[Source, str], Reader] | None = None
    guesses: bool = False
    holds: Callable[[Events, int | None], npt.NDArray[np.bool_]] | None = None
    grows: bool = False


def complete(part: Format) -> Format:
    """Check that the attributes of a format are usable on the command line, and return the format.

    Raises:
        TypeError: an attribute is unusable.
    """
    label = f"event format {part.name!r:.40}"
    if not isinstance(part.name, str) or not part.name or set(part.name) & set(": /"):
        raise TypeError(f"{label}: expected a name without ':', '/' and spaces")
    endings = part.suffixes
    if not isinstance(endings, tuple) or not all(isinstance(e, str) and e[:1] == "." for e in endings):
        raise TypeError(f"{label}: suffixes = {endings!r:.60}: expected endings with a dot, such as ('.mine',)")
    if any(ending != ending.lower() for ending in endings):
        raise TypeError(f"{label}: suffixes = {endings!r:.60}: expected lower case, which matches names in any case")
    if not callable(part.knows) or not callable(part.open):
        raise TypeError(f"{label}: expected two functions, knows(head) and open(source)")
    return part


def called(name: str, formats: Iterable[Format]) -> Format | None:
    """Return the format with a name, else the only format with an ending (such as bin or .bin), else None."""
    ending, matches = "." + name.lower().removeprefix("."), []
    for f in formats:
        if f.name == name:
            return f
        matches += [f] if ending in f.suffixes else []
    return matches[0] if len(matches) == 1 else None


HEAD = 4096
"""Number of bytes at the beginning of a file for the detection of its format."""


@dataclass(slots=True)
class Found:
    """A reader whose pieces are already in memory, for formats that are decoded at once."""

    sensor_size: Size | None
    metadata: Mapping[str, Any] = field(default_factory=dict)
    parts: tuple[Piece, ...] = ()
    damage: Damage | None = None

    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the pieces, then raise the damage, if any."""
        yield from self.parts
        if self.damage is not None:
            raise self.damage


EXTRA = "events"
"""Name of the package's extra that installs the optional dependencies of the formats."""


def extra(module: str, what: str) -> ModuleType:
    """Import a module of an optional package.

    Args:
        module: name of the module.
        what: what needs the package, for the message.

    Raises:
        Damage: the package is not installed; the message has the command that installs it.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise Damage(f"{what} needs the package {package}: {install(EXTRA)}", None) from None


OWN = ("format", "t0")
"""Metadata about the file rather than the recording. Readers add them, so writers omit them."""


def as_json(metadata: Mapping[str, Any]) -> str:
    """Convert metadata to JSON. Values that JSON cannot represent are written as text."""
    return json.dumps({str(key): value for key, value in metadata.items() if key not in OWN}, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value)


def from_json(text: str) -> dict[str, Any]:
    """Convert the output of `as_json` to metadata.

    Raises:
        ValueError: the text is not a JSON object.
    """
    try:
        metadata = json.loads(text)
    except (ValueError, RecursionError):
        metadata = None
    if not isinstance(metadata, dict):
        raise ValueError("its metadata are not a JSON object")
    return {key: value for key, value in metadata.items() if key not in OWN}


def in_order(parts: Iterator[Events]) -> Iterator[tuple[int, Events]]:
    """Yield the number of earlier events, and the part, for each part of a recording.

    Args:
        parts: the parts of one recording, in order.

    Raises:
        Unsavable: a part has another sensor than the first, or begins before the end of the part before.
    """
    n_before, last = 0, np.iinfo(np.int64).min
    size = None
    for part in parts:
        size = size or part.sensor_size
        if part.sensor_size != size:
            actual, expected = (f"{width}x{height}" for width, height in (part.sensor_size, size))
            raise Unsavable(f"its sensor is {actual}, expected {expected} as in the first part", n_before)
        if len(part):
            if part.t[0] < last:
                raise Unsavable(f"time runs back from {last} to {part.t[0]} us", n_before)
            last = int(part.t[-1])
        yield n_before, part
        n_before += len(part)


def held(parts: Iterable[Events], format: Format, left_out: Callable[[int], None]) -> Iterator[Events]:
    """Drop the events that a format cannot store.

    Args:
        parts: the parts of one recording, in order.
        format: the format to write.
        left_out: called with the number of events dropped from a part.
    """
    last = None
    for part in parts:
        if format.holds is not None and len(part) and not (is_storable := format.holds(part, last)).all():
            left_out(int(np.count_nonzero(~is_storable)))
            part = part[is_storable]
        if len(part):
            last = int(part.t[-1])
        yield part


EARLIER = "the filter 'shift: {to_us: 0}' moves the first event to 0 us; 'neuro events split' cuts a longer recording"
SMALLER = "the filters 'crop: {x: [0, 128], y: [0, 128]}' and 'downsample: {factor: 2}' make the sensor smaller"


class Limits(NamedTuple):
    """Range of times and positions that a format can store.

    Attributes:
        times: upper limit of the times, us, exclusive; 0: no limit. Times below 0 cannot be stored.
        columns: number of columns.
        rows: number of rows; 0: as many as columns.
        reserved: row number that has another meaning in the format, so that it cannot be stored; -1: none.
    """

    times: int
    columns: int
    rows: int = 0
    reserved: int = -1

    def outside(self, events: Events) -> npt.NDArray[np.bool_]:
        """Return True for events at positions that cannot be stored."""
        is_off: npt.NDArray[np.bool_] = (events.x >= self.columns) | (events.y >= (self.rows or self.columns))
        return is_off if self.reserved < 0 else is_off | (events.y == self.reserved)

    def holds(self, events: Events, last: int | None = None) -> npt.NDArray[np.bool_]:
        """Return True for events that can be stored; see `Format.holds`."""
        in_time: npt.NDArray[np.bool_] = (events.t >= 0) & ((events.t < self.times) | (self.times == 0))
        return in_time & ~self.outside(events)

    def check(self, events: Events, n_before: int) -> None:
        """Raise an error about the first event of a part that cannot be stored.

        Args:
            events: the part.
            n_before: number of events before the part.

        Raises:
            Unsavable: an event cannot be stored.
        """
        times = f"t 0 to {self.times - 1} us" if self.times else "t from 0 us on"
        positions = (
            f"x 0 to {self.columns - 1}, y 0 to {self.rows - 1}" if self.rows else f"x and y 0 to {self.columns - 1}"
        )
        reserved = f", y not {self.reserved}" if self.reserved >= 0 else ""
        refuse(events, ~self.holds(events), n_before, f"{times}, {positions}{reserved}", self.outside(events))


def refuse(
    events: Events,
    unsavable: npt.NDArray[np.bool_],
    n_before: int,
    limits: str,
    outside: npt.NDArray[np.bool_] | None = None,
) -> None:
    """Raise an error about the first event of a part that cannot be stored.

    Args:
        events: the part.
        unsavable: (n,) True for events that cannot be stored.
        n_before: number of events before the part.
        limits: the expected range, for the message.
        outside: (n,) True for unsavable events whose position cannot be stored. The time of the other unsavable events
            cannot be stored. None: unknown.

    Raises:
        Unsavable: an event cannot be stored.
    """
    if unsavable.any():
        k = int(unsavable.argmax())
        hint = "" if outside is None else SMALLER if outside[k] else EARLIER
        raise Unsavable(f"t {events.t[k]}, x {events.x[k]}, y {events.y[k]}; expected {limits}", n_before + k, hint)
