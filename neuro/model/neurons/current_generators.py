"""Generators of currents. The current of a step arrives after the delay and acts from the next step on.

The function `values(p, t, z)` of a generator computes the currents of several steps at once. A column is a neuron, or
a synapse if `individual` is true. The arguments are arrays:

    p    parameters by name, each of shape (1,) or (columns,)
    t    times of the steps in ms, shape (steps, 1)
    z    standard normal numbers for a generator with `draws`, shape (steps, columns)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Timed

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class CurrentGenerator(Timed):
    """Base of the populations that emit currents instead of spikes.

    Class attributes:
        varies: whether the current may change at every step. If not, it changes at a few known steps.
        draws: whether `values` uses normal numbers.
    """

    role: ClassVar[str] = "current"
    varies: ClassVar[bool] = True
    draws: ClassVar[bool] = False

    @property
    def individual(self) -> bool:
        """True if each synapse has its own current; columns are then synapses instead of neurons."""
        return False

    def steps_per_value(self, resolution: float) -> int:
        """Return the number of successive steps that share one value of the current."""
        return 1

    @staticmethod
    def values(p: Mapping[str, Floats], t: Floats, z: Floats) -> Floats:
        """Return the current in pA at times t, shape (steps, columns). The default is the parameter `amplitude`."""
        return np.broadcast_to(p["amplitude"], (t.size, p["amplitude"].size))


@dataclass(frozen=True, kw_only=True, eq=False)
class dc_generator(CurrentGenerator):
    """Constant current, scaled and delayed by each projection. Source: NEST 3.10."""

    equation: ClassVar[str] = "I = amplitude for start <= t < stop"
    source: ClassVar[str] = "NEST 3.10 dc_generator"
    varies: ClassVar[bool] = False

    amplitude: Value = quantity(0.0, "pA", "current", arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class step_current_generator(CurrentGenerator):
    """Piecewise constant current that changes at listed times and is 0 before the first. Source: NEST 3.10.

    A list of values applies to all neurons. An array of shape [neurons, times] has a row per neuron.
    """

    equation: ClassVar[str] = "I = amplitude_values[k] for amplitude_times[k] <= t < amplitude_times[k + 1]"
    source: ClassVar[str] = "NEST 3.10 step_current_generator"
    varies: ClassVar[bool] = False
    schedule: ClassVar[tuple[str, ...]] = ("amplitude_times", "amplitude_values")

    amplitude_times: Any = quantity(unit="ms", doc="times at which the current changes", kind="moments")
    amplitude_values: Any = quantity(unit="pA", doc="current from each of these times on", kind="series")


@dataclass(frozen=True, kw_only=True, eq=False)
class ac_generator(CurrentGenerator):
    """Sinusoidal current with an offset. Source: NEST 3.10."""

    equation: ClassVar[str] = (
        "I = offset + amplitude sin(2 pi frequency t / 1000 + pi phase / 180) for start <= t < stop"
    )
    source: ClassVar[str] = "NEST 3.10 ac_generator"

    amplitude: Value = quantity(0.0, "pA", "amplitude of the sine", arrays=True)
    offset: Value = quantity(0.0, "pA", "constant part of the current", arrays=True)
    phase: Value = quantity(0.0, "deg", "phase of the sine at t = 0", arrays=True)
    frequency: Value = quantity(0.0, "Hz", "frequency of the sine", at_least=0, arrays=True)

    @staticmethod
    def values(p: Mapping[str, Floats], t: Floats, z: Floats) -> Floats:
        """Return the sinusoidal current."""
        return p["offset"] + p["amplitude"] * sine(p, t)


@dataclass(frozen=True, kw_only=True, eq=False)
class noise_generator(CurrentGenerator):
    """Gaussian white noise current, drawn every `dt` and constant in between. Source: NEST 3.10.

    As in NEST, each connection has separate noise, so two targets of a generator neuron receive different currents.
    With `individual_noise: false`, a generator neuron sends the same noise current to all targets. A changed
    parameter takes effect at the next draw.
    """

    equation: ClassVar[str] = (
        "I = mean + sqrt(std^2 + std_mod^2 sin(2 pi frequency t / 1000 + pi phase / 180)) N(0, 1), "
        "for start <= t < stop, t and N(0, 1) held for dt"
    )
    source: ClassVar[str] = "NEST 3.10 noise_generator"
    draws: ClassVar[bool] = True
    fixed: ClassVar[tuple[str, ...]] = ("dt", "individual_noise")

    mean: Value = quantity(0.0, "pA", "mean current", arrays=True)
    std: Value = quantity(0.0, "pA", "standard deviation", at_least=0, arrays=True)
    dt: float = quantity(1.0, "ms", "interval between two draws", above=0)
    std_mod: Value = quantity(
        0.0, "pA", "square root of the amplitude of the variance's modulation, at most std", at_least=0, arrays=True
    )
    phase: Value = quantity(0.0, "deg", "phase of the modulation at t = 0", arrays=True)
    frequency: Value = quantity(0.0, "Hz", "frequency of the modulation", at_least=0, arrays=True)
    individual_noise: bool = quantity(True, "", "whether each connection has its own noise", kind="boolean")

    @property
    def individual(self) -> bool:
        """The value of the parameter `individual_noise`."""
        return self.individual_noise

    def steps_per_value(self, resolution: float) -> int:
        """Return the number of steps in `dt`."""
        return round(self.dt / resolution)

    @staticmethod
    def values(p: Mapping[str, Floats], t: Floats, z: Floats) -> Floats:
        """Return the noise current."""
        variance = p["std"] ** 2
        if np.any(p["std_mod"]):
            variance = variance + p["std_mod"] ** 2 * sine(p, t)
        return p["mean"] + np.sqrt(variance) * z


def sine(p: Mapping[str, Floats], t: Floats) -> Floats:
    """Return the sine with the parameters `frequency` (Hz) and `phase` (degrees) at times in ms."""
    return np.sin(2.0 * math.pi / 1000.0 * p["frequency"] * t + math.pi / 180.0 * p["phase"])
