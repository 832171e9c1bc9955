"""The same work on many things, on several threads; compiled passes and NumPy's on large arrays run side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def mapped(function: Callable[[T], R], items: Sequence[T], threads: int) -> Iterator[R]:
    """What a function gives for each item, in order; all are begun at once, on so many threads, with 1 one by one.

    Raises:
        Exception: what the function raises for the first item for which it does.
    """
    if threads == 1 or len(items) < 2:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(function, items)
