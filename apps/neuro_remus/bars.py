"""A bar for a long loop, on stderr and only where that is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TypeVar

T = TypeVar("T")


def shown(items: Iterable[T], what: str, total: int, wanted: bool = True) -> Iterable[T]:
    """The items, with a bar while they are gone through.

    Args:
        items: to go through.
        what: text before the bar.
        total: the number of items.
        wanted: False shows none.
    """
    if not wanted or not sys.stderr.isatty():
        return items
    from rich.console import Console
    from rich.progress import track

    return track(items, what, total, console=Console(stderr=True), transient=True)
