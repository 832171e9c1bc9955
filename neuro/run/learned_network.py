"""The network with what it has learnt, as a `Network` that any backend can compile."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from neuro.core.clock import Clock
from neuro.core.quantities import word_of
from neuro.model.network import Network
from neuro.model.parts import Population, Projection
from neuro.model.rules import all_to_all, grid, pairs
from neuro.model.synapses import Synapse
from neuro.model.synapses.delays import steps_of
from neuro.model.views import View
from neuro.program.backend import Engine
from neuro.program.program import (
    Floats,
    Ints,
    Population as ResolvedPopulation,
    Program,
    Projection as ResolvedProjection,
)


def learnt_network(
    net: Network, program: Program, engine: Engine, clock: Clock, rules: Mapping[int, Synapse]
) -> Network:
    """A copy of `net` that holds the present weights and parameters and nothing random in its connections.

    Delays that learn are those that the next spikes would take, in whole steps.
    Synapses that were drawn at random become listed pairs; weights, delays and initial states that were drawn
    become arrays, and what was encoded becomes spikes or rates. States such as V_m begin anew.

    Args:
        net: what was compiled.
        program: its resolved form.
        engine: holds the present weights and parameters.
        clock: of the network.
        rules: the present synapse models of projections.
    """
    copy = Network(net.name, resolution=net.resolution)
    for index, population in enumerate(program.populations):
        copy.populations[population.name] = _population(net.populations[population.name], population, index, engine)
    for index, projection in enumerate(program.projections):
        copy.projections[projection.name] = _projection(
            net.projections[projection.name], projection, program, index, engine, clock, rules[index]
        )
    copy.signals, copy.groups = dict(net.signals), dict(net.groups)
    for name, probe in net.probes.items():
        view, pre, post = (_moved(each, copy) for each in (probe.view, probe.pre, probe.post))
        copy.probes[name] = replace(probe, view=view, pre=pre, post=post)
    copy.trials_section, copy.trials_origin = net.trials_section, net.trials_origin
    return copy


def _moved(view: View | None, net: Network) -> View | None:
    """The same neurons of the population of that name."""
    return None if view is None else net.populations[view.population.name][view.index]


def _population(part: Population, resolved: ResolvedPopulation, index: int, engine: Engine) -> Population:
    if resolved.stream is not None:
        return replace(part, shape=resolved.shape)
    model = resolved.model
    changed = {}
    for entry in fields(model):
        word = word_of(entry.name)
        if word in resolved.parameters:
            now = _one_or_all(engine.get(index, word))
            changed[entry.name] = bool(now) if entry.metadata["quantity"].kind == "boolean" else now
    initial = {name: _one_or_all(resolved.initial[name]) for name in part.initial}
    return replace(part, shape=resolved.shape, model=replace(model, **changed), initial=initial)


def _projection(
    part: Projection,
    resolved: ResolvedProjection,
    program: Program,
    index: int,
    engine: Engine,
    clock: Clock,
    synapse: Synapse,
) -> Projection:
    weight = engine.get_synapses(index, "weight")
    delay = clock.array_ms(_steps(resolved, index, engine, clock.resolution))
    shape: Callable[[Floats], Any] = _one_or_all
    rule = part.rule
    if isinstance(rule, all_to_all) and resolved.layout == "dense":
        sizes = (program.populations[resolved.source].size, program.populations[resolved.target].size)
        shape = lambda values: _one_or_all(values, sizes)  # noqa: E731
    elif isinstance(rule, grid) and resolved.grid is not None:
        kernels = weight.reshape(resolved.grid.kernels)
        return replace(part, synapse=synapse, weight=kernels, delay=float(delay[0]))
    elif resolved.layout != "one_to_one":
        pre, post = program.connections(index)
        rule = pairs(pre=pre, post=post)
    whole = replace(part, source_view=None, target_view=None)
    each = {f.name: shape(value) for f in fields(synapse) if isinstance(value := getattr(synapse, f.name), np.ndarray)}
    synapse = replace(synapse, **each) if each else synapse
    return replace(whole, rule=rule, synapse=synapse, weight=shape(weight), delay=shape(delay))


def _steps(part: ResolvedProjection, index: int, engine: Engine, h: float) -> Ints:
    """The delays in steps, those that learn as the next spike would take them."""
    if not part.synapse.delays:
        return part.delay.astype(np.int64)
    fewest, most = part.delay_range(h)
    learnt = engine.get_synapses(index, "delay")
    return np.array([steps_of(delay, h, fewest, most) for delay in learnt], dtype=np.int64)


def _one_or_all(values: Floats, shape: tuple[int, ...] | None = None) -> Any:
    """A number where all are equal, else an array that cannot be changed."""
    if values.size and (values == values[0]).all():
        return float(values[0])
    array = values.copy() if shape is None else values.reshape(shape).copy()
    array.flags.writeable = False
    return array
