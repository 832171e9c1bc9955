"""Decoding the 8-byte events of DAT."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel

U = np.uint32


@kernel
def decode(words, side, shift, up, t, x, y, p):
    """Decode events; one simple loop, which the compiler turns into vector instructions.

    Args:
        words: (2 n,) uint32, time and address in turn.
        side: bits of x, all set.
        shift: bit at which y begins; its bits end below `up`.
        up: bit of the polarity.
        t: (n,) int64, filled with the 32-bit times as they are.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        largest x and y, whether time does not run back, all addresses or-ed.
    """
    x_max = U(0)
    y_max = U(0)
    seen = U(0)
    back = U(0)
    rows = (U(1) << U(up - shift)) - U(1)
    last = U(0)
    for k in range(t.size):
        now = words[2 * k]
        address = words[2 * k + 1]
        column = address & U(side)
        row = (address >> U(shift)) & rows
        t[k] = now
        x[k] = column
        y[k] = row
        p[k] = (address >> U(up)) & U(1)
        x_max = max(x_max, column)
        y_max = max(y_max, row)
        seen |= address
        back |= U(now < last)
        last = now
    return x_max, y_max, back == 0, seen
