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
from functools import partial
from pathlib import Path
from struct import Struct
from typing import Any, NamedTuple

import lz4.frame
import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.formats._aedat4_packet import I32, I64, LIMIT, RECORD, U32, USUAL, FlatTable, Malformed, Packets
from neuro.events.formats._format import Damage, Format, Piece, Size, in_order, outside, refuse
from neuro.events.formats._reading import Cursor, GrowingArray, growing
from neuro.events.source import Source

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
        from neuro.events.formats._aedat4_kernels import split, walk

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
        self._packets, self._split, self._walk = Packets(packed), split, walk
        self._plain = np.empty(USUAL, np.uint8)
        wanted = streams[self._wanted]
        self.sensor_size: Size | None = (wanted["width"], wanted["height"]) if "width" in wanted else None
        self._highest = np.iinfo(np.int16 if self.sensor_size is None else np.uint16).max
        named = {str(number): stream for number, stream in streams.items()}
        self.metadata: dict[str, Any] = {"compression": packed, "streams": named}

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        cursor, held = Cursor(self._source, self._start, block), GrowingArray()
        held.room(min(block, self._source.size or 0, _GUESS[0] * _GUESS[1]) // _GUESS[0])
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
        held.room(count)
        columns = held.t, held.x, held.y, held.p
        x, y, ordered = self._split(np.frombuffer(plain, np.uint8), start, count, held.used, *columns)
        if max(x, y) > self._highest:
            raise Damage("a packet has an event at a negative place", place)
        held.added([held.used], [place], held.used + count, (x, y), ordered)

    def _alike(self, cursor: Cursor, held: GrowingArray, counts: npt.NDArray[np.int64]) -> None:
        """Add the packets that come next and are like those before, as far as they are read and there is room."""
        if not self._packets.alike:
            return
        place, data = cursor.at, cursor.held
        data = data[: self._table - place] if self._table > 0 else data[:]
        data.flags.writeable = False
        room = min(data.size // ENTRY.size, _MOST)
        begins, places = np.empty(room, np.int64), np.empty(room, np.int64)
        like = self._wanted, self._packets.head, self._packets.lead, self._highest
        columns = held.t, held.x, held.y, held.p
        taken = self._walk(data, counts, *like, self._plain, begins, places, held.used, *columns)
        used, found, n, highest, ordered = taken
        cursor.take(used)
        held.added(begins[:found].tolist(), (place + places[:found]).tolist(), n, highest, ordered)


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
LARGEST = (1 << 15) - 1
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
            off = outside(events, LARGEST + 1, LARGEST + 1)
            refuse(events, (events.t < 0) | off, done, f"t from 0 us on, x and y 0 to {LARGEST}", off)
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


def _holds(events: Events, last: int | None) -> npt.NDArray[np.bool_]:
    return (events.t >= 0) & ~outside(events, LARGEST + 1, LARGEST + 1)


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
    "aedat4", "AEDAT 4", (".aedat4",), lambda head: head.startswith(MAGIC), Aedat4, write, holds=_holds, grows=True
)
"""Read and written."""
