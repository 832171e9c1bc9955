# mypy: ignore-errors
"""Counts events in the cells of a grid."""

from neuro.apps import kernel


@kernel
def count(x, y, shift, out):
    """Add the events at x, y (uint16, px) to out[y >> shift, x >> shift] (int64)."""
    for k in range(x.shape[0]):
        out[y[k] >> shift, x[k] >> shift] += 1
