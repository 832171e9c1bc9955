# mypy: ignore-errors
"""Compiled loops of `neuro.events.dvs` that find the few pixels of an image which need work."""

from math import inf, log, nan

import numpy as np

from neuro.events._dvs_kernels import BLOCK, CHANGE, LOG, OFF, ON, TIE
from neuro.kernels.jit import allocating, inner, kernel

MANY = 48
"""Changed pixels of a block from which on all of it is tried at once."""


@inner
def differing(new, old, low, high):
    """How many pixels from low to high - 1 differ; without a branch, so that it is done many pixels at a time."""
    found = 0
    for i in range(np.uint64(low), np.uint64(high)):  # unsigned: no index is from the end
        found += new[i] != old[i]
    return found


@inner
def outside(low, high, width, box):
    """Whether pixels low to high - 1 of the flat image certainly have none in a box; its rows are looked at before."""
    row = low // width
    return high <= (row + 1) * width and (high - row * width <= box[0] or low - row * width >= box[2])


@inner
def possible(new, scale, low, high):
    """Whether all intensities from low to high - 1 are finite and not negative; without a branch."""
    bad = 0
    for i in range(np.uint64(low), np.uint64(high)):
        light = new[i] * scale
        bad |= (not light >= 0.0) | (light == inf)
    return bad == 0


@inner
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
def look(new, old, first, box, width, scale, block_due, t1, blocks, changed):
    """Find the blocks in which pixels changed or are due until t1, and look at their intensities.

    Args: new, old: images, flat; first: take all for changed; box: x0, y0, x1, y1, outside of which
    nothing changed; width: of the image; scale: of the images; block_due: us. Filled: the blocks, and
    how many of their pixels changed.
    Returns (number of blocks, first pixel with an impossible intensity or -1).
    """
    n = 0
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


@inner
def curve(value, table, scale, floor, knee, slope, height):
    """Log intensity of a pixel."""
    if table.size:
        return table[int(value)]
    seen = value * scale + floor
    return log(seen) if seen > knee else seen * slope + height


@allocating
def pick(
    new, old, first, blocks, changed, count, calm, table, scale, floor, knee, slope, height, due, t1, levels,
    index, logs, bright,
):  # fmt: skip
    """Find the pixels that changed or are due in the blocks found by `look`, but for those without an event.

    Args: calm: no pixel has leak, noise, a limit of bandwidth or a refractory period; table: (levels,)
    log intensities, empty for floats; floor, knee, slope, height: of the curve; due: (n,), us. Filled:
    index of each pixel, its log (nan: as before), its inten01.
    Returns the number of pixels.
    """
    k = 0
    ahead = np.empty(BLOCK)
    for b in range(count):
        low = blocks[b] * BLOCK
        high = min(low + BLOCK, new.size)
        known = calm and not first and changed[b] >= MANY
        if known:
            for i in range(low, high):
                same = new[i] == old[i]
                ahead[i - low] = levels[i, LOG] if same else curve(new[i], table, scale, floor, knee, slope, height)
            if glide(ahead, low, high, levels):
                continue
        for i in range(low, high):
            if changed[b] and (new[i] != old[i] or first):
                to = ahead[i - low] if known else curve(new[i], table, scale, floor, knee, slope, height)
                if calm and not first:
                    end = levels[i, CHANGE] + (to - levels[i, LOG])
                    if TIE - levels[i, OFF] < end < levels[i, ON] - TIE:
                        levels[i, CHANGE] = end
                        levels[i, LOG] = to
                        continue
                index[k] = i
                logs[k] = to
                bright[k] = (255.0 * new[i] * scale + 20.0) / 275.0
                k += 1
            elif due[i] <= t1:
                index[k] = i
                logs[k] = nan
                k += 1
    return k


@kernel
def settle(blocks, count, new, old, due, block_due):
    """Keep what was looked at, and when the first pixel of each block is due."""
    for k in range(count):
        low = blocks[k] * BLOCK
        high = min(low + BLOCK, due.size)
        soonest = inf
        for i in range(low, high):
            old[i] = new[i]
            soonest = min(soonest, due[i])
        block_due[blocks[k]] = soonest
