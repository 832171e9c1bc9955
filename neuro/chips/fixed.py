"""Program in a chip's integers: registers, weight words and delays, with their rounding errors.

The chip backend reads only these classes and the program itself.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.chips.spinnaker_rule import SpinnakerRule
from neuro.kernels.jit import kernel
from neuro.model.synapses.loihi_rule import LearningRule
from neuro.program.program import Floats, Ints

Words = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Rounding:
    """Rounding error of a quantity in a register.

    Attributes:
        quantity: name of the quantity in the language, e.g. "tau_m".
        unit: unit of `exact` and `got`.
        exact, got: the described value and the value of the register, for the neuron with the largest difference.
        error: their difference, relative to a typical scale (for a potential, the distance from E_L to V_th).
    """

    quantity: str
    unit: str
    exact: float
    got: float
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class FixedPopulation:
    """A population in registers.

    Attributes:
        name: name of the population.
        kind: "source" and "current" (generators, on the host), "relay", or the integer step of the population's family,
            e.g. "loihi_lif".
        registers: registers by name, shape (1,) if all neurons share the value, else (size,).
        initial: state registers at step 0, of the same shapes.
        volt: units of the voltage register per mV.
        rest: potential in mV at which the voltage register is 0, shape (1,) or (size,).
        ampere: units of the current registers per pA, for the excitatory and the inhibitory current, each of shape (1,)
            or (size,); empty if currents have no meaning.
        drive: units per pA in the register for constant currents.
        rounding: differences between the registers and the description.
    """

    name: str
    kind: str
    registers: dict[str, Ints] = field(default_factory=dict)
    initial: dict[str, Ints] = field(default_factory=dict)
    volt: float = 1.0
    rest: Floats = field(default_factory=lambda: np.zeros(1))
    ampere: tuple[Floats, ...] = ()
    drive: Floats = field(default_factory=lambda: np.zeros(1))
    rounding: tuple[Rounding, ...] = ()


@dataclass(frozen=True, slots=True)
class WeightRounding:
    """The effect of rounding on the weights of a projection.

    Attributes:
        saturated: share of the weights beyond the largest mantissa.
        zeroed: share of the nonzero weights that become 0.
        worst: largest relative error of a weight that does not become 0.
        rms: root mean squared error, relative to the root mean squared weight.
    """

    saturated: float
    zeroed: float
    worst: float
    rms: float


@dataclass(frozen=True, slots=True, eq=False)
class FixedProjection:
    """A projection in words.

    Attributes:
        name: name of the projection.
        mantissas: content of the weight memory, shape (1,) if shared, else one per synapse (for a grid, one per
            weight of its kernels). On SpiNNaker the sign selects the receptor.
        words: amount that a spike adds to the input of its target (Loihi: in units of 64).
        low, high: smallest and largest mantissa; `grain` is the step between two mantissas.
        exponent: Loihi's weight exponent; 0 on SpiNNaker.
        sign_mode: Loihi's sign mode; "" elsewhere.
        bits: bits of a mantissa.
        step: weight per mantissa in the unit of the language, shape (1,) or one per mantissa; `step_below` holds for
            negative mantissas, which act on another receptor on SpiNNaker.
        lag: steps from the emission of a spike to the update that sees it, shape (1,) or one per synapse; see
            `neuro.chips.inputs`.
        delay: content of the delay register, of the same shape.
        rule: rule of synapses that learn on the chip, else None.
        n_scale: dopamine in 1/ms per unit of the modulatory traces.
        native: whether the weights in YAML are mantissas, including the bits that the chip drops.
        shift: right shift of the sum of a step, in bits, before other projections are added.
        wraps: whether the sum of a step wraps as a two's complement of 24 bits.
        receptor: 1 for the second (imaginary) input of neurons in registers, else 0.
        rounding: the rounding errors of the weights.
    """

    name: str
    mantissas: Words
    words: Words
    low: int
    high: int
    grain: int
    exponent: int
    sign_mode: str
    bits: int
    step: Floats
    step_below: Floats
    lag: Words
    delay: Words
    rule: LearningRule | SpinnakerRule | None = None
    n_scale: float = 0.0
    native: bool = False
    shift: int = 0
    wraps: bool = False
    receptor: int = 0
    rounding: WeightRounding = WeightRounding(0.0, 0.0, 0.0, 0.0)

    @property
    def sums_apart(self) -> bool:
        """True if the sum of a step is processed before the sums of other projections are added."""
        return bool(self.shift or self.wraps or self.receptor)

    def weights(self, mantissas: Words | Floats) -> Floats:
        """Return mantissas as weights in the unit of the language."""
        steps: Floats = np.where(mantissas < 0, self.step_below, self.step)
        return mantissas * steps

    def acting(self, words: Words) -> Floats:
        """Convert words to weights in the unit of the language; lost bits stay lost."""
        return self.weights(words.astype(np.float64) * 2.0 ** -(self.exponent + self.shift))

    def exact(self, weights: Floats) -> Floats:
        """Return weights in units of a mantissa, before rounding."""
        values: Floats = weights / np.where(weights < 0.0, self.step_below, self.step)
        return values


SAMPLE = 512
"""Largest number of different weights of a projection for the evaluation of a scale."""


def thinned(weights: Floats) -> Floats:
    """Reduce many weights to the largest, the smallest and evenly spaced others; few weights are unchanged."""
    if weights.size > 64 * SAMPLE:
        return np.concatenate(([weights.min(), weights.max()], weights[:: weights.size // (32 * SAMPLE)]))
    return weights


def sampled(weights: Floats) -> Floats:
    """Return at most `SAMPLE` different values of thinned weights, evenly spaced in the sorted list."""
    values = np.unique(weights)
    if values.size <= SAMPLE:
        return values
    return values[np.linspace(0, values.size - 1, SAMPLE).round().astype(np.int64)]


def round_weights(
    weights: Floats, above: Floats, below: Floats, low: int, high: int, grain: int, keep: bool = True
) -> tuple[Words, WeightRounding]:
    """Round weights to the nearest mantissas, and return them with the rounding errors.

    Args:
        weights: described weights, one for all or one per synapse.
        above: weight per mantissa of weights >= 0, one for all or one per synapse.
        below: weight per mantissa of negative weights.
        low: smallest mantissa.
        high: largest mantissa.
        grain: step between two mantissas; a tie goes to the even step.
        keep: whether to return mantissas; otherwise the array is empty.
    """
    size = 0 if not weights.size else max(weights.size, above.size)
    mantissas = np.zeros(size if keep else 0, dtype=np.int32)
    peak = max(float(weights.max(initial=0.0)), -float(weights.min(initial=0.0)))
    if peak == 0.0:
        return mantissas, WeightRounding(0.0, 0.0, 0.0, 0.0)
    statistics = np.zeros(6)
    judge(weights, above, below, low, high, grain, peak, mantissas, statistics)
    outside, nonzero, survivors, worst, error, square = statistics.tolist()
    rms = math.sqrt(error / square)
    return mantissas, WeightRounding(outside / size, (nonzero - survivors) / nonzero, _clean(worst), _clean(rms))


def judge_weights(
    weights: Floats, mantissas: Words | Floats, step: Floats | float, low: int, high: int
) -> WeightRounding:
    """Return the rounding errors of some weights.

    Args:
        weights: described weights, one per mantissa.
        mantissas: the rounded weights.
        step: weight per mantissa.
        low: smallest mantissa.
        high: largest mantissa.
    """
    nonzero = weights != 0.0
    if not nonzero.any():
        return WeightRounding(0.0, 0.0, 0.0, 0.0)
    exact = weights / step
    tolerance = 0.5 + 1e-9
    has_outside = exact.max() > high + tolerance or exact.min() < low - tolerance
    saturated = float(np.mean((exact > high + tolerance) | (exact < low - tolerance))) if has_outside else 0.0
    survives = nonzero & (mantissas != 0)
    error = np.multiply(mantissas, step, out=exact)  # later overwritten by the errors, to save memory
    ratio = np.divide(error, weights, out=np.ones_like(error), where=survives)
    ratio -= 1.0
    worst = float(np.max(np.abs(ratio, out=ratio), initial=0.0))
    peak = float(np.abs(weights).max())
    error -= weights
    error /= peak
    square = np.divide(weights, peak, out=ratio)
    rms = float(np.sqrt(np.sum(np.square(error, out=error)) / np.sum(np.square(square, out=square))))
    n_nonzero = int(nonzero.sum())
    return WeightRounding(saturated, float((n_nonzero - int(survives.sum())) / n_nonzero), _clean(worst), _clean(rms))


def _clean(error: float) -> float:
    """Return 0 for an error in only the last bits of a double."""
    return 0.0 if error < 1e-12 else error


def scale_errors(values: Floats, steps: NDArray[np.float64], low: int, high: int, grain: int) -> Floats:
    """Return the mean squared error of some weights, relative to their mean square, for each candidate step."""
    peak = float(np.abs(values).max(initial=0.0))
    if peak == 0.0:
        return np.zeros(steps.size)
    relative, sizes = values[None, :] / peak, steps[:, None] / peak
    exact = relative / sizes
    mantissas = np.clip(np.rint(exact / grain) * grain, low, high)
    errors: Floats = np.sum(((mantissas - exact) * sizes) ** 2, axis=1) / np.sum(relative**2)
    errors[errors < 1e-24] = 0.0
    return errors


class FarthestWeight(NamedTuple):
    """A weight beyond all mantissas, and the weight per mantissa at that synapse."""

    weight: float
    step: float


def farthest_weight(weights: Floats, step: Floats, low: int, high: int) -> FarthestWeight:
    """Return the weight that is furthest beyond the mantissas from low to high."""
    all_weights, steps = np.broadcast_arrays(weights, step)
    exact = all_weights / steps
    index = int(np.argmax(np.maximum(exact - high, low - exact)))
    return FarthestWeight(float(all_weights[index]), float(steps[index]))


def worst_rounding(name: str, unit: str, exact: ArrayLike, got: ArrayLike, scale: ArrayLike) -> Rounding:
    """Return the rounding of the neuron with the largest difference, relative to `scale`."""
    w, g, s = np.broadcast_arrays(np.atleast_1d(exact), np.atleast_1d(got), np.asarray(scale, dtype=np.float64))
    with np.errstate(invalid="ignore"):
        error = np.nan_to_num(np.where(w == g, 0.0, (g - w) / s), nan=np.inf)
    k = int(np.argmax(np.abs(error)))
    return Rounding(name, unit, float(w[k]), float(g[k]), float(error[k]) if abs(error[k]) > 1e-12 else 0.0)


RUN = 4096
"""Number of squares per partial sum. With many millions of squares, partial sums are more exact than one sum."""


@kernel
def arriving(targets, weight, sign, total):
    """Add the weights of a sign to their targets, in the order of the synapses."""
    for e in range(targets.size):
        w = sign * weight[e]
        if w > 0.0:
            total[targets[e]] += w


@kernel
def judge(weights, above, below, low, high, grain, peak, mantissas, statistics):
    """Round weights to mantissas and measure the errors.

    Args:
        weights: weights, one per synapse or one for all.
        above: weight per mantissa of weights >= 0, one for all or one per synapse.
        below: weight per mantissa of negative weights.
        low: smallest mantissa.
        high: largest mantissa.
        grain: step between mantissas, which are multiples of `grain`, or `low` or `high`. Ties go to the even multiple.
        peak: largest magnitude of a weight, more than 0.
        mantissas: output, or empty.
        statistics: output of six numbers: weights beyond the mantissas, nonzero weights, nonzero weights that do not
            become 0, the largest relative error of those, and the sums of squared errors and of squared weights,
            relative to `peak`.
    """
    n = max(weights.size, above.size) if weights.size else 0
    has_own_weights, has_own_steps, keep = weights.size > 1, above.size > 1, mantissas.size > 0
    tolerance = 0.5 + 1e-9
    n_beyond = n_nonzero = n_survivors = 0
    largest_error = errors = squares = 0.0
    for first in range(0, n, RUN):
        error_run = square_run = 0.0
        for e in range(first, min(first + RUN, n)):
            w = weights[e if has_own_weights else 0]
            k = e if has_own_steps else 0
            step = below[k] if w < 0.0 else above[k]
            exact = w / step
            n_beyond += (exact > high + tolerance) | (exact < low - tolerance)
            m = min(max(np.rint(w / (step * grain)) * grain, low), high)
            if keep:
                mantissas[e] = m
            value = m * step
            if w != 0.0:
                n_nonzero += 1
                if m != 0:
                    n_survivors += 1
                    largest_error = max(largest_error, abs(value / w - 1.0))
            error = (value - w) / peak
            square = w / peak
            error_run += error * error
            square_run += square * square
        errors += error_run
        squares += square_run
    statistics[0], statistics[1], statistics[2] = n_beyond, n_nonzero, n_survivors
    statistics[3], statistics[4], statistics[5] = largest_error, errors, squares
