"""Registers of chips that overflow: reported once for all recordings, with in how many."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from neuro.program.backend import OverflowWarning

Overflows = Mapping[str, tuple[int, str]]
"""By what overflows, such as "input wraps of hidden", in how many recordings, and what keeps it from that."""


@contextmanager
def noted(found: dict[str, tuple[int, str]]) -> Iterator[None]:
    """Add what overflows inside, in a recording, to what was found, instead of warning of it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OverflowWarning)
        yield
    for each in caught:
        message = each.message
        if not isinstance(message, OverflowWarning):
            warnings.warn_explicit(message, each.category, each.filename, each.lineno)
        elif message.what:
            found[message.what] = found.get(message.what, (0, ""))[0] + 1, message.hint


def warn_of_overflows(backend: str, found: Overflows, recordings: int) -> None:
    """Warn once of each register that overflowed, with in how many recordings."""
    for what, (some, hint) in found.items():
        text = f"backend '{backend}': {what} in {some} of {recordings} recordings\n  hint: {hint}"
        warnings.warn(text, OverflowWarning, stacklevel=2)
