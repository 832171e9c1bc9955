"""Whether the texts of a third-party HDF5 file are in it: if not, HDF5 reads on for ever, or beyond the file.

Source: HDF5 File Format Specification 3.0, III.E, "Disk Format: Level 1E - Global Heap".
"""

from __future__ import annotations

from typing import Any

import numpy as np

_SAID = np.dtype([("length", "<u4"), ("heap", "<u8"), ("index", "<u4")])
"""What a data set holds of a text."""


class Texts:
    """The heaps in which a file keeps texts.

    Args:
        content: of the file.

    Attributes:
        whole: whether no heap ends elsewhere than it says.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._lengths: dict[tuple[int, int], int] = {}
        at, self.whole = content.find(b"GCOL"), True
        while at >= 0 and self.whole:
            self.whole = self._add(at)
            at = content.find(b"GCOL", at + 4)

    def _add(self, at: int) -> bool:
        """Take up the heap at a place; whether it is whole."""
        content = self._content
        end = at + int.from_bytes(content[at + 8 : at + 16], "little")
        place = at + 16
        while place + 16 <= end <= len(content):
            index = int.from_bytes(content[place : place + 2], "little")
            length = int.from_bytes(content[place + 8 : place + 16], "little")
            self._lengths[at, index] = length
            if index == 0:  # what is free, with its head
                place += length if length else len(content)
            else:
                place += 16 + -(-length // 8) * 8
        return place <= end <= len(content)

    def has(self, data: Any) -> bool:
        """Whether a data set holds texts that are in the file; those of one that is stored in chunks are believed."""
        import h5py

        if h5py.check_string_dtype(data.dtype) is None:
            return False
        begin = data.id.get_offset()
        if begin is None:
            return True
        said = np.frombuffer(self._content[begin : begin + _SAID.itemsize * data.size], _SAID)
        found = ((self._lengths.get((heap, index), -1), n) for n, heap, index in said.tolist())
        return said.size == data.size and all(not n or length >= n for length, n in found)
