# mypy: ignore-errors
"""Compiled loops of the filters, representations and segmenters.

Kernels process one part of a recording and write to output arrays. Arrays for the state are updated in place.
"""

from __future__ import annotations

from math import exp, log

import numpy as np

from neuro.apps import draws
from neuro.extend import kernel, subkernel


@kernel
def compact(keep, values, out):
    """Copy the selected values to the beginning of `out`.

    Args:
        keep: (n,) bool.
        values: (n,).
        out: output with at least one place more than there are selected values, because values that are not selected
            are written as well and then overwritten.
    """
    j = 0
    for k in range(keep.shape[0]):
        out[j] = values[k]
        j += keep[k]


@kernel
def supported(t, x, y, dt_us, last, keep):
    """Keep events if a neighbouring pixel had an event at most `dt_us` before.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16, columns.
        y: (n,) uint16, rows.
        dt_us: longest time since the neighbour's event, us.
        last: (height + 2, width + 2) int64, time of each pixel's last event, us, with a margin of one pixel.
        keep: (n,) bool, output.
    """
    for k in range(t.shape[0]):
        i, j = y[k] + 1, x[k] + 1
        newest = max(last[i, j - 1], last[i, j + 1])
        for row in (i - 1, i + 1):
            newest = max(newest, last[row, j - 1], last[row, j], last[row, j + 1])
        keep[k] = newest >= t[k] - dt_us
        last[i, j] = t[k]


@kernel
def rested(t, x, y, period_us, extend, last, keep):
    """Keep an event if the last event of its pixel that passed is at least `period_us` earlier.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16, columns.
        y: (n,) uint16, rows.
        period_us: refractory period, us.
        extend: restart the period at dropped events too, so that the pixel's last event counts, passed or not.
        last: (height, width) int64, start of the pixel's refractory period, us.
        keep: (n,) bool, output.
    """
    for k in range(t.shape[0]):
        previous = last[y[k], x[k]]
        keep[k] = t[k] >= previous + period_us
        last[y[k], x[k]] = t[k] if extend or keep[k] else previous


@kernel
def look_up(x, y, good, keep):
    """Keep events of good pixels.

    Args:
        x: (n,) uint16, columns.
        y: (n,) uint16, rows.
        good: (height, width) bool.
        keep: (n,) bool, output.
    """
    for k in range(x.shape[0]):
        keep[k] = good[y[k], x[k]]


@kernel
def tar(t, x, y, tau_us, theta, radius, mask, last_update, keep):
    """Keep events in temporal active regions; see `filters.TAR`.

    Most pixels of a neighbourhood were last updated by the same event, so the decay factor of the pixel before is
    reused if possible. Times are subtracted as uint64, which cannot overflow for any pair of int64 times.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16, columns.
        y: (n,) uint16, rows.
        tau_us: decay time constant, us.
        theta: threshold of the mask.
        radius: radius of the neighbourhood, px.
        mask: (height + 2 radius, width + 2 radius) float64.
        last_update: int64 of the same shape, us.
        keep: (n,) bool, output.
    """
    side = 2 * radius + 1
    rate = -1.0 / tau_us
    for k in range(t.shape[0]):
        time = t[k]
        factor_for = time
        factor = 1.0
        for row in range(y[k], y[k] + side):
            for column in range(x[k], x[k] + side):
                updated_at = last_update[row, column]
                if updated_at != factor_for:
                    factor_for = updated_at
                    factor = exp(rate * (np.uint64(time) - np.uint64(updated_at)))
                mask[row, column] = mask[row, column] * factor + 1.0
                last_update[row, column] = time
        keep[k] = mask[y[k] + radius, x[k] + radius] > theta


LIMIT = 600.0
"""Time constants after which `surfaces` rescales its values; exp(600) is far below the largest float64."""


@kernel
def surfaces(columns, tau_us, theta, radius, cell, origin, values, counts, sums, keep):
    """Sum the surfaces of events in temporal active regions; see `filters.TARSurfaces`.

    A value v is stored as v exp((t - origin) / tau), so that all values decay implicitly as the unit exp((t - origin) /
    tau) grows. An event then needs one exponential, and all values are rescaled only every 600 tau. Times are
    subtracted as uint64, which cannot overflow for any pair of int64 times.

    Args:
        columns: t, x, y and p of the events.
        tau_us: decay time constant, us.
        theta: threshold of the mask.
        radius: radius of the neighbourhood, px.
        cell: side of a cell, px.
        origin: (1,) int64, us.
        values: (height + 2 radius, width + 2 radius, 2) float64, leaky sum of each pixel and polarity.
        counts: (rows, columns) int64, events that passed in each cell.
        sums: (rows, columns, 2, side, side) float64, sums of surfaces in each cell.
        keep: (n,) bool, output.
    """
    t, x, y, p = columns
    side = 2 * radius + 1
    for k in range(t.shape[0]):
        age = (np.uint64(t[k]) - np.uint64(origin[0])) / tau_us
        if age > LIMIT:
            values *= exp(-age)
            origin[0] = t[k]
            age = 0.0
        unit = exp(age)
        active = unit
        for row in range(y[k], y[k] + side):
            for column in range(x[k], x[k] + side):
                active += values[row, column, 0] + values[row, column, 1]
        keep[k] = active > theta * unit
        if keep[k]:
            add_surface(unit, x[k], y[k], p[k], radius, cell, values, counts, sums)
        values[y[k] + radius, x[k] + radius, p[k]] += unit


@subkernel
def add_surface(unit, x, y, p, radius, cell, values, counts, sums):
    """Add the values of the neighbours in the event's cell to the sums of the cell."""
    cell_row, cell_column = y // cell, x // cell
    counts[cell_row, cell_column] += 1
    first_row, first_column = cell_row * cell - y + radius, cell_column * cell - x + radius
    side = 2 * radius + 1
    for i in range(max(0, first_row), min(side, first_row + cell)):
        for j in range(max(0, first_column), min(side, first_column + cell)):
            sums[cell_row, cell_column, p, i, j] += values[y + i, x + j, p] / unit


@kernel
def join(events, columns, rows, threshold, sums, out):
    """Sum the events of each block of pixels, and write an event whenever the sum reaches the threshold.

    Args:
        events: columns t, x, y and p.
        columns: (width,) uint16, block column of each pixel column.
        rows: (height,) uint16, block row of each pixel row.
        threshold: sum that makes an event, events.
        sums: (block rows, block columns) int64.
        out: output columns t, x, y and p, of the same length as `events`.

    Returns:
        The number of events written.
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
"""Bits per pass of the radix sort, so that the 2^11 counts fit in the L1 cache."""


@kernel
def shake(t, key, first, amount, out):
    """Add a random offset to each time.

    Args:
        t: (n,) int64, us.
        key: uint64 of the random stream.
        first: number of the part's first event in the recording.
        amount: largest offset, us.
        out: (n,) int64, us.
    """
    choices = np.uint64(2 * amount + 1)
    for k in range(t.shape[0]):
        out[k] = t[k] + np.int64(draws.step_word(key, first + k) % choices) - amount


@kernel
def by_digit(t, lowest, shift, order, counts, out):
    """Sort stably by a digit, as a pass of a radix sort does.

    Args:
        t: (n,) int64.
        lowest: smallest of `t`.
        shift: position of the digit in t - lowest, bits.
        order: (n,) int64 indices into `t` in the order of the lower digits.
        counts: (2^DIGIT,) int64, work array.
        out: (n,) int64, output: the indices sorted by the digit.
    """
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
"""Length of a bin, us. The Poisson process restarts in each bin, so that the noise of a bin does not depend on the bins
before. A restart does not change the statistics, because the process has no memory."""


@kernel
def sprinkle(first, last, key, mean_us, pixels, out_t, out_pixel, out_p):
    """Write noise events with first <= t <= last.

    Args:
        first: first time of the noise, us.
        last: last time of the noise, us.
        key: uint64 of the random stream.
        mean_us: mean time between noise events of the whole sensor, us.
        pixels: number of pixels of the sensor.
        out_t: (capacity,) int64, output: times, us.
        out_pixel: (capacity,) int64, output: pixel numbers, row by row.
        out_p: (capacity,) uint8, output: polarities.

    Returns:
        The number of events written.

    Raises:
        OverflowError: the output arrays are too small.
    """
    n = 0
    for number in range(first // BIN_US, last // BIN_US + 1):
        base = draws.step_word(key, number)
        offset_us = 0.0
        k = 0
        while True:
            offset_us -= mean_us * log(1.0 - draws.uniform(base, k))
            if offset_us >= BIN_US:
                break
            t = number * BIN_US + int(offset_us)
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
    """Merge noise and events in the order of time; at equal times the noise comes first.

    Args:
        noise_t: (m,) int64, times of the noise, us.
        noise_pixel: (m,) int64, pixel numbers, row by row.
        noise_p: (m,) uint8, polarities of the noise.
        width: width of the sensor, px.
        events: columns t, x, y and p.
        out: output columns t, x, y and p, as long as both inputs together.
    """
    t, x, y, p = events
    out_t, out_x, out_y, out_p = out
    j = 0
    for k in range(t.shape[0]):
        while j < noise_t.shape[0] and noise_t[j] <= t[k]:
            index = j + k
            out_t[index], out_p[index] = noise_t[j], noise_p[j]
            out_x[index], out_y[index] = noise_pixel[j] % width, noise_pixel[j] // width
            j += 1
        out_t[j + k], out_x[j + k], out_y[j + k], out_p[j + k] = t[k], x[k], y[k], p[k]


@kernel
def count(x, y, p, ranges, separate, signed, out):
    """Count the events of each pixel.

    Args:
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        ranges: (segments, 2) int64, first event and end of each segment.
        separate: make polarity an axis.
        signed: count OFF events as -1.
        out: (segments, 1 or 2, height, width) int32, incremented.
    """
    for s in range(ranges.shape[0]):
        for k in range(ranges[s, 0], ranges[s, 1]):
            channel = p[k] if separate else 0
            out[s, channel, y[k], x[k]] += 2 * p[k] - 1 if signed else 1


@kernel
def spread(t, x, y, p, start, stop, separate, signed, timed, out):
    """Distribute events over the two nearest time bins.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        start: time of the first bin, us.
        stop: time of the last bin, us, at least `start`.
        separate: make polarity an axis.
        signed: count OFF events as -1.
        timed: weight events by their time, from 0 to 1.
        out: (1 or 2, bins, height, width) float, incremented.
    """
    last = out.shape[1] - 1
    # Subtract as uint64, which cannot overflow for any pair of int64 times.
    length = max(np.float64(np.uint64(stop) - np.uint64(start)), 1.0)
    for k in range(t.shape[0]):
        if t[k] < start or t[k] > stop:
            continue
        elapsed = np.float64(np.uint64(t[k]) - np.uint64(start))
        position = last * elapsed / length
        low = min(max(int(position), 0), last)
        fraction = position - low
        value = 2.0 * p[k] - 1.0 if signed else 1.0
        if timed:
            value *= elapsed / length
        channel = p[k] if separate else 0
        out[channel, low, y[k], x[k]] += value * (1.0 - fraction)
        if low < last:
            out[channel, low + 1, y[k], x[k]] += value * fraction


NEVER = np.iinfo(np.int64).min


@subkernel
def elapsed_us(before, now):
    """Return the time from `before` to `now`, us. Subtraction as uint64 cannot overflow for any pair of int64 times."""
    return np.float64(np.uint64(now) - np.uint64(before))


@kernel
def mark(t, x, y, p, separate, last):
    """Record the time of each pixel's last event in `last`, (1 or 2, height, width) int64."""
    for k in range(t.shape[0]):
        last[p[k] if separate else 0, y[k], x[k]] = t[k]


@kernel
def ages(last, now, tau, linear, out):
    """Write the time surface at a time to `out`.

    Args:
        last: (pixels,) int64, time of each pixel's last event, `NEVER` without an event.
        now: time of the surface, us.
        tau: decay time constant, us.
        linear: decay linearly instead of exponentially.
        out: (pixels,) float.
    """
    for i in range(last.shape[0]):
        if last[i] == NEVER:
            out[i] = 0.0
        elif linear:
            out[i] = max(0.0, 1.0 - elapsed_us(last[i], now) / tau)
        else:
            out[i] = exp(-elapsed_us(last[i], now) / tau)


@kernel
def leak(t, x, y, p, previous, options, values, value, since):
    """Add events to leaky pixels.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        previous: time of the event before these events, us.
        options: three flags: make polarity an axis, decay linearly, and increment before the decay.
        values: decay time constant, us, and increase of a pixel per event.
        value: (1 or 2, height, width) float64, values of the pixels, updated.
        since: (1 or 2, height, width) int64, time at which `value` was last updated, us.
    """
    separate, linear, increments_first = options
    tau, increment = values
    for k in range(t.shape[0]):
        read_time = previous if increments_first else t[k]
        previous = t[k]
        c = p[k] if separate else 0
        u = value[c, y[k], x[k]]
        if u > 0.0:
            decay = elapsed_us(since[c, y[k], x[k]], read_time) / tau
            u = max(0.0, u - decay) if linear else u * exp(-decay)
        value[c, y[k], x[k]] = u + increment
        since[c, y[k], x[k]] = read_time


@kernel
def leaked(value, since, now, tau, linear, out):
    """Write the values of leaky pixels at a time to `out`.

    Args:
        value: (pixels,) float64, values at the times `since`.
        since: (pixels,) int64, time at which `value` was last updated, us.
        now: time of the surface, us.
        tau: decay time constant, us.
        linear: decay linearly instead of exponentially.
        out: (pixels,) float.
    """
    for i in range(value.shape[0]):
        if value[i] == 0.0:
            out[i] = 0.0
        elif linear:
            out[i] = max(0.0, value[i] - elapsed_us(since[i], now) / tau)
        else:
            out[i] = value[i] * exp(-elapsed_us(since[i], now) / tau)


FURTHEST = 30.0
"""Largest time between an event and the reference time of its cell, in time constants. The memory is then rescaled."""


@subkernel
def leave(now, t, x, y, constants, oldest, reference, here, filled, following):
    """Remove events that have left the window from the memory of a cell. Arguments as for `histograms`.

    Returns:
        The oldest event that stays, -1 for none.
    """
    cell, radius, window, tau, _ = constants
    while oldest >= 0 and elapsed_us(t[oldest], now) > window:
        i, j = y[oldest] % cell + radius, x[oldest] % cell + radius
        filled[i, j] -= 1
        here[i, j] = here[i, j] - exp((t[oldest] - reference) / tau) if filled[i, j] else 0.0
        oldest = following[oldest]
    return oldest


@kernel
def forget(t, x, y, constants, memory, inside, queues, following):
    """Remove the events that have left the window by the time of the last event from all cells.

    No result changes, because a cell changes only at its own events, and later events do not use the removed events.
    The remaining events are renumbered: the first event that is still in a memory becomes event 0. Arguments as for
    `histograms`.

    Returns:
        The old number of the new event 0.
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
    """Sum the time surfaces of all events, as HATS does, in one pass.

    Each cell stores the sum of decayed events per pixel, and removes events that leave the window.

    The memory of a cell refers to a reference time, so that an event changes one value only: an event at time t_j is
    stored as exp((t_j - reference) / tau), and the memory is scaled when it is read. The reference time is moved before
    stored values exceed e^30. A pixel whose last event leaves the window is set to exactly 0, without rounding error.

    Args:
        columns: t, (n,) int64, us; x and y, uint16; p, uint8.
        begin: number of old events: they were processed before and are in the memory.
        constants: side of a cell (px), radius (px), window (us), tau (us), and the contribution of an event to its own
            surface.
        memory: (rows, columns, 2, cell + 2 radius, cell + 2 radius) float64, sum of decayed events per pixel, with a
            margin of 0. Initially 0.
        inside: int32 of the same shape, number of events in the sum. Initially 0.
        queues: (3, rows, columns, 2) int64, oldest event, newest event and reference time (us) of each cell and
            polarity. Initially -1.
        following: (n,) int64, next event of the same cell and polarity, -1 for none. It is read for old events and
            written for new events.
        sums: (rows, columns, 2, size, size) float64, incremented.
        counts: (rows, columns, 2) int64, incremented.
    """
    t, x, y, p = columns
    cell, radius, _, tau, includes_event = constants
    size = 2 * radius + 1
    for k in range(begin, t.shape[0]):
        time = t[k]
        r, c, q = y[k] // cell, x[k] // cell, p[k]
        here, filled = memory[r, c, q], inside[r, c, q]
        oldest, newest, reference = queues[0, r, c, q], queues[1, r, c, q], queues[2, r, c, q]
        if counts[r, c, q] == 0:
            reference = time
        oldest = leave(time, t, x, y, constants, oldest, reference, here, filled, following)
        if elapsed_us(reference, time) / tau > FURTHEST:
            scale = exp(-elapsed_us(reference, time) / tau)
            for i in range(here.shape[0]):
                for j in range(here.shape[1]):
                    here[i, j] *= scale
            reference = time
        row, column = y[k] % cell, x[k] % cell
        scale = exp((reference - time) / tau)
        for i in range(size):
            for j in range(size):
                sums[r, c, q, i, j] += here[row + i, column + j] * scale
        sums[r, c, q, radius, radius] += includes_event
        counts[r, c, q] += 1
        here[row + radius, column + radius] += exp((time - reference) / tau)
        filled[row + radius, column + radius] += 1
        following[k] = -1
        if oldest < 0:
            oldest = k
        else:
            following[newest] = k
        queues[0, r, c, q], queues[1, r, c, q], queues[2, r, c, q] = oldest, k, reference


@kernel
def msd(t, tau_us, threshold, v, last, cuts):
    """Find the events at which a motion symbol detector reaches its threshold; see `segmentation.MSD`.

    Args:
        t: (n,) int64, us.
        tau_us: decay time constant, us.
        threshold: potential at which a segment is complete, events.
        v: potential after the events so far.
        last: time of the last event so far, us.
        cuts: (n,) int64, output: number of these events up to the end of each segment.

    Returns:
        The number of cuts, the potential, and the time of the last event.
    """
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
def peaks(t, last, n_before, constants, state, candidate, queue_t, queue_v, n_queued, cuts):
    """Find the peaks of a leaky integrator's potential; see `segmentation.Peaks`.

    A queue holds the events of the search range whose potential no later event exceeds. The first event of the queue
    therefore has the highest potential.

    Args:
        t: (n,) int64, us.
        last: time of the event before these events, us.
        n_before: number of events before these events.
        constants: tau, rise, v0, search (us) and threshold.
        state: (2,) float64, slow and fast part of the potential.
        candidate: (2,) int64, number (-1: none) and time (us) of an event that may be a peak.
        queue_t: (n_queued + n,) int64, times of the queued events, us.
        queue_v: (n_queued + n,) float64, potentials of the queued events.
        n_queued: length of the queue so far.
        cuts: (n + 1,) int64, output: number of events of the recording up to each peak, including the peak.

    Returns:
        The number of cuts, and the positions of the queue's beginning and end.
    """
    tau, rise, v0, search, threshold = constants
    slow, fast = state
    number, time = candidate
    n, head, tail = 0, 0, n_queued
    for k in range(t.shape[0]):
        now = t[k]
        minus_dt = last - now
        slow = slow * exp(minus_dt / tau) + v0
        if rise > 0.0:
            fast = fast * exp(minus_dt / rise) + v0
        v = slow - fast
        last = now
        if number >= 0 and now - time > search:
            cuts[n] = number + 1
            n += 1
            number = -1
        while head < tail and now - queue_t[head] > search:
            head += 1
        if (head == tail or queue_v[head] < v) and v > threshold:
            number, time = n_before + k, now
        while head < tail and queue_v[tail - 1] <= v:
            tail -= 1
        queue_t[tail] = now
        queue_v[tail] = v
        tail += 1
    state[0], state[1] = slow, fast
    candidate[0], candidate[1] = number, time
    return n, head, tail
