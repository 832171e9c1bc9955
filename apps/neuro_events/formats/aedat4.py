"""The events of one packet of AEDAT 4, which may be packed and laid out in any way that is right."""

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
"""Most packets are not longer when unpacked."""
LIMIT = 1 << 28
"""No packet is longer, packed or unpacked; a damaged length must not fill the memory."""
_SWELL = 4
"""Few packets are more times longer when unpacked."""


class Packets:
    """Finds the events of packets, and learns how these begin, by which `_aedat4_kernels` knows those that are alike.

    Args:
        packed: "none", "LZ4" or "Zstandard".

    Attributes:
        head: how a packet begins, as far as it is known to be an LZ4 frame without checksums; empty if it is none.
        lead: how an unpacked one begins, between its size and the number of events; empty if that is not known.
    """

    def __init__(self, packed: str) -> None:
        self._packed, self._unpack = packed, _unpacker(packed)
        self.head, self.lead = b"", b""

    @property
    def alike(self) -> bool:
        """Whether enough is known for the kernel."""
        return bool(self.lead) and (self._packed == "none" or bool(self.head))

    def events(self, data: Bytes, place: int) -> tuple[bytes, int, int]:
        """The unpacked packet, the byte of it at which the events begin, and how many there are.

        Args:
            data: the packet.
            place: byte at which it begins, for messages.

        Raises:
            Damage: it cannot be unpacked, or is not made as it should be.
        """
        plain = self._unpack(data, place)
        if self._packed == "LZ4":
            head = data[:7].tobytes()  # used only where it says that there are neither checksums nor a length
            self.head = head if len(head) == 7 and head[4] & 0b11011111 == 0b01000000 else b""
        start = 4 + len(self.lead) + 4
        try:
            if len(plain) < 12 or U32.unpack_from(plain)[0] != len(plain) - 4:
                raise Malformed(f"its {len(plain)} bytes are not as many as it says")
            if self.lead and len(plain) >= start and plain.startswith(self.lead, 4):
                count = U32.unpack_from(plain, start - 4)[0]
                if start + count * RECORD.itemsize <= len(plain):
                    return plain, start, count
            table = FlatTable(memoryview(plain)[4:], b"EVTS")
            start, count = table.vector(0, RECORD.itemsize)
        except Malformed as error:
            raise Damage(f"a packet is damaged: {error}", place) from None
        # Only where all offsets stand before the events do bytes that are the same there mean the same.
        self.lead = plain[4:start] if table.looked <= start - 4 else b""
        return plain, 4 + start, count


def _unpacker(packed: str) -> Callable[[Bytes, int], bytes]:
    """A function that unpacks the packet that stands at a place.

    It raises `Damage` for one that cannot be unpacked.
    """
    if packed == "none":
        return lambda data, place: data.tobytes()
    if packed == "LZ4":
        plain, failure = partial(_lz4, lz4.frame.create_decompression_context()), RuntimeError
    else:
        zstandard = extra("zstandard", "AEDAT 4 with Zstandard packets")
        plain, failure = partial(_zstandard, zstandard), zstandard.ZstdError

    def unpack(data: Bytes, place: int) -> bytes:
        try:
            unpacked: bytes = plain(data)
        except (failure, EOFError, ValueError, MemoryError):
            raise Damage(f"a packet of {data.size} bytes is no {packed} data", place) from None
        return unpacked

    return unpack


def _lz4(context: Any, data: Bytes) -> bytes:
    """Unpacks a frame; with enough room at once this takes half the time of the package's own function."""
    room, used = _SWELL * data.size, 0
    parts = []
    ended = False
    try:
        while not ended:
            part, taken, ended = lz4.frame.decompress_chunk(context, data[used:], max_length=room)
            if not (ended or part or taken):
                raise EOFError
            parts.append(part)
            used, room = used + taken, 2 * room
            if sum(map(len, parts)) > LIMIT:
                raise ValueError
    finally:
        if not ended:
            lz4.frame.reset_decompression_context(context)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _zstandard(module: Any, data: Bytes) -> bytes:
    """Unpacks a frame, which need not tell its length, and not without limit."""
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
    """An offset leads out of the buffer, or the buffer is of another kind."""


class FlatTable:
    """The root table of a buffer.

    Args:
        data: the buffer, after its size.
        kind: the four letters by which it says what it is.

    Attributes:
        looked: the byte after the last one that was looked at, but for numbers of items.

    Raises:
        Malformed: it is of another kind or too short.

    The little of FlatBuffers that AEDAT 4 needs: fields of a root table, found by offsets that are all checked.

    Source: the FlatBuffers binary format (flatbuffers.dev, "Internals"): a table begins with the signed distance back
    to its vtable; that holds its own size, the table's size and an offset for each field, 0 for one that is left out.
    """

    def __init__(self, data: Buffer, kind: bytes) -> None:
        self._data = data
        self.looked = 8
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
        self.looked = max(self.looked, at + kind.size)
        return value

    def _place(self, field: int) -> int | None:
        if field >= self._fields:
            return None
        offset = self._read(U16, self._vtable + 4 + 2 * field)
        return self._at + offset if offset else None

    def number(self, field: int, kind: Struct, default: int) -> int:
        """A field that is a number.

        Args:
            field: its index in the schema.
            kind: how it is written.
            default: its value where it is left out.
        """
        place = self._place(field)
        return default if place is None else self._read(kind, place)

    def vector(self, field: int, width: int) -> tuple[int, int]:
        """Where the items of a field begin and how many there are; (0, 0) where it is left out.

        Args:
            field: its index in the schema.
            width: bytes of an item.

        Raises:
            Malformed: the items reach beyond the buffer.
        """
        place = self._place(field)
        if place is None:
            return 0, 0
        start = place + self._read(U32, place)
        looked = self.looked
        count = self._read(U32, start)
        self.looked = looked
        if start + 4 + count * width > len(self._data):
            raise Malformed(f"{count} items of {width} bytes do not fit in its {len(self._data)} bytes")
        return start + 4, count


MAGIC = b"#!AER-DAT4.0\r\n"
COMPRESSIONS = ("none", "LZ4", "LZ4", "Zstandard", "Zstandard")
"""By the number in the header; LZ4 and Zstandard each have a thorough variant that is read alike."""

HEADER_LIMIT = 1 << 24
"""No header is longer; a damaged length must not fill the memory."""
TYPES = {"EVTS": "events", "FRME": "frames", "IMUS": "imus", "TRIG": "triggers"}

ENTRY = Struct("<ii")
"""Before each packet: the stream, and how many bytes the packet has."""
_GUESS = 8, 1 << 24
"""Bytes of a packed event, about, and events at most, by which room is made at once."""
_NUMBERS = 256
"""Streams with lower numbers are counted in the kernel."""
_MOST = 1 << 12
"""Packets with events that are decoded at once, at most."""


class Aedat4:
    """An open AEDAT 4 file.

    ``metadata`` has ``compression``, ``streams`` (number to type, sensor and source) and, once all is read,
    ``other_packets``: how many of each other type.
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
            raise Damage(f"the header has {size} bytes, which the file has not", len(MAGIC))
        try:
            packed, self._table, streams = read_header(header)
        except Malformed as error:
            raise Damage(f"the header is damaged: {error}", len(lead)) from None
        self._streams = streams
        events = [number for number, stream in streams.items() if stream["type"] == "events"]
        if not events:
            raise Damage("the header lists no stream of events", len(lead))
        self._wanted = events[0]
        self._packets, self._split, self._walk = Packets(packed), aedat4_kernels.split, aedat4_kernels.walk
        self._plain = np.empty(USUAL, np.uint8)
        wanted = streams[self._wanted]
        self.sensor_size: Size | None = (wanted["width"], wanted["height"]) if "width" in wanted else None
        self._highest = np.iinfo(np.int16 if self.sensor_size is None else np.uint16).max
        named = {str(number): stream for number, stream in streams.items()}
        self.metadata: dict[str, Any] = {"compression": packed, "streams": named}

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        cursor, held = Cursor(self._source, self._start, block), GrowingArray()
        held.reserve(min(block, self._source.size or 0, _GUESS[0] * _GUESS[1]) // _GUESS[0])
        counts = np.full(_NUMBERS, -1, np.int64)
        counts[[number for number in self._streams if 0 <= number < _NUMBERS]] = 0
        others: Counter[str] = Counter()
        damage: Damage | None = None
        begin = self._start
        try:
            while self._one(cursor, held, others):
                self._alike(cursor, held, counts)
                if cursor.at - begin >= block:
                    yield held.piece()
                    begin = cursor.at
        except Damage as found:
            damage = Damage(found.what, found.offset)  # without the frames, which hold the file
        yield held.piece()
        for number, stream in self._streams.items():
            if number != self._wanted and 0 <= number < _NUMBERS and counts[number]:
                others[stream["type"]] += int(counts[number])
        self.metadata["other_packets"] = dict(others)
        if damage is not None:
            raise damage

    def _one(self, cursor: Cursor, held: GrowingArray, others: Counter[str]) -> bool:
        """Take one packet of any kind; whether there was one."""
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
            raise Damage(f"a packet of {size} bytes, which do not fit before the table of packets", place)
        data = cursor.take(size)
        if data.size < size:
            raise Damage(f"the file ends in a packet: it has {data.size} of {size} bytes", place)
        if stream == self._wanted:
            self._add(held, place, *self._packets.events(data, place))
        else:
            others[self._streams[stream]["type"]] += 1
        return True

    def _add(self, held: GrowingArray, place: int, plain: bytes, start: int, count: int) -> None:
        """Add the events of one packet."""
        held.reserve(count)
        columns = held.t, held.x, held.y, held.p
        x, y, ordered = self._split(np.frombuffer(plain, np.uint8), start, count, held.used, *columns)
        if max(x, y) > self._highest:
            raise Damage("a packet has an event at a negative place", place)
        held.commit([held.used], [place], held.used + count, (x, y), ordered)

    def _alike(self, cursor: Cursor, held: GrowingArray, counts: npt.NDArray[np.int64]) -> None:
        """Add the packets that come next and are like those before, as far as they are read and there is room."""
        if not self._packets.alike:
            return
        place, data = cursor.at, cursor.buffered
        data = data[: self._table - place] if self._table > 0 else data[:]
        data.flags.writeable = False
        room = min(data.size // ENTRY.size, _MOST)
        begins, places = np.empty(room, np.int64), np.empty(room, np.int64)
        alike = aedat4_kernels.Alike(self._wanted, self._packets.head, self._packets.lead, self._highest)
        columns = held.t, held.x, held.y, held.p
        taken = self._walk(data, counts, alike, self._plain, begins, places, held.used, columns)
        used, found, n, highest, ordered = taken
        cursor.take(used)
        held.commit(begins[:found].tolist(), (place + places[:found]).tolist(), n, highest, ordered)


class Header(NamedTuple):
    """What a header says.

    Attributes:
        compression: a word of `COMPRESSIONS`.
        table: place of the table of packets, -1 without one.
        streams: what is known of each, by its number.
    """

    compression: str
    table: int
    streams: dict[int, dict[str, Any]]


def read_header(data: bytes) -> Header:
    """Read the FlatBuffer `IOHE`.

    Raises:
        Malformed: it is none.
    """
    table = FlatTable(data, b"IOHE")
    compression = table.number(0, I32, 0)
    if not 0 <= compression < len(COMPRESSIONS):
        raise Malformed(f"compression {compression} is not known")
    start, count = table.vector(2, 1)
    return Header(COMPRESSIONS[compression], table.number(1, I64, -1), _streams(data[start : start + count]))


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
    sizes = {key: node.findtext(f"./node[@name='info']/attr[@key='{key}']") for key in ("sizeX", "sizeY", "source")}
    if sizes["sizeX"] is not None and sizes["sizeY"] is not None:
        width, height = int(sizes["sizeX"]), int(sizes["sizeY"])
        if not (1 <= width <= 1 << 15 and 1 <= height <= 1 << 15):
            raise Malformed(f"its sensor is {width}x{height}, expected 1x1 to 32768x32768")
        stream |= {"width": width, "height": height}
    return stream | ({"source": sizes["source"]} if sizes["source"] else {})


PACKET = 1 << 13
"""Events of a packet, at most."""
LIMITS = Limits(0, 1 << 15)
"""Places are int16."""

_ROW = np.dtype(
    {
        "names": ["fields", "place", "stream", "size", "events", "start", "stop"],
        "formats": ["<i4", "<i8", "<i4", "<i4", "<i8", "<i8", "<i8"],
        "offsets": [0, 8, 16, 20, 24, 32, 40],
        "itemsize": 48,
    }
)
"""A packet in the table at the end: the distance back to the list of fields, and the fields."""
_HEADER = Struct("<II4sHHHHHHiiqII")
_HEAD_OF_TABLE = 14 + 32
"""The byte of a file that says where the table begins, in `_HEADER` behind the line."""
_VECTOR = Struct("<II4sHHHHiII")
"""A root table with one field, items: all before these."""
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
    """Encode as AEDAT 4 with one stream of events; packed with LZ4. Metadata are not kept.

    The FlatBuffers are written as they lie in memory, since each has one form: the size, the place of the root table,
    four letters for the kind, the table's own list of fields, the table, what it points to. Numbers stand at multiples
    of their size from the beginning, as verifiers of FlatBuffers ask.

    Source: the schemas ``ioheader.fbs``, ``events.fbs`` and ``file_data_table.fbs`` of iniVation's dv-processing.
    """
    number, pack = _packer()
    rows: list[tuple[int, int, int, int, int]] = []
    place = 0
    with growing(path.open("wb")) as append:
        for done, events in in_order(parts):
            if not place:
                append(head := MAGIC + new_header(number, *events.sensor_size))
                place = len(head)
            LIMITS.check(events, done)
            for k in range(0, len(events), PACKET):
                some = events[k : k + PACKET]
                data = pack(packet(some))
                append(ENTRY.pack(0, len(data)) + data)
                rows.append((place + ENTRY.size, len(data), len(some), int(some.t[0]), int(some.t[-1])))
                place += ENTRY.size + len(data)
        append(pack(_packet_table(rows)))
    with path.open("r+b") as file:
        file.seek(_HEAD_OF_TABLE)
        file.write(np.int64(place).tobytes())


def _packer() -> tuple[int, Callable[[bytes], bytes]]:
    """The number of the compression in the header, and what does it."""
    return 1, partial(lz4.frame.compress, store_size=False)


def packet(events: Events) -> bytes:
    """A packet that is not compressed."""
    records = np.zeros(len(events), RECORD)
    for name in "txyp":
        records[name] = getattr(events, name)
    return _vector(b"EVTS", len(events), records.tobytes())


def new_header(compression: int, width: int, height: int) -> bytes:
    """The FlatBuffer `IOHE`; the place of the table is written when it is known."""
    text = _STREAM.format(compression=("NONE", "LZ4")[compression], width=width, height=height).encode()
    padded = text + bytes(8 - len(text) % 8)
    size, fields = _HEADER.size - 4 + len(padded), (10, 20, 4, 8, 16)
    return _HEADER.pack(size, 20, b"IOHE", *fields, 0, 12, compression, -1, 4, len(text)) + padded


def _vector(kind: bytes, count: int, items: bytes) -> bytes:
    """A FlatBuffer whose root table has one field, a list."""
    return _VECTOR.pack(_VECTOR.size - 4 + len(items), 16, kind, 6, 8, 4, 0, 8, 4, count) + items


def _packet_table(rows: list[tuple[int, int, int, int, int]]) -> bytes:
    """The FlatBuffer `FTAB`: for each packet a table of its own; all have one list of fields."""
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
"""Read and written."""
