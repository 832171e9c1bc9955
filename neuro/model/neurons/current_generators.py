"""Generators of currents. What one emits in a step arrives after the delay, and acts from the next step on.

A current is a function `values(p, t, z)` of arrays: parameters by word, shape (1,) or (columns,), the times of some
steps, shape (steps, 1), and standard normal numbers, shape (steps, columns), of a generator that `draws`.
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
    """A population whose neurons emit a current instead of spikes.

    Class attributes:
        varies: whether the current may differ from step to step; else it changes at a few known steps.
        draws: whether `values` takes normal numbers.
    """

    role: ClassVar[str] = "current"
    varies: ClassVar[bool] = True
    draws: ClassVar[bool] = False

    @property
    def individual(self) -> bool:
        """Whether each synapse has a current of its own, so that columns are synapses and not neurons."""
        return False

    def held(self, resolution: float) -> int:
        """For how many steps a value is sent."""
        return 1

    @staticmethod
    def values(p: Mapping[str, Floats], t: Floats, z: Floats) -> Floats:
        """The current in pA at some times, shape (steps, columns); unless it varies the amplitude that is set."""
        return np.broadcast_to(p["amplitude"], (t.size, p["amplitude"].size))


@dataclass(frozen=True, kw_only=True, eq=False)
class dc_generator(CurrentGenerator):
    """Sends a constant current; a projection scales it by its weight and delays it. Source: NEST 3.10."""

    equation: ClassVar[str] = "I = amplitude for start <= t < stop"
    source: ClassVar[str] = "NEST 3.10 dc_generator"
    varies: ClassVar[bool] = False

    amplitude: Value = quantity(0.0, "pA", "current", arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class step_current_generator(CurrentGenerator):
    """Sends a current that steps to another value at listed times, and is 0 before the first. Source: NEST 3.10.

    One list of values is for all neurons; an array of shape [neurons, times] has a row for each.
    """

    equation: ClassVar[str] = "I = amplitude_values[k] for amplitude_times[k] <= t < amplitude_times[k + 1]"
    source: ClassVar[str] = "NEST 3.10 step_current_generator"
    varies: ClassVar[bool] = False
    schedule: ClassVar[tuple[str, ...]] = ("amplitude_times", "amplitude_values")

    amplitude_times: Any = quantity(unit="ms", doc="when the current changes", kind="moments")
    amplitude_values: Any = quantity(unit="pA", doc="the current from each of these times on", kind="series")


@dataclass(frozen=True, kw_only=True, eq=False)
class ac_generator(CurrentGenerator):
    """Sends a current that follows a sine. Source: NEST 3.10."""

    equation: ClassVar[str] = (
        "I = offset + amplitude sin(2 pi frequency t / 1000 + pi phase / 180) for start <= t < stop"
    )
    source: ClassVar[str] = "NEST 3.10 ac_generator"

    amplitude: Value = quantity(0.0, "pA", "how far the current rises and falls", arrays=True)
    offset: Value = quantity(0.0, "pA", "constant part", arrays=True)
    phase: Value = quantity(0.0, "deg", "of the sine at t = 0", arrays=True)
    frequency: Value = quantity(0.0, "Hz", "of the sine", at_least=0, arrays=True)

    @staticmethod
    def values(p: Mapping[str, Floats], t: Floats, z: Floats) -> Floats:
        """The sine."""
        return p["offset"] + p["amplitude"] * sine(p, t)


@dataclass(frozen=True, kw_only=True, eq=False)
class noise_generator(CurrentGenerator):
    """Sends a Gaussian current that is drawn anew every `dt` and held in between. Source: NEST 3.10.

    As in NEST each connection has noise of its own, also those of one neuron to many. With `individual_noise: false`
    each neuron has one noise, which all its targets share. What is set acts at the next draw.
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
    dt: float = quantity(1.0, "ms", "how long a value is held", above=0)
    std_mod: Value = quantity(0.0, "pA", "how far the variance is modulated, at most std", at_least=0, arrays=True)
    phase: Value = quantity(0.0, "deg", "of the modulation at t = 0", arrays=True)
    frequency: Value = quantity(0.0, "Hz", "of the modulation", at_least=0, arrays=True)
    individual_noise: bool = quantity(True, "", "whether each connection has its own noise", kind="boolean")

    @property
    def individual(self) -> bool:
        """As NEST's, unless another is given."""
        return self.individual_noise

    def held(self, resolution: float) -> int:
        """Steps of `dt`."""
        return round(self.dt / resolution)

    @staticmethod
    def values(p: Mapping[str, Floats], t: Floats, z: Floats) -> Floats:
        """The draws."""
        variance = p["std"] ** 2
        if np.any(p["std_mod"]):
            variance = variance + p["std_mod"] ** 2 * sine(p, t)
        return p["mean"] + np.sqrt(variance) * z


def sine(p: Mapping[str, Floats], t: Floats) -> Floats:
    """Of the words `frequency` (Hz) and `phase` (degrees), at times in ms."""
    return np.sin(2.0 * math.pi / 1000.0 * p["frequency"] * t + math.pi / 180.0 * p["phase"])
