"""Registers of chips that overflow while recordings are tested: told once for all, with in how many."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from neuro import OverflowWarning

__all__ = ["Overflows", "noted", "summed", "tell"]

Overflows = Mapping[str, tuple[int, str]]
"""By what overflows, such as "input wraps of hidden", in how many recordings, and what keeps it from that."""


@contextmanager
def noted(found: dict[str, tuple[int, str]]) -> Iterator[None]:
    """Add what overflows inside, in a recording, to what was found, instead of warning of it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OverflowWarning)
        yield
    for each in caught:
        told = each.message
        if not isinstance(told, OverflowWarning):
            warnings.warn_explicit(told, each.category, each.filename, each.lineno)
        elif told.what:
            found[told.what] = found.get(told.what, (0, ""))[0] + 1, told.hint


def summed(each: Iterator[Mapping[str, Any]]) -> dict[str, tuple[int, str]]:
    """Those of several sets of recordings."""
    found: dict[str, tuple[int, str]] = {}
    for one in each:
        for what, (recordings, hint) in one.items():
            found[what] = found.get(what, (0, ""))[0] + recordings, hint
    return found


def tell(backend: str, found: Overflows, recordings: int) -> None:
    """Warn of each once."""
    for what, (some, hint) in found.items():
        text = f"backend '{backend}': {what} in {some} of {recordings} recordings\n  hint: {hint}"
        warnings.warn(text, OverflowWarning, stacklevel=2)
