"""The little of FlatBuffers that AEDAT 4 needs: fields of a root table, found by offsets that are all checked.

Source: the FlatBuffers binary format (flatbuffers.dev, "Internals"): a table begins with the signed distance back to
its vtable; that holds its own size, the table's size and an offset for each field, 0 for one that is left out.
"""

from __future__ import annotations

from struct import Struct, error

I32 = Struct("<i")
I64 = Struct("<q")
U16 = Struct("<H")
U32 = Struct("<I")

Buffer = bytes | memoryview


class Malformed(ValueError):
    """An offset leads out of the buffer, or the buffer is of another kind."""


class Table:
    """The root table of a buffer.

    Args:
        data: the buffer, after its size.
        kind: the four letters by which it says what it is.

    Attributes:
        looked: the byte after the last one that was looked at, but for numbers of items.

    Raises:
        Malformed: it is of another kind or too short.
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
