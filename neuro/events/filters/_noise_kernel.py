# mypy: ignore-errors
"""A Poisson process that is a function of time."""

from math import log

import numpy as np

from neuro.kernels.draws import mix, step_word, uniform
from neuro.kernels.jit import kernel

BIN_US = 1024
"""In each bin of this length the process begins anew, which a Poisson process may since it has no memory."""


@kernel
def sprinkle(first, last, key, mean_us, pixels, out_t, out_pixel, out_p):
    """Noise with first <= t <= last, us; mean_us: mean time to the next event of the whole sensor; key: uint64.

    Returns the number of events written; there is an error if the buffers are too small.
    """
    n = 0
    for number in range(first // BIN_US, last // BIN_US + 1):
        base = step_word(key, number)
        at = 0.0
        k = 0
        while True:
            at -= mean_us * log(1.0 - uniform(base, k))
            if at >= BIN_US:
                break
            t = number * BIN_US + int(at)
            if first <= t <= last:
                if n == out_t.shape[0]:
                    raise OverflowError("noise: more events than expected")
                word = mix(base + np.uint64(k) + np.uint64(1))
                out_t[n] = t
                out_pixel[n] = (word >> np.uint64(1)) % np.uint64(pixels)
                out_p[n] = word & np.uint64(1)
                n += 1
            k += 1
    return n


@kernel
def merge(noise_t, noise_pixel, noise_p, width, t, x, y, p, out_t, out_x, out_y, out_p):
    """Both in the order of time, the noise first; out_*: as long as both."""
    j = 0
    for k in range(t.shape[0]):
        while j < noise_t.shape[0] and noise_t[j] <= t[k]:
            at = j + k
            out_t[at], out_p[at] = noise_t[j], noise_p[j]
            out_x[at], out_y[at] = noise_pixel[j] % width, noise_pixel[j] // width
            j += 1
        out_t[j + k], out_x[j + k], out_y[j + k], out_p[j + k] = t[k], x[k], y[k], p[k]
