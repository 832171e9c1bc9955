# mypy: ignore-errors
"""Counting events per pixel."""

from __future__ import annotations

from math import exp

import numpy as np

from neuro.kernels.jit import kernel, subkernel


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
def histograms(t, x, y, p, begin, constants, memory, inside, queues, following, sums, counts):
    """Sum the time surfaces of all events.

    Args:
        t: (n,) int64.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
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
