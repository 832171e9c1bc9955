"""DAT of Prophesee, versions 1 and 2 (N-CARS, Gen1 and 1 Mpx automotive data sets, exports of the vendor's tools).

Lines that begin with ``%``, a byte for the kind of event (0x00 or 0x0C: those of pixels), a byte for its size (8), then
little-endian uint32 time in us and uint32 address.
Version 2: x in bits 0-13, y in bits 14-27, polarity in bit 28 (1 = ON), the rest 0.
Version 1 (and files of kind 0x00 that tell no version): x in bits 0-8, y in bits 9-16, polarity in bit 17.

The sensor is the header's ``Width`` and ``Height``; N-CARS has none, as older files, which get the first of 304x240
(ATIS), 640x480 and 1280x720 that holds all events.

A recording longer than 2^32 us (71.6 minutes) begins again at 0: a time in the last sixteenth of the range followed by
one in the first sixteenth is taken for that, and 2^32 us are added from there on. Any other fall is time running back.
The writer refuses times of 2^32 us and more, so its files need no such rule.

Source: Prophesee, "DAT file format", docs.prophesee.ai; version 1: Prophesee's Matlab reader ``load_atis_data``.
No file of version 1 was to be had: it is read from the specification.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.formats._format import Damage, Format, Piece, in_order
from neuro.events.formats._prophesee import ATIS, GEN3, GEN4, Header, check_room, header_text, parse, read_header
from neuro.events.formats._reading import Begin, begin
from neuro.events.source import Source, step

WORD = 8
KINDS = (0x00, 0x0C)
"""Kinds of events that are those of pixels."""

T_LIMIT = 1 << 32
NEAR_WRAP = T_LIMIT // 16

_LAYOUTS = {1: (0x1FF, 9, 17), 2: (0x3FFF, 14, 28)}


class Dat:
    """An open DAT file; ``metadata`` has ``version``, ``event_type`` and the lines of the ``header``."""

    def __init__(self, source: Source) -> None:
        self._source = source
        header = read_header(source)
        kind = source.head(header.length + 2)[header.length :]
        if not header.length:
            raise Damage(f"begins with {source.head(12)!r}, expected a header of lines that begin with '%'", 0)
        if header.coding is not None:
            raise header.damage("format" if "format" in header.fields else "evt", "none, this being that of a RAW file")
        if len(kind) < 2:
            raise Damage("the file ends before the kind and the size of its events", header.length)
        if kind[0] not in KINDS or kind[1] != WORD:
            expected = "expected kind 0x00 or 0x0c (of pixels) and 8 bytes"
            raise Damage(f"events of kind 0x{kind[0]:02x} and {kind[1]} bytes, {expected}", header.length)
        self._start = header.length + 2
        self._version = _version(header, kind[0])
        self.sensor_size = header.sensor_size()
        self.metadata: dict[str, Any] = {
            "version": self._version,
            "event_type": kind[0],
            "header": dict(header.fields),
        }

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        return self._pieces(block, Begin(self._start))

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """The events from some block on; see `Seeker`."""
        samples = self._source.samples(self._start, step(block, WORD), 4)
        clocks = ((place, int(data.view("<u4")[0])) for place, data in samples if data.size == 4)
        return self._pieces(block, begin(self._start, clocks, start_us, T_LIMIT))

    def _pieces(self, block: int, at: Begin) -> Iterator[Piece]:
        from neuro.events.formats._evt2_kernels import decode_dat

        layout = _LAYOUTS[self._version]
        last, added = at.clock or 0, at.added
        for place, data in self._source.blocks(at.place, block, WORD):
            n = whole = data.size // WORD
            words = data[: n * WORD].view("<u4")
            t, x, y = np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.uint16)
            p = np.empty(n, np.uint8)
            x_max, y_max, ordered, seen = decode_dat(words, *layout, t, x, y, p)
            if self._version == 2 and seen >> 29:
                whole = int((words[1::2] >> np.uint32(29) != 0).argmax())
            if n and (added or not ordered or t[0] < last):
                ordered, last, added = _unwrap(t, last, added)
            elif n:
                last = int(t[-1])
            highest = (int(x_max), int(y_max)) if whole == n > 0 else None
            byte = _places(place)
            yield Piece(t[:whole], x[:whole], y[:whole], p[:whole], highest, bool(ordered), byte)
            if whole < n:
                address = words[2 * whole + 1]
                raise Damage(f"address 0x{address:08x} has bits above the polarity, expected none", byte(whole))
            if rest := data.size % WORD:
                what = f"{rest} bytes left over after {(place - self._start) // WORD + n} events of 8 bytes"
                raise Damage(what, place + n * WORD)


def _version(header: Header, kind: int) -> int:
    told = header.fields.get("version")
    if told is None:
        return 2 if kind == 0x0C else 1
    if told not in ("0", "1", "2"):
        raise header.damage("version", "0, 1 or 2")
    return max(int(told), 1)


def _places(place: int) -> Any:
    return lambda event: place + WORD * event


def _unwrap(t: npt.NDArray[np.int64], last: int, added: int) -> tuple[bool, int, int]:
    """Add the wraps to the times of a block, in place.

    Args:
        t: (n,) 32-bit times, us.
        last: the 32-bit time before them.
        added: us that wraps before them add.

    Returns:
        whether time does not run back, the last 32-bit time, and us added from here on.
    """
    before = np.concatenate(([last], t[:-1]))
    now = added + T_LIMIT * np.cumsum((before >= T_LIMIT - NEAR_WRAP) & (t < NEAR_WRAP))
    last = int(t[-1])
    t += now
    return bool((t[1:] >= t[:-1]).all()), last, int(now[-1])


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as version 2, kind 0x0C, with the sensor in the header; metadata are not kept."""
    with path.open("wb") as file:
        for done, events in in_order(parts):
            if file.tell() == 0:
                file.write(_text(events.sensor_size))
            check_room(events, done, T_LIMIT, 1 << 14)
            words = np.empty((len(events), 2), "<u4")
            words[:, 0] = events.t
            words[:, 1] = events.x | events.y.astype(np.uint32) << 14 | events.p.astype(np.uint32) << 28
            file.write(words.tobytes())
        if file.tell() == 0:
            file.write(_text(None))


def _text(size: tuple[int, int] | None) -> bytes:
    sides = [] if size is None else [("Height", str(size[1])), ("Width", str(size[0]))]
    return header_text([("Data", "file containing CD events."), ("Version", "2"), *sides]) + bytes([0x0C, WORD])


def _knows(head: bytes) -> bool:
    header = parse(head)
    return header.coding is None and ("version" in header.fields or "file containing" in header.fields.get("data", ""))


DAT = Format("dat", "Prophesee DAT", (".dat",), _knows, Dat, write, usual=ATIS, larger=(GEN3, GEN4))
"""Read and written."""
