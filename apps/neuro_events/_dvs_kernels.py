# mypy: ignore-errors
"""Compiled loops of `neuro_events.dvs`.

Times are float64, us since the first image. While the image of a pixel changes along a straight line
of slope s, its low-passed log intensity lags behind by lag(u) = (lag + s/r) exp(-ru) - s/r, where u is
the time since then and r the bandwidth in 1/us. So what the pixel sees of a change is
v(u) = v + a u + q (exp(-ru) - 1), with a = s + leak and q = lag + s/r (0 without a limit of bandwidth).
"""

from __future__ import annotations

from math import exp, expm1, inf, isnan, log, nan
from typing import Any, NamedTuple

import numpy as np

from neuro.apps import draws
from neuro.extend import allocating, kernel, subkernel

BLOCK = 64
SETTLED = 40.0
"""Time constants after which a lag is gone: exp(-40) is less than the rounding of 1."""
TIE = 1e-9
"""Log units by which a threshold may be missed, so that light that comes back to where it was makes as many
OFF as ON events in spite of rounding. v2e rounds its log intensities to 1e-8 for this."""
PIXEL = np.dtype(
    [
        ("leak", "f8"),  # log units per us
        ("bright", "f8"),  # intensity of the image that was last different, v2e's inten01
        ("since", "f8"),  # time at which change and lag hold
        ("lag", "f8"),  # low-passed minus true log intensity
        ("listen", "f8"),  # blind until then
        ("noise", "f8"),  # time of the next noise event, if it is let through
        ("drawn", "i8"),  # random words used
    ]
)
"""State of a pixel, beside its levels."""
ON, OFF, LOG, CHANGE = range(4)
"""Columns of the levels of all pixels, log units: thresholds, log of the image that was last different, change since
the last event. They lie apart from the rest, which a pixel that stays below its thresholds does not need."""
FIXED = np.dtype([("cutoff", "f8"), ("blind", "f8"), ("wait", "f8"), ("dimmed", "f8"), ("seed", "i8")])
"""Of all pixels: cutoff 1/us at full scale or 0, refractory us, mean us between noise events in the dark,
share of them that full scale takes away, seed."""


class Pixels(NamedTuple):
    """Arrays of a camera with n pixels in m blocks.

    Attributes:
        fixed: (1,) `FIXED`.
        state: (n,) `PIXEL`.
        levels: (n, 4) float64, see `ON`.
        due: (n,) float64, us: until then a pixel has no event while its image stays as it is.
        block_due: (m,) float64, us: the first of each block.
        blocks: (m,) int64, filled by `look` with the blocks to be looked at.
        changed: (m,) int64, filled by `look` with the number of their pixels that changed.
        index: (n,) int64, filled by `pick` with the pixels to be worked on.
        logs: (n,) float64, filled by `pick` with their log intensities, nan: as before.
        bright: (n,) float64, filled by `pick` with their inten01.
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
    """The log intensity of light.

    Attributes:
        table: (levels,) log intensities, empty for floats.
        scale: that of the images.
        floor: what is added to the light.
        knee: where the log begins.
        slope: of the line below it.
        height: of the line at 0.
    """

    table: Any
    scale: float
    floor: float
    knee: float
    slope: float
    height: float


@subkernel
def draw(seed, pixel, number):
    """The pixel's random word of this number: a function of nothing else."""
    key = draws.mix(np.uint64(seed) + np.uint64(pixel) * np.uint64(0x9E3779B97F4A7C15))
    return draws.mix(key + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15))


@subkernel
def unit(word):
    """A number between 0 and 1, both excluded, from the upper 53 bits."""
    return (float(word >> np.uint64(11)) + 0.5) / 9007199254740992.0


@subkernel
def next_noise(state, i, all_):
    """Draw the time of the next noise event; the lowest bit of the word is its polarity."""
    state.drawn += 1
    state.noise -= all_.wait * log(unit(draw(all_.seed, i, state.drawn)))


@subkernel
def eased(q, r, u):
    """What the lag, and so v, has changed by because of the limited bandwidth."""
    return q * expm1(-r * u) if q != 0.0 else 0.0


@subkernel
def value(v, a, q, r, u):
    """v(u), see above."""
    return v + a * u + eased(q, r, u)


@subkernel
def root(v, a, q, r, target, left, right):
    """Time in [left, right], where v(u) is monotone and reaches the target.

    v(u) is bent to one side only, so Newton's steps from the outer side of the bend do not overshoot.
    """
    u = right if (value(v, a, q, r, right) - target) * q > 0.0 else left
    for _ in range(60):
        slope = a - q * r * exp(-r * u)
        if slope == 0.0:
            break
        step = (value(v, a, q, r, u) - target) / slope
        u = min(max(u - step, left), right)
        if abs(step) < 1e-6:
            break
    return u


@subkernel
def crossing(v, a, q, r, on, off, span):
    """First time up to span at which v(u) reaches a threshold, and the polarity; inf if it does not."""
    if q == 0.0:
        if a > 0.0 and v + a * span >= on - TIE:
            return min((on - v) / a, span), 1
        if a < 0.0 and v + a * span <= TIE - off:
            return min((-off - v) / a, span), 0
        return inf, 0
    if max(a * span, 0.0) + abs(q) < on - TIE - v and min(a * span, 0.0) - abs(q) > TIE - off - v:
        return inf, 0
    turn = span
    if a * q > 0.0 and q * r / a > 1.0:
        turn = min(span, log(q * r / a) / r)
    left = 0.0
    for right in (turn, span):
        end = value(v, a, q, r, right)
        if end >= on - TIE:
            return root(v, a, q, r, on, left, right), 1
        if end <= TIE - off:
            return root(v, a, q, r, -off, left, right), 0
        left = right
    return inf, 0


@subkernel
def bandwidth(state, all_):
    """1/us; in proportion to the intensity."""
    return all_.cutoff * state.bright


@subkernel
def due_time(state, levels, i, all_):
    """Until when the pixel has no event and draws no noise while its image stays as it is, or a bit less."""
    r = bandwidth(state, all_)
    wait = max(state.listen - state.since, 0.0)
    q = state.lag + eased(state.lag, r, wait)
    on, off, change = levels[i, ON], levels[i, OFF], levels[i, CHANGE]
    high = change + abs(q)
    if high < on and change - abs(q) > -off:
        u = (on - high) / state.leak if state.leak > 0.0 else inf
    else:
        span = inf
        if q != 0.0:
            span = SETTLED / r + ((on + off + abs(q)) / state.leak if state.leak > 0.0 else 0.0)
        u, _ = crossing(change, state.leak, q, r, on, off, span)
    return min(state.since + wait + u, state.noise)


@subkernel
def run(state, levels, i, s, end, all_, origin, earliest, n, out):
    """Let a pixel see the log intensity go with slope s until `end`; returns events written, whether it got there."""
    out_t, out_pixel, out_p = out
    r = bandwidth(state, all_)
    start = state.since
    span = end - start
    u = 0.0
    blind = state.listen - start
    a = s + state.leak
    tail = s / r if r > 0.0 else 0.0
    while True:
        if blind > u:
            wake = min(blind, span)
            state.lag += eased(state.lag + tail, r, wake - u)
            u = wake
            if u >= span:
                break
        q = state.lag + tail
        ahead, p = crossing(levels[i, CHANGE], a, q, r, levels[i, ON], levels[i, OFF], span - u)
        at = min(u + ahead, span) if ahead < inf else inf
        while state.noise - start <= u:
            next_noise(state, i, all_)
        while state.noise - start < at and state.noise <= end:
            word = draw(all_.seed, i, state.drawn)
            if unit(draws.mix(word)) >= all_.dimmed * min(state.bright, 1.0):
                at = state.noise - start
                p = int(word & np.uint64(1))
                break
            next_noise(state, i, all_)
        if at == inf:
            change = eased(q, r, span - u)
            levels[i, CHANGE] += a * (span - u) + change
            state.lag += change
            break
        if n == out_t.shape[0]:
            state.since = start + u
            return n, False
        out_t[n] = origin + max(int(start + at), earliest)
        out_pixel[n] = i
        out_p[n] = p
        n += 1
        state.lag += eased(q, r, at - u)
        levels[i, CHANGE] = 0.0
        u = at
        blind = at + all_.blind
        state.listen = start + blind
    state.since = end
    return n, True


@kernel
def advance(k, count, t0, t1, origin, pixels, out):
    """Let the pixels found by `look` see the image of t1; between t0 and t1 their log goes straight.

    Returns (events written, pixel to go on from); the latter is less than count where the buffers were
    full, and the call must be repeated with fresh ones.
    """
    all_, levels, due = pixels.fixed[0], pixels.levels, pixels.due
    index, logs, bright = pixels.index, pixels.logs, pixels.bright
    n = 0
    earliest = int(t0)
    for j in range(k, count):
        i = index[j]
        state = pixels.state[i]
        s = 0.0
        if not isnan(logs[j]):
            if state.since < t0:
                n, done = run(state, levels, i, 0.0, t0, all_, origin, earliest, n, out)
                if not done:
                    return n, j
            s = (logs[j] - levels[i, LOG]) / (t1 - t0)
            state.bright = bright[j]
            end = levels[i, CHANGE] + (s + state.leak) * (t1 - t0)
            quiet = all_.cutoff == 0.0 and state.listen <= t0 and state.noise > t1
            if quiet and TIE - levels[i, OFF] < end < levels[i, ON] - TIE:
                levels[i, CHANGE] = end
                state.since = t1
                levels[i, LOG] = logs[j]
                later = t1 + (levels[i, ON] - end) / state.leak if state.leak > 0.0 else inf
                due[i] = min(later, state.noise)
                continue
        n, done = run(state, levels, i, s, t1, all_, origin, earliest, n, out)
        if not done:
            return n, j
        if not isnan(logs[j]):
            levels[i, LOG] = logs[j]
        due[i] = due_time(state, levels, i, all_)
    return n, count


@kernel
def begin(pixels):
    """Show the first image, at time 0."""
    all_, levels = pixels.fixed[0], pixels.levels
    for i in range(pixels.due.size):
        state = pixels.state[i]
        levels[i, LOG] = pixels.logs[i]
        state.bright = pixels.bright[i]
        if all_.wait < inf:
            next_noise(state, i, all_)
        else:
            state.noise = inf
        pixels.due[i] = due_time(state, levels, i, all_)


@kernel
def in_order(t, pixel, p, width, order, out_t, out_x, out_y, out_p):
    """Columns and rows of pixels, all in the given order."""
    for k in range(order.size):
        i = order[k]
        out_t[k] = t[i]
        out_y[k] = pixel[i] // width
        out_x[k] = pixel[i] % width
        out_p[k] = p[i]


@kernel
def few_in_order(t, pixel, p, width, out_t, out_x, out_y, out_p):
    """As `in_order`, by time and then as they come: each is put in its place among those before."""
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
"""Changed pixels of a block from which on all of it is tried at once."""


@subkernel
def differing(new, old, low, high):
    """How many pixels from low to high - 1 differ; without a branch, so that it is done many pixels at a time."""
    found = 0
    for i in range(np.uint64(low), np.uint64(high)):  # unsigned: no index is from the end
        found += new[i] != old[i]
    return found


@subkernel
def outside(low, high, width, box):
    """Whether pixels low to high - 1 of the flat image certainly have none in a box; its rows are looked at before."""
    row = low // width
    return high <= (row + 1) * width and (high - row * width <= box[0] or low - row * width >= box[2])


@subkernel
def possible(new, scale, low, high):
    """Whether all intensities from low to high - 1 are finite and not negative; without a branch."""
    bad = 0
    for i in range(np.uint64(low), np.uint64(high)):
        light = new[i] * scale
        bad |= (not light >= 0.0) | (light == inf)
    return bad == 0


@subkernel
def glide(logs, low, high, levels):
    """Take on the logs of a block of pixels without leak and noise if none has an event; returns whether it did."""
    loud = 0
    start = np.uint64(low)
    for i in range(np.uint64(high - low)):
        end = levels[start + i, CHANGE] + (logs[i] - levels[start + i, LOG])
        loud |= (end >= levels[start + i, ON] - TIE) | (end <= TIE - levels[start + i, OFF])
    if loud:
        return False
    for i in range(np.uint64(high - low)):
        levels[start + i, CHANGE] += logs[i] - levels[start + i, LOG]
        levels[start + i, LOG] = logs[i]
    return True


@kernel
def look(new, old, first, box, width, scale, t1, pixels):
    """Find the blocks in which pixels changed or are due until t1, and look at their intensities.

    Args: new, old: images, flat; first: take all for changed; box: x0, y0, x1, y1, outside of which
    nothing changed; width: of the image; scale: of the images; pixels: `Pixels`.
    Returns (number of blocks, first pixel with an impossible intensity or -1).
    """
    n = 0
    block_due, blocks, changed = pixels.block_due, pixels.blocks, pixels.changed
    above, below = box[1] * width, box[3] * width
    for block in range(block_due.size):
        low = block * BLOCK
        high = min(low + BLOCK, new.size)
        within = high > above and low < below and not outside(low, high, width, box)
        if block_due[block] > t1 and not within and not first:
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
    """Log intensity of a pixel."""
    if curve.table.size:
        return curve.table[int(value)]
    seen = value * curve.scale + curve.floor
    return log(seen) if seen > curve.knee else seen * curve.slope + curve.height


@allocating
def pick(new, old, first, count, calm, curve, t1, pixels):
    """Find the pixels that changed or are due in the blocks found by `look`, but for those without an event.

    Args: calm: no pixel has leak, noise, a limit of bandwidth or a refractory period; curve: `Curve`; pixels: `Pixels`.
    Returns the number of pixels.
    """
    blocks, changed, due, levels = pixels.blocks, pixels.changed, pixels.due, pixels.levels
    index, logs, bright = pixels.index, pixels.logs, pixels.bright
    k = 0
    ahead = np.empty(BLOCK)
    for b in range(count):
        low = blocks[b] * BLOCK
        high = min(low + BLOCK, new.size)
        known = calm and not first and changed[b] >= MANY
        if known:
            for i in range(low, high):
                same = new[i] == old[i]
                ahead[i - low] = levels[i, LOG] if same else log_intensity(new[i], curve)
            if glide(ahead, low, high, levels):
                continue
        for i in range(low, high):
            if changed[b] and (new[i] != old[i] or first):
                to = ahead[i - low] if known else log_intensity(new[i], curve)
                if calm and not first:
                    end = levels[i, CHANGE] + (to - levels[i, LOG])
                    if TIE - levels[i, OFF] < end < levels[i, ON] - TIE:
                        levels[i, CHANGE] = end
                        levels[i, LOG] = to
                        continue
                index[k] = i
                logs[k] = to
                bright[k] = (255.0 * new[i] * curve.scale + 20.0) / 275.0
                k += 1
            elif due[i] <= t1:
                index[k] = i
                logs[k] = nan
                k += 1
    return k


@kernel
def settle(count, new, old, pixels):
    """Keep what was looked at, and when the first pixel of each block is due."""
    blocks, due, block_due = pixels.blocks, pixels.due, pixels.block_due
    for k in range(count):
        low = blocks[k] * BLOCK
        high = min(low + BLOCK, due.size)
        soonest = inf
        for i in range(low, high):
            old[i] = new[i]
            soonest = min(soonest, due[i])
        block_due[blocks[k]] = soonest
