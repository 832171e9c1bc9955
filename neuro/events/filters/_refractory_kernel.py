# mypy: ignore-errors
"""Dead time."""

from neuro.kernels.jit import kernel


@kernel
def rested(t, x, y, period_us, extend, last, keep):
    """last: int64[height, width], since when the pixel is dead, us; keep: bool[n]."""
    for k in range(t.shape[0]):
        before = last[y[k], x[k]]
        keep[k] = t[k] >= before + period_us
        last[y[k], x[k]] = t[k] if extend or keep[k] else before
