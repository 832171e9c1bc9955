"""The events of one packet of AEDAT 4, which may be packed and laid out in any way that is right."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from struct import Struct, error
from typing import Any

import lz4.frame
import numpy as np

from neuro.events.formats._format import Damage, extra
from neuro.events.source import Bytes

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
            self.head = _plain_head(data[:7].tobytes())
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


def _plain_head(head: bytes) -> bytes:
    """The header of an LZ4 frame that was unpacked, if it says that there are neither checksums nor a length."""
    return head if len(head) == 7 and head[4] & 0b11011111 == 0b01000000 else b""


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
