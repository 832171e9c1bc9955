# mypy: ignore-errors
"""Compiled loops of `neuro_events.dvs`.

Times are float64, us since the first image. While the log intensity of a pixel changes linearly with slope s, the
low-passed log intensity minus the true one is lag(u) = (lag + s/r) exp(-ru) - s/r. Here u is the time since the start
of the change, lag is the difference at u = 0, and r is the bandwidth in 1/us. The pixel compares its thresholds with
v(u) = v + a u + q (exp(-ru) - 1), where v is the change up to u = 0 since the last event, a = s + leak, and q = lag +
s/r (q = 0 without a limit of the bandwidth).
"""

from __future__ import annotations

from math import exp, expm1, inf, isnan, log, nan
from typing import Any, NamedTuple

import numpy as np

from neuro.apps import draws
from neuro.extend import allocating, kernel, subkernel

BLOCK = 64
SETTLED = 40.0
"""Time constants after which a lag is negligible: exp(-40) is less than the rounding error of 1."""
TIE = 1e-9
"""Tolerance of the thresholds, log units. Light that returns to its old value then triggers as many OFF as ON events in
spite of rounding. v2e rounds its log intensities to 1e-8 for this purpose."""
PIXEL = np.dtype(
    [
        ("leak", "f8"),  # log units per us
        ("bright", "f8"),  # v2e's inten01: (i + 20) / 275, where i is 0 to 255 in the last image that changed it
        ("since", "f8"),  # time to which change and lag refer
        ("lag", "f8"),  # low-passed minus true log intensity
        ("listen", "f8"),  # end of the refractory period
        ("noise", "f8"),  # time of the next noise candidate
        ("drawn", "i8"),  # number of random words drawn
    ]
)
"""State of a pixel, except its levels."""
ON, OFF, LOG, CHANGE = range(4)
"""Columns of the levels of all pixels, log units: the thresholds, the log intensity of the last image in which the
pixel changed, and the change since the last event. The levels are an array apart from the state, because pixels that
stay below their thresholds need only the levels, and a smaller array is faster."""
FIXED = np.dtype([("cutoff", "f8"), ("blind", "f8"), ("wait", "f8"), ("dimmed", "f8"), ("seed", "i8")])
"""Parameters of all pixels: cutoff at full scale, 1/us, or 0; refractory period, us; mean time between noise candidates
in the dark, us; share of the candidates that is dropped at full scale; seed."""


class Pixels(NamedTuple):
    """Arrays of a camera with n pixels in m blocks.

    Attributes:
        fixed: (1,) `FIXED`.
        state: (n,) `PIXEL`.
        levels: (n, 4) float64, see `ON`.
        due: (n,) float64, us: earliest time of the next event of a pixel with constant light.
        block_due: (m,) float64, us: smallest `due` of each block.
        blocks: (m,) int64, output of `look`: the blocks to process.
        changed: (m,) int64, output of `look`: the number of changed pixels in each of these blocks.
        index: (n,) int64, output of `pick`: the pixels to process.
        logs: (n,) float64, output of `pick`: log intensities of these pixels, NaN if unchanged.
        bright: (n,) float64, output of `pick`: `bright` of these pixels in the new image, see `PIXEL`.
    """

    fixed: Any
    state: Any
    levels: Any
    due: Any
    block_due: Any
    blocks: Any
    changed: Any
    index: Any
    logs: Any
    bright: Any


class Curve(NamedTuple):
    """Curve from intensity to log intensity.

    Attributes:
        table: (levels,) log intensities of integer images; empty for floats.
        scale: factor from the image's values to shares of full scale.
        floor: intensity added to the light.
        knee: intensity above which the log begins.
        slope: slope of the line below the knee.
        height: offset of the line at 0.
    """

    table: Any
    scale: float
    floor: float
    knee: float
    slope: float
    height: float


@subkernel
def draw(seed, pixel, number):
    """Return random word `number` of a pixel. The word depends only on the three arguments."""
    key = draws.mix(np.uint64(seed) + np.uint64(pixel) * np.uint64(0x9E3779B97F4A7C15))
    return draws.mix(key + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15))


@subkernel
def unit(word):
    """Convert the upper 53 bits of a word to a number between 0 and 1, both exclusive."""
    return (float(word >> np.uint64(11)) + 0.5) / 9007199254740992.0


@subkernel
def next_noise(state, i, fixed):
    """Draw the time of the next noise candidate. The lowest bit of the drawn word is the polarity of the candidate."""
    state.drawn += 1
    state.noise -= fixed.wait * log(unit(draw(fixed.seed, i, state.drawn)))


@subkernel
def lag_change(q, r, u):
    """Return the change of the lag after time u, which also changes v. Without a limit of the bandwidth, return 0."""
    return q * expm1(-r * u) if q != 0.0 else 0.0


@subkernel
def value(v, a, q, r, u):
    """Return v(u); see the module's docstring."""
    return v + a * u + lag_change(q, r, u)


@subkernel
def root(v, a, q, r, target, lower, upper):
    """Return the time in [lower, upper] at which v(u) reaches the target, for monotone v(u).

    v(u) is convex for q > 0 and concave for q < 0. Newton's method does not overshoot if it starts at the end of the
    interval at which v(u) - target has the sign of q.
    """
    u = upper if (value(v, a, q, r, upper) - target) * q > 0.0 else lower
    for _ in range(60):
        slope = a - q * r * exp(-r * u)
        if slope == 0.0:
            break
        step = (value(v, a, q, r, u) - target) / slope
        u = min(max(u - step, lower), upper)
        if abs(step) < 1e-6:
            break
    return u


@subkernel
def crossing(v, a, q, r, on, off, span):
    """Return the first time up to `span` at which v(u) reaches a threshold (inf: never), and the polarity."""
    if q == 0.0:
        if a > 0.0 and v + a * span >= on - TIE:
            return min((on - v) / a, span), 1
        if a < 0.0 and v + a * span <= TIE - off:
            return min((-off - v) / a, span), 0
        return inf, 0
    if max(a * span, 0.0) + abs(q) < on - TIE - v and min(a * span, 0.0) - abs(q) > TIE - off - v:
        return inf, 0
    turning_point = span
    if a * q > 0.0 and q * r / a > 1.0:
        turning_point = min(span, log(q * r / a) / r)
    lower = 0.0
    for upper in (turning_point, span):
        end = value(v, a, q, r, upper)
        if end >= on - TIE:
            return root(v, a, q, r, on, lower, upper), 1
        if end <= TIE - off:
            return root(v, a, q, r, -off, lower, upper), 0
        lower = upper
    return inf, 0


@subkernel
def bandwidth(state, fixed):
    """Return the bandwidth of a pixel, 1/us, in proportion to its intensity."""
    return fixed.cutoff * state.bright


@subkernel
def due_time(state, levels, i, fixed):
    """Return a lower bound of the time of a pixel's next event or noise candidate with constant light."""
    r = bandwidth(state, fixed)
    wait = max(state.listen - state.since, 0.0)
    q = state.lag + lag_change(state.lag, r, wait)
    on_level, off_level, change = levels[i, ON], levels[i, OFF], levels[i, CHANGE]
    high = change + abs(q)
    if high < on_level and change - abs(q) > -off_level:
        u = (on_level - high) / state.leak if state.leak > 0.0 else inf
    else:
        span = inf
        if q != 0.0:
            span = SETTLED / r + ((on_level + off_level + abs(q)) / state.leak if state.leak > 0.0 else 0.0)
        u, _ = crossing(change, state.leak, q, r, on_level, off_level, span)
    return min(state.since + wait + u, state.noise)


@subkernel
def run(state, levels, i, s, end, fixed, origin, earliest, n, out):
    """Simulate a pixel whose log intensity changes with slope s until `end`.

    Returns:
        The number of events written, and False if the output arrays were full before `end`.
    """
    out_t, out_pixel, out_p = out
    r = bandwidth(state, fixed)
    start = state.since
    span = end - start
    u = 0.0
    blind = state.listen - start
    a = s + state.leak
    tail = s / r if r > 0.0 else 0.0
    while True:
        if blind > u:
            wake = min(blind, span)
            state.lag += lag_change(state.lag + tail, r, wake - u)
            u = wake
            if u >= span:
                break
        q = state.lag + tail
        delay, p = crossing(levels[i, CHANGE], a, q, r, levels[i, ON], levels[i, OFF], span - u)
        due_time = min(u + delay, span) if delay < inf else inf
        while state.noise - start <= u:
            next_noise(state, i, fixed)
        while state.noise - start < due_time and state.noise <= end:
            word = draw(fixed.seed, i, state.drawn)
            if unit(draws.mix(word)) >= fixed.dimmed * min(state.bright, 1.0):
                due_time = state.noise - start
                p = int(word & np.uint64(1))
                break
            next_noise(state, i, fixed)
        if due_time == inf:
            change = lag_change(q, r, span - u)
            levels[i, CHANGE] += a * (span - u) + change
            state.lag += change
            break
        if n == out_t.shape[0]:
            state.since = start + u
            return n, False
        out_t[n] = origin + max(int(start + due_time), earliest)
        out_pixel[n] = i
        out_p[n] = p
        n += 1
        state.lag += lag_change(q, r, due_time - u)
        levels[i, CHANGE] = 0.0
        u = due_time
        blind = due_time + fixed.blind
        state.listen = start + blind
    state.since = end
    return n, True


@kernel
def advance(k, count, t0, t1, origin, pixels, out):
    """Simulate the pixels from `pick` from t0 to t1, with a linear change of their log intensity.

    Returns:
        The number of events written, and the place in `index` to continue from. A place below `count` means that the
        output arrays are full: call again with new arrays.
    """
    fixed, levels, due = pixels.fixed[0], pixels.levels, pixels.due
    index, logs, bright = pixels.index, pixels.logs, pixels.bright
    n = 0
    earliest = int(t0)
    for j in range(k, count):
        i = index[j]
        state = pixels.state[i]
        s = 0.0
        if not isnan(logs[j]):
            if state.since < t0:
                n, is_finished = run(state, levels, i, 0.0, t0, fixed, origin, earliest, n, out)
                if not is_finished:
                    return n, j
            s = (logs[j] - levels[i, LOG]) / (t1 - t0)
            state.bright = bright[j]
            end = levels[i, CHANGE] + (s + state.leak) * (t1 - t0)
            quiet = fixed.cutoff == 0.0 and state.listen <= t0 and state.noise > t1
            if quiet and TIE - levels[i, OFF] < end < levels[i, ON] - TIE:
                levels[i, CHANGE] = end
                state.since = t1
                levels[i, LOG] = logs[j]
                crossing = t1 + (levels[i, ON] - end) / state.leak if state.leak > 0.0 else inf
                due[i] = min(crossing, state.noise)
                continue
        n, is_finished = run(state, levels, i, s, t1, fixed, origin, earliest, n, out)
        if not is_finished:
            return n, j
        if not isnan(logs[j]):
            levels[i, LOG] = logs[j]
        due[i] = due_time(state, levels, i, fixed)
    return n, count


@kernel
def begin(pixels):
    """Initialise the pixels with the first image, at time 0."""
    fixed, levels = pixels.fixed[0], pixels.levels
    for i in range(pixels.due.size):
        state = pixels.state[i]
        levels[i, LOG] = pixels.logs[i]
        state.bright = pixels.bright[i]
        if fixed.wait < inf:
            next_noise(state, i, fixed)
        else:
            state.noise = inf
        pixels.due[i] = due_time(state, levels, i, fixed)


@kernel
def in_order(t, pixel, p, width, order, out_t, out_x, out_y, out_p):
    """Write events in the given order, with columns and rows of their pixels."""
    for k in range(order.size):
        i = order[k]
        out_t[k] = t[i]
        out_y[k] = pixel[i] // width
        out_x[k] = pixel[i] % width
        out_p[k] = p[i]


@kernel
def few_in_order(t, pixel, p, width, out_t, out_x, out_y, out_p):
    """Sort events by time with insertion, and write them as `in_order` does. Events at equal times keep their order."""
    for i in range(t.size):
        k = i
        while k > 0 and out_t[k - 1] > t[i]:
            out_t[k], out_x[k], out_y[k], out_p[k] = out_t[k - 1], out_x[k - 1], out_y[k - 1], out_p[k - 1]
            k -= 1
        out_t[k] = t[i]
        out_y[k] = pixel[i] // width
        out_x[k] = pixel[i] % width
        out_p[k] = p[i]


MANY = 48
"""Smallest number of changed pixels of a block that is processed in one vectorised loop."""


@subkernel
def differing(new, old, low, high):
    """Return the number of pixels from low to high - 1 that differ. The loop has no branches, so it is vectorised."""
    count = 0
    for i in range(np.uint64(low), np.uint64(high)):  # unsigned, to avoid the test for negative indices
        count += new[i] != old[i]
    return count


@subkernel
def outside(low, high, width, box):
    """Return whether pixels low to high - 1 lie in one row and outside a box's columns. Rows are not checked."""
    row = low // width
    return high <= (row + 1) * width and (high - row * width <= box[0] or low - row * width >= box[2])


@subkernel
def possible(new, scale, low, high):
    """Return whether all intensities from low to high - 1 are finite and not negative. The loop is vectorised."""
    bad = 0
    for i in range(np.uint64(low), np.uint64(high)):
        light = new[i] * scale
        bad |= (not light >= 0.0) | (light == inf)
    return bad == 0


@subkernel
def update_silent_block(logs, low, high, levels):
    """Update a block of pixels without leak and noise, and return True. If a pixel has an event, only return False."""
    has_event = 0
    start = np.uint64(low)
    for i in range(np.uint64(high - low)):
        end = levels[start + i, CHANGE] + (logs[i] - levels[start + i, LOG])
        has_event |= (end >= levels[start + i, ON] - TIE) | (end <= TIE - levels[start + i, OFF])
    if has_event:
        return False
    for i in range(np.uint64(high - low)):
        levels[start + i, CHANGE] += logs[i] - levels[start + i, LOG]
        levels[start + i, LOG] = logs[i]
    return True


@kernel
def look(new, old, first, box, width, scale, t1, pixels):
    """Find the blocks with pixels that changed or are due up to t1, and check the intensities of these blocks.

    Args:
        new: the image, flat.
        old: the image before, flat.
        first: treat all pixels as changed.
        box: x0, y0, x1, y1: the part of the image that may have changed.
        width: width of the image, px.
        scale: factor from the image's values to shares of full scale.
        t1: time of the image, us.
        pixels: `Pixels`; `blocks` and `changed` are written.

    Returns:
        The number of blocks, and the first pixel with an impossible intensity or -1.
    """
    n = 0
    block_due, blocks, changed = pixels.block_due, pixels.blocks, pixels.changed
    above, below = box[1] * width, box[3] * width
    for block in range(block_due.size):
        low = block * BLOCK
        high = min(low + BLOCK, new.size)
        is_inside = high > above and low < below and not outside(low, high, width, box)
        if block_due[block] > t1 and not is_inside and not first:
            continue
        count = high - low if first else differing(new, old, low, high)
        if count == 0 and block_due[block] > t1:
            continue
        blocks[n], changed[n] = block, count
        n += 1
        if count and not possible(new, scale, low, high):
            for i in range(low, high):
                if not possible(new, scale, i, i + 1):
                    return n, i
    return n, -1


@subkernel
def log_intensity(value, curve):
    """Return the log intensity of a pixel."""
    if curve.table.size:
        return curve.table[int(value)]
    light = value * curve.scale + curve.floor
    return log(light) if light > curve.knee else light * curve.slope + curve.height


@allocating
def pick(new, old, first, count, calm, curve, t1, pixels):
    """Find the pixels that changed or are due in the blocks of `look`, and update those without an event directly.

    Args:
        new: the image, flat.
        old: the image before, flat.
        first: treat all pixels as changed.
        count: number of blocks.
        calm: True if the pixels have no leak, noise, limit of the bandwidth and refractory period.
        curve: `Curve`.
        t1: time of the image, us.
        pixels: `Pixels`; `index`, `logs` and `bright` are written.

    Returns:
        The number of pixels to process.
    """
    blocks, changed, due, levels = pixels.blocks, pixels.changed, pixels.due, pixels.levels
    index, logs, bright = pixels.index, pixels.logs, pixels.bright
    k = 0
    block_logs = np.empty(BLOCK)
    for b in range(count):
        low = blocks[b] * BLOCK
        high = min(low + BLOCK, new.size)
        has_logs = calm and not first and changed[b] >= MANY
        if has_logs:
            for i in range(low, high):
                is_same = new[i] == old[i]
                block_logs[i - low] = levels[i, LOG] if is_same else log_intensity(new[i], curve)
            if update_silent_block(block_logs, low, high, levels):
                continue
        for i in range(low, high):
            if changed[b] and (new[i] != old[i] or first):
                new_log = block_logs[i - low] if has_logs else log_intensity(new[i], curve)
                if calm and not first:
                    end = levels[i, CHANGE] + (new_log - levels[i, LOG])
                    if TIE - levels[i, OFF] < end < levels[i, ON] - TIE:
                        levels[i, CHANGE] = end
                        levels[i, LOG] = new_log
                        continue
                index[k] = i
                logs[k] = new_log
                bright[k] = (255.0 * new[i] * curve.scale + 20.0) / 275.0
                k += 1
            elif due[i] <= t1:
                index[k] = i
                logs[k] = nan
                k += 1
    return k


@kernel
def settle(count, new, old, pixels):
    """Store the image of the processed blocks, and the earliest due time of each block."""
    blocks, due, block_due = pixels.blocks, pixels.due, pixels.block_due
    for k in range(count):
        low = blocks[k] * BLOCK
        high = min(low + BLOCK, due.size)
        soonest = inf
        for i in range(low, high):
            old[i] = new[i]
            soonest = min(soonest, due[i])
        block_due[blocks[k]] = soonest
