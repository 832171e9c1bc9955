# mypy: ignore-errors
"""Support by neighbours."""

from neuro.kernels.jit import kernel


@kernel
def supported(t, x, y, dt_us, last, keep):
    """last: int64[height + 2, width + 2], time of each pixel's last event, us; keep: bool[n]."""
    for k in range(t.shape[0]):
        i, j = y[k] + 1, x[k] + 1
        newest = max(last[i, j - 1], last[i, j + 1])
        for row in (i - 1, i + 1):
            newest = max(newest, last[row, j - 1], last[row, j], last[row, j + 1])
        keep[k] = newest >= t[k] - dt_us
        last[i, j] = t[k]
