"""Keeping a plastic weight between 0 and its largest value, of either sign."""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations


def within(w, w_max):
    """A weight between 0 and `w_max`, which is below 0 where the synapse inhibits."""
    return min(max(w, 0.0), w_max) if w_max > 0.0 else max(min(w, 0.0), w_max)
