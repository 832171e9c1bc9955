"""One look at all events."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel


@kernel
def survey(t, x, y):
    """Largest x and y, and whether time does not run back."""
    x_max = np.uint16(0)
    y_max = np.uint16(0)
    back = False
    for k in range(t.size):
        x_max = max(x_max, x[k])
        y_max = max(y_max, y[k])
    for k in range(1, t.size):
        back |= t[k] < t[k - 1]
    return x_max, y_max, not back
