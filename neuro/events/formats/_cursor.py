"""Going through a file from front to back, a few bytes at a time, whatever its blocks are."""

from __future__ import annotations

import numpy as np

from neuro.events.source import Bytes, Source


class Cursor:
    """Takes the bytes of a source one after the other.

    Args:
        source: where they come from.
        start: first byte.
        block: bytes to hold at a time.

    Attributes:
        at: the next byte.
    """

    def __init__(self, source: Source, start: int, block: int) -> None:
        self.at = start
        self._blocks = source.blocks(start, block)
        self._held: Bytes = np.zeros(0, np.uint8)
        self._used = 0

    @property
    def held(self) -> Bytes:
        """What comes next, as far as it is read."""
        return self._held[self._used :]

    def take(self, count: int) -> Bytes:
        """The next ``count`` bytes; fewer only at the end of the file."""
        if self._held.size - self._used < count:
            self._fill(count)
        taken = self._held[self._used : self._used + count]
        self._used += taken.size
        self.at += taken.size
        return taken

    def _fill(self, count: int) -> None:
        parts = [self._held[self._used :]]
        missing = count - parts[0].size
        while missing > 0 and (more := next(self._blocks, None)) is not None:
            parts.append(more[1])
            missing -= more[1].size
        parts = [part for part in parts if part.size]
        self._held = parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0, np.uint8), *parts])
        self._used = 0
