"""The clock of EVT 3.0, without its events."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel

TIME_HIGH = 8


@kernel
def track(words, high, kinds):
    """Follow TIME_HIGH through words, as `neuro.events.formats._evt3_kernel.decode` does.

    Args:
        words: (n,) uint16.
        high: bits 12 and more of the time with all wraps, -1 before the first TIME_HIGH.
        kinds: bits of the kinds of words that were seen.

    Returns:
        high and kinds after them, and the largest high.
    """
    most = high
    for k in range(words.size):
        word = np.int64(words[k])
        kind = word >> 12
        kinds |= 1 << kind
        if kind == TIME_HIGH:
            value = word & 0xFFF
            last = high & 0xFFF
            if high < 0:
                high = value
            elif value != last:
                high = (((high >> 12) + (last >= value + 2048)) << 12) | value
            most = max(most, high)
    return high, kinds, most
