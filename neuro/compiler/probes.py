"""Probes of a network: checks, and conversion to probes of a program."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from neuro.compiler.check import recordable
from neuro.compiler.shapes import Shape, end_of
from neuro.core.clock import Clock
from neuro.core.errors import a, unknown
from neuro.model.network import Network
from neuro.model.neurons import CurrentGenerator
from neuro.model.parts import (
    Population,
    Probe,
    naming_the_part,
    refuse,
)
from neuro.program import program as resolved
from neuro.program.program import Ints, Projection, synapse_states

AT_PRE = 0
ALONE = ("spikes", "rate")


def check_probes(net: Network, shapes: Mapping[str, Shape], clock: Clock) -> None:
    """Check probes, except for properties that are known only after connections are made.

    Raises:
        ModelError: a probe asks for something that does not exist.
    """
    names: dict[str, str] = {}
    for part in net.probes.values():
        if part.every is not None and part.at is not None:
            message = f"found both every = {part.every:g} ms and at = {part.at}: expected one of them"
            refuse(part, message, word="every", about=("at",))
        for name in {part.name, *part.traces().values()}:
            if (owner := names.setdefault(name, part.name)) != part.name:
                refuse(part, f"probe '{owner}' already has a trace named '{name}': expected another name")
        if part.every is not None:
            with naming_the_part(part):
                every = clock.step(part.every, "every")
            if every < 1:
                message = f"every = {part.every:g} ms: expected at least the resolution, {clock.resolution:g} ms"
                refuse(part, message, word="every", kind="resolution")
        if part.of in net.populations:
            with naming_the_part(part, "of", part.of):
                end_of(part.view, shapes[part.of])
            _check_neurons(part, net.populations[part.of])


def _check_neurons(part: Probe, population: Population) -> None:
    states = list(part.traces())
    for word, value in (("at", part.at), ("synapses", part.synapses)):
        if value is not None:
            refuse(part, f"{word} is for projections: '{part.of}' is a population", word=word, kind="no projection")
    if len(states) > 1 and (single := next((state for state in states if state in ALONE), "")):
        refuse(part, f"'{single}' cannot be recorded with other quantities", "give it a separate probe", "record")
    if states[0] in ALONE:
        quantity = states[0]
        if isinstance(population.model, CurrentGenerator):
            refuse(part, f"{quantity} of '{part.of}', {a(population.model.name)}: it emits a current", word="record")
        if quantity == "spikes" and part.every is not None:
            refuse(part, "every is for states: all spikes are recorded", "leave 'every' out", "every")
        if quantity == "rate" and part.every is None:
            text = "a rate needs every, the length of its bins"
            refuse(part, text, "write every: 10.0, a common length", "record", about=("every",))
        if part.mean:
            message = "a rate is a mean over the neurons" if quantity == "rate" else "mean is for states"
            way_out = "leave 'mean' out" if quantity == "rate" else "record: rate is the mean rate of spikes"
            refuse(part, message, way_out, "mean", about=("record",))
        return
    states_of_model = recordable(population)
    for state in states:
        if state not in states_of_model:
            message = f"'{part.of}', {a(population.model.name)}, has no state '{state}'"
            raise unknown("state", state, [*states_of_model, *ALONE], part.origin, ("record",)).but(
                message=f"probe '{part.name}': {message}"
            )


def resolve_probes(net: Network, shapes: Mapping[str, Shape], clock: Clock) -> tuple[resolved.Probe, ...]:
    """Return the probes of populations, one for each state."""
    names = list(net.populations)
    return tuple(
        resolved.Probe(
            name, names.index(p.of), state, _every(p, clock), p.origin, end_of(p.view, shapes[p.of]).ids, p.mean
        )
        for p in net.probes.values()
        if p.of in net.populations
        for state, name in p.traces().items()
    )


def resolve_synapse_probes(
    net: Network, program: resolved.Program, shapes: Mapping[str, Shape], clock: Clock
) -> tuple[resolved.SynapseProbe, ...]:
    """Return the probes of projections, one for each state.

    Raises:
        ModelError: a probe asks for something that does not exist.
    """
    names, probes = list(net.projections), []
    for p in net.probes.values():
        if p.of in net.populations:
            continue
        index = names.index(p.of)
        _check_synapses(net, p, program.projections[index])
        every, chosen = AT_PRE if p.at else _every(p, clock), _recorded_synapses(p, program, index, shapes)
        for state, name in p.traces().items():
            probes.append(resolved.SynapseProbe(name, index, state, every, chosen, p.mean, p.origin))
    return tuple(probes)


def _check_synapses(net: Network, part: Probe, projection: Projection) -> None:
    states = synapse_states(projection)
    for state in part.traces():
        if state not in states:
            error = unknown("state", state, states, part.origin, ("record",)).but(
                message=f"probe '{part.name}': the synapses of '{part.of}', {projection.synapse.name}, "
                f"have no state '{state}'",
                kind="synapses",
            )
            raise error.but(hint="record them by a probe of the source") if state in ALONE else error
    if part.at is None:
        return
    if part.mean:
        refuse(part, "mean is for records at intervals, not at pre spikes", "leave 'mean' out", "mean")
    if projection.carries == "current":
        refuse(part, f"at = {part.at}: '{part.of}' carries a current, and no spikes", word="at")
    if projection.grid is not None:
        refuse(part, f"at = {part.at}: the synapses of a grid share their weights", "every: 10.0 records weights", "at")
    if projection.synapse.learns == "chip" or net.trials_section is not None:
        label = projection.synapse.name if net.trials_section is None else "a network with trials"
        refuse(part, f"at = {part.at}: not possible with {label}", "every: 10.0 records its synapses", "at")
    for state in part.traces():
        if state in ("K_plus", "n"):
            refuse(
                part, f"at = {part.at}: '{state}' belongs to a neuron, not to a synapse", "every: 1.0 records it", "at"
            )


def _recorded_synapses(part: Probe, program: resolved.Program, index: int, shapes: Mapping[str, Shape]) -> Ints | None:
    """Return the indices of the recorded synapses, None for all."""
    projection = program.projections[index]
    if part.pre is not None or part.post is not None:
        projection = program.projections[index]
        if part.synapses is not None:
            refuse(part, "found both 'synapses' and the neurons at their ends: expected one of them")
        if projection.grid is not None:
            message = "pre and post: the synapses of a grid share their weights"
            refuse(part, message, "synapses: [0, 1] records some synapses", "pre")
        is_recorded = np.ones(projection.size, dtype=np.bool_)
        views = {"pre": part.pre, "post": part.post}
        for (word, view), ids in zip(views.items(), program.connections(index), strict=True):
            if view is not None:
                with naming_the_part(part, word, view.population.name):
                    is_recorded &= np.isin(ids, view.within(shapes[view.population.name])[0])
        if not is_recorded.any():
            ends = " ".join(
                f"{word} {view}" for word, view in (("from", part.pre), ("to", part.post)) if view is not None
            )
            refuse(part, f"none of the {projection.size:,} synapses of '{part.of}' goes {ends}: expected at least one")
        return np.flatnonzero(is_recorded)
    if part.synapses is None:
        return None
    chosen = np.asarray(part.synapses)
    if chosen.size and chosen.max() >= projection.size:
        message = (
            f"synapses: found {chosen.max()}: expected at most {projection.size - 1}, the last synapse of '{part.of}'"
        )
        refuse(part, message, word="synapses", kind="count of synapses")
    if np.unique(chosen).size < chosen.size or not chosen.size:
        refuse(part, "synapses: expected at least one, without repetitions", word="synapses")
    return chosen


def _every(part: Probe, clock: Clock) -> int:
    return 1 if part.every is None else clock.step(part.every, "every")
