"""A program in a chip's integers: registers, weight words and delays, with what rounding did to each.

This is all that the chip backend sees beside the program itself.
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
    """A quantity that a register holds.

    Attributes:
        quantity: as the language names it, e.g. "tau_m".
        unit: of `wanted` and `got`.
        wanted, got: the described value and the one that the register stands for, of the neuron where they differ most.
        error: their difference relative to what matters (for a potential, the distance of V_th from E_L).
    """

    quantity: str
    unit: str
    wanted: float
    got: float
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class FixedPopulation:
    """A population in registers.

    Attributes:
        name: of the population.
        kind: "source" and "current" (generators, on the host), "relay", or which of its family's integer steps it
            takes, e.g. "loihi_lif".
        registers: by name, shape (1,) where all neurons share it, else (size,).
        initial: state registers at step 0, likewise.
        volt: units of the voltage register per mV.
        rest: potential in mV where the voltage register is 0, shape (1,) or (size,).
        ampere: units of the current registers per pA of the excitatory and the inhibitory current, shape (1,) or
            (size,); empty where currents have no meaning.
        drive: units per pA that a constant current adds to the register that holds it.
        rounding: what the registers differ in from the description.
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
    """What rounding does to the weights of a projection.

    Attributes:
        saturated: share of the weights that are larger than the largest mantissa.
        zeroed: share of the weights other than 0 that become 0.
        worst: largest relative error of a weight that does not become 0.
        rms: root of the mean squared error relative to the root of the mean squared weight.
    """

    saturated: float
    zeroed: float
    worst: float
    rms: float


@dataclass(frozen=True, slots=True, eq=False)
class FixedProjection:
    """A projection in words.

    Attributes:
        name: of the projection.
        mantissas: what the weight memory holds, shape (1,) where shared, else one per synapse (of a grid: per weight of
            its kernels). On SpiNNaker the sign says the receptor.
        words: what a spike adds to the input of its target (Loihi: in units of 64).
        low, high: smallest and largest mantissa; `grain` is the step between two.
        exponent: Loihi's weight exponent; SpiNNaker: 0.
        sign_mode: Loihi's; "" elsewhere.
        bits: of a mantissa.
        step: weight in the unit of the language per mantissa, shape (1,) or one per mantissa; `step_below` that of
            negative ones, which on SpiNNaker go to another receptor.
        lag: steps from the emission of a spike to the update that sees it, shape (1,) or one per synapse; see
            `neuro.chips.inputs`.
        delay: the delay register, likewise.
        rule: of synapses that learn on the chip, else None.
        n_scale: dopamine in 1/ms of one unit of the modulatory traces.
        native: whether the weights of the language are the mantissas, bits that the chip drops included.
        shift: by how many bits the sum of a step is shifted down before it is added to that of other projections.
        wraps: whether that sum is a two's complement of 24 bits.
        receptor: 1 where it goes to the second input of neurons in registers, the imaginary one.
        rounding: what became of the weights.
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
    def apart(self) -> bool:
        """Whether the sum of a step is not simply added to that of other projections."""
        return bool(self.shift or self.wraps or self.receptor)

    def weights(self, mantissas: Words | Floats) -> Floats:
        """What mantissas stand for, in the unit of the language."""
        steps: Floats = np.where(mantissas < 0, self.step_below, self.step)
        return mantissas * steps

    def acting(self, words: Words) -> Floats:
        """What words send, in the unit of the language: less than their mantissas where bits were lost."""
        return self.weights(words.astype(np.float64) * 2.0 ** -(self.exponent + self.shift))

    def exact(self, weights: Floats) -> Floats:
        """Weights in units of a mantissa, before rounding."""
        values: Floats = weights / np.where(weights < 0.0, self.step_below, self.step)
        return values


SAMPLE = 512
"""Different weights of a projection that a scale is judged by."""


def thinned(weights: Floats) -> Floats:
    """Some of many weights: the largest, the smallest and others evenly between; all of few."""
    if weights.size > 64 * SAMPLE:
        return np.concatenate(([weights.min(), weights.max()], weights[:: weights.size // (32 * SAMPLE)]))
    return weights


def sampled(weights: Floats) -> Floats:
    """Some of the different ones among weights that are thinned."""
    values = np.unique(weights)
    if values.size <= SAMPLE:
        return values
    return values[np.linspace(0, values.size - 1, SAMPLE).round().astype(np.int64)]


def round_weights(
    weights: Floats, above: Floats, below: Floats, low: int, high: int, grain: int, keep: bool = True
) -> tuple[Words, WeightRounding]:
    """The nearest mantissas, and what rounding did.

    Args:
        weights: as described, one or one per synapse.
        above: weight per mantissa, one or one per synapse.
        below: that of negative weights.
        low: the smallest mantissa.
        high: the largest.
        grain: the step between two; a tie goes to the even step.
        keep: whether mantissas are wanted; none else.
    """
    size = 0 if not weights.size else max(weights.size, above.size)
    mantissas = np.zeros(size if keep else 0, dtype=np.int32)
    peak = max(float(weights.max(initial=0.0)), -float(weights.min(initial=0.0)))
    if peak == 0.0:
        return mantissas, WeightRounding(0.0, 0.0, 0.0, 0.0)
    found = np.zeros(6)
    judge(weights, above, below, low, high, grain, peak, mantissas, found)
    outside, nonzero, kept, worst, error, square = found.tolist()
    rms = math.sqrt(error / square)
    return mantissas, WeightRounding(outside / size, (nonzero - kept) / nonzero, _clean(worst), _clean(rms))


def judge_weights(
    weights: Floats, mantissas: Words | Floats, step: Floats | float, low: int, high: int
) -> WeightRounding:
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


def scale_errors(values: Floats, steps: NDArray[np.float64], low: int, high: int, grain: int) -> Floats:
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


class FarthestWeight(NamedTuple):
    """A weight that no mantissa reaches, and what one mantissa is worth there."""

    weight: float
    step: float


def farthest_weight(weights: Floats, step: Floats, low: int, high: int) -> FarthestWeight:
    """The weight that is furthest beyond the mantissas from low to high."""
    every, steps = np.broadcast_arrays(weights, step)
    exact = every / steps
    at = int(np.argmax(np.maximum(exact - high, low - exact)))
    return FarthestWeight(float(every[at]), float(steps[at]))


def worst_rounding(name: str, unit: str, wanted: ArrayLike, got: ArrayLike, scale: ArrayLike) -> Rounding:
    """The rounding of the neuron whose register differs most, relative to `scale`."""
    w, g, s = np.broadcast_arrays(np.atleast_1d(wanted), np.atleast_1d(got), np.asarray(scale, dtype=np.float64))
    with np.errstate(invalid="ignore"):
        error = np.nan_to_num(np.where(w == g, 0.0, (g - w) / s), nan=np.inf)
    at = int(np.argmax(np.abs(error)))
    return Rounding(name, unit, float(w[at]), float(g[at]), float(error[at]) if abs(error[at]) > 1e-12 else 0.0)


RUN = 4096
"""Squares that are summed before they are added to a sum of all: a sum of many millions of them loses fewer bits."""


@kernel
def arriving(targets, weight, sign, total):
    """Add to each target the weights of a sign, in their order."""
    for e in range(targets.size):
        w = sign * weight[e]
        if w > 0.0:
            total[targets[e]] += w


@kernel
def judge(weights, above, below, low, high, grain, peak, mantissas, found):
    """Round weights to mantissas, and see what that did to them.

    Args:
        weights: one per synapse, or one of all.
        above: weight per mantissa of weights from 0, one or one per synapse.
        below: the same of negative ones.
        low: the smallest mantissa.
        high: the largest.
        grain: mantissas are multiples of it, or these ends; a tie goes to the even one.
        peak: the largest magnitude of a weight, more than 0.
        mantissas: is filled, or empty.
        found: is filled: weights beyond a mantissa, those other than 0, those of them that do not become 0, the largest
            relative error of one, and the squares of all errors and of all weights, relative to `peak`.
    """
    n = max(weights.size, above.size) if weights.size else 0
    own, each, keep = weights.size > 1, above.size > 1, mantissas.size > 0
    half = 0.5 + 1e-9
    beyond = nonzero = kept = 0
    worst = errors = squares = 0.0
    for first in range(0, n, RUN):
        error_run = square_run = 0.0
        for e in range(first, min(first + RUN, n)):
            w = weights[e if own else 0]
            k = e if each else 0
            step = below[k] if w < 0.0 else above[k]
            exact = w / step
            beyond += (exact > high + half) | (exact < low - half)
            m = min(max(np.rint(w / (step * grain)) * grain, low), high)
            if keep:
                mantissas[e] = m
            sent = m * step
            if w != 0.0:
                nonzero += 1
                if m != 0:
                    kept += 1
                    worst = max(worst, abs(sent / w - 1.0))
            error = (sent - w) / peak
            square = w / peak
            error_run += error * error
            square_run += square * square
        errors += error_run
        squares += square_run
    found[0], found[1], found[2] = beyond, nonzero, kept
    found[3], found[4], found[5] = worst, errors, squares
