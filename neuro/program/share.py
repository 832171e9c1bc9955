"""The share of a network that a process has: the synapses onto some neurons of each population."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from numpy.typing import NDArray

T = TypeVar("T")


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

    def agree(self, make: Callable[[], T]) -> T:
        """What a function gives, if it gives something for every share.

        Raises:
            ModelError: that of the first share for which it raises one.
        """
        return make()


WHOLE = Share()
