"""What a run leaves of each population, projection and probe; arrays of a file are read when they are asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro.core.clock import Clock
from neuro.files.stored import Lazy
from neuro.program.program import Floats

__all__ = ["Trace", "Train", "Weights"]


@dataclass(frozen=True, eq=False)
class Train:
    """Spikes of one population, by time, then neuron.

    Attributes:
        model: the name of its model.
        shape: its shape.
        counts: of the run, by name.
        recorded: whether its spikes were kept; if not `steps`, `ids` and `multiplicity` are empty.
        resolution_ms: the length of a step.
        steps, ids, multiplicity: one entry for each neuron and step with spikes; read when they are asked for.
        spike_counts, event_counts: spikes of each neuron, and its steps with spikes, whether recorded or not.
        emits: "spikes" or "current".
    """

    model: str
    shape: tuple[int, ...]
    counts: dict[str, int]
    recorded: bool
    resolution_ms: float
    steps: Lazy = Lazy()
    ids: Lazy = Lazy()
    multiplicity: Lazy = Lazy()
    spike_counts: Lazy = Lazy()
    event_counts: Lazy = Lazy()
    emits: str = "spikes"

    @property
    def times_ms(self) -> Floats:
        """The time of each entry in ms."""
        return Clock(self.resolution_ms).array_ms(np.asarray(self.steps))

    @property
    def spikes(self) -> int | None:
        """How many it emitted; None of a generator of currents, which emits none."""
        return self.counts["spikes"] if self.emits == "spikes" else None

    @property
    def size(self) -> int:
        """Number of neurons."""
        return int(np.prod(self.shape))


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of one projection at the end of a run, and its delays where these learn.

    Attributes:
        source, target: names of the populations.
        synapse: the name of its model.
        synapses: their number.
        counts: of the run, by name.
        pre, post: the ends of each synapse; None for a grid or where weights were not kept.
        weight: one for each; kernels of a grid; None where weights were not kept.
        delay_ms: one for each, of a rule that changes delays; None of others.
    """

    source: str
    target: str
    synapse: str
    synapses: int
    counts: dict[str, int]
    pre: Lazy = Lazy(None)
    post: Lazy = Lazy(None)
    weight: Lazy = Lazy(None)
    delay_ms: Lazy = Lazy(None)


@dataclass(frozen=True, eq=False)
class Trace:
    """What a probe recorded of one state.

    Attributes:
        population: whose neurons; "" of synapses.
        state: its name, "rate" of a rate.
        unit: of the values.
        times_ms: shape (times,).
        values: shape (times, neurons or synapses); of a rate or a mean, and at pre spikes, (times,).
        projection: whose synapses; "" of neurons.
        probe: the name of the probe, "" for that of the trace.
        mean: whether it is a mean.
        ids: the neuron of each column; None where it is all of them.
        pre, post: the ends of the synapse of each column, at pre spikes of each time; None of neurons, means and grids.
    """

    population: str
    state: str
    unit: str
    times_ms: Lazy = Lazy()
    values: Lazy = Lazy()
    projection: str = ""
    probe: str = ""
    mean: bool = False
    ids: Lazy = Lazy(None)
    pre: Lazy = Lazy(None)
    post: Lazy = Lazy(None)

    @property
    def at_pre_spikes(self) -> bool:
        """Whether it has what pre spikes leave in synapses."""
        return not self.single and bool(self.values.ndim == 1)

    @property
    def single(self) -> bool:
        """Whether it is one number for all, a rate or a mean."""
        return self.mean or self.state == "rate"

    @property
    def columns(self) -> int:
        """How many numbers are recorded each time; at pre spikes one."""
        return 1 if self.values.ndim == 1 else int(self.values.shape[1])

    def read(self) -> Any:
        """What `sim.trace` gives beside the times: the values, at pre spikes with the ends of the synapses, by name."""
        if self.at_pre_spikes:
            return {"pre": self.pre, "post": self.post, self.state: self.values}
        return self.values
