"""Conversion of an event camera's events to spikes, as a kernel that is imported with the first recording."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import kernel
from neuro.program.program import Ints


@kernel
def see(
    t: Ints,
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    p: NDArray[np.uint8],
    eye: Any,
    after: int,
    steps: Ints,
    ids: Ints,
) -> int:
    """Write steps and neurons of the visible events in steps after `after`; return their number.

    If an event is outside a population that is smaller than the sensor, return -1 - (index of the event).
    """
    n = 0
    step, begin, end = 0, 1, 0  # step of the last event and its times; avoids most divisions
    for k in range(t.shape[0]):
        since = t[k] - eye.begin
        if since < 0:
            continue
        if not begin <= since < end:
            ms_steps = since * eye.denominator // eye.numerator
            step = ms_steps + eye.start + 1
            begin = -(-ms_steps * eye.numerator // eye.denominator)
            end = -(-(ms_steps + 1) * eye.numerator // eye.denominator)
        if step <= after or step > eye.stop:
            continue
        column, row = np.int64(x[k]), np.int64(y[k])
        if column < eye.left or column >= eye.right or row < eye.top or row >= eye.bottom:
            continue
        if eye.polarity >= 0 and p[k] != eye.polarity:
            continue
        column -= eye.left
        row -= eye.top
        if eye.scale > 1:
            column //= eye.scale
            row //= eye.scale
        if column >= eye.columns or row >= eye.rows:
            return -1 - k
        steps[n] = step
        ids[n] = row * eye.columns + column + p[k] * eye.polarity_stride
        n += 1
    return n
