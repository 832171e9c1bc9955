"""The share of a network that a process has: the synapses onto some neurons of each population."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Ints: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class Share:
    """One of several shares of equal size; `WHOLE` is the only one.

    All shares of a network call the methods that join them in the same order.

    Attributes:
        index: which one.
        number: how many there are.
    """

    index: int = 0
    number: int = 1

    def of(self, neurons: int) -> tuple[int, int]:
        """The first of the neurons of a population that are of this share, and the end."""
        each, more = divmod(neurons, self.number)
        first = self.index * each + min(self.index, more)
        return first, first + each + (self.index < more)

    def gather(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values of all shares, in their order."""
        return values

    def total(self, values: Ints) -> Ints:
        """The sum of the values of all shares."""
        found: Ints = self.gather(values[None]).sum(axis=0)
        return found

    def every(self, holds: bool) -> bool:
        """Whether something holds for all shares."""
        return bool(self.gather(np.array([holds])).all())

    def agree(self, make: Callable[[], T]) -> T:
        """What a function gives, if it gives something for every share.

        Raises:
            ModelError: that of the first share for which it raises one.
        """
        return make()


WHOLE = Share()

AT_ONCE = 1 << 20
"""Synapses that are joined at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """The synapses of neighbouring sources, of all shares.

    Attributes:
        sources: the first source, and the end.
        begin: the place of the first of the synapses among all.
        order: which of the gathered ones each is.
        own: those of this share.
        at: where these begin among the gathered ones.
    """

    sources: tuple[int, int]
    begin: int
    order: Ints
    own: slice
    at: int


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The synapses of a projection in the order of their sources, of each share some; all shares ask alike.

    Attributes:
        share: which ones these are.
        row_ends: those of source i are row_ends[i] : row_ends[i + 1].
        delays: of each; None where those of a source are not sorted by delay.
    """

    share: Share
    row_ends: Ints
    delays: NDArray[np.integer[Any]] | None

    def fan_out(self) -> Ints:
        """Synapses of each source, of all shares."""
        return self.share.total(np.diff(self.row_ends))

    def stretches(self) -> Iterator[Stretch]:
        """All synapses in order, some sources at a time."""
        ends = np.concatenate(([0], np.cumsum(self.fan_out())))
        first = 0
        while first < ends.size - 1:
            last = max(first + 1, int(np.searchsorted(ends, ends[first] + AT_ONCE, side="right")) - 1)
            own = slice(int(self.row_ends[first]), int(self.row_ends[last]))
            pre = np.repeat(np.arange(first, last), np.diff(self.row_ends[first : last + 1]))
            numbers = self.share.gather(np.array([pre.size]))
            keys: tuple[NDArray[Any], ...] = (self.share.gather(pre),)
            if self.delays is not None:
                keys = (self.share.gather(self.delays[own]), *keys)
            # The targets of a share lie before those of the next, so equal ones are in order.
            yield Stretch(
                (first, last), int(ends[first]), np.lexsort(keys), own, int(numbers[: self.share.index].sum())
            )
            first = last

    def joined(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values of the synapses of all shares, in order, from those of this one."""
        return np.concatenate([self.share.gather(values[each.own])[each.order] for each in self.stretches()])

    def places(self) -> Ints:
        """Which of all synapses those of this share are."""
        found = np.empty(int(self.row_ends[-1]), dtype=np.int64)
        for each in self.stretches():
            among = np.empty(each.order.size, dtype=np.int64)
            among[each.order] = np.arange(each.order.size)
            found[each.own] = each.begin + among[each.at : each.at + each.own.stop - each.own.start]
        return found
