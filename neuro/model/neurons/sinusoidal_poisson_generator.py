"""A Poisson process whose rate follows a sine."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Generator
from neuro.model.neurons.generators import poisson


@dataclass(frozen=True, kw_only=True, eq=False)
class sinusoidal_poisson_generator(Generator):
    """Emits a Poisson number of spikes each step, at a rate that follows a sine; below 0 it counts as 0.

    In NEST one generator sends each target a train of its own, unless `individual_spike_trains` is false. Here each
    neuron has one train; so while it is true, a neuron may have one target only.
    """

    equation: ClassVar[str] = (
        "number of spikes in a step ~ Poisson(max(0, rate + amplitude sin(2 pi frequency t / 1000 + pi phase / 180)) "
        "h / 1000)"
    )
    source: ClassVar[str] = "NEST 3.10 sinusoidal_poisson_generator"
    timed: ClassVar[bool] = True
    fixed: ClassVar[tuple[str, ...]] = ("individual_spike_trains",)

    rate: Value = quantity(0.0, "Hz", "mean rate", at_least=0, arrays=True)
    amplitude: Value = quantity(0.0, "Hz", "how far the rate rises and falls", arrays=True)
    frequency: Value = quantity(0.0, "Hz", "of the sine", at_least=0, arrays=True)
    phase: Value = quantity(0.0, "deg", "of the sine at t = 0", arrays=True)
    individual_spike_trains: bool = quantity(True, "", "whether targets must not share a train", kind="boolean")
    start: float = quantity(0.0, "ms", "emits after this time", at_least=0)
    stop: float = quantity(math.inf, "ms", "and up to this one", at_least=0, infinite=True)


MEAN, AMPLITUDE, PER_STEP, PHASE = range(4)


def constants(p, h, c):
    """Spikes a step, and the sine's angle a step; `p` are the parameters above in order but start and stop."""
    c[MEAN], c[AMPLITUDE] = p[0] * h / 1000.0, p[1] * h / 1000.0
    c[PER_STEP], c[PHASE] = 2.0 * math.pi / 1000.0 * p[2] * h, math.pi / 180.0 * p[3]


def emit(s, c, u, step, lo, hi, out):
    """Poisson numbers of one mean."""
    mean = c[MEAN] + c[AMPLITUDE] * math.sin(c[PER_STEP] * step + c[PHASE])
    if mean > 0.0:
        nothing = math.exp(-mean)
        for i in range(lo, hi):
            if u[i] >= nothing:
                out[i] = poisson(u[i], mean, nothing)
