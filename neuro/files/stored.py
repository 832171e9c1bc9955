"""Arrays that lie in a file and are read when they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

Opener = Callable[[], AbstractContextManager[Any]]
_MISSING: Any = object()


class Stored:
    """An array in an HDF5 file.

    Args:
        opener: gives the open file.
        name: of the data set.
        length: what comes after so many entries, as in a file that grows, is not seen, so that arrays of one part fit.
        flat: whether it has one axis; older files have a single column instead.
    """

    def __init__(self, opener: Opener, name: str, length: int, flat: bool = False) -> None:
        self._opener, self._name, self._length, self._flat = opener, name, length, flat

    def read(self) -> Any:
        """All of it."""
        return self[: self._length]

    def __getitem__(self, where: Any) -> Any:
        with self._opener() as file:
            found = file[self._name][where]
            return found.reshape(-1) if self._flat else found

    def span(self, after: float, to: float) -> slice:
        """Where those of ascending numbers lie that are in after < x <= to; few of them are read."""
        with self._opener() as file:
            data = file[self._name]
            return slice(*(_first_above(data, bound, self._length) for bound in (after, to)))


def span(times: Any, after: float, to: float) -> slice:
    """Likewise of an array, stored or not."""
    if isinstance(times, Stored):
        return times.span(after, to)
    return slice(*(int(np.searchsorted(times, bound, side="right")) for bound in (after, to)))


def _first_above(data: Any, bound: float, length: int) -> int:
    low, high = 0, length
    if not high or data[high - 1] <= bound:
        return high
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if data[middle] <= bound else (low, middle)
    return low


class Lazy:
    """A field of a dataclass that holds an array, or a `Stored` one that is read and kept when it is asked for."""

    def __init__(self, default: Any = _MISSING) -> None:
        self._default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, part: Any, owner: type | None = None) -> Any:
        if part is None:
            if self._default is _MISSING:
                raise AttributeError(self._name)
            return self._default
        value = vars(part)[self._name]
        if isinstance(value, Stored):
            value = vars(part)[self._name] = value.read()
        return value

    def __set__(self, part: Any, value: Any) -> None:
        vars(part)[self._name] = value


def kept(part: Any, name: str) -> Any:
    """What a lazy field holds, an array or a `Stored` one, of which a slice can be read."""
    return vars(part)[name]
