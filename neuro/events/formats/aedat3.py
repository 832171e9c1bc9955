"""AEDAT 3.1 of cAER, for example the recordings of DVS Gesture.

Lines that begin with ``#``, the last ``#!END-HEADER``, then packets of little-endian numbers: a header of 28 bytes
(type and camera, int16; bytes of an event, byte of its time, overflows of the time, room, number and number of valid
events, int32), then the events. Those of type 1 are polarity events of 8 bytes: bit 0 valid, bit 1 polarity (1 = ON),
bits 2-16 y downwards, bits 17-31 x, then the time in us (31 bits), to which each overflow of the packet adds 2^31.

Events of other types and invalid ones are left out and counted. Of a file with several cameras, the first one's events
are given. Packets must be stored as they are ("#Format: RAW").

Source: "AEDAT 3.1" at docs.inivation.com; the bits also as in the README of DVS Gesture (Amir et al., CVPR 2017).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events.formats._aedat_header import header
from neuro.events.formats._format import Damage, Format, Piece, Size
from neuro.events.source import Bytes, Source

MAGIC = b"#!AER-DAT3.1"
END = b"#!END-HEADER"
EVENT = 8
SIZES = {"DVS128": (128, 128), "DAVIS128": (128, 128), "DAVIS208": (208, 192), "DAVIS240": (240, 180),
         "DAVIS346": (346, 260), "DAVIS640": (640, 480)}  # fmt: skip
"""px, by how the name of a camera begins."""

State = npt.NDArray[np.int64]

_FORMAT = re.compile(rb"#Format: *(\S+)")
_CAMERA = re.compile(rb"\n#Source (\d{1,5}): *([\w-]+)")
_START = re.compile(rb"#Start-Time: *([\x20-\x7e]+)")


class Aedat3:
    """An open AEDAT 3.1 file.

    ``metadata`` has ``camera`` and ``start``, where told, and, for what was read so far, ``other_events`` and
    ``invalid_events``, which are left out.
    """

    def __init__(self, source: Source) -> None:
        lines, ended = header(source, MAGIC, END)
        if not ended:
            raise Damage(f"the header does not end, expected a line {END.decode()}", len(lines))
        stored = _FORMAT.search(lines)
        if stored and stored.group(1) != b"RAW":
            what = stored.group(1).decode("ascii", "replace")
            raise Damage(f"packets are stored as {what}, expected RAW", stored.start(1))
        self._source, self._start = source, len(lines)
        cameras = [(int(number), name.decode()) for number, name in _CAMERA.findall(lines)]
        self._camera = cameras[0][0] if len(cameras) > 1 else -1
        self.sensor_size: Size | None = None
        self.metadata: dict[str, Any] = {"other_events": 0, "invalid_events": 0}
        if cameras:
            name = cameras[0][1]
            self.metadata["camera"] = name
            self.sensor_size = next((size for known, size in SIZES.items() if name.upper().startswith(known)), None)
        if start := _START.search(lines):
            self.metadata["start"] = start.group(1).decode()

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        from neuro.events.formats._aedat3_kernel import decode

        state, left_out = np.zeros(3, np.int64), np.zeros(2, np.int64)
        held, end = np.zeros(0, np.uint8), self._start
        for place, more in self._source.blocks(self._start, block):
            data = np.concatenate((held, more)) if held.size else more
            begin, before, n = place - held.size, state.copy(), data.size // EVENT
            t, x, y = np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.uint16)
            p = np.empty(n, np.uint8)
            found, used, x_max, y_max, ordered, broken = decode(data, self._camera, state, left_out, t, x, y, p)
            self.metadata |= {"other_events": int(left_out[0]), "invalid_events": int(left_out[1])}

            def byte(event: int, begin: int = begin, data: Bytes = data, state: State = before) -> int:
                return begin + _begins(data, self._camera, state, event)

            highest = (int(x_max), int(y_max)) if found else (-1, -1)
            yield Piece(t[:found], x[:found], y[:found], p[:found], highest, bool(ordered), byte)
            if broken:
                raise Damage("expected the header of a packet", begin + used)
            held, end = data[used:], begin + used
        if missing := int(state[0] + state[1] * EVENT):
            raise Damage(f"the last packet is cut, {missing - held.size} bytes are missing", end)
        if held.size:
            raise Damage(f"{held.size} bytes left over after the last packet", end)


def _begins(data: Bytes, camera: int, state: State, event: int) -> int:
    """The byte at which an event begins: 8 before the end of the shortest beginning of the data that has it."""
    from neuro.events.formats._aedat3_kernel import decode

    low, high = 0, data.size
    while low < high:
        middle = (low + high) // 2
        n = middle // EVENT
        room = np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.uint16), np.empty(n, np.uint8)
        found = decode(data[:middle], camera, state.copy(), np.zeros(2, np.int64), *room)[0]
        low, high = (low, middle) if found > event else (middle + 1, high)
    return low - EVENT


AEDAT3 = Format(
    "aedat3", "AEDAT 3.1", (".aedat", ".aedat3"), lambda head: head.startswith(MAGIC), Aedat3,
    untested="no recording of this format was at hand; read from the specification",
)  # fmt: skip
"""Only read."""
