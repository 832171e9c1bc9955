"""Codes that give values: rates in Hz, or what a further code makes into spikes."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.coding.arguments import Floats, check_bounds, check_inside, number, positive, share, whole, word
from neuro.core.checks import numbers
from neuro.core.errors import ModelError

_WIDTHS = 1.5  # Bohte's beta: fields are as wide as their distance over it


def rate(r: npt.ArrayLike, r_min: float, r_max: float, max_rate: float, min_rate: float = 0.0) -> Floats:
    """Rate code: rates in proportion to values.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        r_min: the value with the lowest rate.
        r_max: the value with the highest rate.
        max_rate: the highest rate, Hz.
        min_rate: the lowest rate, at least 0 and below ``max_rate``, Hz.

    Returns:
        Rates in Hz, shape of ``r``.

    Raises:
        ModelError: what is no number, not ``r_min < r_max``, not ``0 <= min_rate < max_rate``, or a value outside of
            the range.

    Source: thesis eq. 12, line 672: a rate is a number of spikes over a time.
    """
    low, high = number(min_rate, "min_rate"), number(max_rate, "max_rate")
    if not 0 <= low < high:
        told = f"min_rate is {min_rate} and max_rate {max_rate}"
        raise ModelError(f"{told}, expected 0 <= min_rate < max_rate", path=("max_rate",))
    rates: Floats = low + (high - low) * share(r, r_min, r_max)
    return rates


def population(
    r: npt.ArrayLike,
    n: int,
    r_min: float,
    r_max: float,
    max_rate: float,
    fields: Literal["gaussian", "cosine"] = "gaussian",
) -> Floats:
    """Population code: each value excites n neurons, the more the nearer it is to the centres of their fields.

    Gaussian fields lie on a line: with the distance ``d = (r_max - r_min) / (n - 2)`` the centre of neuron i, from
    0, is ``r_min + (i - 1/2) d``, and the standard deviation d / 1.5. Cosine fields lie on a circle, on which
    ``r_min`` and ``r_max`` are one direction: neuron i prefers the angle ``2 pi i / n`` from it, and its rate is the
    cosine of the angle to that, or 0 where it is negative.

    Args:
        r: values between ``r_min`` and ``r_max``, any shape and unit.
        n: neurons for each value, at least 3.
        r_min: the smallest value.
        r_max: the largest value.
        max_rate: what a neuron gives for its field's centre, Hz.
        fields: "gaussian" on a line or "cosine" on a circle.

    Returns:
        Rates in Hz, the shape of ``r`` and an axis of n.

    Raises:
        ModelError: what is no number, not ``r_min < r_max``, ``n`` or ``max_rate`` out of bounds, another word for
            ``fields``, or a value outside of the range.

    Source: gaussian: Bohte, La Poutre & Kok, IEEE Trans. Neural Networks 13 (2002); cosine: Georgopoulos,
        Schwartz & Kettner, Science 233 (1986).
    """
    neurons = np.arange(whole(n, "n", 3, 2**20))
    peak = positive(max_rate, "max_rate")
    circle = word(fields, "fields", ("gaussian", "cosine")) == "cosine"
    check_bounds(r_min, r_max)
    values = numbers(r, "r")
    check_inside(values, r_min, r_max)
    if circle:
        angle = 2.0 * np.pi * ((values[..., None] - r_min) / (r_max - r_min) - neurons / neurons.size)
        return peak * np.maximum(np.cos(angle), 0.0)
    distance = (r_max - r_min) / (neurons.size - 2)
    away = (values[..., None] - r_min) / distance - (neurons - 0.5)
    activity: Floats = peak * np.exp(-0.5 * (_WIDTHS * away) ** 2)
    return activity
