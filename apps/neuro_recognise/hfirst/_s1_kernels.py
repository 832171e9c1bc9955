# mypy: ignore-errors
"""The compiled loop of `neuro_recognise.hfirst.s1`."""

import numpy as np

from neuro.apps import allocating


@allocating
def first_spikes(steps, rows, columns, bank, leak, threshold, held, height, width):
    """Spikes of layer S1: of the orientations at a place the first to reach threshold, which resets the others.

    A place is brought up to date where an event reaches it. Of equal orientations the first fires.

    steps: int64[n], ascending, in which events arrive; rows, columns: int64[n]; bank: float64[side, side,
    orientations], mV; leak: mV a step; held: steps of rest after a spike. Returns int64[2, spikes]: steps and neurons,
    (orientation, row, column) in C order.
    """
    side, orientations = bank.shape[0], bank.shape[2]
    half = side // 2
    v = np.zeros((height, width, orientations))
    since = np.zeros((height, width), np.int64)
    free = np.zeros((height, width), np.int64)
    reached = np.empty((height * width, 2), np.int64)
    found = np.empty((2, 256), np.int64)
    n, k = 0, 0
    while k < steps.size:
        now, touched = steps[k], 0
        while k < steps.size and steps[k] == now:
            y, x = rows[k], columns[k]
            for r in range(max(0, y - half), min(height, y + half + 1)):
                for c in range(max(0, x - half), min(width, x + half + 1)):
                    if now < free[r, c]:
                        continue
                    here, taps = v[r, c], bank[half + y - r, half + x - c]
                    if since[r, c] != now:
                        lost = leak * (now - since[r, c])
                        for o in range(orientations):
                            here[o] -= min(max(here[o], -lost), lost)
                        since[r, c] = now
                        reached[touched, 0], reached[touched, 1] = r, c
                        touched += 1
                    for o in range(orientations):
                        here[o] += taps[o]
            k += 1
        for place in range(touched):
            r, c = reached[place]
            best = v[r, c].argmax()
            if v[r, c, best] < threshold:
                continue
            if n == found.shape[1]:
                more = np.empty((2, 2 * n), np.int64)
                more[:, :n] = found
                found = more
            found[0, n], found[1, n] = now, (best * height + r) * width + c
            n += 1
            v[r, c] = 0.0
            free[r, c] = now + held + 1
    return found[:, :n].copy()
