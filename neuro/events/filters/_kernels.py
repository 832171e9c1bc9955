# mypy: ignore-errors
"""Compiled loops of the filters: a part of a recording in, what passes or what is made out."""

from __future__ import annotations

from math import exp, log

import numpy as np

from neuro.kernels.draws import mix, step_word, uniform
from neuro.kernels.jit import kernel, subkernel


@kernel
def compact(keep, values, out):
    """keep: bool[n]; values: [n]; out: at least one longer than what is kept, since every value is written first."""
    j = 0
    for k in range(keep.shape[0]):
        out[j] = values[k]
        j += keep[k]


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


@kernel
def rested(t, x, y, period_us, extend, last, keep):
    """last: int64[height, width], since when the pixel is dead, us; keep: bool[n]."""
    for k in range(t.shape[0]):
        before = last[y[k], x[k]]
        keep[k] = t[k] >= before + period_us
        last[y[k], x[k]] = t[k] if extend or keep[k] else before


@kernel
def look_up(x, y, good, keep):
    """good: bool[height, width]; keep: bool[n]."""
    for k in range(x.shape[0]):
        keep[k] = good[y[k], x[k]]


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


LIMIT = 600.0
"""Time constants after which the unit is set anew; exp(600) is far from the end of float64."""


@kernel
def surfaces(t, x, y, p, tau_us, theta, radius, cell, origin, held, counts, sums, keep):
    """held: float64[height + 2 radius, width + 2 radius, 2]; origin: int64[1], us; counts: int64[rows, columns].

    sums: float64[rows, columns, 2, side, side]; keep: bool[n]. What is held is in units of exp((t - origin) / tau), so
    all values decay at once as the unit grows: an event needs one exponential, and only every 600 tau all are touched.
    Times are subtracted as uint64, which is right over all of int64.
    """
    side = 2 * radius + 1
    for k in range(t.shape[0]):
        age = (np.uint64(t[k]) - np.uint64(origin[0])) / tau_us
        if age > LIMIT:
            held *= exp(-age)
            origin[0] = t[k]
            age = 0.0
        unit = exp(age)
        active = unit
        for row in range(y[k], y[k] + side):
            for column in range(x[k], x[k] + side):
                active += held[row, column, 0] + held[row, column, 1]
        keep[k] = active > theta * unit
        if keep[k]:
            add_surface(unit, x[k], y[k], p[k], radius, cell, held, counts, sums)
        held[y[k] + radius, x[k] + radius, p[k]] += unit


@subkernel
def add_surface(unit, x, y, p, radius, cell, held, counts, sums):
    """Add what the neighbours in the event's cell hold to the sum of the cell."""
    cell_row, cell_column = y // cell, x // cell
    counts[cell_row, cell_column] += 1
    first_row, first_column = cell_row * cell - y + radius, cell_column * cell - x + radius
    side = 2 * radius + 1
    for i in range(max(0, first_row), min(side, first_row + cell)):
        for j in range(max(0, first_column), min(side, first_column + cell)):
            sums[cell_row, cell_column, p, i, j] += held[y + i, x + j, p] / unit


@kernel
def join(t, x, y, p, columns, rows, threshold, sums, out_t, out_x, out_y, out_p):
    """columns: uint16[width], rows: uint16[height], block of each; sums: int64[blocks down, across].

    out_*: of the length of t. Returns how many events were written.
    """
    n = 0
    for k in range(t.shape[0]):
        column, row = columns[x[k]], rows[y[k]]
        total = sums[row, column] + (1 if p[k] else -1)
        if abs(total) >= threshold:
            out_t[n], out_x[n], out_y[n], out_p[n] = t[k], column, row, p[k]
            n += 1
            total = 0
        sums[row, column] = total
    return n


DIGIT = 11
"""Bits sorted by in one pass: the counts of 2^11 values stay in the innermost cache."""


@kernel
def shake(t, key, first, amount, out):
    """Event k of the part is number first + k of the recording; key: uint64; out: int64[n], us."""
    choices = np.uint64(2 * amount + 1)
    for k in range(t.shape[0]):
        out[k] = t[k] + np.int64(step_word(key, first + k) % choices) - amount


@kernel
def by_digit(t, lowest, shift, order, counts, out):
    """One pass of a stable radix sort: put order, int64[n] indices into t, by some bits of t - lowest into out."""
    mask = counts.shape[0] - 1
    counts[:] = 0
    for k in order:
        counts[((t[k] - lowest) >> shift) & mask] += 1
    begin = 0
    for digit in range(counts.shape[0]):
        begin, counts[digit] = begin + counts[digit], begin
    for k in order:
        digit = ((t[k] - lowest) >> shift) & mask
        out[counts[digit]] = k
        counts[digit] += 1


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
