"""What a file format is to the rest of the package.

A reader gives the events of a file in pieces, so that a file of any size is read in constant memory and a damaged one
gives what is whole. The same reader serves `load`, which asks for one piece, and `stream`.
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
    """Raised by a reader, after all whole pieces before it: ``what`` is wrong at byte ``offset`` of the data.

    The offset is None where no byte is to blame, as in a file that another library unpacks.
    """

    def __init__(self, what: str, offset: int | None) -> None:
        super().__init__(what, offset)
        self.what = what
        self.offset = offset


class Unsavable(ValueError):
    """Raised by a writer: the format has no room for event ``event``, because of ``what``; ``hint`` is the way out."""

    def __init__(self, what: str, event: int, hint: str = "") -> None:
        super().__init__(what, event, hint)
        self.what = what
        self.event = event
        self.hint = hint


def no_place(event: int) -> int | None:
    """None: no byte or line is known for an event."""
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Some events in the order of the file, not yet checked against the sensor.

    Attributes:
        t: (n,) int64, us.
        x, y: (n,) uint16, px.
        p: (n,) uint8, 1 = ON.
        highest: largest x and y, (-1, -1) where there is no event; None: not looked at.
        ordered: whether time does not run back within the piece; None: not looked at.
        place: gives the byte at which an event of the piece begins, None where there is no such byte.
        line: gives the line of the text at which it stands, None where the file is no text.
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
    """An open file.

    A reader of several layouts may have ``untested``, as `Format` has.

    Attributes:
        sensor_size: width and height that the file or the format states, None where neither does; may raise `Damage`.
        metadata: what the file says of itself.
    """

    @property
    def sensor_size(self) -> Size | None: ...
    @property
    def metadata(self) -> Mapping[str, Any]: ...
    def pieces(self, block: int) -> Iterator[Piece]:
        """The events from the beginning, each piece from about ``block`` bytes.

        Raises:
            Damage: after the last piece that is whole.
        """


@runtime_checkable
class Seeker(Reader, Protocol):
    """A reader that can begin later in a file that lies on the disk or in memory; `stream` asks only then."""

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """The same pieces as those of `pieces`, without some at the beginning.

        Args:
            block: as for `pieces`.
            start_us: in a file that is whole all events of the pieces left out are earlier, us.

        Raises:
            Damage: as `pieces`, for what is read.
        """


@runtime_checkable
class Sized(Protocol):
    """A reader of files that do not tell which of several sensors they are of.

    Attributes:
        way_out: the option that tells it, for messages.
    """

    way_out: str

    def use_sensor(self, size: Size) -> None:
        """Read the file as one of this sensor; called before all else, where the user gives a size.

        Raises:
            Damage: no sensor of the format has this size.
        """


@dataclass(frozen=True, slots=True)
class Format:
    """A file format.

    Attributes:
        name: the word that ``load(..., format=name)`` takes.
        title: what to call it in a message.
        suffixes: endings of file names, lower case, with the dot.
        knows: whether the first bytes of a file (up to `HEAD`) are those of this format; a format without a signature
            says False and is found by its suffixes.
        open: make a reader; raises `Damage` where the header is damaged.
        write: write pieces of one recording to a path that is new; raises `Unsavable`. None: only read.
        usual: the sensor where the file states none and all events fit.
        larger: sensors that are tried after `usual`, in this order.
        inside: as `open`, for one recording of a file with several, by its place: the rest of ``load(...,
            format="hdf5:/davis/left")``; None where files have no places.
        guesses: whether `knows` goes by looks, as of plain text; it is then asked after all signatures.
        holds: (events, time of the event before them or None) -> (n,) bool, the events that `write` has room for; None:
            it has room for all.
        grows: whether what `write` has written so far is a recording at any time, so that a killed process leaves one.
        untested: why nothing but files made from the specification was read, "" where real ones were.
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
    """Return a format if its words can be used on the command line, and raise `TypeError` if not."""
    what = f"event format {part.name!r:.40}"
    if not isinstance(part.name, str) or not part.name or set(part.name) & set(": /"):
        raise TypeError(f"{what}: expected a name without ':', '/' and spaces")
    endings = part.suffixes
    if not isinstance(endings, tuple) or not all(isinstance(e, str) and e[:1] == "." for e in endings):
        raise TypeError(f"{what}: suffixes = {endings!r:.60}: expected endings with a dot, such as ('.mine',)")
    if any(ending != ending.lower() for ending in endings):
        raise TypeError(f"{what}: suffixes = {endings!r:.60}: expected lower case, which any case of a name fits")
    if not callable(part.knows) or not callable(part.open):
        raise TypeError(f"{what}: expected two functions, knows(head) and open(source)")
    return part


def called(name: str, formats: Iterable[Format]) -> Format | None:
    """The format of this name, else the only one whose files end so (as bin, or .bin); None where there is none."""
    ending, found = "." + name.lower().removeprefix("."), []
    for f in formats:
        if f.name == name:
            return f
        found += [f] if ending in f.suffixes else []
    return found[0] if len(found) == 1 else None


HEAD = 4096
"""Bytes by which formats are recognised."""


@dataclass(slots=True)
class Found:
    """A reader made of a list of pieces, for formats that are read at once; `damage` is what lies behind them."""

    sensor_size: Size | None
    metadata: Mapping[str, Any] = field(default_factory=dict)
    parts: tuple[Piece, ...] = ()
    damage: Damage | None = None

    def pieces(self, block: int) -> Iterator[Piece]:
        """The pieces as they are, then the damage."""
        yield from self.parts
        if self.damage is not None:
            raise self.damage


EXTRA = "events"
"""The extra of this package that installs them."""


def extra(module: str, what: str) -> ModuleType:
    """Import a module of an optional package.

    Args:
        module: its name.
        what: for what it is needed.

    Raises:
        Damage: it is not installed; says the command that installs it.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise Damage(f"{what} needs the package {package}: {install(EXTRA)}", None) from None


OWN = ("format", "t0")
"""Of the file itself, not of the recording; found anew when it is read."""


def as_json(metadata: Mapping[str, Any]) -> str:
    """Metadata as JSON; what JSON cannot say is written as its text."""
    return json.dumps({str(key): value for key, value in metadata.items() if key not in OWN}, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value)


def from_json(text: str) -> dict[str, Any]:
    """The metadata that `as_json` wrote.

    Raises:
        ValueError: the text is none.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise ValueError("its metadata are no JSON object")
    return {key: value for key, value in found.items() if key not in OWN}


def in_order(parts: Iterator[Events]) -> Iterator[tuple[int, Events]]:
    """The parts of one recording, each with the number of events before it.

    Args:
        parts: of one recording, in order.

    Raises:
        Unsavable: a part has another sensor than the first, or begins before the one before it ends.
    """
    done, last = 0, np.iinfo(np.int64).min
    size = None
    for part in parts:
        size = size or part.sensor_size
        if part.sensor_size != size:
            has, had = (f"{width}x{height}" for width, height in (part.sensor_size, size))
            raise Unsavable(f"its sensor is {has}, expected {had} as in the first part", done)
        if len(part):
            if part.t[0] < last:
                raise Unsavable(f"time runs back from {last} to {part.t[0]} us", done)
            last = int(part.t[-1])
        yield done, part
        done += len(part)


def held(parts: Iterable[Events], format: Format, left_out: Callable[[int], None]) -> Iterator[Events]:
    """Leave out the events for which a format has no room.

    Args:
        parts: of one recording, in order.
        format: that is written.
        left_out: called with the number of events that were left out of a part.
    """
    last = None
    for part in parts:
        if format.holds is not None and len(part) and not (fits := format.holds(part, last)).all():
            left_out(int(np.count_nonzero(~fits)))
            part = part[fits]
        if len(part):
            last = int(part.t[-1])
        yield part


EARLIER = "the filter 'shift: {to_us: 0}' lets it begin at 0 us; what is longer fits in parts of 'neuro events split'"
SMALLER = "the filters 'crop: {x: [0, 128], y: [0, 128]}' and 'downsample: {factor: 2}' make the sensor smaller"


class Room(NamedTuple):
    """Times and places that a format can store.

    Attributes:
        times: times from 0 up to this, us, not included; 0: any from 0 us on.
        columns: number of columns.
        rows: number of rows; 0: as many as columns.
        reserved: a row that means something else; -1: none.
    """

    times: int
    columns: int
    rows: int = 0
    reserved: int = -1

    def outside(self, events: Events) -> npt.NDArray[np.bool_]:
        """Return which events lie at places that cannot be stored."""
        off: npt.NDArray[np.bool_] = (events.x >= self.columns) | (events.y >= (self.rows or self.columns))
        return off if self.reserved < 0 else off | (events.y == self.reserved)

    def holds(self, events: Events, last: int | None = None) -> npt.NDArray[np.bool_]:
        """Return which events can be stored; see `Format.holds`."""
        in_time: npt.NDArray[np.bool_] = (events.t >= 0) & ((events.t < self.times) | (self.times == 0))
        return in_time & ~self.outside(events)

    def check(self, events: Events, done: int) -> None:
        """Refuse the first event of a part that cannot be stored.

        Args:
            events: the part.
            done: number of events before it.

        Raises:
            Unsavable: there is one.
        """
        when = f"t 0 to {self.times - 1} us" if self.times else "t from 0 us on"
        where = (
            f"x 0 to {self.columns - 1}, y 0 to {self.rows - 1}" if self.rows else f"x and y 0 to {self.columns - 1}"
        )
        reserved = f", y not {self.reserved}" if self.reserved >= 0 else ""
        refuse(events, ~self.holds(events), done, f"{when}, {where}{reserved}", self.outside(events))


def refuse(
    events: Events, bad: npt.NDArray[np.bool_], done: int, limits: str, outside: npt.NDArray[np.bool_] | None = None
) -> None:
    """Refuse the first event of a part that is bad.

    Args:
        events: the part.
        bad: (n,) which events do not fit.
        done: number of events before the part.
        limits: what was expected.
        outside: (n,) which of them lie at a place for which there is no room; the others do so in time. None: unknown.

    Raises:
        Unsavable: there is one.
    """
    if bad.any():
        k = int(bad.argmax())
        hint = "" if outside is None else SMALLER if outside[k] else EARLIER
        raise Unsavable(f"t {events.t[k]}, x {events.x[k]}, y {events.y[k]}; expected {limits}", done + k, hint)
