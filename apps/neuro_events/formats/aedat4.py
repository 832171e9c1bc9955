"""AEDAT 4 of iniVation: packets of events, compressed or not, as FlatBuffers."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from struct import Struct, error
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events._events import Events
from neuro_events.formats._format import Damage, Format, Limits, Piece, Size, extra, in_order
from neuro_events.formats._reading import Cursor, GrowingArray, growing
from neuro_events.source import Bytes, Source

aedat4_kernels = LazyModule("neuro_events.formats._aedat4_kernels")

RECORD = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "u1"), ("unused", "u1", 3)])
USUAL = 1 << 18
"""Buffer for an unpacked packet, bytes; most packets fit."""
LIMIT = 1 << 28
"""Largest size of a packet, packed or unpacked, bytes, so that a damaged length cannot fill the memory."""
_EXPANSION = 4
"""Expected ratio of unpacked to packed size, which few packets exceed."""


class Packets:
    """Decoder of packets that also learns their common beginning.

    `_aedat4_kernels` then decodes packets with the same beginning.

    Args:
        compression: "none", "LZ4" or "Zstandard".

    Attributes:
        head: first bytes of a packet that is an LZ4 frame without checksums; empty for other packets.
        lead: first bytes of an unpacked packet, between its size and the number of events; empty if unknown.
    """

    def __init__(self, compression: str) -> None:
        self._compression, self._unpack = compression, _unpacker(compression)
        self.head, self.lead = b"", b""

    @property
    def is_known(self) -> bool:
        """True if the beginnings that the kernel needs are known."""
        return bool(self.lead) and (self._compression == "none" or bool(self.head))

    def events(self, data: Bytes, place: int) -> tuple[bytes, int, int]:
        """Unpack a packet.

        Args:
            data: the packet.
            place: byte of the file at which the packet begins, for messages.

        Returns:
            The unpacked packet, the offset of its events, and their number.

        Raises:
            Damage: the packet cannot be unpacked, or is malformed.
        """
        plain = self._unpack(data, place)
        if self._compression == "LZ4":
            head = data[:7].tobytes()  # usable only if it announces neither checksums nor a length
            self.head = head if len(head) == 7 and head[4] & 0b11011111 == 0b01000000 else b""
        start = 4 + len(self.lead) + 4
        try:
            if len(plain) < 12 or U32.unpack_from(plain)[0] != len(plain) - 4:
                raise Malformed(f"its size of {len(plain)} bytes differs from the size that it states")
            if self.lead and len(plain) >= start and plain.startswith(self.lead, 4):
                count = U32.unpack_from(plain, start - 4)[0]
                if start + count * RECORD.itemsize <= len(plain):
                    return plain, start, count
            table = FlatTable(memoryview(plain)[4:], b"EVTS")
            start, count = table.vector(0, RECORD.itemsize)
        except Malformed as error:
            raise Damage(f"a packet is damaged: {error}", place) from None
        # Equal beginnings imply equal layouts only if all offsets are stored before the events.
        self.lead = plain[4:start] if table.read_up_to <= start - 4 else b""
        return plain, 4 + start, count


def _unpacker(compression: str) -> Callable[[Bytes, int], bytes]:
    """Return a function (packet, place) -> unpacked bytes, which raises `Damage` for an invalid packet."""
    if compression == "none":
        return lambda data, place: data.tobytes()
    if compression == "LZ4":
        plain, failure = partial(_lz4, lz4.frame.create_decompression_context()), RuntimeError
    else:
        zstandard = extra("zstandard", "AEDAT 4 with Zstandard packets")
        plain, failure = partial(_zstandard, zstandard), zstandard.ZstdError

    def unpack(data: Bytes, place: int) -> bytes:
        try:
            unpacked: bytes = plain(data)
        except (failure, EOFError, ValueError, MemoryError):
            raise Damage(f"a packet of {data.size} bytes is not valid {compression} data", place) from None
        return unpacked

    return unpack


def _lz4(context: Any, data: Bytes) -> bytes:
    """Unpack a frame. With a sufficient first buffer this needs half the time of ``lz4.frame.decompress``."""
    capacity, used = _EXPANSION * data.size, 0
    parts = []
    ended = False
    try:
        while not ended:
            part, n_used, ended = lz4.frame.decompress_chunk(context, data[used:], max_length=capacity)
            if not (ended or part or n_used):
                raise EOFError
            parts.append(part)
            used, capacity = used + n_used, 2 * capacity
            if sum(map(len, parts)) > LIMIT:
                raise ValueError
    finally:
        if not ended:
            lz4.frame.reset_decompression_context(context)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _zstandard(module: Any, data: Bytes) -> bytes:
    """Unpack a frame, which need not state its length, up to `LIMIT` bytes."""
    reader, parts = module.ZstdDecompressor().stream_reader(data), []
    while part := reader.read(1 << 20):
        parts.append(part)
        if len(parts) << 20 > LIMIT:
            raise ValueError
    return b"".join(parts)


I32 = Struct("<i")
I64 = Struct("<q")
U16 = Struct("<H")
U32 = Struct("<I")

Buffer = bytes | memoryview


class Malformed(ValueError):
    """Error about a buffer: an offset leads out of the buffer, or the buffer is of another kind than expected."""


class FlatTable:
    """Root table of a FlatBuffer: the part of FlatBuffers that AEDAT 4 needs, with a check of each offset.

    Args:
        data: the buffer, after its size.
        kind: the four letters that state the kind of the buffer.

    Attributes:
        read_up_to: end of the bytes that were read, except numbers of items.

    Raises:
        Malformed: the buffer has another kind or is too short.

    Source: the FlatBuffers binary format (flatbuffers.dev, "Internals"): a table begins with the signed distance back
        to its vtable, which contains its own size, the table's size and an offset for each field, 0 for an absent
        field.
    """

    def __init__(self, data: Buffer, kind: bytes) -> None:
        self._data = data
        self.read_up_to = 8
        if bytes(data[4:8]) != kind:
            raise Malformed(f"its kind is {bytes(data[4:8])!r}, expected {kind!r}")
        self._at = self._read(U32, 0)
        self._vtable = self._at - self._read(I32, self._at)
        self._fields = (self._read(U16, self._vtable) - 4) // 2

    def _read(self, kind: Struct, at: int) -> int:
        if at < 0:
            raise Malformed("an offset leads out of it")
        try:
            value: int = kind.unpack_from(self._data, at)[0]
        except error:
            raise Malformed("an offset leads out of it") from None
        self.read_up_to = max(self.read_up_to, at + kind.size)
        return value

    def _place(self, field: int) -> int | None:
        if field >= self._fields:
            return None
        offset = self._read(U16, self._vtable + 4 + 2 * field)
        return self._at + offset if offset else None

    def number(self, field: int, kind: Struct, default: int) -> int:
        """Return a field that is a number.

        Args:
            field: index in the schema.
            kind: type of the number.
            default: value of an absent field.
        """
        place = self._place(field)
        return default if place is None else self._read(kind, place)

    def vector(self, field: int, width: int) -> tuple[int, int]:
        """Return the offset of a field's first item and the number of items, (0, 0) for an absent field.

        Args:
            field: index in the schema.
            width: size of an item, bytes.

        Raises:
            Malformed: the items reach beyond the buffer.
        """
        place = self._place(field)
        if place is None:
            return 0, 0
        start = place + self._read(U32, place)
        read_up_to = self.read_up_to
        count = self._read(U32, start)
        self.read_up_to = read_up_to
        if start + 4 + count * width > len(self._data):
            raise Malformed(f"{count} items of {width} bytes do not fit in its {len(self._data)} bytes")
        return start + 4, count


MAGIC = b"#!AER-DAT4.0\r\n"
COMPRESSIONS = ("none", "LZ4", "LZ4", "Zstandard", "Zstandard")
"""Compressions by the number in the header. LZ4 and Zstandard have two levels each, which are decoded alike."""

HEADER_LIMIT = 1 << 24
"""Largest size of a header, bytes, so that a damaged length cannot fill the memory."""
TYPES = {"EVTS": "events", "FRME": "frames", "IMUS": "imus", "TRIG": "triggers"}

ENTRY = Struct("<ii")
"""Header of each packet: the number of its stream, and the size of the packet in bytes."""
_GUESS = 8, 1 << 24
"""Typical size of a packed event, bytes, and largest number of events, for the first allocation of columns."""
_NUMBERS = 256
"""Number of streams that the kernel counts."""
_MOST = 1 << 12
"""Largest number of packets with events per call of the kernel."""


class Aedat4:
    """A reader of AEDAT 4 files.

    ``metadata`` has ``compression``, ``streams`` (number to type, sensor and source) and, after reading, the number of
    ``other_packets`` by type.
    """

    def __init__(self, source: Source) -> None:
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
            raise Damage(f"the header has {size} bytes, more than the file or the limit of {HEADER_LIMIT}", len(MAGIC))
        try:
            compression, self._table, streams = read_header(header)
        except Malformed as error:
            raise Damage(f"the header is damaged: {error}", len(lead)) from None
        self._streams = streams
        events = [number for number, stream in streams.items() if stream["type"] == "events"]
        if not events:
            raise Damage("the header lists no stream of events", len(lead))
        self._number = events[0]
        self._packets, self._split, self._walk = Packets(compression), aedat4_kernels.split, aedat4_kernels.walk
        self._plain = np.empty(USUAL, np.uint8)
        stream = streams[self._number]
        self.sensor_size: Size | None = (stream["width"], stream["height"]) if "width" in stream else None
        self._highest = np.iinfo(np.int16 if self.sensor_size is None else np.uint16).max
        streams_by_name = {str(number): entry for number, entry in streams.items()}
        self.metadata: dict[str, Any] = {"compression": compression, "streams": streams_by_name}

    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the events; see `Reader`."""
        cursor, buffer = Cursor(self._source, self._start, block), GrowingArray()
        buffer.reserve(min(block, self._source.size or 0, _GUESS[0] * _GUESS[1]) // _GUESS[0])
        counts = np.full(_NUMBERS, -1, np.int64)
        counts[[number for number in self._streams if 0 <= number < _NUMBERS]] = 0
        other_streams: Counter[str] = Counter()
        damage: Damage | None = None
        begin = self._start
        try:
            while self._add_next(cursor, buffer, other_streams):
                self._add_similar(cursor, buffer, counts)
                if cursor.at - begin >= block:
                    yield buffer.piece()
                    begin = cursor.at
        except Damage as original:
            damage = Damage(original.what, original.offset)  # a copy without frames, which would keep the file open
        yield buffer.piece()
        for number, stream in self._streams.items():
            if number != self._number and 0 <= number < _NUMBERS and counts[number]:
                other_streams[stream["type"]] += int(counts[number])
        self.metadata["other_packets"] = dict(other_streams)
        if damage is not None:
            raise damage

    def _add_next(self, cursor: Cursor, buffer: GrowingArray, other_streams: Counter[str]) -> bool:
        """Process the next packet of any stream, and return False at the end."""
        place, end = cursor.at, self._table if self._table > 0 else None
        if end is not None and place >= end:
            return False
        entry = cursor.take(ENTRY.size)
        if end is None and not entry.size:
            return False
        if entry.size < ENTRY.size:
            raise Damage("the file ends before its table of packets" if end else "the file ends in a packet", place)
        stream, size = ENTRY.unpack(entry.data)
        if stream not in self._streams:
            raise Damage(f"a packet of stream {stream}, which the header does not list", place)
        if not 0 <= size <= LIMIT or (end is not None and place + ENTRY.size + size > end):
            raise Damage(f"a packet of {size} bytes extends beyond the table of packets or the limit", place)
        data = cursor.take(size)
        if data.size < size:
            raise Damage(f"the file ends in a packet: it has {data.size} of {size} bytes", place)
        if stream == self._number:
            self._add(buffer, place, *self._packets.events(data, place))
        else:
            other_streams[self._streams[stream]["type"]] += 1
        return True

    def _add(self, buffer: GrowingArray, place: int, plain: bytes, start: int, count: int) -> None:
        """Add the events of one packet."""
        buffer.reserve(count)
        columns = buffer.t, buffer.x, buffer.y, buffer.p
        x, y, ordered = self._split(np.frombuffer(plain, np.uint8), start, count, buffer.used, *columns)
        if max(x, y) > self._highest:
            raise Damage("a packet has an event at a negative position", place)
        buffer.commit([buffer.used], [place], buffer.used + count, (x, y), ordered)

    def _add_similar(self, cursor: Cursor, buffer: GrowingArray, counts: npt.NDArray[np.int64]) -> None:
        """Add the next packets that begin like the packet before, as long as the buffer and the columns suffice."""
        if not self._packets.is_known:
            return
        place, data = cursor.at, cursor.buffered
        data = data[: self._table - place] if self._table > 0 else data[:]
        data.flags.writeable = False
        capacity = min(data.size // ENTRY.size, _MOST)
        begins, places = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
        pattern = aedat4_kernels.Pattern(self._number, self._packets.head, self._packets.lead, self._highest)
        columns = buffer.t, buffer.x, buffer.y, buffer.p
        used, n_packets, n, highest, ordered = self._walk(
            data, counts, pattern, self._plain, begins, places, buffer.used, columns
        )
        cursor.take(used)
        buffer.commit(begins[:n_packets].tolist(), (place + places[:n_packets]).tolist(), n, highest, ordered)


class Header(NamedTuple):
    """Content of a header.

    Attributes:
        compression: one of `COMPRESSIONS`.
        table: byte at which the table of packets begins, -1 without a table.
        streams: properties of each stream, by its number.
    """

    compression: str
    table: int
    streams: dict[int, dict[str, Any]]


def read_header(data: bytes) -> Header:
    """Read the FlatBuffer `IOHE`.

    Raises:
        Malformed: the data are not such a buffer.
    """
    table = FlatTable(data, b"IOHE")
    compression = table.number(0, I32, 0)
    if not 0 <= compression < len(COMPRESSIONS):
        raise Malformed(f"unknown compression {compression}")
    start, count = table.vector(2, 1)
    return Header(COMPRESSIONS[compression], table.number(1, I64, -1), _streams(data[start : start + count]))


def _streams(info: bytes) -> dict[int, dict[str, Any]]:
    """Return the properties of the streams in the XML."""
    if b"<!" in info:
        raise Malformed("its list of streams is not plain XML")
    try:
        nodes = ElementTree.fromstring(info).findall("./node[@name='outInfo']/node")
        streams = {int(node.get("name", "")): _stream(node) for node in nodes}
    except Malformed:
        raise
    except (ElementTree.ParseError, ValueError) as error:
        raise Malformed(f"its list of streams cannot be read ({error})") from None
    return streams


def _stream(node: ElementTree.Element) -> dict[str, Any]:
    kind = node.findtext("./attr[@key='typeIdentifier']", "")
    stream: dict[str, Any] = {"type": TYPES.get(kind, kind)}
    sizes = {key: node.findtext(f"./node[@name='info']/attr[@key='{key}']") for key in ("sizeX", "sizeY", "source")}
    if sizes["sizeX"] is not None and sizes["sizeY"] is not None:
        width, height = int(sizes["sizeX"]), int(sizes["sizeY"])
        if not (1 <= width <= 1 << 15 and 1 <= height <= 1 << 15):
            raise Malformed(f"its sensor is {width}x{height}, expected 1x1 to 32768x32768")
        stream |= {"width": width, "height": height}
    return stream | ({"source": sizes["source"]} if sizes["source"] else {})


PACKET = 1 << 13
"""Largest number of events in a packet."""
LIMITS = Limits(0, 1 << 15)
"""Range of the writer; positions are int16."""

_ROW = np.dtype(
    {
        "names": ["fields", "place", "stream", "size", "events", "start", "stop"],
        "formats": ["<i4", "<i8", "<i4", "<i4", "<i8", "<i8", "<i8"],
        "offsets": [0, 8, 16, 20, 24, 32, 40],
        "itemsize": 48,
    }
)
"""Record of a packet in the table at the end: the distance back to the list of fields, and the fields."""
_HEADER = Struct("<II4sHHHHHHiiqII")
_HEAD_OF_TABLE = 14 + 32
"""Offset of the field in `_HEADER` that states the offset of the table, from the beginning of the file."""
_VECTOR = Struct("<II4sHHHHiII")
"""Bytes before the items, in a FlatBuffer whose root table has a single field: a list of items."""
_FIELDS = Struct("<7H")
_STREAM = (
    '<dv version="2.0"><node name="outInfo" path="/mainloop/Recorder/outInfo/">'
    '<node name="0" path="/mainloop/Recorder/outInfo/0/">'
    '<attr key="compression" type="string">{compression}</attr>'
    '<attr key="originalModuleName" type="string">neuro</attr>'
    '<attr key="originalOutputName" type="string">events</attr>'
    '<attr key="typeDescription" type="string">Array of events (polarity ON/OFF).</attr>'
    '<attr key="typeIdentifier" type="string">EVTS</attr>'
    '<node name="info" path="/mainloop/Recorder/outInfo/0/info/">'
    '<attr key="sizeX" type="int">{width}</attr><attr key="sizeY" type="int">{height}</attr>'
    '<attr key="source" type="string">neuro</attr></node></node></node></dv>'
)


def write(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as AEDAT 4 with one stream of events, compressed with LZ4, without metadata.

    Each FlatBuffer has a fixed form, so it is written directly: the size, the offset of the root table, four letters
    for the kind, the table's own list of fields, the table, and its items. Numbers are aligned to multiples of their
    size, as verifiers of FlatBuffers require.

    Source: the schemas ``ioheader.fbs``, ``events.fbs`` and ``file_data_table.fbs`` of iniVation's dv-processing.
    """
    number, pack = _packer()
    rows: list[tuple[int, int, int, int, int]] = []
    place = 0
    with growing(path.open("wb")) as append:
        for n_before, events in in_order(parts):
            if not place:
                append(head := MAGIC + new_header(number, *events.sensor_size))
                place = len(head)
            LIMITS.check(events, n_before)
            for k in range(0, len(events), PACKET):
                part = events[k : k + PACKET]
                data = pack(packet(part))
                append(ENTRY.pack(0, len(data)) + data)
                rows.append((place + ENTRY.size, len(data), len(part), int(part.t[0]), int(part.t[-1])))
                place += ENTRY.size + len(data)
        append(pack(_packet_table(rows)))
    with path.open("r+b") as file:
        file.seek(_HEAD_OF_TABLE)
        file.write(np.int64(place).tobytes())


def _packer() -> tuple[int, Callable[[bytes], bytes]]:
    """Return the number of the compression in the header, and the compressing function."""
    return 1, partial(lz4.frame.compress, store_size=False)


def packet(events: Events) -> bytes:
    """Return an uncompressed packet."""
    records = np.zeros(len(events), RECORD)
    for name in "txyp":
        records[name] = getattr(events, name)
    return _vector(b"EVTS", len(events), records.tobytes())


def new_header(compression: int, width: int, height: int) -> bytes:
    """Return the FlatBuffer `IOHE`, without the offset of the table, which `write` fills in at the end."""
    text = _STREAM.format(compression=("NONE", "LZ4")[compression], width=width, height=height).encode()
    padded = text + bytes(8 - len(text) % 8)
    size, fields = _HEADER.size - 4 + len(padded), (10, 20, 4, 8, 16)
    return _HEADER.pack(size, 20, b"IOHE", *fields, 0, 12, compression, -1, 4, len(text)) + padded


def _vector(kind: bytes, count: int, items: bytes) -> bytes:
    """Return a FlatBuffer whose root table has one field, a list."""
    return _VECTOR.pack(_VECTOR.size - 4 + len(items), 16, kind, 6, 8, 4, 0, 8, 4, count) + items


def _packet_table(rows: list[tuple[int, int, int, int, int]]) -> bytes:
    """Return the FlatBuffer `FTAB`: a table for each packet. All tables share a list of fields."""
    n = len(rows)
    fields = _VECTOR.size + 4 * n
    begin = (fields + _FIELDS.size + 7) // 8 * 8
    packets = np.zeros(n, _ROW)
    places = begin + _ROW.itemsize * np.arange(n)
    packets["fields"] = places - fields
    for name, column in zip(("place", "size", "events", "start", "stop"), zip(*rows, strict=True), strict=False):
        packets[name] = column
    offsets = (places - (_VECTOR.size + 4 * np.arange(n))).astype("<u4")
    inner = offsets.tobytes() + _FIELDS.pack(14, _ROW.itemsize, 8, 16, 24, 32, 40)
    return _vector(b"FTAB", n, inner + bytes(begin - _VECTOR.size - len(inner)) + packets.tobytes())


AEDAT4 = Format(
    "aedat4",
    "AEDAT 4",
    (".aedat4",),
    lambda head: head.startswith(MAGIC),
    Aedat4,
    write,
    holds=LIMITS.holds,
    grows=True,
)
"""AEDAT 4, read and written."""
