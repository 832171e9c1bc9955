"""Numbers to spike times and counts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from neuro.core.checks import is_number, numbers
from neuro.core.errors import ModelError
from neuro.core.registry import Registry

Floats = npt.NDArray[np.float64]


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
    values = _checked(r, r_min, r_max, window)
    latency: Floats = window * (r_max - values) / (r_max - r_min)
    return latency


def log_intensity_to_latency(r: npt.ArrayLike, r_min: float, r_max: float, window: float) -> Floats:
    """Logarithmic intensity-to-latency code (log I2L).

    ``t = window (ln r_max - ln r) / (ln r_max - ln r_min)``: equal ratios give equal delays.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value that spikes last; more than 0.
        r_max: the value that spikes first.
        window: length of the code, in the unit wanted for the times (ms).

    Returns:
        Spike times, shape of ``r``, in [0, window].

    Raises:
        ModelError: what is no number, not ``0 < r_min < r_max``, ``window`` not positive, or a value outside of the
            range.

    Source: thesis eq. 15, line 693.
    """
    if is_number(r_min) and not r_min > 0:
        raise ModelError(f"r_min is {r_min}, expected more than 0 for a logarithmic code")
    values = _checked(r, r_min, r_max, window)
    latency: Floats = window * (np.log(r_max) - np.log(values)) / (np.log(r_max) - np.log(r_min))
    return latency


def _checked(r: npt.ArrayLike, r_min: float, r_max: float, window: float) -> Floats:
    for name, value in (("r_min", r_min), ("r_max", r_max), ("window", window)):
        if not is_number(value):
            raise ModelError(f"{name} is {value!r:.60}, expected a number")
    if not r_min < r_max:
        raise ModelError(f"r_min is {r_min} and r_max {r_max}, expected r_min < r_max")
    if not window > 0:
        raise ModelError(f"window is {window}, expected more than 0")
    values = numbers(r, "r")
    outside = ~((values >= r_min) & (values <= r_max))
    if outside.any():
        raise ModelError(f"value {values[outside][0]} is outside of [{r_min}, {r_max}]")
    return values


CODES: Registry[Callable[..., Floats]] = Registry(
    "code", (intensity_to_latency, log_intensity_to_latency), group="neuro.codes"
)
"""All codes by name: functions of values and named parameters that give spike times."""
