# mypy: ignore-errors
"""Compiled loops of `neuro_remus.frontend`."""

import numpy as np

from neuro.apps import allocating


@allocating
def c1_responses(x, y, bounds, bank, sizes, height, width, out):
    """S1 and C1 of every pseudo-frame of a recording.

    A frame has far fewer pixels with events than pixels, so each such pixel adds its count times the
    (turned) filter to the response; this is the 'same' convolution with zeros outside of the frame.

    x, y: uint16[n], inside the frame; bounds: int64[frames + 1]; bank: float64[scales, orientations,
    side, side]; sizes: int64[scales]; out: float64[frames, scales, orientations, height // 2, width // 2].
    """
    side = bank.shape[2]
    half = side // 2
    count = np.zeros((height, width), np.int64)
    rows = np.empty(height * width, np.int64)
    columns = np.empty(height * width, np.int64)
    response = np.empty((height + 2 * half, width + 2 * half))
    for frame in range(out.shape[0]):
        active = 0
        for k in range(bounds[frame], bounds[frame + 1]):
            if count[y[k], x[k]] == 0:
                rows[active] = y[k]
                columns[active] = x[k]
                active += 1
            count[y[k], x[k]] += 1
        for s in range(bank.shape[0]):
            first = (side - sizes[s]) // 2
            last = first + sizes[s]
            for o in range(bank.shape[1]):
                response[:] = 0.0
                for k in range(active):
                    value = float(count[rows[k], columns[k]])
                    for i in range(first, last):
                        to = response[rows[k] + i]
                        taps = bank[s, o, side - 1 - i]
                        for j in range(first, last):
                            to[columns[k] + j] += value * taps[side - 1 - j]
                for i in range(out.shape[3]):
                    for j in range(out.shape[4]):
                        a, b = half + 2 * i, half + 2 * j
                        best = max(response[a, b], response[a, b + 1])
                        best = max(best, max(response[a + 1, b], response[a + 1, b + 1]))
                        out[frame, s, o, i, j] = max(best, 0.0)
        for k in range(active):
            count[rows[k], columns[k]] = 0
