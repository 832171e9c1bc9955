"""Sources of spikes and currents."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Generator


@dataclass(frozen=True, kw_only=True, eq=False)
class poisson_generator(Generator):
    """Emits a Poisson number of spikes each step, independently for each neuron of the population.

    All targets of one of its neurons see the same train. Source: NEST 3.10, `poisson_generator` behind
    one parrot per neuron.
    """

    equation: ClassVar[str] = "number of spikes in a step ~ Poisson(rate h / 1000)"
    source: ClassVar[str] = "NEST 3.10 poisson_generator"
    role: ClassVar[str] = "poisson"

    rate: Value = quantity(0.0, "Hz", "mean rate", at_least=0, arrays=True)
    start: float = quantity(0.0, "ms", "emits after this time", at_least=0)
    stop: float = quantity(math.inf, "ms", "and up to this one", at_least=0, infinite=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class spike_generator(Generator):
    """Emits listed spikes; more can be injected while running. Two at one time make a spike of multiplicity 2."""

    equation: ClassVar[str] = "emits at the listed times"
    source: ClassVar[str] = "NEST 3.10 spike_generator"
    role: ClassVar[str] = "listed"

    spike_times: Any = quantity((), "ms", "one ascending list of times for each neuron", kind="times")


@dataclass(frozen=True, kw_only=True, eq=False)
class dc_generator(Generator):
    """Sends a constant current; a projection scales it by its weight and delays it. Source: NEST 3.10."""

    equation: ClassVar[str] = "I = amplitude for start <= t < stop"
    source: ClassVar[str] = "NEST 3.10 dc_generator"
    role: ClassVar[str] = "current"

    amplitude: Value = quantity(0.0, "pA", "current", arrays=True)
    start: float = quantity(0.0, "ms", "begin", at_least=0)
    stop: float = quantity(math.inf, "ms", "end", at_least=0, infinite=True)
