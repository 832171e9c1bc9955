"""AEDAT 4.0 of iniVation's DV software.

The line ``#!AER-DAT4.0``, then a FlatBuffer ``IOHE`` with the compression, the place of the table at the end and an XML
text that lists the streams, then packets: stream (int32), bytes (int32), and that many bytes which are compressed (LZ4
or Zstandard frames) or plain and hold a FlatBuffer with its size before it. Of the streams the first with events
(``EVTS``) is read; frames, inertial samples, triggers and further streams are counted in ``metadata``.

An event is 16 bytes: time (int64, us), x, y (int16), polarity (1 = ON), 3 bytes unused. Times are Unix times.

Source: AEDAT 4.0 in iniVation's documentation (docs.inivation.com, "AEDAT file formats") and the published schemas
``ioheader.fbs``, ``events.fbs``.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Callable, Iterator
from struct import Struct
from typing import Any

import numpy as np

from neuro.events.formats._cursor import Cursor
from neuro.events.formats._extra import extra
from neuro.events.formats._flatbuffers import I32, I64, U32, Malformed, Table
from neuro.events.formats._format import Damage, Format, Piece, Size
from neuro.events.formats._growing import Growing
from neuro.events.source import Bytes, Source

MAGIC = b"#!AER-DAT4.0\r\n"
RECORD = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "u1"), ("unused", "u1", 3)])
COMPRESSIONS = ("none", "LZ4", "LZ4", "Zstandard", "Zstandard")
"""By the number in the header; LZ4 and Zstandard each have a thorough variant that is read alike."""

HEADER_LIMIT = 1 << 24
"""No header is longer; a damaged length must not fill the memory."""
PACKET_LIMIT = 1 << 28
"""No packet is longer when unpacked, for the same reason."""
USUAL = 1 << 18
"""Most packets are not longer when unpacked."""
TYPES = {"EVTS": "events", "FRME": "frames", "IMUS": "imus", "TRIG": "triggers"}

_ENTRY = Struct("<ii")
_GUESS = 8, 1 << 24
"""Bytes of a packed event, about, and events at most, by which room is made at once."""


class Aedat4:
    """An open AEDAT 4 file.

    ``metadata`` has ``compression``, ``streams`` (number to type, sensor and source) and, once all is read,
    ``other_packets``: how many of each other type.
    """

    def __init__(self, source: Source) -> None:
        from neuro.events.formats._aedat4_kernel import split

        self._source = source
        lead = source.head(len(MAGIC) + 4)
        if not lead.startswith(MAGIC):
            raise Damage(f"begins with {lead[:14]!r}, expected the line {MAGIC[:-2].decode()}", 0)
        if len(lead) < len(MAGIC) + 4:
            raise Damage("the file ends within its header", len(lead))
        size = U32.unpack_from(lead, len(MAGIC))[0]
        self._start = len(lead) + size
        header = source.head(self._start)[len(lead) :] if size <= HEADER_LIMIT else b""
        if len(header) < size:
            raise Damage(f"the header has {size} bytes, which the file has not", len(MAGIC))
        try:
            packed, self._table, streams = _header(header)
        except Malformed as error:
            raise Damage(f"the header is damaged: {error}", len(lead)) from None
        self._streams = streams
        events = [number for number, stream in streams.items() if stream["type"] == "events"]
        if not events:
            raise Damage("the header lists no stream of events", len(lead))
        self._wanted = events[0]
        self._unpack, self._split = _unpacker(packed), split
        self._lead = b""
        wanted = streams[self._wanted]
        self.sensor_size: Size | None = (wanted["width"], wanted["height"]) if "width" in wanted else None
        told = {str(number): stream for number, stream in streams.items()}
        self.metadata: dict[str, Any] = {"compression": packed, "streams": told}

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        others: Counter[str] = Counter()
        held = Growing()
        held.room(min(block, self._source.size or 0, _GUESS[0] * _GUESS[1]) // _GUESS[0])
        damage: Damage | None = None
        begin = self._start
        try:
            for place, data in self._packets(block, others):
                self._add(held, place, data)
                if place + data.size - begin >= block:
                    yield held.piece()
                    begin = place + data.size
        except Damage as found:
            damage = found
        yield held.piece()
        self.metadata["other_packets"] = dict(others)
        if damage is not None:
            raise damage

    def _packets(self, block: int, others: Counter[str]) -> Iterator[tuple[int, Bytes]]:
        """Place and content of each packet with events; the others are counted."""
        cursor = Cursor(self._source, self._start, block)
        end = self._table if self._table > 0 else None
        while end is None or cursor.at < end:
            place = cursor.at
            entry = cursor.take(_ENTRY.size)
            if end is None and not entry.size:
                return
            if entry.size < _ENTRY.size:
                raise Damage("the file ends before its table of packets" if end else "the file ends in a packet", place)
            stream, size = _ENTRY.unpack(entry.data)
            if stream not in self._streams:
                raise Damage(f"a packet of stream {stream}, which the header does not list", place)
            if not 0 <= size <= PACKET_LIMIT or (end is not None and place + 8 + size > end):
                raise Damage(f"a packet of {size} bytes, which do not fit before the table of packets", place)
            data = cursor.take(size)
            if data.size < size:
                raise Damage(f"the file ends in a packet: it has {data.size} of {size} bytes", place)
            if stream == self._wanted:
                yield place, data
            else:
                others[self._streams[stream]["type"]] += 1

    def _add(self, held: Growing, place: int, data: Bytes) -> None:
        """Unpack one packet."""
        plain = self._unpack(data, place)
        start, count = self._vector(plain, place)
        held.room(count)
        n, events = held.used, np.frombuffer(plain, RECORD, count, start)
        x, y, ordered = self._split(events, held.t[n:], held.x[n:], held.y[n:], held.p[n:])
        if self.sensor_size is None and max(x, y) > np.iinfo(np.int16).max:
            raise Damage("a packet has an event at a negative place", place)
        held.added(count, (int(x), int(y)), bool(ordered), place)

    def _vector(self, plain: bytes, place: int) -> tuple[int, int]:
        """Where the events of an unpacked packet begin, and how many there are.

        Packets of one file mostly begin alike, up to the number of events; then no offset needs to be followed.
        """
        start = 4 + len(self._lead) + 4
        try:
            if len(plain) < 12 or U32.unpack_from(plain)[0] != len(plain) - 4:
                raise Malformed(f"its {len(plain)} bytes are not as many as it says")
            if self._lead and len(plain) >= start and plain.startswith(self._lead, 4):
                count = U32.unpack_from(plain, start - 4)[0]
                if start + count * RECORD.itemsize <= len(plain):
                    return start, count
            start, count = Table(memoryview(plain)[4:], b"EVTS").vector(0, RECORD.itemsize)
        except Malformed as error:
            raise Damage(f"a packet is damaged: {error}", place) from None
        self._lead = plain[4 : max(start, 4)]
        return 4 + start, count


def _header(data: bytes) -> tuple[str, int, dict[int, dict[str, Any]]]:
    """Compression, place of the table of packets (-1: none) and the streams."""
    table = Table(data, b"IOHE")
    compression = table.number(0, I32, 0)
    if not 0 <= compression < len(COMPRESSIONS):
        raise Malformed(f"compression {compression} is not known")
    start, count = table.vector(2, 1)
    return COMPRESSIONS[compression], table.number(1, I64, -1), _streams(data[start : start + count])


def _streams(info: bytes) -> dict[int, dict[str, Any]]:
    """The streams that the XML lists."""
    if b"<!" in info:
        raise Malformed("its list of streams is no plain XML")
    try:
        nodes = ElementTree.fromstring(info).findall("./node[@name='outInfo']/node")
        found = {int(node.get("name", "")): _stream(node) for node in nodes}
    except Malformed:
        raise
    except (ElementTree.ParseError, ValueError) as error:
        raise Malformed(f"its list of streams cannot be read ({error})") from None
    return found


def _stream(node: ElementTree.Element) -> dict[str, Any]:
    kind = node.findtext("./attr[@key='typeIdentifier']", "")
    stream: dict[str, Any] = {"type": TYPES.get(kind, kind)}
    told = {key: node.findtext(f"./node[@name='info']/attr[@key='{key}']") for key in ("sizeX", "sizeY", "source")}
    if told["sizeX"] is not None and told["sizeY"] is not None:
        width, height = int(told["sizeX"]), int(told["sizeY"])
        if not (1 <= width <= 1 << 15 and 1 <= height <= 1 << 15):
            raise Malformed(f"its sensor is {width}x{height}, expected 1x1 to 32768x32768")
        stream |= {"width": width, "height": height}
    return stream | ({"source": told["source"]} if told["source"] else {})


def _unpacker(packed: str) -> Callable[[Bytes, int], bytes]:
    """A function that unpacks the packet that stands at a place.

    It raises `Damage` for one that cannot be unpacked.
    """
    if packed == "none":
        return lambda data, place: data.tobytes()
    if packed == "LZ4":
        lz4 = extra("lz4.frame", "AEDAT 4 with LZ4 packets")
        plain, failure = _lz4(lz4), RuntimeError
    else:
        zstandard = extra("zstandard", "AEDAT 4 with Zstandard packets")
        plain, failure = _zstandard(zstandard), zstandard.ZstdError

    def unpack(data: Bytes, place: int) -> bytes:
        try:
            unpacked: bytes = plain(data)
        except (failure, EOFError, ValueError, MemoryError):
            raise Damage(f"a packet of {data.size} bytes is no {packed} data", place) from None
        return unpacked

    return unpack


def _lz4(module: Any) -> Callable[[Bytes], bytes]:
    """Unpacks a frame; with room for a usual one at once this takes half the time of the package's own function."""
    context = module.create_decompression_context()

    def plain(data: Bytes) -> bytes:
        room, used = USUAL, 0
        parts = []
        ended = False
        try:
            while not ended:
                part, taken, ended = module.decompress_chunk(context, data[used:], max_length=room)
                if not (ended or part or taken):
                    raise EOFError
                parts.append(part)
                used, room = used + taken, 2 * room
        finally:
            if not ended:
                module.reset_decompression_context(context)
        return parts[0] if len(parts) == 1 else b"".join(parts)

    return plain


def _zstandard(module: Any) -> Callable[[Bytes], bytes]:
    """Unpacks a frame, which need not tell its length, and not without limit."""

    def plain(data: Bytes) -> bytes:
        reader, parts = module.ZstdDecompressor().stream_reader(data), []
        while part := reader.read(1 << 20):
            parts.append(part)
            if len(parts) << 20 > PACKET_LIMIT:
                raise ValueError
        return b"".join(parts)

    return plain


AEDAT4 = Format("aedat4", "AEDAT 4", (".aedat4",), lambda head: head.startswith(MAGIC), Aedat4)
"""Read only."""
