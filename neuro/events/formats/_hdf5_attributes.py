"""Attributes of HDF5, read so that a damaged file does not stop the program.

HDF5 keeps strings of any length in heaps, and its library goes round without end in a heap whose sizes are damaged. So
such strings are read only where all heaps of the file are whole. Strings of a fixed length, which this library writes,
lie elsewhere.

Source: "HDF5 File Format Specification 3.0", section III.E, "Disk Format: Level 1E - Global Heap".
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from neuro.events.formats._metadata import as_json
from neuro.events.source import Bytes

NEAR = 1 << 25
"""Bytes at the beginning and the end of a file in which heaps are looked for; 32 MiB."""

_HEAP = re.compile(b"GCOL\x01")


def heaps_whole(data: Bytes) -> bool:
    """Whether the heaps of a file that lie near its beginning and end have sizes that add up."""
    near = [data] if data.size <= 2 * NEAR else [data[:NEAR], data[-NEAR:]]
    return all(_whole(part[found.start() :]) for part in near for found in _HEAP.finditer(part.data))


def _whole(heap: Bytes) -> bool:
    """Whether the objects of a heap fill it: 16 bytes and the content each, and the rest as object 0."""
    end = _number(heap, 8)
    if end > heap.size:
        return False
    at = 16
    while end - at >= 16:
        index, size = _number(heap, at) & 0xFFFF, _number(heap, at + 8)
        at += 16 + -(-size // 8) * 8 if index else size
        if index == 0 and size < 16:
            return False
    return at <= end


def _number(data: Bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 8].tobytes(), "little")


def attributes(node: Any, heaps: bool) -> dict[str, Any]:
    """The attributes of a group or dataset that hold numbers or text.

    Args:
        node: an open h5py group or dataset.
        heaps: whether strings of any length may be read.
    """
    import h5py

    found = {}
    for name in node.attrs:
        attribute = h5py.h5a.open(node.id, name.encode())
        fixed = attribute.dtype.kind in "biufSU" and attribute.get_space().get_simple_extent_npoints() < NEAR
        if fixed or (heaps and h5py.check_string_dtype(attribute.dtype) is not None):
            value = node.attrs[name]
            found[name] = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return found


def describe(target: Any, sensor_size: tuple[int, int], metadata: Any) -> None:
    """Put sensor size and metadata into attributes of a group or dataset, once."""
    import h5py

    if "sensor_size" not in target.attrs:
        text = as_json(metadata).encode()
        target.attrs["sensor_size"] = np.array(sensor_size, np.int64)
        target.attrs.create("metadata", text, dtype=h5py.string_dtype("utf-8", len(text)))
