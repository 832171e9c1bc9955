"""Inputs of a network: generators with listed values, individual spike trains, and generators for codes."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import replace

import numpy as np

from neuro.compiler.check import check_rate
from neuro.compiler.codes import generator_of
from neuro.compiler.shapes import Shape
from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.model.network import Network
from neuro.model.neurons import (
    Generator,
    Model,
    encode,
    event_camera,
    sinusoidal_poisson_generator,
)
from neuro.program.program import Program, Schedule


def schedule_of(model: Model, size: int, clock: Clock) -> Schedule | None:
    """Return the steps at which a generator changes, and its values from then on; None without changes.

    Args:
        model: model of a population.
        size: number of neurons.
        clock: clock of the network.

    Raises:
        ModelError: a time is off the grid of steps, or the numbers of rows and neurons differ.
    """
    if not isinstance(model, Generator) or not model.schedule:
        return None
    times, values = (getattr(model, word) for word in model.schedule)
    message = f"{model.name}.{model.schedule[1]}"
    if values.ndim == 2 and len(values) != size:
        message += f" has {len(values)} rows: expected {size}, one for each neuron, or one list for all"
        raise ModelError(message, path=(model.name, model.schedule[1]))
    if model.role == "poisson" and values.size:
        check_rate(model, model.schedule[1], float(values.max()), clock)
    steps = clock.steps(times, f"{model.name}.{model.schedule[0]}")
    # A row for each change: a backend reads one row per change.
    rows = np.ascontiguousarray(np.atleast_2d(values).T + 0.0)
    return Schedule(steps, rows)


def check_trains(program: Program) -> None:
    """Raise an error if two targets share a spike train that must be individual.

    Raises:
        ModelError: two targets share a train; the message names the second projection.
    """
    used = {
        k: np.zeros(part.size, dtype=np.int64)
        for k, part in enumerate(program.populations)
        if isinstance(part.model, sinusoidal_poisson_generator) and part.model.individual_spike_trains
    }
    for q, part in enumerate(program.projections):
        if part.source not in used:
            continue
        name, size = program.populations[part.source].name, program.populations[part.source].size
        used[part.source] += np.bincount(program.synapses(q)[0], minlength=size)
        most = int(used[part.source].max(initial=0))
        if most > 1:
            raise ModelError(
                f"projection '{part.name}': a neuron of '{name}' has {most} targets, and individual_spike_trains is "
                "true: expected one target for each",
                where=part.origin,
                hint="give each target its own neuron, by one_to_one; or set individual_spike_trains: false, "
                "and all targets of a neuron share its train",
            )


def with_generators(net: Network, shapes: Mapping[str, Shape], clock: Clock, seed: int) -> Network:
    """Return a network with a `spike_generator` or a `poisson_generator` in place of each `encode` and `event_camera`.

    The generator of a camera lists no spikes; the spikes are streamed.

    Args:
        net: the network; it is not changed.
        shapes: shapes of all populations.
        clock: clock of the network.
        seed: seed of the network.

    Raises:
        ModelError: a code has another number of neurons, or a time is too late or off the grid of steps.
    """
    net_with_generators = copy(net)
    net_with_generators.populations = {
        name: replace(part, model=generator_of(part, part.model, shapes[name], clock, seed))
        if isinstance(part.model, encode | event_camera)
        else part
        for name, part in net.populations.items()
    }
    return net_with_generators
