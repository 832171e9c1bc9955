"""Messages of ROS that hold events, as ROS 1 and ROS 2 write them.

``event_camera_msgs/EventPacket``: header, height, width, seq, time_base (ns), encoding, is_bigendian, bytes. Encodings:
``evt3`` (words of EVT 3.0, whose clock goes on from packet to packet) and ``mono`` (uint64: bit 63 polarity, bits 48-62
y, 32-47 x, 0-31 ns after time_base).
``dvs_msgs/EventArray`` and ``prophesee_event_msgs/EventArray``: header, height, width, events of x, y (uint16), time in
s and ns (uint32), polarity.
Times in ns are cut to us.

ROS 1 writes the fields one after the other; ROS 2 (CDR) after four bytes, each at a multiple of its size, strings with
a zero at the end.

Source: event_camera_msgs (github.com/ros-event-camera/event_camera_msgs), dvs_msgs (github.com/uzh-rpg/rpg_dvs_ros);
"DDSI-RTPS", section 10, for CDR.
"""

from __future__ import annotations

from dataclasses import dataclass
from struct import Struct, error
from typing import Any

import numpy as np

from neuro.events.formats._evt import Decoder
from neuro.events.formats._format import Damage, Piece, Size
from neuro.events.source import Bytes

PACKET = "EventPacket"
ARRAY = "EventArray"
KINDS = (PACKET, ARRAY)

_U32, _U64, _U8 = Struct("<I"), Struct("<Q"), Struct("<B")
_ROS1 = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("p", "u1")])
_CDR = np.dtype([*((name, _ROS1[name]) for name in ("x", "y")), ("unused", "u1", 2),
                 *((name, _ROS1[name]) for name in ("s", "ns", "p")), ("after", "u1")])  # fmt: skip
"""Any event but the first, which needs no bytes between y and the time."""


class _Fields:
    """Reads the fields of a message one after the other."""

    def __init__(self, data: Bytes, cdr: bool) -> None:
        if cdr and data[1:2].tobytes() != b"\x01":
            raise Damage(f"a message begins with {data[:4].tobytes()!r}, expected little-endian CDR", None)
        self._data = data[4:] if cdr else data
        self._at = 0
        self.cdr = cdr

    def number(self, kind: Struct) -> int:
        if self.cdr:
            self._at += -self._at % kind.size
        try:
            value: int = kind.unpack_from(self._data.data, self._at)[0]
        except error:
            raise Damage("a message ends within its fields", None) from None
        self._at += kind.size
        return value

    def bytes(self, count: int) -> Bytes:
        taken = self._data[self._at : self._at + count]
        if taken.size < count:
            raise Damage(f"a message ends within its fields: {taken.size} of {count} bytes", None)
        self._at += count
        return taken

    def text(self) -> str:
        return self.bytes(self.number(_U32)).tobytes().rstrip(b"\0").decode("utf-8", "replace")

    def header(self) -> None:
        """Number (ROS 1 only), time and frame."""
        for _ in range(2 if self.cdr else 3):
            self.number(_U32)
        self.text()


@dataclass(slots=True)
class Packet:
    """The content of a message, its events not yet decoded."""

    size: Size | None
    encoding: str
    base: int
    data: Bytes
    big: bool
    count: int


def packet(data: Bytes, kind: str, cdr: bool) -> Packet:
    """Take a message apart.

    Args:
        data: its bytes.
        kind: `PACKET` or `ARRAY`.
        cdr: whether ROS 2 wrote it.

    Raises:
        Damage: it is shorter than its fields.
    """
    fields = _Fields(data, cdr)
    fields.header()
    height, width = fields.number(_U32), fields.number(_U32)
    size = (width, height) if 1 <= width <= 65536 and 1 <= height <= 65536 else None
    if kind == ARRAY:
        count = fields.number(_U32)
        length = max(0, _CDR.itemsize * count - 3) if cdr else _ROS1.itemsize * count
        return Packet(size, ARRAY, 0, fields.bytes(length), False, count)
    fields.number(_U64)
    base, encoding = fields.number(_U64), fields.text()
    big = bool(fields.number(_U8))
    return Packet(size, encoding, base, fields.bytes(fields.number(_U32)), big, 0)


class Unpacker:
    """Decodes the packets of one camera in order."""

    def __init__(self) -> None:
        self._evt3: Decoder | None = None

    def piece(self, content: Packet) -> Piece:
        """The events of a packet.

        Raises:
            Damage: its encoding is not known, or its bytes are no whole words.
        """
        if content.encoding == ARRAY:
            return _array(content)
        word = {"evt3": 2, "mono": 8}.get(content.encoding)
        if word is None:
            raise Damage(f"encoding {content.encoding!r} is not known, expected evt3 or mono", None)
        if content.data.size % word:
            raise Damage(f"a packet of {content.data.size} bytes, expected whole words of {word} bytes", None)
        data = content.data.reshape(-1, word)[:, ::-1] if content.big else content.data
        data = np.ascontiguousarray(data).reshape(-1)
        if content.encoding == "mono":
            return _mono(data.view("<u8"), content.base)
        self._evt3 = self._evt3 or _evt3()
        return self._evt3.piece(data)


def _evt3() -> Decoder:
    from neuro.events.formats import _evt3_kernel as kernel

    state = np.zeros(kernel.STATES, np.int64)
    state[kernel.ROW] = state[kernel.BASE] = -1
    return Decoder("<u2", state, kernel.room, kernel.decode)


def _mono(words: Any, base: int) -> Piece:
    if base >= 1 << 63:
        raise Damage(f"time_base is {base} ns, expected less than 2^63", None)
    t = (base + (words & 0xFFFFFFFF).astype(np.int64)) // 1000
    x, y = (words >> 32).astype(np.uint16), (words >> 48 & 0x7FFF).astype(np.uint16)
    return Piece(t, x, y, (words >> 63).astype(np.uint8))


def _array(content: Packet) -> Piece:
    """Events of an array; CDR ones begin with one that is two bytes shorter."""
    raw = content.data
    if raw.size == _ROS1.itemsize * content.count:
        events = raw.view(_ROS1)
    else:
        padded = np.zeros(16 * content.count, np.uint8)
        padded[:4], padded[6 : 2 + raw.size] = raw[:4], raw[4:]
        events = padded.view(_CDR)
    if (events["ns"] >= 10**9).any():
        raise Damage(f"a time has {events['ns'].max()} ns, expected less than 10^9", None)
    t = events["s"].astype(np.int64) * 10**6 + events["ns"] // 1000
    x, y = (np.ascontiguousarray(events[name]) for name in "xy")
    return Piece(t, x, y, (events["p"] != 0).astype(np.uint8))
