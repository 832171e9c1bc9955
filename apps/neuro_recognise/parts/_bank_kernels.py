# mypy: ignore-errors
"""Compiled loops of `neuro_recognise.parts.banks`."""

import numpy as np

from neuro.apps import allocating, subkernel


@allocating
def largest_responses(x, y, values, bounds, bank, sizes, height, width, cell, out):
    """Correlate every frame of a recording with the filters, and write the largest response of each cell, at least 0.

    Few pixels of a frame have events. Each pixel with events adds its value times the rotated filter to the responses.
    The result is the 'same' correlation with zeros outside of the frame. A row of a filter is contiguous, with
    orientations innermost, so that the loop over the row is vectorised.

    x, y: uint16[n], inside the frame; values: float64[n], values above 0; bounds: int64[frames + 1]; bank:
    float64[scales, orientations, side, side]; sizes: int64[scales]; cell: side of a cell, px; out:
    float64[frames, scales, orientations, height // cell, width // cell].
    """
    many, side = bank.shape[1], bank.shape[2]
    half = side // 2
    value = np.zeros((height, width))
    rows = np.empty(height * width, np.int64)
    columns = np.empty(height * width, np.int64)
    response = np.empty((height + 2 * half, (width + 2 * half) * many))
    tallest = np.empty(width * many)
    turned = np.empty((bank.shape[0], side, side * many))
    for s in range(bank.shape[0]):
        for i in range(side):
            for j in range(side):
                for o in range(many):
                    turned[s, i, j * many + o] = bank[s, o, side - 1 - i, side - 1 - j]
    for frame in range(out.shape[0]):
        active = 0
        for k in range(bounds[frame], bounds[frame + 1]):
            if value[y[k], x[k]] == 0.0:
                rows[active] = y[k]
                columns[active] = x[k]
                active += 1
            value[y[k], x[k]] += values[k]
        for s in range(bank.shape[0]):
            first = (side - sizes[s]) // 2
            last = first + sizes[s]
            response[:] = 0.0
            for k in range(active):
                pixel = value[rows[k], columns[k]]
                for i in range(first, last):
                    target = response[rows[k] + i, (columns[k] + first) * many : (columns[k] + last) * many]
                    taps = turned[s, i, first * many : last * many]
                    for j in range(len(taps)):
                        target[j] += pixel * taps[j]
            for i in range(out.shape[3]):
                tallest[:] = 0.0
                for a in range(half + cell * i, half + cell * (i + 1)):
                    answered = response[a, half * many : (half + width) * many]
                    for b in range(len(answered)):
                        tallest[b] = answered[b] if answered[b] > tallest[b] else tallest[b]
                for j in range(out.shape[4]):
                    for o in range(many):
                        largest = 0.0
                        for b in range(cell * j, cell * (j + 1)):
                            largest = tallest[b * many + o] if tallest[b * many + o] > largest else largest
                        out[frame, s, o, i, j] = largest
        for k in range(active):
            value[rows[k], columns[k]] = 0.0


@allocating
def leaky_responses(t, x, y, sign, bounds, bank, sizes, height, width, leak, cell, out):
    """Write the largest absolute response of each cell at the end of each frame. Responses leak at a constant rate.

    The leak is applied to a response when an event reaches it, and to all responses at the end of a frame.

    t: int64[n], us; x, y: uint16[n], inside the frame; sign: float64[n], sign of an event; bounds:
    int64[frames + 1]; bank: float64[scales, orientations, side, side]; sizes: int64[scales]; leak: per us; cell: side
    of a cell, px; out: float64[frames, scales, orientations, height // cell, width // cell].
    """
    side = bank.shape[2]
    half = side // 2
    response = np.zeros((bank.shape[0], bank.shape[1], height, width))
    updated = np.zeros((bank.shape[0], height, width), np.int64)
    for frame in range(out.shape[0]):
        for k in range(bounds[frame], bounds[frame + 1]):
            for s in range(bank.shape[0]):
                reach = sizes[s] // 2
                for i in range(max(0, y[k] - reach), min(height, y[k] + reach + 1)):
                    for j in range(max(0, x[k] - reach), min(width, x[k] + reach + 1)):
                        leaked = leak * (t[k] - updated[s, i, j])
                        updated[s, i, j] = t[k]
                        for o in range(bank.shape[1]):
                            tap = bank[s, o, half + i - y[k], half + j - x[k]]
                            response[s, o, i, j] = _leaked(response[s, o, i, j], leaked) + sign[k] * tap
        last = t[bounds[frame + 1] - 1]
        for s in range(bank.shape[0]):
            for o in range(bank.shape[1]):
                for i in range(out.shape[3]):
                    for j in range(out.shape[4]):
                        largest = 0.0
                        for a in range(cell * i, cell * (i + 1)):
                            for b in range(cell * j, cell * (j + 1)):
                                value = abs(_leaked(response[s, o, a, b], leak * (last - updated[s, a, b])))
                                largest = max(largest, value)
                        out[frame, s, o, i, j] = largest


@subkernel
def _leaked(v, amount):
    """Move a response towards 0 by an amount. E.g. with amount 1, 3 becomes 2, and -0.5 becomes 0."""
    return max(v - amount, 0.0) if v > 0.0 else min(v + amount, 0.0)
