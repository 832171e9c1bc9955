"""Decoding the 5-byte words of N-MNIST."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel

WORD = 5
OVERFLOW_ROW = 240
OVERFLOW_US = 1 << 13


@kernel
def decode(words, begin, t, x, y, p):
    """Decode words.

    Args:
        words: (5 n,) uint8.
        begin: us added to every time so far.
        t: (n,) int64, filled.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        number of events, largest x and y, whether time does not run back, and us added from here on.
    """
    n = 0
    x_max = np.uint8(0)
    y_max = np.uint8(0)
    ordered = True
    last = np.int64(-1)
    for k in range(t.size):
        at = WORD * k
        row = words[at + 1]
        if row == OVERFLOW_ROW:
            begin += OVERFLOW_US
            continue
        high = words[at + 2]
        now = begin + ((np.int64(high & 0x7F) << 16) | (np.int64(words[at + 3]) << 8) | np.int64(words[at + 4]))
        t[n] = now
        x[n] = words[at]
        y[n] = row
        p[n] = high >> 7
        x_max = max(x_max, words[at])
        y_max = max(y_max, row)
        ordered &= now >= last
        last = now
        n += 1
    return n, x_max, y_max, ordered, begin
