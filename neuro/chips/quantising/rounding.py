"""What rounding does: to weights, of which a scale loses more or less, and to the numbers of neurons."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.chips.quantising.fixed import Rounding, WeightRounding, Words
from neuro.program.program import Floats

SAMPLE = 512
"""Different weights of a projection that a scale is judged by."""


def sample(weights: Floats) -> Floats:
    """Some of the different weights: the largest, the smallest and others evenly between."""
    if weights.size > 64 * SAMPLE:
        weights = np.concatenate(([weights.min(), weights.max()], weights[:: weights.size // (32 * SAMPLE)]))
    values = np.unique(weights)
    if values.size <= SAMPLE:
        return values
    return values[np.linspace(0, values.size - 1, SAMPLE).round().astype(np.int64)]


def rounded(weights: Floats, step: Floats | float, low: int, high: int, grain: int) -> Words:
    """The nearest mantissas from low to high in steps of grain; a tie goes to the even step."""
    nearest = np.rint(weights / (np.asarray(step) * grain)) * grain
    mantissas: Words = np.clip(nearest, low, high).astype(np.int32)
    return mantissas


def judged(weights: Floats, mantissas: Words | Floats, step: Floats | float, low: int, high: int) -> WeightRounding:
    """What rounding did to some weights.

    Args:
        weights: as described, one per mantissa.
        mantissas: what became of them.
        step: weight per mantissa.
        low: the smallest mantissa.
        high: the largest.
    """
    nonzero = weights != 0.0
    if not nonzero.any():
        return WeightRounding(0.0, 0.0, 0.0, 0.0)
    exact = weights / step
    half = 0.5 + 1e-9
    beyond = exact.max() > high + half or exact.min() < low - half
    saturated = float(np.mean((exact > high + half) | (exact < low - half))) if beyond else 0.0
    kept = nonzero & (mantissas != 0)
    error = np.multiply(mantissas, step, out=exact)  # what is sent, then by how much it is wrong
    ratio = np.divide(error, weights, out=np.ones_like(error), where=kept)
    ratio -= 1.0
    worst = float(np.max(np.abs(ratio, out=ratio), initial=0.0))
    peak = float(np.abs(weights).max())
    error -= weights
    error /= peak
    square = np.divide(weights, peak, out=ratio)
    rms = float(np.sqrt(np.sum(np.square(error, out=error)) / np.sum(np.square(square, out=square))))
    lost = int(nonzero.sum())
    return WeightRounding(saturated, float((lost - int(kept.sum())) / lost), _clean(worst), _clean(rms))


def _clean(error: float) -> float:
    """0 where only the last bits of a double differ."""
    return 0.0 if error < 1e-12 else error


def errors(values: Floats, steps: NDArray[np.float64], low: int, high: int, grain: int) -> Floats:
    """Mean squared error, relative to the mean square, of some weights for each of some steps."""
    peak = float(np.abs(values).max(initial=0.0))
    if peak == 0.0:
        return np.zeros(steps.size)
    relative, sizes = values[None, :] / peak, steps[:, None] / peak
    exact = relative / sizes
    mantissas = np.clip(np.rint(exact / grain) * grain, low, high)
    lost: Floats = np.sum(((mantissas - exact) * sizes) ** 2, axis=1) / np.sum(relative**2)
    lost[lost < 1e-24] = 0.0
    return lost


class Beyond(NamedTuple):
    """A weight that no mantissa reaches, and what one mantissa is worth there."""

    weight: float
    step: float


def beyond(weights: Floats, step: Floats, low: int, high: int) -> Beyond:
    """The weight that is furthest beyond the mantissas from low to high."""
    every, steps = np.broadcast_arrays(weights, step)
    exact = every / steps
    at = int(np.argmax(np.maximum(exact - high, low - exact)))
    return Beyond(float(every[at]), float(steps[at]))


def worst(name: str, unit: str, wanted: ArrayLike, got: ArrayLike, scale: ArrayLike) -> Rounding:
    """The rounding of the neuron whose register differs most, relative to `scale`."""
    w, g, s = np.broadcast_arrays(np.atleast_1d(wanted), np.atleast_1d(got), np.asarray(scale, dtype=np.float64))
    with np.errstate(invalid="ignore"):
        error = np.nan_to_num(np.where(w == g, 0.0, (g - w) / s), nan=np.inf)
    at = int(np.argmax(np.abs(error)))
    return Rounding(name, unit, float(w[at]), float(g[at]), float(error[at]) if abs(error[at]) > 1e-12 else 0.0)
