"""Attributes of HDF5, read so that a damaged file does not stop the program, and the sensor that they tell.

HDF5 keeps strings of any length in heaps, and its library goes round without end in a heap whose sizes are damaged. So
such strings are read only where all heaps of the file are whole. Strings of a fixed length, which this library writes,
lie elsewhere.

The sensor is told by ``sensor_size`` or ``geometry`` (width, height), ``width`` and ``height``, or e2vid's
``sensor_resolution``: height, width and perhaps channels, as the shape of an image. Some have written it the other way
round. So a sensor that stands upright is refused; a file whose events lie off a sensor is refused in any case.

Source: "HDF5 File Format Specification 3.0", section III.E, "Disk Format: Level 1E - Global Heap"; the event packagers
of rpg_e2vid's and its successors' tools (``sensor_resolution`` = ``image.shape``).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from neuro.events.formats._format import Damage, Size
from neuro.events.formats._metadata import as_json, from_json
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


def size_of(told: Mapping[str, Any]) -> Size | None:
    """The sensor that attributes tell, width and height.

    Raises:
        Damage: it is impossible, or `sensor_resolution` may be in either order.
    """
    if "sensor_size" in told:
        size = np.ravel(told["sensor_size"]).tolist()
    elif {"width", "height"} <= told.keys():
        size = [number for key in ("width", "height") for number in np.ravel(told[key]).tolist()[:1]]
    elif "geometry" in told:
        size = [int(number) for number in re.findall(r"\d+", str(told["geometry"]))]
    elif "sensor_resolution" in told:
        size = _resolution(np.ravel(told["sensor_resolution"]).tolist())
    else:
        return None
    if len(size) != 2 or not all(isinstance(n, int) and 1 <= n <= 65536 for n in size):
        raise Damage(f"its sensor is {size}, expected width and height from 1 to 65536", None)
    return size[0], size[1]


def _resolution(told: list[Any]) -> list[Any]:
    """Width and height of height, width and perhaps channels."""
    size = [int(n) if isinstance(n, float) and n.is_integer() else n for n in told[1::-1]]
    if len(told) not in (2, 3) or not all(isinstance(n, int) for n in size):
        raise Damage(f"sensor_resolution is {told}, expected height and width", None)
    width, height = size
    if height > width:
        hint = f"give sensor_size=({height}, {width}) or ({width}, {height}), or --sensor WxH"
        raise Damage(f"sensor_resolution is {told}, height and width or width and height: {hint}", None)
    return size


def metadata_of(told: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as metadata; those that this library wrote as JSON as they were."""
    text = told.get("metadata", "{}")
    rest = {key: value for key, value in told.items() if key not in ("sensor_size", "metadata")}
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in rest.items()}
    return plain | (from_json(text) if isinstance(text, str) else {})


def describe(target: Any, sensor_size: tuple[int, int], metadata: Any) -> None:
    """Put sensor size and metadata into attributes of a group or dataset, once."""
    import h5py

    if "sensor_size" not in target.attrs:
        text = as_json(metadata).encode()
        target.attrs["sensor_size"] = np.array(sensor_size, np.int64)
        target.attrs.create("metadata", text, dtype=h5py.string_dtype("utf-8", len(text)))
