"""The scales, impulses and shares of Loihi's learning engine that come nearest to given numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from neuro.core.errors import ModelError
from neuro.model.synapses.loihi_rule import (
    FRACTION_BITS,
    LARGEST_EXPONENT,
    LARGEST_U,
    MANTISSA_BITS,
    PRODUCT_BITS,
    TRACE_MAX,
    WIDTHS,
    Factor,
    Term,
)

LARGEST_IMPULSE = 31
"""Leaves room for four spikes in 7 bits."""
SMALLEST_UPDATE = 2.0**-FRACTION_BITS
"""A change by less than this many mantissas is cut to nothing: mappings are refused below it."""
COARSE_UPDATE = 16 * SMALLEST_UPDATE
"""Below this many mantissas cutting loses up to 6 % of a change, or a trace has less than 16 levels: a warning."""
_MANTISSAS = (1, 3, 5, 7)


@dataclass(frozen=True, slots=True)
class Fit:
    """An impulse and a scale mantissa 2^exponent; `value` is their product."""

    impulse: int
    mantissa: int
    exponent: int

    @property
    def value(self) -> float:
        """What one spike makes of it."""
        return self.impulse * self.mantissa * 2.0**self.exponent


def nearest_fit(change: float, bits: int, what: str) -> Fit:
    """Impulse and scale whose product is nearest to a change; of those within 1 % the one with the largest impulse.

    Raises:
        ModelError: none is within a quarter.
    """
    lowest = -FRACTION_BITS - max(0, bits - PRODUCT_BITS)
    found = []
    for impulse in range(1, LARGEST_IMPULSE + 1):
        for mantissa in _MANTISSAS:
            exponent = round(math.log2(change / (impulse * mantissa)))
            fit = Fit(impulse, mantissa, min(LARGEST_EXPONENT, max(lowest, exponent)))
            off = abs(fit.value / change - 1.0)
            found.append(((off > 0.01, off if off > 0.01 else -impulse, mantissa), fit, off))
    _, fit, off = min(found, key=lambda entry: entry[0])
    if off > 0.25:
        raise too_small(what, change) if fit.value > change else too_large(what, change)
    return fit


def signal_fit(gain: float, largest_n: float, b: float) -> tuple[Fit, float]:
    """A scale and the unit of r1 and r2 that makes it exact, so that `largest_n` fits 7 bits.

    Of the units up to four times the smallest one that does, the one of which `b` is most nearly a whole number.
    """
    lowest = -FRACTION_BITS - (WIDTHS["t"] + WIDTHS["r1"] + MANTISSA_BITS - PRODUCT_BITS)
    units = [
        (mantissa * 2.0**exponent / gain, mantissa, exponent)
        for mantissa in _MANTISSAS
        for exponent in range(lowest, LARGEST_EXPONENT + 1)
    ]
    fitting = [unit for unit in units if unit[0] * TRACE_MAX >= largest_n]
    if not fitting:
        raise too_large("stdp_dopa: dopamine", largest_n * gain)
    finest = min(fitting)[0]
    n_scale, mantissa, exponent = min(
        (unit for unit in fitting if unit[0] <= 4 * finest), key=lambda u: (abs(round(b / u[0]) * u[0] - b), u[0])
    )
    return Fit(0, mantissa, exponent), n_scale


def fading(tau: float) -> tuple[tuple[Term, ...], str]:
    """Products by which a tag decays with a time constant in steps: a share of 128ths in every 2^k-th step."""
    found = []
    for every in range(LARGEST_U + 1):
        share = 1.0 - math.exp(-(2**every) / tau)
        part = max(1, round(share * 128))
        if share <= 0.25 or every == 0:
            found.append((abs(-(2**every) / math.log1p(-min(part, 127) / 128) / tau - 1.0), every, min(part, 127)))
    near = [entry for entry in found if entry[0] <= 0.01]
    off, every, part = near[0] if near else min(found)
    bits = [1 << k for k in range(7) if part >> k & 1]
    terms = tuple(Term(-1, bit.bit_length() - 8, "u", every, (Factor("t"),)) for bit in bits)
    return terms, f"the eligibility loses {part}/128 in every {2**every}th step: tau_c is {off:.1%} off"


def too_small(what: str, change: float) -> ModelError:
    """The error for a change that the accumulator cannot hold."""
    return ModelError(
        f"{what}: a change of {change:.3g} mantissas cannot be represented: the smallest is {SMALLEST_UPDATE:.3g}",
        hint="a smaller weight scale (weight exponent) or a larger step size of the rule",
    )


def too_large(what: str, change: float) -> ModelError:
    """The error for a change beyond the accumulator."""
    return ModelError(
        f"{what}: a change of {change:.3g} mantissas does not fit the accumulator",
        hint="a larger weight scale (weight exponent) or a smaller step size of the rule",
    )
