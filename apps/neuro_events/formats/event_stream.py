"""Formats with five bytes per event: Event Stream of the Vision Institute in Paris, and ``.bin`` of N-MNIST (`Bin`).

Event Stream 2.0 (``.es``) has DVS events, or generic events of bytes.

A file begins with "Event Stream", three bytes of version and one of type (0 generic, 1 DVS, 2 ATIS, 3 display,
4 colour). In a DVS file, width and height follow (uint16, little-endian), then events of 5 bytes: time since the event
before (7 bits, us) and polarity (lowest bit, 1 = ON), x, y (uint16, little-endian). Before an event, a byte 0xff adds
127 us, and a byte 0xfe has no effect. A generic event is a byte of time, bytes of size (7 bits each, lowest first; the
lowest bit of a byte is set if another byte follows), and the bytes of the content. A byte 0xff adds 254 us.

Rows are numbered as in the file. The specification does not define the first row. The format's own viewers count from
the bottom, and faery flips the rows, while the file of POKER-DVS has the rows of the published arrays, which are
upright with y downwards.

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
"""Size of the header up to the type, bytes."""
START = 20
"""Size of the header of a DVS file, bytes."""
EVENT = 5
OVERFLOW_US = 127
GENERIC_OVERFLOW_US = 254
GENERIC, DVS = 0, 1
TYPES = {GENERIC: "generic", DVS: "DVS", 2: "ATIS", 3: "display", 4: "colour"}
LONGEST_GAP = OVERFLOW_US << 26
"""Longest gap that the writer accepts, us. A gap needs a byte per 127 us, so a longer gap would need over 64 MB."""

LAYOUT = Layout(
    EVENT, t=Field(1, 7, size=1), x=Field(0, 16, byte=1), y=Field(16, 16, byte=1), p=Field(0, 1, size=1),
    odd=Odd(0xFE, 0xFE, differs=False, size=1), others="silence", rule=GAPS, least=1,
)  # fmt: skip


class EventStream(WordReader):
    """A reader of Event Stream files with DVS events."""

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
        """Check the end of the file; see `WordReader`."""
        if rest.size:
            raise Damage(f"the last event is cut after {rest.size} of {EVENT} bytes", end)


def _kind(source: Source) -> int:
    """Check the header up to the type, and return the type."""
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
    """Return whether a file with these first bytes has generic events."""
    return head.startswith(MAGIC) and len(head) >= HEADER and head[12] == VERSION[0] and head[15] == GENERIC


def generic(source: FileInput, *, name: str | None = None, strict: bool = True) -> list[tuple[int, bytes]]:
    """Read the events of a generic Event Stream file.

    Args:
        source: a path, the bytes of a file, or an open binary file.
        name: name of bytes or of an open file in messages.
        strict: raise an error at damage. False returns the readable part, with an `EventFileWarning`.

    Returns:
        Time in us and content of each event.

    Raises:
        EventFileError: no such file, events of another type, or damage; the message names the byte.
    """
    with opened_source(source, name) as data:
        return _read_generic(data, strict)


def _read_generic(data: Source, strict: bool) -> list[tuple[int, bytes]]:
    try:
        kind = _kind(data)
    except Damage as damage:
        raise EventFileError(data.name, damage.what, damage.offset) from None
    if kind != GENERIC:
        raise EventFileError(data.name, f"has {TYPES[kind]} events, expected generic events", HEADER - 1)
    events: list[tuple[int, bytes]] = []
    try:
        for event in _generic_events(data.all().tobytes()):
            events.append(event)
    except Damage as damage:
        error = EventFileError(data.name, damage.what, damage.offset)
        if strict:
            raise error from None
        warnings.warn(f"{error}; the events before it were read", EventFileWarning, stacklevel=3)
    return events


def _generic_events(data: bytes) -> Iterator[tuple[int, bytes]]:
    time, offset = 0, HEADER
    while offset < len(data):
        first = data[offset]
        if first >= 0xFE:
            time += GENERIC_OVERFLOW_US if first == 0xFF else 0
            offset += 1
            continue
        begin = offset
        size, shift, continues = 0, 0, True
        while continues:
            offset += 1
            if offset >= len(data) or size > len(data):
                raise Damage(f"the last event is cut after {len(data) - begin} bytes", begin)
            size |= data[offset] >> 1 << shift
            shift, continues = shift + 7, bool(data[offset] & 1)
        offset += 1
        if size > len(data) - offset:
            raise Damage(f"an event has {size} bytes, but only {len(data) - offset} are left", begin)
        time += first
        yield time, data[offset : offset + size]
        offset += size


def write(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as Event Stream 2.0 of DVS events, without metadata."""
    time = 0

    def encode_part(n_before: int, events: Events) -> bytes:
        nonlocal time
        gaps = np.diff(events.t, prepend=time)
        limits = f"t from 0 us on, and at most {LONGEST_GAP} us after the event before or 0"
        unsavable = (gaps < 0) | (gaps > LONGEST_GAP)
        # The hint names a filter that moves the first event, so it does not help at a gap within the recording.
        first_is_unsavable = not n_before and unsavable[:1].any()
        refuse(events, unsavable, n_before, limits, np.zeros(len(events), np.bool_) if first_is_unsavable else None)
        out = np.empty(EVENT * len(events) + int((gaps // OVERFLOW_US).sum()), np.uint8)
        word_kernels.encode_event_stream(events.t, events.x, events.y, events.p, time, out)
        time = int(events.t[-1]) if len(events) else time
        return out.tobytes()

    write_words(parts, path, _new_header, encode_part)


def _new_header(sensor: Size | None) -> bytes:
    size = sensor or (1, 1)
    if max(size) > 0xFFFF:
        raise Unsavable(f"its sensor is {size[0]}x{size[1]}, expected at most 65535x65535", 0, SMALLER)
    return MAGIC + bytes(VERSION) + bytes([DVS]) + np.array(size, "<u2").tobytes()


def _holds(events: Events, last: int | None) -> npt.NDArray[np.bool_]:
    """Return True for the events before the first gap that is too long. All later events are after that gap, too."""
    gaps = np.diff(events.t, prepend=last or 0)
    return ~np.logical_or.accumulate(gaps > LONGEST_GAP) & (events.t >= 0)


EVENT_STREAM = Format(
    "event_stream", "Event Stream", (".es",), lambda head: head.startswith(MAGIC), EventStream, write,
    holds=_holds, grows=True,
)  # fmt: skip
"""Event Stream of DVS events, read and written."""


NMNIST_SENSOR = (34, 34)
"""Sensor of N-MNIST, px."""

OVERFLOW_ROW = 240
"""Row of a word that is not an event, but adds 2^13 us to all later times."""

NMNIST_LAYOUT = Layout(
    EVENT, t=Field(0, 23, byte=1), x=Field(0, 8, size=1), y=Field(24, 8, byte=1), p=Field(23, 1, byte=1),
    odd=Odd(0xFF, OVERFLOW_ROW, differs=False, byte=1, size=1), others="overflow", is_big=True,
)  # fmt: skip
NMNIST_LIMITS = Limits(1 << 23, 256, reserved=OVERFLOW_ROW)


class Bin(WordReader):
    """A reader of the ``.bin`` files of N-MNIST and N-Caltech101, which do not state their sensor.

    Five bytes per event, big-endian: x, y, then one bit polarity (1 = ON) and 23 bits of time in us.
    A file has no header, so neither the format nor the sensor is stored.

    Source: Orchard et al., Front. Neurosci. 9:437, 2015, and the data set's own Matlab reader, the source of the rule
    for y = 240.
    """

    layout = NMNIST_LAYOUT
    word_noun = "events"
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
"""``.bin`` of N-MNIST, read and written, without the sensor size and the metadata."""
