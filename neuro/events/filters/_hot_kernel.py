# mypy: ignore-errors
"""A look at each event's pixel."""

from neuro.kernels.jit import kernel


@kernel
def look_up(x, y, good, keep):
    """good: bool[height, width]; keep: bool[n]."""
    for k in range(x.shape[0]):
        keep[k] = good[y[k], x[k]]
