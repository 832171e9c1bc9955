"""Events of many packets gathered into one piece, in arrays that grow."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from neuro.events.formats._format import Piece

Kind = TypeVar("Kind", bound=np.generic)


def _longer(old: npt.NDArray[Kind], size: int) -> npt.NDArray[Kind]:
    new = np.empty(size, old.dtype)
    new[: old.size] = old
    return new


class Growing:
    """Gathers the events of packets.

    Attributes:
        t: int64, us; filled up to ``used``, as are the others.
        x, y: uint16, px.
        p: uint8, 1 = ON.
        used: number of events.
    """

    def __init__(self) -> None:
        self._reset(0)

    def _reset(self, room: int) -> None:
        self.t, self.p = np.empty(room, np.int64), np.empty(room, np.uint8)
        self.x, self.y = np.empty(room, np.uint16), np.empty(room, np.uint16)
        self.used = 0
        self._highest = (-1, -1)
        self._ordered = True
        self._begins: list[int] = []
        self._places: list[int | None] = []

    def room(self, count: int) -> None:
        """Make room for so many events after those that are there."""
        needed = self.used + count
        if needed > self.t.size:
            size = max(needed, 2 * self.t.size)
            self.t, self.p = _longer(self.t, size), _longer(self.p, size)
            self.x, self.y = _longer(self.x, size), _longer(self.y, size)

    def added(
        self, begins: Sequence[int], places: Sequence[int | None], used: int, highest: tuple[int, int], ordered: bool
    ) -> None:
        """Say what was filled in.

        Args:
            begins: first event of each packet.
            places: byte at which each begins.
            used: number of events that there are now.
            highest: largest x and y of the new ones.
            ordered: whether time does not run back among them, and from the last one before them.
        """
        if used == self.used:
            return
        self._ordered &= ordered
        self._highest = (max(self._highest[0], highest[0]), max(self._highest[1], highest[1]))
        self._begins += begins
        self._places += places
        self.used = used

    def piece(self) -> Piece:
        """What there is; what comes next begins anew."""
        begins, places, n = np.array(self._begins, np.int64), self._places, self.used

        def place(event: int) -> int | None:
            return places[int(np.searchsorted(begins, event, side="right")) - 1]

        piece = Piece(self.t[:n], self.x[:n], self.y[:n], self.p[:n], self._highest, self._ordered, place)
        self._reset(n)
        return piece
