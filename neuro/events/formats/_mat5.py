"""The variables of MAT files of versions 4 and 5 (to 7), from their bytes.

SciPy reads these too, but ends the program with a segmentation fault on some damaged files. Numbers become arrays
(flat, in the file's order), structs mappings, cells and arrays of structs lists; text, sparse matrices, objects and
functions are left out.

Version 5: 128 bytes of header, then elements of a type and a size (or both in four bytes, with up to four bytes of
content), padded to 8 bytes; a matrix is an element of elements: flags and class, shape, name, content; compressed
elements are zlib streams. Version 4: per variable five int32 (kind, rows, columns, whether complex, length of the
name), the name, the numbers.

Source: MathWorks, "MAT-File Format", R2024b, chapter 1.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from struct import Struct
from typing import Any

import numpy as np

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, COMPRESSED = 14, 15
CELL, STRUCT = 1, 2
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
OLD = ("f8", "f4", "i4", "i2", "u2", "u1")
"""Types of version 4 by the tens digit of the kind."""

DEPTH = 8
"""Structs and cells within each other that are read; what lies deeper is left out."""
ITEMS = 1000
"""Most cells, structs or fields that are read of one."""
UNPACKED = 1 << 32
"""Most bytes that a compressed variable may have."""


def variables(data: Any) -> dict[str, Any]:
    """The variables of a file by their names.

    Args:
        data: its bytes.

    Raises:
        ValueError: it is damaged.
    """
    data = memoryview(data)
    mark = bytes(data[126:128])
    if mark in (b"IM", b"MI"):
        order = "<" if mark == b"IM" else ">"
        return dict(_matrix(content, order, DEPTH) for kind, content in _elements(data[128:], order) if kind == MATRIX)
    return dict(_old(data))


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Types and contents one after the other; compressed ones are unpacked."""
    at = 0
    tag = Struct(order + "II")
    while at < len(data):
        kind, size = tag.unpack(data[at : at + 8].tobytes().ljust(8, b"\0"))
        start = at + 8
        if kind >> 16:
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
        content = data[start : start + size]
        if len(content) < size or len(data) - at < 8:
            raise ValueError("an element ends beyond the file or what it lies in")
        if kind == COMPRESSED:
            yield from _elements(memoryview(_unpacked(content)), order)
            at = start + size
        else:
            yield kind, content
            at = start + size + (-size % 8 if start == at + 8 else 4 - size)


def _unpacked(content: memoryview) -> bytes:
    try:
        return zlib.decompressobj().decompress(content, UNPACKED)
    except zlib.error as error:
        raise ValueError(f"a compressed variable is damaged: {error}") from None


def _matrix(content: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix; None for what is left out."""
    parts = _elements(content, order)
    try:
        flags, shape, name = (next(parts)[1] for _ in range(3))
    except StopIteration:
        if not len(content):
            return "", np.zeros(0)
        raise ValueError("a variable has no name or no shape") from None
    if len(flags) < 4 or len(shape) % 4:
        raise ValueError("a variable has no class or no shape")
    word = int(np.frombuffer(flags[:4], order + "u4")[0])
    count = math.prod(np.frombuffer(shape, order + "i4").tolist())
    return bytes(name).decode("utf-8", "replace"), _value(word & 0xFF, bool(word & 0x800), count, parts, order, depth)


def _value(kind: int, complex_: bool, count: int, parts: Any, order: str, depth: int) -> Any:
    if kind in CLASSES and not complex_:
        stored, content = next(parts, (0, memoryview(b"")))
        if stored not in TYPES:
            raise ValueError(f"numbers of type {stored}")
        dtype = np.dtype(order + TYPES[stored])
        if count < 0 or len(content) != count * dtype.itemsize:
            raise ValueError(f"a variable has {len(content)} bytes, expected {count} numbers of {dtype.itemsize}")
        return np.frombuffer(content, dtype).astype(CLASSES[kind], copy=False)
    if kind == CELL and depth:
        return [_matrix(cell, order, depth - 1)[1] for (_, cell), _ in zip(parts, range(ITEMS), strict=False)]
    if kind == STRUCT and depth:
        return _structs(parts, order, depth - 1)
    return None


def _structs(parts: Any, order: str, depth: int) -> Any:
    """A mapping, or a list of them: length of a name, names, then the fields of one after the other."""
    try:
        width, names = (next(parts)[1] for _ in range(2))
    except StopIteration:
        raise ValueError("a struct has no fields") from None
    length = int.from_bytes(width, "little" if order == "<" else "big")
    if not 1 <= length <= 64:
        raise ValueError(f"a struct has names of {length} bytes")
    told = [bytes(names[at : at + length]).split(b"\0")[0] for at in range(0, len(names), length)]
    keys = [name.decode("utf-8", "replace") for name in told]
    values = [_matrix(field, order, depth)[1] for (_, field), _ in zip(parts, range(ITEMS), strict=False)]
    found = [dict(zip(keys, values[at : at + len(keys)], strict=False)) for at in range(0, len(values), len(keys) or 1)]
    return found[0] if len(found) == 1 else found


def _old(data: memoryview) -> Iterator[tuple[str, Any]]:
    """Variables of version 4."""
    at = 0
    while at < len(data):
        head = data[at : at + 20].tobytes().ljust(20, b"\xff")
        order = "<" if 0 <= int.from_bytes(head[:4], "little", signed=True) < 1000 else ">"
        kind, rows, columns, complex_, length = np.frombuffer(head, order + "i4").tolist()
        number = kind // 10 % 10
        if not (0 <= kind < 2000 and number < len(OLD) and min(rows, columns) >= 0 and 1 <= length <= 256):
            raise ValueError("a variable has an impossible header")
        start = at + 20 + length
        size = rows * columns * np.dtype(OLD[number]).itemsize
        content = data[start : start + size]
        at = start + size * (2 if complex_ else 1)
        if len(content) < size or at > len(data):
            raise ValueError("a variable ends beyond the file")
        name = bytes(data[start - length : start]).split(b"\0")[0].decode("latin-1")
        plain = kind % 10 == 0 and not complex_
        yield name, np.frombuffer(content, order + OLD[number]) if plain else None
