"""AEDAT 2.0 of the DVS128 and the DAVIS240 (jAER).

Lines that begin with ``#`` and end with CR LF, then words of a big-endian 32-bit address and a
big-endian 32-bit time in us.

DVS128 address: bit 0 polarity (0 = ON), bits 1-7 x, bits 8-14 y, bit 15 set for a word that is no event.
DAVIS240 address: bit 31 clear, y in bits 22-30, x in bits 12-21, bit 11 polarity (1 = ON); bit 10 marks an
external event and bit 31 a sample of the pixels or of the inertial sensor.

The header may name the chip; without a name it is a DVS128. Rows and columns stay as the file has them.

Source: jAER's AEDAT 2.0 description (inivation.github.io/inivation-docs, "AEDAT file formats"); the
polarity and the axes of the DVS128 as in the published arrays of POKER-DVS.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events.formats._format import Damage, Format, Piece, Size
from neuro.events.source import Source

MAGIC = b"#!AER-DAT2.0"
WORD = 8
T_WRAP = 1 << 32
END_OF_HEADER = (b"#End Of ASCII Header", b"#End of Preferences")

_TEXT_LINE = re.compile(rb"#[\t\x20-\x7e\x80-\xff]*\r?\n")
_CHIP = re.compile(rb"# *AEChip: *([\w.$]+)")

Words = npt.NDArray[np.uint32]


@dataclass(frozen=True, slots=True)
class _Chip:
    size: tuple[int, int]
    x: tuple[int, int]
    y: tuple[int, int]
    polarity: int
    on: int
    other: int
    unused: int

    def field(self, address: Words, place: tuple[int, int]) -> npt.NDArray[np.uint16]:
        shift, bits = place
        return ((address >> np.uint32(shift)) & np.uint32((1 << bits) - 1)).astype(np.uint16)


_CHIPS = {
    "DVS128": _Chip((128, 128), (1, 7), (8, 7), polarity=0, on=0, other=1 << 15, unused=0xFFFF0000),
    "DAVIS240": _Chip((240, 180), (12, 10), (22, 9), polarity=11, on=1, other=1 << 31 | 1 << 10, unused=0),
}


class Aedat2:
    """An open AEDAT 2.0 file; ``metadata`` has ``chip`` and, once all is read, ``other_words``: words left out."""

    def __init__(self, source: Source) -> None:
        self._data = source.all()
        data = self._data.tobytes()
        if not data.startswith(MAGIC):
            raise Damage(f"begins with {data[:12]!r}, expected the line {MAGIC.decode()}", 0)
        self._start = _header_length(data)
        self._name = _chip_name(data[: self._start])
        self._chip = _CHIPS[self._name]
        self.sensor_size: Size | None = self._chip.size
        self.metadata: dict[str, Any] = {"chip": self._name}

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        start, chip = self._start, self._chip
        n = (self._data.size - start) // WORD
        words = np.frombuffer(self._data[start : start + n * WORD].tobytes(), ">u4").reshape(-1, 2)
        address, time = words[:, 0].astype(np.uint32), words[:, 1].astype(np.int64)
        unused = (address & np.uint32(chip.unused)) != 0
        if unused.any():
            k = int(unused.argmax())
            raise Damage(f"address 0x{address[k]:08x} is none of a {self._name}", start + k * WORD)
        t = time + T_WRAP * np.cumsum(np.diff(time, prepend=time[:1]) < -(T_WRAP // 2))
        event = (address & np.uint32(chip.other)) == 0
        offsets = start + WORD * np.flatnonzero(event)
        address = address[event]
        p = (address >> np.uint32(chip.polarity) & np.uint32(1)) == chip.on
        self.metadata["other_words"] = len(event) - len(address)
        x, y = chip.field(address, chip.x), chip.field(address, chip.y)
        yield Piece(t[event], x, y, p.astype(np.uint8), place=lambda k: int(offsets[k]))
        if rest := (self._data.size - start) % WORD:
            raise Damage(f"{rest} bytes left over after {n} words of 8 bytes", start + n * WORD)


def _header_length(data: bytes) -> int:
    """Where the words begin. A word may begin with the byte of ``#``; a line of text has no control bytes."""
    position = 0
    while line := _TEXT_LINE.match(data, position):
        position = line.end()
        if line.group().startswith(END_OF_HEADER):
            break
    if position == 0:
        raise Damage("the first line does not end", len(MAGIC))
    return position


def _chip_name(header: bytes) -> str:
    found = _CHIP.search(header)
    if found is None:
        return "DVS128"
    full = found.group(1).decode("ascii", "replace")
    for name in _CHIPS:
        if name.lower() in full.lower():
            return name
    raise Damage(f"chip {full} is not known, expected one of {', '.join(_CHIPS)}", found.start(1))


AEDAT2 = Format("aedat2", "AEDAT 2.0", (".aedat", ".aedat2"), lambda head: head.startswith(MAGIC), Aedat2)
"""Read only."""
