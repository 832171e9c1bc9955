"""Trials of a network: checks, and conversion to trials of a program."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

from neuro.compiler.check import recordable
from neuro.compiler.shapes import Shape
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, a, nearest, unknown, words_of
from neuro.model.network import Network
from neuro.model.neurons import spike_generator
from neuro.model.parts import Group, Trials, dropout as Dropout, labels as Labels, reward as Reward, winner_take_all
from neuro.program import program as resolved


def resolve_trials(net: Network, section: Trials, shapes: Mapping[str, Shape], clock: Clock) -> resolved.Trials:
    """Return the trials of a network in ticks and indices.

    Raises:
        ModelError: a part that trials need is missing or does not fit.
    """
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
        message = f"reward.silent = {reward.silent:g}: expected 0, since no neuron decided"
        _refuse(net, "reward.silent", message, "r_stdp.epsilon and r_stdp.rescue set what silence teaches")
    dropout: Dropout | None = section.dropout
    states = recordable(net.populations[output])
    for state in section.reset:
        if state not in states:
            _refuse(net, "reset", f"reset: '{output}' has no state '{state}'", nearest(state, states))
    _check_learners(net, output, labels, list(net.groups.values())[group])
    return resolved.Trials(
        input=names.index(_input(net, section)),
        output=names.index(output),
        group=group,
        duration=_duration(net, section, clock),
        stop_at_decision=section.stop == "at_decision",
        spikes=section.spikes,
        maps=shape[0],
        maps_per_label=maps_per_label,
        reward=(reward.correct, reward.wrong, reward.silent),
        dropout=0.0 if dropout is None else dropout.p,
        dropout_decay=1.0 if dropout is None else dropout.decay,
        dropout_per_trial=dropout is not None and dropout.every == "trial",
        reset=section.reset,
        anew=any(part.synapse.learns == "pairs" for part in net.projections.values()),
        after=_after(net, section, clock),
        origin=net.trials_origin,
    )


def _refuse(net: Network, word: str, message: str, hint: str = "", missing: str = "") -> NoReturn:
    text = f"trials: {message}"
    raise ModelError(text, where=net.trials_origin, hint=hint, path=words_of(word), missing=missing)


def _check_population(net: Network, name: str, word: str) -> str:
    if name not in net.populations:
        raise unknown("population", name, net.populations, path=words_of(word)).at(net.trials_origin, f"trials: {word}")
    return name


def _input(net: Network, section: Trials) -> str:
    name = _check_population(net, section.input, "input")
    model = net.populations[name].model
    if not isinstance(model, spike_generator):
        _refuse(net, "input", f"input '{name}' is {a(model.name)}: expected a spike_generator")
    if any(len(times) for times in model.spike_times):
        _refuse(net, "input", f"input '{name}' has spike_times: expected none, because trials bring their own")
    return name


def _output(net: Network, section: Trials) -> str:
    """Return the deciding population: the population of `labels`, else of `dropout`, else of the only group."""
    declared = {word: part.of for word, part in (("labels", section.labels), ("dropout", section.dropout)) if part}
    for word, name in declared.items():
        _check_population(net, name, f"{word}.of")
    if len(set(declared.values())) > 1:
        _refuse(
            net,
            "labels",
            f"labels of '{declared['labels']}' but dropout of '{declared['dropout']}': expected one population",
        )
    if declared:
        return str(next(iter(declared.values())))
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


def _ticks(net: Network, clock: Clock, value: float, word: str) -> int:
    try:
        return clock.step(value, word)
    except ModelError as error:
        raise error.at(net.trials_origin, "trials") from None


def _after(net: Network, section: Trials, clock: Clock) -> int:
    """Return the number of ticks after a trial in which dopamine acts; 0 if no reward sets a signal."""
    ticks = _ticks(net, clock, section.after, "after")
    learners = [part for part in net.projections.values() if part.synapse.learns == "pairs"]
    for part in learners:
        signal = part.synapse.parameters()["signal"]
        if signal is not None and ticks == 0:
            message = f"after = 0 ms, and the reward sets '{signal}' at the end of a trial: expected a time > 0 ms"
            _refuse(net, "after", f"{message} in which {part.synapse.name} of '{part.name}' learns from it")
        if signal is not None and section.labels is None:
            text = f"{part.synapse.name} of '{part.name}' needs 'labels', because the reward sets '{signal}'"
            _refuse(net, "", text, missing="labels")
        if signal is not None and net.signals[signal].values is not None:
            message = f"signal '{signal}' has values: expected none, because the reward of each trial sets it"
            _refuse(net, "", message, f"{part.synapse.name}.dopamine takes the spikes of a population")
    if ticks and not learners:
        _refuse(net, "after", f"after = {section.after:g} ms: expected 0, because no synapse learns by dopamine")
    return ticks


def _duration(net: Network, section: Trials, clock: Clock) -> int:
    ticks = _ticks(net, clock, section.duration, "duration")
    if ticks < 1:
        message = f"duration = {section.duration:g} ms: expected at least the resolution, {clock.resolution:g} ms"
        _refuse(net, "duration", message)
    return ticks


def _check_learners(net: Network, output: str, labels: Labels | None, group: Group) -> None:
    for part in net.projections.values():
        if part.synapse.learns != "trials":
            continue
        label = f"projection '{part.name}': {part.synapse.name}"
        if part.target != output:
            text = f"{label} onto '{part.target}': expected '{output}', which decides"
            raise ModelError(text, where=part.origin, path=words_of(part.synapse.name))
        if part.synapse.peaks and group.choice.several:
            message = f"{label} learns from the largest V_m up to a decision, and group '{group.name}' makes several"
            raise ModelError(
                f"{message}: expected winner_take_all", where=part.origin, path=words_of(part.synapse.name)
            )
        if labels is None and part.synapse.supervised:
            text = f"{part.synapse.name} of '{part.name}' needs 'labels', because rewards depend on them"
            _refuse(net, "", text, missing="labels")
