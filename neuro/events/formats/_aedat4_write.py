"""Writing AEDAT 4: a header, packets of events, and the table that says where each is.

The FlatBuffers are written as they lie in memory, since each has one form: the size, the place of the root table, four
letters for the kind, the table's own list of fields, the table, what it points to. Numbers stand at multiples of their
size from the beginning, as verifiers of FlatBuffers ask.

Source: the schemas ``ioheader.fbs``, ``events.fbs`` and ``file_data_table.fbs`` of iniVation's dv-processing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from struct import Struct
from typing import BinaryIO

import numpy as np

from neuro.events._events import Events
from neuro.events.formats._aedat4_packet import RECORD
from neuro.events.formats._write import in_order, refuse

MAGIC = b"#!AER-DAT4.0\r\n"
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
_ENTRY = Struct("<ii")
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
    """Encode as AEDAT 4 with one stream of events; packed with LZ4 where that is installed. Metadata are not kept."""
    number, pack = _packer()
    rows: list[tuple[int, int, int, int, int]] = []
    with path.open("wb") as file:
        for done, events in in_order(parts):
            if not file.tell():
                file.write(MAGIC + _header(number, *events.sensor_size))
            outside = (events.x > LARGEST) | (events.y > LARGEST)
            refuse(events, (events.t < 0) | outside, done, f"t from 0 us on, x and y 0 to {LARGEST}", outside)
            for k in range(0, len(events), PACKET):
                rows.append(_put(file, events[k : k + PACKET], pack))
        place = file.tell()
        file.write(pack(_table(rows)))
        file.seek(_HEAD_OF_TABLE)
        file.write(np.int64(place).tobytes())


def _packer() -> tuple[int, Callable[[bytes], bytes]]:
    """The number of the compression in the header, and what does it."""
    try:
        import lz4.frame
    except ImportError:
        return 0, bytes
    return 1, lambda data: lz4.frame.compress(data, store_size=False)


def _put(file: BinaryIO, events: Events, pack: Callable[[bytes], bytes]) -> tuple[int, int, int, int, int]:
    """Write a packet, and give its row of the table: place behind its entry, bytes, events, first and last time."""
    records = np.zeros(len(events), RECORD)
    for name in "txyp":
        records[name] = getattr(events, name)
    data, place = pack(_vector(b"EVTS", len(events), records.tobytes())), file.tell()
    file.write(_ENTRY.pack(0, len(data)) + data)
    return place + _ENTRY.size, len(data), len(events), int(events.t[0]), int(events.t[-1])


def _header(compression: int, width: int, height: int) -> bytes:
    """The FlatBuffer `IOHE`; the place of the table is written when it is known."""
    text = _STREAM.format(compression=("NONE", "LZ4")[compression], width=width, height=height).encode()
    padded = text + bytes(8 - len(text) % 8)
    size, fields = _HEADER.size - 4 + len(padded), (10, 20, 4, 8, 16)
    return _HEADER.pack(size, 20, b"IOHE", *fields, 0, 12, compression, -1, 4, len(text)) + padded


def _vector(kind: bytes, count: int, items: bytes) -> bytes:
    """A FlatBuffer whose root table has one field, a list."""
    return _VECTOR.pack(_VECTOR.size - 4 + len(items), 16, kind, 6, 8, 4, 0, 8, 4, count) + items


def _table(rows: list[tuple[int, int, int, int, int]]) -> bytes:
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
