"""Probes and trials of a network: checked, and resolved to those of a program."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

import numpy as np

from neuro.compiler.check import recordable
from neuro.compiler.shapes import Shape, end_of
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, a, nearest, unknown, words_of
from neuro.model.network import Network
from neuro.model.neurons import CurrentGenerator, spike_generator
from neuro.model.parts import (
    Group,
    Population,
    Probe,
    Trials,
    dropout as Dropout,
    labels as Labels,
    naming_the_part,
    refuse,
    reward as Reward,
    winner_take_all,
)
from neuro.program import program as resolved
from neuro.program.program import Ints, Projection, synapse_states

AT_PRE = 0
ALONE = ("spikes", "rate")


def check_probes(net: Network, shapes: Mapping[str, Shape], clock: Clock) -> None:
    """What can be said of the probes before connections are made.

    Raises:
        ModelError: a probe asks for what there is not.
    """
    names: dict[str, str] = {}
    for part in net.probes.values():
        if part.every is not None and part.at is not None:
            refuse(
                part, f"every = {part.every:g} ms and at = {part.at}: expected one of both", word="every", about=("at",)
            )
        for name in {part.name, *part.traces().values()}:
            if (other := names.setdefault(name, part.name)) != part.name:
                refuse(part, f"probe '{other}' has a trace of the name '{name}', too: expected another name")
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
    for word, given in (("at", part.at), ("synapses", part.synapses)):
        if given is not None:
            refuse(part, f"{word} is for projections: '{part.of}' is a population", word=word, kind="no projection")
    if len(states) > 1 and (alone := next((state for state in states if state in ALONE), "")):
        refuse(part, f"'{alone}' is recorded alone", "give it a probe of its own", "record")
    if states[0] in ALONE:
        what = states[0]
        if isinstance(population.model, CurrentGenerator):
            refuse(part, f"{what} of '{part.of}', {a(population.model.name)}: it emits a current", word="record")
        if what == "spikes" and part.every is not None:
            refuse(part, "every is for states: spikes are all recorded", "leave 'every' out", "every")
        if what == "rate" and part.every is None:
            text = "a rate needs every, the length of its bins"
            refuse(part, text, "every: 10.0 is a common one", "record", about=("every",))
        if part.mean:
            message = "a rate is a mean over the neurons" if what == "rate" else "mean is for states"
            way_out = "leave 'mean' out" if what == "rate" else "record: rate gives that of spikes"
            refuse(part, message, way_out, "mean", about=("record",))
        return
    known = recordable(population)
    for state in states:
        if state not in known:
            message = f"'{part.of}', {a(population.model.name)}, has no state '{state}'"
            raise unknown("state", state, [*known, *ALONE], part.origin, ("record",)).but(
                message=f"probe '{part.name}': {message}"
            )


def resolve_probes(net: Network, shapes: Mapping[str, Shape], clock: Clock) -> tuple[resolved.Probe, ...]:
    """The probes of populations, one for each state."""
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
    """The probes of projections, one for each state.

    Raises:
        ModelError: a probe asks for what there is not.
    """
    names, found = list(net.projections), []
    for p in net.probes.values():
        if p.of in net.populations:
            continue
        index = names.index(p.of)
        _check_synapses(net, p, program.projections[index])
        every, chosen = AT_PRE if p.at else _every(p, clock), _chosen(p, program, index, shapes)
        for state, name in p.traces().items():
            found.append(resolved.SynapseProbe(name, index, state, every, chosen, p.mean, p.origin))
    return tuple(found)


def _check_synapses(net: Network, part: Probe, projection: Projection) -> None:
    known = synapse_states(projection)
    for state in part.traces():
        if state not in known:
            error = unknown("state", state, known, part.origin, ("record",)).but(
                message=f"probe '{part.name}': the synapses of '{part.of}', {projection.synapse.name}, "
                f"have no state '{state}'",
                kind="synapses",
            )
            raise error.but(hint="a probe of its source records them") if state in ALONE else error
    if part.at is None:
        return
    if part.mean:
        refuse(part, "mean is for records every so many ms, not at pre spikes", "leave 'mean' out", "mean")
    if projection.carries == "current":
        refuse(part, f"at = {part.at}: '{part.of}' carries a current, and no spikes", word="at")
    if projection.grid is not None:
        refuse(part, f"at = {part.at}: the synapses of a grid share their weights", "every: 10.0 records these", "at")
    if projection.synapse.learns == "chip" or net.trials_section is not None:
        what = projection.synapse.name if net.trials_section is None else "a network with trials"
        refuse(part, f"at = {part.at}: not of {what}", "every: 10.0 records its synapses", "at")
    for state in part.traces():
        if state in ("K_plus", "n"):
            refuse(part, f"at = {part.at}: '{state}' is of a neuron, not of a synapse", "every: 1.0 records it", "at")


def _chosen(part: Probe, program: resolved.Program, index: int, shapes: Mapping[str, Shape]) -> Ints | None:
    """The places of the synapses that are recorded, None for all."""
    projection = program.projections[index]
    if part.pre is not None or part.post is not None:
        projection = program.projections[index]
        if part.synapses is not None:
            refuse(part, "found both 'synapses' and the neurons at their ends: expected one of both")
        if projection.grid is not None:
            message = "pre and post: the synapses of a grid share their weights"
            refuse(part, message, "synapses: [0, 1] records some of these", "pre")
        kept = np.ones(projection.size, dtype=np.bool_)
        views = {"pre": part.pre, "post": part.post}
        for (word, view), ids in zip(views.items(), program.connections(index), strict=True):
            if view is not None:
                with naming_the_part(part, word, view.population.name):
                    kept &= np.isin(ids, view.within(shapes[view.population.name])[0])
        if not kept.any():
            asked = " ".join(
                f"{word} {view}" for word, view in (("from", part.pre), ("to", part.post)) if view is not None
            )
            refuse(part, f"none of the {projection.size:,} synapses of '{part.of}' goes {asked}: expected at least one")
        return np.flatnonzero(kept)
    if part.synapses is None:
        return None
    chosen = np.asarray(part.synapses)
    if chosen.size and chosen.max() >= projection.size:
        message = f"synapses: found {chosen.max()}: expected at most {projection.size - 1}, as '{part.of}' has them"
        refuse(part, message, word="synapses", kind="count of synapses")
    if np.unique(chosen).size < chosen.size or not chosen.size:
        refuse(part, "synapses: expected at least one, and each once", word="synapses")
    return chosen


def _every(part: Probe, clock: Clock) -> int:
    return 1 if part.every is None else clock.step(part.every, "every")


def resolve_trials(net: Network, shapes: Mapping[str, Shape], clock: Clock) -> resolved.Trials | None:
    """The trials of a network in ticks and indices, or None.

    Raises:
        ModelError: a part they need is missing or does not fit.
    """
    section = net.trials_section
    if section is None:
        return None
    names = list(net.populations)
    output = _output(net, section)
    group = _group(net, output)
    shape = shapes[output]
    labels: Labels | None = section.labels
    maps_per_label = 0 if labels is None else labels.maps_per_label
    if maps_per_label and shape[0] % maps_per_label:
        message = f"labels.maps_per_label = {maps_per_label}: expected a divisor of {shape[0]}, the maps of '{output}'"
        _refuse(net, "labels.maps_per_label", message)
    reward: Reward = section.reward or Reward()
    if reward.silent != 0.0:
        message = f"reward.silent = {reward.silent:g}: expected 0, as no neuron decided that could be rewarded"
        _refuse(net, "reward.silent", message, "r_stdp.epsilon and r_stdp.rescue say what silence teaches")
    dropout: Dropout | None = section.dropout
    known = recordable(net.populations[output])
    for state in section.reset:
        if state not in known:
            _refuse(net, "reset", f"reset: '{output}' has no state '{state}'", nearest(state, known))
    _check_learners(net, output, labels, list(net.groups.values())[group])
    return resolved.Trials(
        input=names.index(_input(net, section)),
        output=names.index(output),
        group=group,
        duration=_duration(net, section, clock),
        stop_at_decision=section.stop == "at_decision",
        maps=shape[0],
        maps_per_label=maps_per_label,
        reward=(reward.correct, reward.wrong, reward.silent),
        dropout=0.0 if dropout is None else dropout.p,
        dropout_decay=1.0 if dropout is None else dropout.decay,
        dropout_per_trial=dropout is not None and dropout.every == "trial",
        reset=section.reset,
        origin=net.trials_origin,
    )


def _refuse(net: Network, word: str, message: str, hint: str = "", missing: str = "") -> NoReturn:
    text = f"trials: {message}"
    raise ModelError(text, where=net.trials_origin, hint=hint, path=words_of(word), missing=missing)


def _known(net: Network, name: str, word: str) -> str:
    if name not in net.populations:
        raise unknown("population", name, net.populations, path=words_of(word)).at(net.trials_origin, f"trials: {word}")
    return name


def _input(net: Network, section: Trials) -> str:
    name = _known(net, section.input, "input")
    model = net.populations[name].model
    if not isinstance(model, spike_generator):
        _refuse(net, "input", f"input '{name}' is {a(model.name)}: expected a spike_generator")
    if any(len(times) for times in model.spike_times):
        _refuse(net, "input", f"input '{name}' has spike_times: expected none, as trials bring their own")
    return name


def _output(net: Network, section: Trials) -> str:
    """The population that decides: the one with labels, else with dropout, else the one with a group."""
    said = {word: part.of for word, part in (("labels", section.labels), ("dropout", section.dropout)) if part}
    for word, name in said.items():
        _known(net, name, f"{word}.of")
    if len(set(said.values())) > 1:
        _refuse(
            net, "labels", f"labels of '{said['labels']}' but dropout of '{said['dropout']}': expected one population"
        )
    if said:
        return str(next(iter(said.values())))
    members = [group.choice.of for group in net.groups.values() if group.choice.decides]
    if len(members) != 1:
        _refuse(net, "", f"{len(members)} groups and no labels: expected labels that name the output")
    return members[0]


def _group(net: Network, output: str) -> int:
    for index, group in enumerate(net.groups.values()):
        if group.choice.of == output and group.choice.decides:
            if isinstance(group.choice, winner_take_all) and not group.choice.first_to_fire:
                _refuse(net, "", f"group '{group.name}' decides at each step: expected first_to_fire: true")
            return index
    _refuse(net, "", f"no group decides in '{output}'", f"add a group winner_take_all of '{output}'")


def _duration(net: Network, section: Trials, clock: Clock) -> int:
    try:
        ticks = clock.step(section.duration, "duration")
    except ModelError as error:
        raise error.at(net.trials_origin, "trials") from None
    if ticks < 1:
        message = f"duration = {section.duration:g} ms: expected at least the resolution, {clock.resolution:g} ms"
        _refuse(net, "duration", message)
    return ticks


def _check_learners(net: Network, output: str, labels: Labels | None, group: Group) -> None:
    for part in net.projections.values():
        if part.synapse.learns != "trials":
            continue
        what = f"projection '{part.name}': {part.synapse.name}"
        if part.target != output:
            text = f"{what} onto '{part.target}': expected '{output}', which decides"
            raise ModelError(text, where=part.origin, path=words_of(part.synapse.name))
        if part.synapse.peaks and group.choice.several:
            message = f"{what} teaches by the largest V_m up to the one decision, and group '{group.name}' has several"
            raise ModelError(
                f"{message}: expected winner_take_all", where=part.origin, path=words_of(part.synapse.name)
            )
        if labels is None and part.synapse.supervised:
            text = f"{part.synapse.name} of '{part.name}' needs 'labels', as rewards depend on them"
            _refuse(net, "", text, missing="labels")
