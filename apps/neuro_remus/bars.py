"""How far a long loop is, on stderr."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

from neuro.apps import Bar

T = TypeVar("T")


def shown(items: Iterable[T], what: str, total: int, wanted: bool = True) -> Iterator[T]:
    """The items, and how far it is while they are gone through.

    Args:
        items: to go through.
        what: is being done.
        total: the number of items.
        wanted: False shows nothing.
    """
    if not wanted:
        yield from items
        return
    with Bar() as bar:
        for done, item in enumerate(items, 1):
            bar.show(done, total, f"{what}: {done:,} of {total:,}")
            yield item
