"""Sources of spikes whose moments are listed, or follow from a rate."""

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
    timed: ClassVar[bool] = True

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
class spike_train(Generator):
    """Emits the spikes of a recording; more can be injected while running. Two at one time make one of multiplicity 2.

    In YAML `{file: ..., key: ...}` may stand for `spikes`: a group of an HDF5 file with data sets `times` and `ids`, as
    `neuro run --out` writes them, or a data set with two columns; an NPY file with these columns or fields; a CSV file
    whose first line names the columns.
    """

    equation: ClassVar[str] = "emits at the recorded times"
    source: ClassVar[str] = "NEST 3.10 spike_generator, of which one is listed for each neuron"
    role: ClassVar[str] = "listed"
    file_of: ClassVar[str] = "spikes"

    spikes: Any = quantity(
        unit="ms", doc="a row for each spike, in ascending time: when, and which neuron", kind="train"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class inhomogeneous_poisson_generator(Generator):
    """Emits a Poisson number of spikes each step, at a rate that changes at listed times and is 0 before the first.

    One list of rates is for all neurons; an array of shape [neurons, times] has a row for each. All targets of
    one of its neurons see the same train.
    """

    equation: ClassVar[str] = (
        "number of spikes in a step ~ Poisson(rate h / 1000), "
        "rate = rate_values[k] for rate_times[k] <= t < rate_times[k + 1]"
    )
    source: ClassVar[str] = "NEST 3.10 inhomogeneous_poisson_generator"
    role: ClassVar[str] = "poisson"
    timed: ClassVar[bool] = True
    schedule: ClassVar[tuple[str, ...]] = ("rate_times", "rate_values")

    rate_times: Any = quantity(unit="ms", doc="when the rate changes", kind="moments")
    rate_values: Any = quantity(unit="Hz", doc="the rate from each of these times on", kind="series", at_least=0)
    start: float = quantity(0.0, "ms", "emits after this time", at_least=0)
    stop: float = quantity(math.inf, "ms", "and up to this one", at_least=0, infinite=True)
