# mypy: ignore-errors
"""Compiled loops of `neuro.events.dvs`."""

from math import inf, log

import numpy as np
from numba import njit


@njit(cache=True)
def mix(z):
    """SplitMix64's finaliser, uint64 to uint64. Source: Steele, Lea, Flood, OOPSLA 2014."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True)
def draw(seed, pixel, number):
    """The pixel's random word of this number: a function of nothing else."""
    key = mix(np.uint64(seed) + np.uint64(pixel) * np.uint64(0x9E3779B97F4A7C15))
    return mix(key + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15))


@njit(cache=True)
def exponential(word, mean):
    """From a random word, whose lowest bit is left for the polarity."""
    return -mean * log((float(word >> np.uint64(11)) + 0.5) / 9007199254740992.0)


@njit(cache=True)
def advance(
    pixel, log0, log1, t0, t1, change, listen, on, off, refractory, leak,
    seed, noise_mean, noise_time, noise_number, out_t, out_pixel, out_p,
):  # fmt: skip
    """Let all pixels from `pixel` on see the log intensity go straight from log0 at t0 to log1 at t1.

    State, one value per pixel: change float64, since the last event (log units); listen float64, us,
    until when the pixel is blind; noise_time float64, us, of the next noise event; noise_number int64,
    random words used. on, off: float64, thresholds. leak: rise per us in units of the ON threshold.
    noise_mean: us between noise events. out_t int64 us, out_pixel int64, out_p uint8: buffers.
    Returns (events written, pixel to go on from); the latter is less than the number of pixels where
    the buffers were full, and the call must be repeated with fresh ones.
    """
    n = 0
    room = out_t.shape[0]
    for i in range(pixel, log0.shape[0]):
        rate = (log1[i] - log0[i]) / (t1 - t0) + leak * on[i]
        t = max(float(t0), listen[i])
        if t >= t1:
            continue
        v = change[i]
        while True:
            at = inf
            p = 0
            end = v + rate * (t1 - t)
            if end >= on[i]:
                at = t + (on[i] - v) / rate
                p = 1
            elif end <= -off[i]:
                at = t + (-off[i] - v) / rate
            while noise_time[i] <= t:
                noise_number[i] += 1
                noise_time[i] += exponential(draw(seed, i, noise_number[i]), noise_mean)
            if noise_time[i] < at and noise_time[i] <= t1:
                at = noise_time[i]
                p = int(draw(seed, i, noise_number[i]) & np.uint64(1))
            if at == inf:
                v = end
                break
            if n == room:
                change[i], listen[i] = v, t
                return n, i
            at = min(max(at, t), float(t1))
            out_t[n] = int(at)
            out_pixel[n] = i
            out_p[n] = p
            n += 1
            v = 0.0
            t = at + refractory
            listen[i] = t
            if t >= t1:
                break
        change[i] = v
    return n, log0.shape[0]
