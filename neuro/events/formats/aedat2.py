"""AEDAT 2.0 of the DVS128 and the DAVIS cameras (jAER).

Lines that begin with ``#`` and end with CR LF, then words of a big-endian 32-bit address and a
big-endian 32-bit time in us. The time wraps; from then on 2^32 us are added.

DVS128 address: bit 0 polarity (0 = ON), bits 1-7 x, bits 8-14 y, bit 15 set for an external event.
DAVIS address: bit 31 clear, y in bits 22-30, x in bits 12-21, bit 11 polarity (1 = ON); bit 10 marks an
external event and bit 31 a sample of the pixels or of the inertial sensor.

The header may name the chip; without a name it is a DVS128. Rows and columns stay as the file numbers them: jAER
counts rows from the bottom, while the arrays published of POKER-DVS, upright with y downwards, have them unchanged.

Source: "AEDAT 2.0" at docs.inivation.com, which also has the names of the chips; polarity and axes of the DVS128 as in
the published arrays of POKER-DVS.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neuro.events._events import Events
from neuro.events.formats._aedat_header import header
from neuro.events.formats._format import Damage, Format, Piece, Size
from neuro.events.formats._seek import Begin, begin
from neuro.events.formats._write import in_order, refuse
from neuro.events.source import Bytes, Source, step

MAGIC = b"#!AER-DAT2.0"
WORD = 8
T_LIMIT = 1 << 32
LOOK = 1 << 14
"""Bytes of a block in which an event is looked for, to learn its time."""
END = b"#End Of ASCII Header"
"""How the last line begins, in files that have it."""

_CHIP = re.compile(rb"# *AEChip: *([\w.$]+)")
_SIZE = re.compile(rb"# Sensor size: (\d{1,5})x(\d{1,5})\r?\n")


@dataclass(frozen=True, slots=True)
class _Chip:
    """A layout of addresses; places are the lowest bit and the number of bits."""

    name: str
    title: str
    size: Size
    x: tuple[int, int]
    y: tuple[int, int]
    polarity: int
    on: int
    sample: int
    external: int
    unused: int

    def layout(self) -> tuple[int, ...]:
        (x, x_bits), (y, y_bits) = self.x, self.y
        fields = (x, (1 << x_bits) - 1, y, (1 << y_bits) - 1, self.polarity, self.on)
        return (*fields, self.sample, self.external, self.unused)


def _davis(name: str, title: str, size: Size) -> _Chip:
    chip = f"eu.seebetter.ini.chips.davis.{title}"
    return _Chip(name, chip, size, (12, 10), (22, 9), polarity=11, on=1, sample=1 << 31, external=1 << 10, unused=0)


_DVS128 = _Chip(
    "DVS128", "ch.unizh.ini.jaer.chip.retina.DVS128", (128, 128), (1, 7), (8, 7),
    polarity=0, on=0, sample=0, external=1 << 15, unused=0xFFFF0000,
)  # fmt: skip
_CHIPS = (
    _DVS128,
    _davis("DAVIS240", "DAVIS240C", (240, 180)),
    _davis("DAVIS346", "Davis346blue", (346, 260)),
    _davis("DAVIS640", "Davis640", (640, 480)),
)
"""By the size of the sensor."""


class Aedat2:
    """An open AEDAT 2.0 file.

    ``metadata`` has ``chip`` and, for what was read so far, ``other_words``: samples of pixels and of the inertial
    sensor, and ``external_events``; both are left out.
    """

    def __init__(self, source: Source) -> None:
        lines, _ = header(source, MAGIC, END)
        self._source = source
        self._start = len(lines)
        self._chip = _chip(lines)
        self.sensor_size: Size | None = _size(lines) or self._chip.size
        self.metadata: dict[str, Any] = {"chip": self._chip.name, "other_words": 0, "external_events": 0}

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        return self._pieces(block, Begin(self._start))

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """The events from some block on; see `Seeker`."""
        size = step(block, WORD)
        samples = self._source.samples(self._start, size, min(size, LOOK))
        return self._pieces(block, begin(self._start, self._clocks(samples), start_us, T_LIMIT))

    def _clocks(self, samples: Iterable[tuple[int, Bytes]]) -> Iterator[tuple[int, int]]:
        """The time of the first event of each sample that has one; other words may have times that run back."""
        other = np.uint32(self._chip.sample | self._chip.external)
        for place, data in samples:
            events = np.flatnonzero((_addresses(data) & other) == 0)
            if events.size:
                at = WORD * int(events[0])
                yield place, int.from_bytes(data[at + 4 : at + 8].tobytes(), "big")

    def _pieces(self, block: int, at: Begin) -> Iterator[Piece]:
        from neuro.events.formats._aedat2_kernel import decode

        chip, layout = self._chip, self._chip.layout()
        clock, skipped = np.array([-1 if at.clock is None else at.clock, at.added]), np.zeros(2, np.int64)
        for place, data in self._source.blocks(at.place, block, WORD):
            n = data.size // WORD
            t, x, y = np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.uint16)
            p = np.empty(n, np.uint8)
            found, done, x_max, y_max, ordered = decode(data, layout, clock, skipped, t, x, y, p)
            self.metadata |= {"other_words": int(skipped[0]), "external_events": int(skipped[1])}
            other = 0 if found == done else chip.sample | chip.external

            def byte(event: int, place: int = place, data: Bytes = data, other: int = other) -> int:
                if not other:
                    return place + WORD * event
                return place + WORD * int(np.flatnonzero((_addresses(data) & np.uint32(other)) == 0)[event])

            highest = (int(x_max), int(y_max)) if found else (-1, -1)
            yield Piece(t[:found], x[:found], y[:found], p[:found], highest, bool(ordered), byte)
            end = place + WORD * done
            if done < n:
                raise Damage(f"address 0x{_addresses(data)[done]:08x} is none of a {chip.name}", end)
            if rest := data.size % WORD:
                raise Damage(f"{rest} bytes left over after {(end - self._start) // WORD} words of 8 bytes", end)


def _addresses(data: Bytes) -> np.ndarray[Any, np.dtype[np.uint32]]:
    whole = data[: data.size // WORD * WORD].tobytes()
    return np.frombuffer(whole, ">u4")[::2].astype(np.uint32)


def _chip(lines: bytes) -> _Chip:
    found = _CHIP.search(lines)
    if found is None:
        return _DVS128
    full = found.group(1).decode("ascii", "replace")
    for chip in _CHIPS:
        if chip.name.lower() in full.lower():
            return chip
    known = ", ".join(chip.name for chip in _CHIPS)
    raise Damage(f"chip {full} is not known, expected one of {known}", found.start(1))


def _size(lines: bytes) -> Size | None:
    """The size that `write` puts into the header."""
    found = _SIZE.search(lines)
    if found is None:
        return None
    width, height = int(found.group(1)), int(found.group(2))
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise Damage(f"sensor size {width}x{height}, expected 1x1 to 65536x65536", found.start(1))
    return width, height


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as AEDAT 2.0 of the smallest camera that has the sensor's size, which a line of the header keeps."""
    chip = _DVS128
    with path.open("wb") as file:
        for done, events in in_order(parts):
            if not file.tell():
                width, height = events.sensor_size
                fits = [c for c in _CHIPS if width <= c.size[0] and height <= c.size[1]]
                chip = fits[0] if fits else _CHIPS[-1]
                file.write(_new_header(chip, f"# Sensor size: {width}x{height}\r\n"))
            columns, rows = chip.size
            outside = (events.x >= columns) | (events.y >= rows)
            limits = f"t 0 to {T_LIMIT - 1} us, x 0 to {columns - 1}, y 0 to {rows - 1}"
            refuse(events, (events.t < 0) | (events.t >= T_LIMIT) | outside, done, limits, outside)
            words = np.empty((len(events), 2), ">u4")
            address = (events.p == chip.on).astype(np.uint32) << chip.polarity
            address |= events.x.astype(np.uint32) << chip.x[0] | events.y.astype(np.uint32) << chip.y[0]
            words[:, 0], words[:, 1] = address, events.t
            file.write(words.tobytes())
        if not file.tell():
            file.write(_new_header(chip, ""))


def _new_header(chip: _Chip, size: str) -> bytes:
    text = (
        "#!AER-DAT2.0\r\n"
        "# This is a raw AE data file - do not edit\r\n"
        "# Data format is int32 address, int32 timestamp (8 bytes total), repeated for each event\r\n"
        "# Timestamps tick is 1 us\r\n"
        f"# AEChip: {chip.title}\r\n{size}{END.decode()}\r\n"
    )
    return text.encode("ascii")


AEDAT2 = Format("aedat2", "AEDAT 2.0", (".aedat", ".aedat2"), lambda head: head.startswith(MAGIC), Aedat2, write)
"""Read and written."""
