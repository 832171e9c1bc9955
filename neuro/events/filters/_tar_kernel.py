# mypy: ignore-errors
"""The mask of temporal active regions."""

from math import exp

import numpy as np

from neuro.kernels.jit import kernel


@kernel
def tar(t, x, y, tau_us, theta, radius, mask, touched, keep):
    """mask: float64, touched: int64 us, both [height + 2 radius, width + 2 radius]; keep: bool[n].

    Neighbours are mostly touched together, so the factor of the one before is used again where it can be.
    Times are subtracted as uint64, which is right over all of int64.
    """
    side = 2 * radius + 1
    rate = -1.0 / tau_us
    for k in range(t.shape[0]):
        now = t[k]
        before = now
        factor = 1.0
        for row in range(y[k], y[k] + side):
            for column in range(x[k], x[k] + side):
                at = touched[row, column]
                if at != before:
                    before = at
                    factor = exp(rate * (np.uint64(now) - np.uint64(at)))
                mask[row, column] = mask[row, column] * factor + 1.0
                touched[row, column] = now
        keep[k] = mask[y[k] + radius, x[k] + radius] > theta
