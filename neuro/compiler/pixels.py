"""The pixels that events fall on, as steps and neurons, in one pass."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import kernel
from neuro.program.program import Ints


class Eye(NamedTuple):
    """What a camera sees of its sensor, and when.

    Attributes:
        begin: the time of the recording that is its beginning, us.
        numerator, denominator: us in a step, as a ratio.
        start: the step after which the recording begins.
        stop: the last step.
        left, right, top, bottom: columns and rows that are seen, each the first and the one after the last.
        scale: side of the squares of pixels that share a neuron.
        rows, columns: of the population.
        polarity: that which is seen, 0 or 1; -1: both.
        apart: neurons between the two polarities, 0 where they share them.
    """

    begin: int
    numerator: int
    denominator: int
    start: int
    stop: int
    left: int
    right: int
    top: int
    bottom: int
    scale: int
    rows: int
    columns: int
    polarity: int
    apart: int


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
    """Write steps and neurons of the events that are seen in steps after one; return how many they are.

    Where the population is smaller than the sensor: -1 less the index of the first event beyond it.
    """
    n = 0
    step, begin, end = 0, 1, 0  # the step of the event before, and the times in it: most divisions are spared
    for k in range(t.shape[0]):
        since = t[k] - eye.begin
        if since < 0:
            continue
        if not begin <= since < end:
            whole = since * eye.denominator // eye.numerator
            step = whole + eye.start + 1
            begin = -(-whole * eye.numerator // eye.denominator)
            end = -(-(whole + 1) * eye.numerator // eye.denominator)
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
        ids[n] = row * eye.columns + column + p[k] * eye.apart
        n += 1
    return n
