"""Decoding the 8-byte words of AEDAT 2.0."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel

WORD = 8
T_WRAP = 1 << 32
T_HALF = 1 << 31


@kernel
def decode(words, layout, clock, skipped, t, x, y, p):
    """Decode words up to the first that is none of the chip.

    Args:
        words: (8 n,) uint8.
        layout: shift and mask of x, shift and mask of y, shift of the polarity, what it is where ON, bits of samples,
            bits of external events, bits that no word has.
        clock: (2,) int64, the last 32-bit time (-1 before the first) and us added to it; both are brought up to date.
        skipped: (2,) int64, samples and external events; they are counted on.
        t: (n,) int64, filled.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        number of events and of words, largest x and y, and whether time does not run back.
    """
    x_shift, x_mask, y_shift, y_mask, p_shift, on, sample, external, unused = layout
    last = clock[0]
    begin = clock[1]
    n = 0
    x_max = np.int64(0)
    y_max = np.int64(0)
    ordered = True
    before = np.int64(-1)
    done = t.size
    for k in range(t.size):
        at = WORD * k
        address = (
            np.int64(words[at]) << 24 | np.int64(words[at + 1]) << 16 | np.int64(words[at + 2]) << 8 | words[at + 3]
        )
        raw = (
            np.int64(words[at + 4]) << 24 | np.int64(words[at + 5]) << 16 | np.int64(words[at + 6]) << 8 | words[at + 7]
        )
        if address & unused:
            done = k
            break
        if raw - last < -T_HALF:
            begin += T_WRAP
        elif last >= 0 and begin > 0 and raw - last > T_HALF:
            begin -= T_WRAP
        last = raw
        if address & (sample | external):
            skipped[0 if address & sample else 1] += 1
            continue
        column = address >> x_shift & x_mask
        row = address >> y_shift & y_mask
        t[n] = now = begin + raw
        x[n] = column
        y[n] = row
        p[n] = (address >> p_shift & 1) == on
        x_max = max(x_max, column)
        y_max = max(y_max, row)
        ordered &= now >= before
        before = now
        n += 1
    clock[0] = last
    clock[1] = begin
    return n, done, x_max, y_max, ordered
