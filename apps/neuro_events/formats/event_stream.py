"""Formats of five bytes an event: Event Stream of the Vision Institute in Paris, and the ``.bin`` of N-MNIST (`Bin`).

Event Stream 2.0 (``.es``) has DVS events, and generic ones as bytes.

"Event Stream", three bytes of version and one of type (0 generic, 1 DVS, 2 ATIS, 3 display, 4 colour). A DVS file goes
on with width and height (uint16, little-endian) and events of 5 bytes: time since the event before (7 bits, us) and
polarity (lowest bit, 1 = ON), x, y (uint16, little-endian). Before an event, a byte 0xff adds 127 us and a byte 0xfe
says nothing. A generic event is a byte of time, bytes of size (7 bits each, lowest first; the lowest bit of a byte is
set where another follows), and so many bytes; 0xff adds 254 us.

Rows stay as the file numbers them. The specification does not say where they begin: the format's own viewers count from
the bottom and faery turns them round, while the file of POKER-DVS has the rows of the arrays that were published, which
stand upright with y downwards.

Source: github.com/neuromorphic-paris/event_stream, README, version 2.0.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events._events import Events
from neuro_events.formats._format import SMALLER, Damage, Format, Limits, Size, Unsavable, refuse
from neuro_events.formats._reading import write_words
from neuro_events.formats._words import GAPS, Decoder, Field, Layout, Odd, WordReader, layout_writer
from neuro_events.source import Bytes, EventFileError, EventFileWarning, FileInput, Source, opened_source

word_kernels = LazyModule("neuro_events.formats._word_kernels")

MAGIC = b"Event Stream"
VERSION = (2, 0, 0)
HEADER = 16
"""Bytes of the header up to the type."""
START = 20
"""Bytes of the header of a DVS file."""
EVENT = 5
OVERFLOW_US = 127
GENERIC_OVERFLOW_US = 254
GENERIC, DVS = 0, 1
TYPES = {GENERIC: "generic", DVS: "DVS", 2: "ATIS", 3: "display", 4: "colour"}
LONGEST_GAP = OVERFLOW_US << 26
"""us; an event after a longer one would take more than 64 MB, since 127 us of silence take a byte."""

LAYOUT = Layout(
    EVENT, t=Field(1, 7, size=1), x=Field(0, 16, byte=1), y=Field(16, 16, byte=1), p=Field(0, 1, size=1),
    odd=Odd(0xFE, 0xFE, differs=False, size=1), others="silence", rule=GAPS, least=1,
)  # fmt: skip


class EventStream(WordReader):
    """An open Event Stream file of DVS events."""

    layout = LAYOUT
    start = START

    def __init__(self, source: Source) -> None:
        kind = _kind(source)
        if kind == GENERIC:
            raise Damage("has generic events, which neuro.events.formats.event_stream.generic reads", HEADER - 1)
        if kind != DVS:
            raise Damage(f"has {TYPES[kind]} events, expected DVS events", HEADER - 1)
        header = source.head(START)
        if len(header) < START:
            raise Damage(f"the header has {len(header)} bytes, expected {START}", len(header))
        width, height = (int.from_bytes(header[at : at + 2], "little") for at in (HEADER, HEADER + 2))
        if not width or not height:
            raise Damage(f"sensor size {width}x{height}, expected at least 1x1", HEADER)
        self.source = source
        self.sensor_size: Size | None = (width, height)
        self.metadata = {"version": ".".join(str(number) for number in header[12:15])}

    def check_end(self, rest: Bytes, end: int, decoder: Decoder) -> None:
        """See `WordReader`."""
        if rest.size:
            raise Damage(f"the last event is cut after {rest.size} of {EVENT} bytes", end)


def _kind(source: Source) -> int:
    """Check the header up to the type, and give that."""
    header = source.head(HEADER)
    if not header.startswith(MAGIC):
        raise Damage(f"begins with {header[: len(MAGIC)]!r}, expected {MAGIC!r}", 0)
    if len(header) < HEADER:
        raise Damage(f"the header has {len(header)} bytes, expected {HEADER}", len(header))
    major, minor, patch, kind = header[12:]
    if major != VERSION[0]:
        raise Damage(f"version {major}.{minor}.{patch}, expected 2", 12)
    if kind not in TYPES:
        raise Damage(f"type {kind}, expected 0 to {max(TYPES)}", HEADER - 1)
    return kind


def is_generic(head: bytes) -> bool:
    """Whether a file that begins so has generic events."""
    return head.startswith(MAGIC) and len(head) >= HEADER and head[12] == VERSION[0] and head[15] == GENERIC


def generic(source: FileInput, *, name: str | None = None, strict: bool = True) -> list[tuple[int, bytes]]:
    """Read the events of a generic Event Stream file.

    Args:
        source: a path, the bytes of a file, or an open binary file.
        name: what to call bytes or an open file in messages.
        strict: False gives what is whole of a damaged file, with an `EventFileWarning`.

    Returns:
        Time in us and bytes of each event.

    Raises:
        EventFileError: no such file, other events, or damage; the message says at which byte.
    """
    with opened_source(source, name) as data:
        return _all_generic(data, strict)


def _all_generic(data: Source, strict: bool) -> list[tuple[int, bytes]]:
    try:
        kind = _kind(data)
    except Damage as damage:
        raise EventFileError(data.name, damage.what, damage.offset) from None
    if kind != GENERIC:
        raise EventFileError(data.name, f"has {TYPES[kind]} events, expected generic events", HEADER - 1)
    events: list[tuple[int, bytes]] = []
    try:
        for event in _generic(data.all().tobytes()):
            events.append(event)
    except Damage as damage:
        error = EventFileError(data.name, damage.what, damage.offset)
        if strict:
            raise error from None
        warnings.warn(f"{error}; the events before it were read", EventFileWarning, stacklevel=3)
    return events


def _generic(data: bytes) -> Iterator[tuple[int, bytes]]:
    now, at = 0, HEADER
    while at < len(data):
        first = data[at]
        if first >= 0xFE:
            now += GENERIC_OVERFLOW_US if first == 0xFF else 0
            at += 1
            continue
        begin = at
        size, shift, more = 0, 0, True
        while more:
            at += 1
            if at >= len(data) or size > len(data):
                raise Damage(f"the last event is cut after {len(data) - begin} bytes", begin)
            size |= data[at] >> 1 << shift
            shift, more = shift + 7, bool(data[at] & 1)
        at += 1
        if size > len(data) - at:
            raise Damage(f"an event has {size} bytes, but only {len(data) - at} are left", begin)
        now += first
        yield now, data[at : at + size]
        at += size


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as Event Stream 2.0 of DVS events; the metadata are not kept."""
    now = 0

    def encoded(done: int, events: Events) -> bytes:
        nonlocal now
        gaps = np.diff(events.t, prepend=now)
        limits = f"t from 0 us on, and at most {LONGEST_GAP} us after the event before or 0"
        bad = (gaps < 0) | (gaps > LONGEST_GAP)
        late = not done and bad[:1].any()  # where the recording begins, which a filter can move; no gap within it
        refuse(events, bad, done, limits, np.zeros(len(events), np.bool_) if late else None)
        out = np.empty(EVENT * len(events) + int((gaps // OVERFLOW_US).sum()), np.uint8)
        word_kernels.encode_event_stream(events.t, events.x, events.y, events.p, now, out)
        now = int(events.t[-1]) if len(events) else now
        return out.tobytes()

    write_words(parts, path, _new_header, encoded)


def _new_header(sensor: Size | None) -> bytes:
    size = sensor or (1, 1)
    if max(size) > 0xFFFF:
        raise Unsavable(f"its sensor is {size[0]}x{size[1]}, expected at most 65535x65535", 0, SMALLER)
    return MAGIC + bytes(VERSION) + bytes([DVS]) + np.array(size, "<u2").tobytes()


def _holds(events: Events, last: int | None) -> npt.NDArray[np.bool_]:
    """All up to the first after a gap that is too long: those behind it are as far from what was written."""
    gaps = np.diff(events.t, prepend=last or 0)
    return ~np.logical_or.accumulate(gaps > LONGEST_GAP) & (events.t >= 0)


EVENT_STREAM = Format(
    "event_stream", "Event Stream", (".es",), lambda head: head.startswith(MAGIC), EventStream, write,
    holds=_holds, grows=True,
)  # fmt: skip
"""Read and written."""


NMNIST_SENSOR = (34, 34)
"""Of N-MNIST, px."""

OVERFLOW_ROW = 240
"""Such a word is no event but adds 2^13 us to all times after it."""

NMNIST_LAYOUT = Layout(
    EVENT, t=Field(0, 23, byte=1), x=Field(0, 8, size=1), y=Field(24, 8, byte=1), p=Field(23, 1, byte=1),
    odd=Odd(0xFF, OVERFLOW_ROW, differs=False, byte=1, size=1), others="overflow", is_big=True,
)  # fmt: skip
NMNIST_LIMITS = Limits(1 << 23, 256, reserved=OVERFLOW_ROW)


class Bin(WordReader):
    """An open ``.bin`` of N-MNIST or N-Caltech101; ``sensor_size`` is None, since the file does not tell it.

    Five bytes an event, big-endian: x, y, then one bit polarity (1 = ON) and 23 bits of time in us.
    The file has no header, so neither its kind nor its sensor is written in it.

    Source: Orchard et al., Front. Neurosci. 9:437, 2015, and the data set's own Matlab reader, from which
    the rule for y = 240 comes.
    """

    layout = NMNIST_LAYOUT
    called = "events"
    sensor_size: Size | None = None
    start = 0

    def __init__(self, source: Source) -> None:
        self.source = source
        self.metadata = {}


NMNIST = Format(
    "nmnist", "N-MNIST .bin", (".bin",), lambda head: False, Bin,
    layout_writer(lambda size: b"", NMNIST_LAYOUT, NMNIST_LIMITS), holds=NMNIST_LIMITS.holds, grows=True,
    usual=NMNIST_SENSOR,
)  # fmt: skip
"""Read and written; the sensor size and the metadata are not kept."""
