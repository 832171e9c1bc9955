# mypy: ignore-errors
"""Compiled loops of the filters: a part of a recording in, what passes or what is made out."""

from __future__ import annotations

from math import exp, log

import numpy as np

from neuro.apps import draws
from neuro.extend import kernel, subkernel


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
def surfaces(columns, tau_us, theta, radius, cell, origin, held, counts, sums, keep):
    """columns: of events; held: float64[height + 2 radius, width + 2 radius, 2]; origin: int64[1], us.

    counts: int64[rows, columns]; sums: float64[rows, columns, 2, side, side]; keep: bool[n]. What is held is in units
    of exp((t - origin) / tau), so all values decay at once as the unit grows: an event needs one exponential, and only
    every 600 tau all are touched. Times are subtracted as uint64, which is right over all of int64.
    """
    t, x, y, p = columns
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
def join(events, columns, rows, threshold, sums, out):
    """columns: uint16[width], rows: uint16[height], block of each; sums: int64[blocks down, across].

    events, out: columns t, x, y and p, as long. Returns how many events were written.
    """
    t, x, y, p = events
    out_t, out_x, out_y, out_p = out
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
        out[k] = t[k] + np.int64(draws.step_word(key, first + k) % choices) - amount


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
        base = draws.step_word(key, number)
        at = 0.0
        k = 0
        while True:
            at -= mean_us * log(1.0 - draws.uniform(base, k))
            if at >= BIN_US:
                break
            t = number * BIN_US + int(at)
            if first <= t <= last:
                if n == out_t.shape[0]:
                    raise OverflowError("noise: more events than expected")
                word = draws.mix(base + np.uint64(k) + np.uint64(1))
                out_t[n] = t
                out_pixel[n] = (word >> np.uint64(1)) % np.uint64(pixels)
                out_p[n] = word & np.uint64(1)
                n += 1
            k += 1
    return n


@kernel
def merge(noise_t, noise_pixel, noise_p, width, events, out):
    """Both in the order of time, the noise first; events, out: columns t, x, y and p; out: as long as both."""
    t, x, y, p = events
    out_t, out_x, out_y, out_p = out
    j = 0
    for k in range(t.shape[0]):
        while j < noise_t.shape[0] and noise_t[j] <= t[k]:
            at = j + k
            out_t[at], out_p[at] = noise_t[j], noise_p[j]
            out_x[at], out_y[at] = noise_pixel[j] % width, noise_pixel[j] // width
            j += 1
        out_t[j + k], out_x[j + k], out_y[j + k], out_p[j + k] = t[k], x[k], y[k], p[k]


@kernel
def count(x, y, p, ranges, separate, signed, out):
    """Add events to frames.

    Args:
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        ranges: (segments, 2) int64.
        separate: whether polarity is an axis.
        signed: whether OFF counts -1.
        out: (segments, 1 or 2, height, width) int32, added to.
    """
    for s in range(ranges.shape[0]):
        for k in range(ranges[s, 0], ranges[s, 1]):
            channel = p[k] if separate else 0
            out[s, channel, y[k], x[k]] += 2 * p[k] - 1 if signed else 1


@kernel
def spread(t, x, y, p, start, stop, separate, signed, timed, out):
    """Add events to the two bins next to them.

    Args:
        t: (n,) int64.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        start: time of the first bin.
        stop: time of the last bin, >= start.
        separate: whether polarity is an axis.
        signed: whether OFF counts -1.
        timed: whether events count their time, from 0 to 1.
        out: (1 or 2, bins, height, width) float, added to.
    """
    last = out.shape[1] - 1
    # As uint64 a difference is right over all of int64.
    length = max(np.float64(np.uint64(stop) - np.uint64(start)), 1.0)
    for k in range(t.shape[0]):
        if t[k] < start or t[k] > stop:
            continue
        passed = np.float64(np.uint64(t[k]) - np.uint64(start))
        place = last * passed / length
        low = min(max(int(place), 0), last)
        above = place - low
        value = 2.0 * p[k] - 1.0 if signed else 1.0
        if timed:
            value *= passed / length
        channel = p[k] if separate else 0
        out[channel, low, y[k], x[k]] += value * (1.0 - above)
        if low < last:
            out[channel, low + 1, y[k], x[k]] += value * above


NEVER = np.iinfo(np.int64).min


@subkernel
def passed(before, now):
    """From one time to a later one, us; subtracted as uint64, which is right over all of int64."""
    return np.float64(np.uint64(now) - np.uint64(before))


@kernel
def mark(t, x, y, p, separate, last):
    """Note the time of each pixel's last event in last, int64 (1 or 2, height, width)."""
    for k in range(t.shape[0]):
        last[p[k] if separate else 0, y[k], x[k]] = t[k]


@kernel
def ages(last, now, tau, linear, out):
    """Read the surface of last, int64 (pixels,), at a time into out, float (pixels,)."""
    for i in range(last.shape[0]):
        if last[i] == NEVER:
            out[i] = 0.0
        elif linear:
            out[i] = max(0.0, 1.0 - passed(last[i], now) / tau)
        else:
            out[i] = exp(-passed(last[i], now) / tau)


@kernel
def leak(t, x, y, p, before, options, values, value, since):
    """Add events to leaky pixels.

    Args:
        t: (n,) int64.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        before: time of the event before the first.
        options: whether polarity is an axis, decay is linear, and events count from the event before them.
        values: tau and increment.
        value: (1 or 2, height, width) float64 of the pixels.
        since: (1 or 2, height, width) int64, the time that the value is of.
    """
    separate, linear, late = options
    tau, increment = values
    for k in range(t.shape[0]):
        when = before if late else t[k]
        before = t[k]
        c = p[k] if separate else 0
        u = value[c, y[k], x[k]]
        if u > 0.0:
            gone = passed(since[c, y[k], x[k]], when) / tau
            u = max(0.0, u - gone) if linear else u * exp(-gone)
        value[c, y[k], x[k]] = u + increment
        since[c, y[k], x[k]] = when


@kernel
def leaked(value, since, now, tau, linear, out):
    """Read leaky pixels, float64 and int64 (pixels,), at a time into out, float (pixels,)."""
    for i in range(value.shape[0]):
        if value[i] == 0.0:
            out[i] = 0.0
        elif linear:
            out[i] = max(0.0, value[i] - passed(since[i], now) / tau)
        else:
            out[i] = value[i] * exp(-passed(since[i], now) / tau)


FURTHEST = 30.0


@subkernel
def leave(now, t, x, y, constants, oldest, reference, here, filled, following):
    """Take events that have left the window out of the memory of a cell; returns the oldest that stays, -1 for none."""
    cell, radius, window, tau, _ = constants
    while oldest >= 0 and passed(t[oldest], now) > window:
        i, j = y[oldest] % cell + radius, x[oldest] % cell + radius
        filled[i, j] -= 1
        here[i, j] = here[i, j] - exp((t[oldest] - reference) / tau) if filled[i, j] else 0.0
        oldest = following[oldest]
    return oldest


@kernel
def forget(t, x, y, constants, memory, inside, queues, following):
    """Take out of all cells what has left the window by the last event; arguments as of `histograms`.

    No later event would find it either, and a cell changes at its own events only, so nothing else becomes different.
    Events are numbered anew from the first that is still remembered, whose old number is returned.
    """
    n = t.shape[0]
    first = n
    rows, columns = queues.shape[1:3]
    for r in range(rows):
        for c in range(columns):
            for q in range(2):
                reference, here, filled = queues[2, r, c, q], memory[r, c, q], inside[r, c, q]
                oldest = leave(t[n - 1], t, x, y, constants, queues[0, r, c, q], reference, here, filled, following)
                queues[0, r, c, q] = oldest
                if oldest >= 0:
                    first = min(first, oldest)
    for r in range(rows):
        for c in range(columns):
            for q in range(2):
                if queues[0, r, c, q] >= 0:
                    queues[0, r, c, q] -= first
                    queues[1, r, c, q] -= first
    for k in range(first, n):
        if following[k] >= 0:
            following[k] -= first
    return first


@kernel
def histograms(columns, begin, constants, memory, inside, queues, following, sums, counts):
    """Sum the time surfaces of all events.

    Args:
        columns: t, (n,) int64; x and y, uint16; p, uint8.
        begin: how many of the events were seen before and are in the memory.
        constants: side of a cell, radius, window, tau, and what an event adds to its own surface.
        memory: (rows, columns, 2, cell + 2 radius, cell + 2 radius) float64, 0: with a margin that stays 0.
        inside: int32 of that shape, 0.
        queues: (3, rows, columns, 2) int64, -1.
        following: (n,) int64, of those seen before the next of its cell and polarity, -1 for none; filled.
        sums: (rows, columns, 2, size, size) float64, 0; filled.
        counts: (rows, columns, 2) int64, 0; filled.

    HATS in one pass: each cell remembers the sum of its decayed events per pixel, and forgets the oldest.

    The memory of a cell is kept for a reference time, so that nothing need be decayed at an event: an event of time t_j
    is remembered as exp((t_j - reference) / tau), and all of the memory is scaled when it is read. The reference is
    moved before weights grow beyond e^30. An event that leaves the window is taken out again; a pixel whose last event
    left is set to exactly 0.
    """
    t, x, y, p = columns
    cell, radius, _, tau, own = constants
    size = 2 * radius + 1
    for k in range(begin, t.shape[0]):
        now = t[k]
        r, c, q = y[k] // cell, x[k] // cell, p[k]
        here, filled = memory[r, c, q], inside[r, c, q]
        oldest, newest, reference = queues[0, r, c, q], queues[1, r, c, q], queues[2, r, c, q]
        if counts[r, c, q] == 0:
            reference = now
        oldest = leave(now, t, x, y, constants, oldest, reference, here, filled, following)
        if passed(reference, now) / tau > FURTHEST:
            scale = exp(-passed(reference, now) / tau)
            for i in range(here.shape[0]):
                for j in range(here.shape[1]):
                    here[i, j] *= scale
            reference = now
        top, left = y[k] % cell, x[k] % cell
        scale = exp((reference - now) / tau)
        for i in range(size):
            for j in range(size):
                sums[r, c, q, i, j] += here[top + i, left + j] * scale
        sums[r, c, q, radius, radius] += own
        counts[r, c, q] += 1
        here[top + radius, left + radius] += exp((now - reference) / tau)
        filled[top + radius, left + radius] += 1
        following[k] = -1
        if oldest < 0:
            oldest = k
        else:
            following[newest] = k
        queues[0, r, c, q], queues[1, r, c, q], queues[2, r, c, q] = oldest, k, reference


@kernel
def msd(t, tau_us, threshold, v, last, cuts):
    """t: int64[n]; v, last: potential and time so far; cuts: int64[n]. Returns number of cuts, v and last."""
    n = 0
    for k in range(t.shape[0]):
        v = v * exp((last - t[k]) / tau_us) + 1.0
        last = t[k]
        if v >= threshold:
            cuts[n] = k + 1
            n += 1
            v = 0.0
    return n, v, last


@kernel
def peaks(t, last, seen, constants, state, candidate, queue_t, queue_v, held, cuts):
    """Peaks of the potential.

    A queue holds the events of the search range that no later event exceeds, so its first is the highest.

    Args:
        t: int64[n].
        last: time of the event before.
        seen: number of events before.
        constants: tau, rise, v0, search (us) and threshold.
        state: float64[2], slow and fast part of the potential.
        candidate: int64[2], its number (-1: none) and time.
        queue_t: int64[held + n].
        queue_v: float64[held + n].
        held: length of the queue so far.
        cuts: int64[n + 1], filled.

    Returns:
        number of cuts, and where the queue begins and ends.
    """
    tau, rise, v0, search, threshold = constants
    slow, fast = state
    number, when = candidate
    n, head, tail = 0, 0, held
    for k in range(t.shape[0]):
        now = t[k]
        passed = last - now
        slow = slow * exp(passed / tau) + v0
        if rise > 0.0:
            fast = fast * exp(passed / rise) + v0
        v = slow - fast
        last = now
        if number >= 0 and now - when > search:
            cuts[n] = number + 1
            n += 1
            number = -1
        while head < tail and now - queue_t[head] > search:
            head += 1
        if (head == tail or queue_v[head] < v) and v > threshold:
            number, when = seen + k, now
        while head < tail and queue_v[tail - 1] <= v:
            tail -= 1
        queue_t[tail] = now
        queue_v[tail] = v
        tail += 1
    state[0], state[1] = slow, fast
    candidate[0], candidate[1] = number, when
    return n, head, tail
