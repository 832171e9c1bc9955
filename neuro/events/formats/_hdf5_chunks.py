"""Whether what an HDF5 file holds of a dataset can be all of it.

HDF5 itself takes a chunk as it is that is too short, or of which a damaged mask says that it is not packed: the rest
is whatever is in memory.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

from neuro.events.formats._format import Damage, extra

ECF = 36559
"""Prophesee's registered filter number."""

SWELL = 1100
"""Most bytes that one byte of a file unpacks to; 1032 of gzip, which is the most that HDF5's own filters reach."""

FAILURES = (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError, OverflowError)
"""What h5py raises for a damaged file."""

SHUFFLE, FLETCHER = 2, 3
"""Filters that keep the length, but for a check sum of 4 bytes of the latter."""


class Padded(io.BytesIO):
    """Bytes as a file; what HDF5 asks for beyond its end is 0, since h5py leaves there what was in memory."""

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer."""
        count = super().readinto(buffer)
        buffer[count:] = bytes(len(buffer) - count)
        return count


def unpackable(dataset: Any) -> None:
    """Refuse a dataset that is packed in a way which is not known here.

    Args:
        dataset: an open h5py dataset.

    Raises:
        Damage: it is.
    """
    import h5py

    plist = dataset.id.get_create_plist()
    for k in range(plist.get_nfilters()):
        number = plist.get_filter(k)[0]
        if h5py.h5z.filter_avail(number):
            continue
        if number == ECF:
            text = "is packed with Prophesee's ECF filter, which HDF5 alone cannot unpack"
            raise Damage(f"{dataset.name} {text}: use the RAW file, or export it with Metavision's tools", None)
        extra("hdf5plugin", f"{dataset.name}, packed with HDF5 filter {number},")
        if not h5py.h5z.filter_avail(number):
            raise Damage(f"{dataset.name} is packed with HDF5 filter {number}, which is not known", None)


def believable(dataset: Any) -> None:
    """Refuse a dataset whose length cannot be: it would fill the memory.

    Args:
        dataset: an open h5py dataset.

    Raises:
        Damage: it is longer than what is stored of it can be when unpacked, or cannot be looked at.
    """
    try:
        stored = min(dataset.id.get_storage_size(), dataset.file.id.get_filesize())
        size = dataset.size * dataset.dtype.itemsize
    except FAILURES as error:
        raise Damage(f"{dataset.name} cannot be read: {one_line(error)}", None) from None
    if size > SWELL * stored:
        raise Damage(f"{dataset.name} has {dataset.size} items, which {stored} bytes cannot hold", None)


def chunks_whole(dataset: Any, first: int, last: int) -> None:
    """Refuse chunks that are not packed and not as long as they should be.

    Args:
        dataset: an open h5py dataset.
        first: number of an item along the first axis.
        last: number after the last item.

    Raises:
        ValueError: there is one.
    """
    if dataset.chunks is None:
        return
    fault = _fault(dataset)
    long, *wide = dataset.chunks
    rows = range(first // long * long, last, long)
    for at in itertools.product(rows, *map(range, itertools.repeat(0), dataset.shape[1:], wide)):
        if text := fault(dataset.id.get_chunk_info_by_coord(at)):
            raise ValueError(text)


def chunks_check(dataset: Any) -> Callable[[int, int], None]:
    """As `chunks_whole`, for a dataset that is read in many parts.

    To find one chunk HDF5 goes through all before it, so all are looked at once, where nothing is damaged.
    """
    if dataset.chunks is None:
        return lambda first, last: None
    fault, faults = _fault(dataset), []
    try:
        dataset.id.chunk_iter(lambda chunk: faults.append(text) if (text := fault(chunk)) else None)
    except FAILURES:
        return partial(chunks_whole, dataset)
    return partial(chunks_whole, dataset) if faults else lambda first, last: None


def _fault(dataset: Any) -> Callable[[Any], str]:
    """Tells what is wrong with the length of a chunk of a dataset, "" where nothing is."""
    filters = dataset.id.get_create_plist()
    kinds = [filters.get_filter(k)[0] for k in range(filters.get_nfilters())]
    size = math.prod(dataset.chunks) * dataset.dtype.itemsize

    def fault(chunk: Any) -> str:
        used = [kind for k, kind in enumerate(kinds) if not chunk.filter_mask >> k & 1]
        expected = size + 4 * used.count(FLETCHER)
        if chunk.byte_offset is not None and set(used) <= {SHUFFLE, FLETCHER} and chunk.size != expected:
            return f"a chunk of {dataset.name} has {chunk.size} bytes, expected {expected}"
        return ""

    return fault


def place(dataset: Any, item: int) -> int | None:
    """Where the (first) chunk of an item begins in the file, None where that is not known or beyond its end."""
    try:
        found: int | None = dataset.id.get_chunk_info_by_coord((item, *(0 for _ in dataset.shape[1:]))).byte_offset
        return found if found is not None and found < dataset.file.id.get_filesize() else None
    except FAILURES:
        return None


def one_line(error: BaseException) -> str:
    """The text of an error."""
    return " ".join(str(error).split())
