"""Codes of one spike a value, whose time tells the value or its rank."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.coding.arguments import Floats, check_bounds, check_inside, finite, positive, word
from neuro.core.checks import is_number, numbers
from neuro.core.errors import ModelError


def intensity_to_latency(r: npt.ArrayLike, r_min: float, r_max: float, window: float) -> Floats:
    """Linear intensity-to-latency code (I2L): the largest value spikes at 0, the smallest at ``window``.

    ``t = window (r_max - r) / (r_max - r_min)``

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value that spikes last.
        r_max: the value that spikes first.
        window: length of the code, in the unit wanted for the times (ms).

    Returns:
        Spike times, shape of ``r``, in [0, window].

    Raises:
        ModelError: what is no number, not ``r_min < r_max``, ``window`` not positive, or a value outside of the range.

    Source: thesis eq. 14, line 689, with its misprint corrected: as printed it gives late spikes to high
        values, against the sentence before it.
    """
    check_bounds(r_min, r_max)
    length, values = positive(window, "window"), numbers(r, "r")
    check_inside(values, r_min, r_max)
    latency: Floats = length * (r_max - values) / (r_max - r_min)
    return latency


def log_intensity_to_latency(r: npt.ArrayLike, r_min: float, r_max: float, window: float) -> Floats:
    """Logarithmic intensity-to-latency code (log I2L): equal ratios of values give equal delays.

    ``t = window (ln r_max - ln r) / (ln r_max - ln r_min)``

    Args:
        r: values between ``r_min`` and ``r_max``, or at most 0, which have no logarithm and no spike; any shape and
            unit.
        r_min: the value that spikes last; more than 0.
        r_max: the value that spikes first.
        window: length of the code, in the unit wanted for the times (ms).

    Returns:
        Spike times, shape of ``r``, in [0, window]; NaN where there is no spike.

    Raises:
        ModelError: what is no number, not ``0 < r_min < r_max``, ``window`` not positive, or a value above 0 outside
            of the range.

    Source: thesis eq. 15, line 693.
    """
    if is_number(r_min) and not r_min > 0:
        raise ModelError(f"r_min is {r_min}, expected more than 0 for a logarithmic code", path=("r_min",))
    check_bounds(r_min, r_max)
    length, values = positive(window, "window"), numbers(r, "r")
    spiking = ~((values <= 0) & np.isfinite(values))
    check_inside(values[spiking], r_min, r_max)
    logarithm = np.log(values, where=spiking, out=np.full(values.shape, np.nan))
    latency: Floats = length * (np.log(r_max) - logarithm) / (np.log(r_max) - np.log(r_min))
    return latency


def rank(r: npt.ArrayLike, ties: Literal["order", "dense"] = "order", window: float | None = None) -> Floats:
    """Rank code: the largest of all values spikes first, whatever its size.

    Args:
        r: values, any shape and unit; all are ranked together.
        ties: "order": equal values spike one after the other, the first in C order first; "dense": they share a
            rank, and the next value has the next one.
        window: length of the code; the ranks themselves are the times if it is not given (ms).

    Returns:
        Spike times, shape of ``r``: the ranks 1 to n, or ``window rank / n`` for n values.

    Raises:
        ModelError: what is no finite number, another word for ``ties``, or ``window`` not positive.

    Source: thesis section 2.3.2, line 697.
    """
    dense = word(ties, "ties", ("order", "dense")) == "dense"
    scale = None if window is None else positive(window, "window")
    values = finite(r, "r")
    flat = values.ravel()
    ranks = np.empty(flat.size)
    if dense:
        ranks[:] = np.unique(-flat, return_inverse=True)[1].reshape(-1) + 1
    else:
        ranks[np.argsort(-flat, kind="stable")] = np.arange(1, flat.size + 1)
    times = ranks if scale is None else scale * ranks / max(flat.size, 1)
    return times.reshape(values.shape)
