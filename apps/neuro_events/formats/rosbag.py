"""Bags of ROS 1 (version 2.0) and ROS 2 with events.

ROS 1: the line ``#ROSBAG V2.0``, then records of a header (fields ``name=value``) and data, each preceded by its size.
Chunks (op 5) contain messages (op 2) and connections (op 7), uncompressed or compressed with bz2 or LZ4. Records are
read in order, without the index at the end, so that an incomplete bag can be read up to the damage.
ROS 2: ``.db3`` (SQLite) and ``.mcap``, read with the package ``rosbags``.

The first topic with events is read. ``metadata`` has ``topic``, ``message``, ``encoding`` and ``topics`` (the other
topics with events).

Source: "Bag format 2.0", wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from struct import Struct, error
from typing import Any

import lz4.frame
import numpy as np

from neuro_events.formats._format import Damage, Format, Piece, Size, extra
from neuro_events.formats._reading import Cursor, GrowingArray
from neuro_events.formats._words import Decoder
from neuro_events.formats.evt import evt3_decoder
from neuro_events.source import Bytes, Source

MAGIC = b"#ROSBAG V2.0\n"
RECORD_LIMIT = 1 << 30
"""Largest size of a record, bytes, so that a damaged size cannot fill the memory."""

MESSAGE, CHUNK, CONNECTION = 2, 5, 7
OPS = frozenset(range(2, 8))

_U32 = Struct("<I")
Message = tuple[int, str, str, Bytes]
"""Byte in the file, topic, type and content of a message."""


class _Bag:
    """Base class of both kinds of bags, which reads the events of one topic."""

    cdr: bool
    """True if messages are in CDR, the format of ROS 2."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.sensor_size: Size | None = None
        self.metadata: dict[str, Any] = {}
        self._topic = ""
        for place, topic, kind, data in self.messages(1 << 20):
            if kind.split("/")[-1] in KINDS:
                first = self._content(place, kind, data)
                self._topic, self.sensor_size = topic, first.size
                self.metadata |= {"topic": topic, "message": kind, "encoding": first.encoding}
                break
        if not self._topic:
            raise Damage(f"has no messages with events, expected {' or '.join(KINDS)}", None)

    def messages(self, block: int) -> Iterator[Message]:
        """Yield all messages from the beginning."""
        raise NotImplementedError

    def _content(self, place: int, kind: str, data: Bytes) -> Packet:
        try:
            return packet(data, kind.split("/")[-1], self.cdr)
        except Damage as damage:
            raise Damage(damage.what, self._byte(place)) from None

    def _byte(self, place: int) -> int | None:
        return place

    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the events; see `Reader`."""
        buffer, unpacker, n_bytes = GrowingArray(), PacketDecoder(), 0
        damage: Damage | None = None
        other_topics: set[str] = set()
        try:
            for place, topic, kind, data in self.messages(block):
                if topic != self._topic:
                    other_topics |= {topic} if kind.split("/")[-1] in KINDS else set()
                    continue
                content = self._content(place, kind, data)
                try:
                    self._add(buffer, place, unpacker.piece(content))
                except Damage as original:
                    raise Damage(original.what, self._byte(place)) from None
                n_bytes += data.size
                if n_bytes >= block:
                    yield buffer.piece()
                    n_bytes = 0
        except Damage as original:
            damage = Damage(original.what, original.offset)  # a copy without traceback, which would keep the file open
        yield buffer.piece()
        self.metadata["topics"] = sorted(other_topics)
        if damage is not None:
            raise damage

    def _add(self, buffer: GrowingArray, place: int, piece: Piece) -> None:
        n, count = buffer.used, piece.t.size
        buffer.reserve(count)
        buffer.t[n : n + count], buffer.p[n : n + count] = piece.t, piece.p
        buffer.x[n : n + count], buffer.y[n : n + count] = piece.x, piece.y
        if not count:
            return
        highest = piece.highest or (int(piece.x.max(initial=0)), int(piece.y.max(initial=0)))
        ordered = bool(np.all(piece.t[1:] >= piece.t[:-1])) if piece.ordered is None else piece.ordered
        forward = ordered and (not n or bool(buffer.t[n] >= buffer.t[n - 1]))
        buffer.commit([n], [self._byte(place)], n + count, highest, forward)


class Ros1Bag(_Bag):
    """A reader of ROS 1 bags."""

    cdr = False

    def __init__(self, source: Source) -> None:
        head = source.head(len(MAGIC))
        if head != MAGIC:
            raise Damage(f"begins with {head!r}, expected the line {MAGIC[:-1].decode()}", 0)
        source.all()
        super().__init__(source)

    def messages(self, block: int) -> Iterator[Message]:
        """Yield all messages; see `_Bag`. Messages in a chunk have the byte of the chunk."""
        cursor = Cursor(self.source, len(MAGIC), block)
        connections: dict[int, tuple[str, str]] = {}
        while True:
            place = cursor.at
            if not (size := cursor.take(4)).size:
                return
            fields, data = _record(cursor, place, size)
            if fields["op"] == bytes([CHUNK]):
                inner = Cursor(Source(_unpack_chunk(fields, data, place).data), 0, 1 << 62)
                while (size := inner.take(4)).size:
                    yield from _message(*_record(inner, place, size), connections, place)
            else:
                yield from _message(fields, data, connections, place)


def _message(
    fields: dict[str, bytes], data: Bytes, connections: dict[int, tuple[str, str]], place: int
) -> Iterator[Message]:
    """Yield the message, if the record holds one. If the record declares a connection, add it to `connections`."""
    op = fields["op"][0]
    if op not in (MESSAGE, CONNECTION):
        return
    number = fields.get("conn", b"")
    if len(number) != 4:
        raise Damage("a record does not state its connection", place)
    connection = _U32.unpack(number)[0]
    if op == CONNECTION:
        kind = _fields(data.tobytes(), place).get("type", b"")
        connections[connection] = (fields.get("topic", b"").decode("utf-8", "replace"), kind.decode("utf-8", "replace"))
    elif connection not in connections:
        raise Damage(f"a message of connection {connection}, which is not declared", place)
    else:
        yield (place, *connections[connection], data)


def _record(cursor: Cursor, place: int, size: Bytes) -> tuple[dict[str, bytes], Bytes]:
    """Return the header and data of the record whose first four bytes are `size`."""
    head = _part(cursor, place, size)
    fields = _fields(head.tobytes(), place)
    if len(fields.get("op", b"")) != 1 or fields["op"][0] not in OPS:
        raise Damage(f"a record of kind {fields.get('op', b'')!r}, expected 2 to 7", place)
    return fields, _part(cursor, place, cursor.take(4))


def _part(cursor: Cursor, place: int, size: Bytes) -> Bytes:
    count = int.from_bytes(size.tobytes(), "little")
    if count > RECORD_LIMIT:
        raise Damage(f"a record of {count} bytes, expected at most {RECORD_LIMIT}", place)
    data = cursor.take(count)
    if size.size < 4 or data.size < count:
        raise Damage("the file ends in a record", place)
    return data


def _fields(data: bytes, place: int) -> dict[str, bytes]:
    """Return the fields ``name=value``, each of which is preceded by its size."""
    fields, at = {}, 0
    while at < len(data):
        try:
            (size,) = _U32.unpack_from(data, at)
        except error:
            size = len(data)
        field = data[at + 4 : at + 4 + size]
        if len(field) < size or b"=" not in field:
            raise Damage("the header of a record is incomplete", place)
        name, value = field.split(b"=", 1)
        fields[name.decode("ascii", "replace")] = value
        at += 4 + size
    return fields


def _unpack_chunk(fields: dict[str, bytes], data: Bytes, place: int) -> Bytes:
    """Unpack the records of a chunk."""
    packed = fields.get("compression", b"").decode("ascii", "replace")
    size = int.from_bytes(fields.get("size", b""), "little")
    plain: Any
    try:
        if packed == "none":
            plain = data
        elif packed == "bz2":
            plain = bz2.BZ2Decompressor().decompress(data.data, min(size, RECORD_LIMIT) + 1)
        elif packed == "lz4":
            plain = lz4.frame.decompress(data)
        else:
            raise Damage(f"a chunk is compressed with {packed!r}, expected none, bz2 or lz4", place)
    except (OSError, EOFError, RuntimeError, MemoryError):
        raise Damage(f"a chunk is not valid {packed} data", place) from None
    if len(plain) != size:
        raise Damage(f"a chunk has {len(plain)} bytes, expected {size}", place)
    return np.frombuffer(plain, np.uint8)


class Ros2Bag(_Bag):
    """A reader of ROS 2 bags. Positions of messages in the file are unknown, since another library reads the file."""

    cdr = True

    def messages(self, block: int) -> Iterator[Message]:
        """Yield all messages; see `_Bag`."""
        bags = extra("rosbags.rosbag2", "a ROS 2 bag")
        with tempfile.TemporaryDirectory() as folder:
            try:
                with bags.Reader(self._path(Path(folder))) as bag:
                    for connection, _, data in bag.messages():
                        yield 0, connection.topic, connection.msgtype, np.frombuffer(data, np.uint8)
            except Damage:
                raise
            except Exception as failure:
                # The package raises errors of many types for a damaged bag.
                raise Damage(f"not an intact ROS 2 bag: {' '.join(str(failure).split())}", None) from None

    def _path(self, folder: Path) -> Path:
        """Return the path of the file, or of a temporary copy with the ending that the library requires."""
        ending = ".mcap" if self.source.head(len(MCAP)) == MCAP else ".db3"
        path = self.source.path
        if path is not None and path.suffix == ending:
            return path
        copy = folder / f"bag{ending}"
        copy.write_bytes(self.source.all().data)
        return copy

    def _byte(self, place: int) -> int | None:
        return None


PACKET = "EventPacket"
ARRAY = "EventArray"
KINDS = (PACKET, ARRAY)

_U64, _U8 = Struct("<Q"), Struct("<B")
_ROS1 = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("p", "u1")])
_CDR = np.dtype([*((name, _ROS1[name]) for name in ("x", "y")), ("unused", "u1", 2),
                 *((name, _ROS1[name]) for name in ("s", "ns", "p")), ("after", "u1")])  # fmt: skip
"""Layout of an event in CDR. The first event of a message has no padding between y and the time."""


class _MessageFields:
    """Reader of the fields of a message, in order."""

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
        data = self._data[self._at : self._at + count]
        if data.size < count:
            raise Damage(f"a message ends within its fields: {data.size} of {count} bytes", None)
        self._at += count
        return data

    def text(self) -> str:
        return self.bytes(self.number(_U32)).tobytes().rstrip(b"\0").decode("utf-8", "replace")

    def header(self) -> None:
        """Skip the number (ROS 1 only), the time and the frame."""
        for _ in range(2 if self.cdr else 3):
            self.number(_U32)
        self.text()


@dataclass(slots=True)
class Packet:
    """Content of a message, with events that are not yet decoded.

    Attributes:
        size: width and height of the sensor, px, or None.
        encoding: encoding of the events.
        base: time_base, ns.
        data: the encoded events.
        big: words are big-endian.
        count: number of events of an array.
    """

    size: Size | None
    encoding: str
    base: int
    data: Bytes
    big: bool
    count: int


def packet(data: Bytes, kind: str, cdr: bool) -> Packet:
    """Parse a message.

    ``event_camera_msgs/EventPacket``: header, height, width, seq, time_base (ns), encoding, is_bigendian, bytes.
    Encodings: ``evt3`` (words of EVT 3.0, whose clock continues from packet to packet) and ``mono`` (uint64: bit 63
    polarity, bits 48-62 y, 32-47 x, 0-31 ns after time_base).
    ``dvs_msgs/EventArray`` and ``prophesee_event_msgs/EventArray``: header, height, width, events of x, y (uint16),
    time in s and ns (uint32), polarity.
    Times in ns are rounded down to us.

    ROS 1 stores the fields without padding. ROS 2 (CDR) stores four bytes first, then each field at a multiple of its
    size, and strings with a terminating zero.

    Args:
        data: the bytes of the message.
        kind: `PACKET` or `ARRAY`.
        cdr: True for a message of ROS 2.

    Raises:
        Damage: the message is shorter than its fields.

    Source: event_camera_msgs (github.com/ros-event-camera/event_camera_msgs), dvs_msgs
        (github.com/uzh-rpg/rpg_dvs_ros); "DDSI-RTPS", section 10, for CDR.
    """
    fields = _MessageFields(data, cdr)
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


class PacketDecoder:
    """Decoder of the packets of one camera, in order."""

    def __init__(self) -> None:
        self._evt3: Decoder | None = None

    def piece(self, content: Packet) -> Piece:
        """Decode a packet.

        Raises:
            Damage: unknown encoding, or incomplete words.
        """
        if content.encoding == ARRAY:
            return _array(content)
        word = {"evt3": 2, "mono": 8}.get(content.encoding)
        if word is None:
            raise Damage(f"unknown encoding {content.encoding!r}, expected evt3 or mono", None)
        if content.data.size % word:
            raise Damage(f"a packet of {content.data.size} bytes, expected a multiple of {word} bytes", None)
        data = content.data.reshape(-1, word)[:, ::-1] if content.big else content.data
        data = np.ascontiguousarray(data).reshape(-1)
        if content.encoding == "mono":
            return _mono(data.view("<u8"), content.base)
        self._evt3 = self._evt3 or evt3_decoder()
        return self._evt3.piece(data)


def _mono(words: Any, base: int) -> Piece:
    if base >= 1 << 63:
        raise Damage(f"time_base is {base} ns, expected less than 2^63", None)
    t = (base + (words & 0xFFFFFFFF).astype(np.int64)) // 1000
    x, y = (words >> 32).astype(np.uint16), (words >> 48 & 0x7FFF).astype(np.uint16)
    return Piece(t, x, y, (words >> 63).astype(np.uint8))


def _array(content: Packet) -> Piece:
    """Decode the events of an array. In CDR the first event is two bytes shorter than the others."""
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


MCAP = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3\0"

ROS1 = Format("rosbag1", "ROS 1 bag", (".bag",), lambda head: head.startswith(MAGIC), Ros1Bag)
"""ROS 1 bags, read only. EventPacket is tested on a real bag, EventArray on synthetic ones."""
ROS2 = Format(
    "rosbag2", "ROS 2 bag", (".mcap", ".db3"), lambda head: head.startswith((MCAP, SQLITE)), Ros2Bag,
    untested="made with the package rosbags; no recording of a camera was available",
)  # fmt: skip
"""ROS 2 bags, read only."""
