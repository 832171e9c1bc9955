"""Checks of a network as a whole. Each check raises a `ModelError` with a hint on what to change."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.learning import check_dopamine, check_moves
from neuro.compiler.shapes import Shape, end_of, size
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, a, unknown, words_of
from neuro.core.keyed_random import LARGEST_MEAN
from neuro.core.registry import Registry
from neuro.core.values import plain
from neuro.model.distributions import Distribution
from neuro.model.network import Network
from neuro.model.neurons import (
    MODELS,
    CurrentGenerator,
    Generator,
    Model,
    Neuron,
    gamma_sup_generator,
    noise_generator,
    poisson_generator,
    sinusoidal_poisson_generator,
    spike_generator,
)
from neuro.model.parts import AnyPart, Population, Projection, naming_the_part, refuse
from neuro.model.rules import LEARNING_IN_TRIALS, LEARNING_KERNELS, grid
from neuro.model.space import of_distance
from neuro.model.synapses import SYNAPSES, Modulated, MoveRule, Synapse, static
from neuro.program.program import Floats, Receptor

FINER = "use a finer resolution or a lower rate"


def check_network(net: Network, shapes: Mapping[str, Shape]) -> None:
    """Check a network, except trials and the values of arrays. Trials and arrays are checked when they are resolved.

    Args:
        net: the network.
        shapes: resolved shapes of all populations.

    Raises:
        ModelError: the first error, with the place and a hint.
    """
    if not net.populations:
        raise ModelError(f"network '{net.name}' has no population: expected at least one")
    for name in net.projections:
        if name in net.populations:
            refuse(net.projections[name], "a population has the same name: expected another name")
    for population in net.populations.values():
        _check_population(population, shapes[population.name])
    for projection in net.projections.values():
        for role, name, view in (
            ("from", projection.source, projection.source_view),
            ("to", projection.target, projection.target_view),
        ):
            with naming_the_part(projection, role, name):
                end = end_of(view, shapes[name])
            if isinstance(projection.rule, grid) and end.ids is not None:
                message = f"a grid {role} {view}: expected the whole population"
                refuse(projection, message, "all_to_all and pairs connect views", "grid")
        _check_ends(net, projection)
        _check_synapse(net, projection, shapes)
        _check_graded(net, projection)
    _check_groups(net, shapes)


def recordable(population: Population) -> list[str]:
    """Return the names of the readable states of a population's model."""
    return [state.name for state in population.model.states if not state.hidden]


def _check_population(part: Population, shape: Shape) -> None:
    model = part.model
    if part.neurons is not None:
        with naming_the_part(part, "neurons"):
            table_size = part.neurons.neurons.size
        if table_size != size(shape):
            message = f"its table lists {table_size} neurons: expected {size(shape)}, as many as its shape has"
            refuse(part, message, "'shape: auto' takes it from the table", "shape")
    _check_class(part, MODELS, type(model))
    if isinstance(model, spike_generator) and len(model.spike_times) not in (0, size(shape)):
        message = (
            f"spike_generator.spike_times has {len(model.spike_times)} lists: "
            f"expected {size(shape)}, one for each neuron"
        )
        refuse(part, message, word="spike_generator.spike_times")
    if isinstance(model, Neuron) and 0 < model.most < size(shape):
        subject = f"{size(shape)} neurons of {model.name}"
        refuse(part, f"{subject}: expected at most {model.most}, since all neurons are compared with each other")


def _check_class(part: AnyPart, registry: Registry[Any], model: type[Any]) -> None:
    """Check that a third-party class, registered or not, has all that backends need."""
    try:
        registry.check(model)
    except ModelError as error:
        raise error.at(part.origin, f"{part.word} '{part.name}'") from None


def check_values(model: Model, parameters: Mapping[str, Floats], clock: Clock) -> None:
    """Check the resolved parameters of one population, alone and together.

    Args:
        model: model of the population.
        parameters: one value for all neurons or one for each, by word. Missing words are not checked.
        clock: clock of the network.
    """
    if isinstance(model, Generator):
        check_generator(model, parameters, clock)
    top = "V_peak" if "V_peak" in model.quantities() else "V_th"
    if "V_reset" in parameters and top in parameters:
        v_reset, v_top = np.broadcast_arrays(parameters["V_reset"], parameters[top])
        bad = np.flatnonzero(v_reset >= v_top)
        if bad.size:
            where = f"[{bad[0]}]" if v_reset.size > 1 else ""
            message = (
                f"{model.name}.V_reset{where} = {v_reset[bad[0]]:g} mV: expected less than {top} = {v_top[bad[0]]:g} mV"
            )
            raise ModelError(message, hint=f"lower V_reset or raise {top}", path=(model.name, "V_reset"), about=(top,))
    if "t_ref" in parameters:
        clock.steps(parameters["t_ref"], f"{model.name}.t_ref")
    if isinstance(model, Neuron):
        model.check_steps(parameters, clock.resolution)


def check_generator(model: Generator, parameters: Mapping[str, Floats], clock: Clock) -> None:
    """Check the resolved parameters of a generator, alone and together.

    Args:
        model: the generator, as described.
        parameters: one value for all neurons or one for each, by word. Missing words are not checked.
        clock: clock of the network.

    Raises:
        ModelError: the first error.
    """
    if isinstance(model, poisson_generator | sinusoidal_poisson_generator) and "rate" in parameters:
        check_rate(model, "rate", float(parameters["rate"].max()), clock)
    if isinstance(model, sinusoidal_poisson_generator) and {"rate", "amplitude"} <= set(parameters):
        peak = np.max(parameters["rate"] + np.abs(parameters["amplitude"]))
        check_rate(model, "rate + amplitude", float(peak), clock)
    if isinstance(model, gamma_sup_generator) and "rate" in parameters:
        # The probability of leaving a stage is at most 1/2, and the probability that no neuron leaves is a double > 0.
        rate = float(parameters["rate"].max())
        per_step = model.gamma_shape * clock.resolution / 1000.0
        limit = min(0.5, LARGEST_MEAN / model.n_proc) / per_step
        if rate > limit:
            message = (
                f"{model.name}.rate = {rate:g} Hz: expected at most {limit:g} Hz with gamma_shape = "
                f"{model.gamma_shape} and n_proc = {model.n_proc} at a resolution of {clock.resolution:g} ms"
            )
            raise ModelError(message, hint=FINER, path=(model.name, "rate"), about=("gamma_shape", "n_proc"))
    if isinstance(model, noise_generator):
        if clock.step(model.dt, f"{model.name}.dt") < 1:
            message = f"{model.name}.dt = {model.dt:g} ms: expected at least the resolution, {clock.resolution:g} ms"
            raise ModelError(message, path=(model.name, "dt"), kind="resolution")
        if {"std", "std_mod"} <= set(parameters):
            std, std_mod = np.broadcast_arrays(parameters["std"], parameters["std_mod"])
            bad = np.flatnonzero(std_mod > std)
            if bad.size:
                where = f"[{bad[0]}]" if std.size > 1 else ""
                message = (
                    f"{model.name}.std_mod{where} = {std_mod[bad[0]]:g} pA: expected at most std = {std[bad[0]]:g} pA"
                )
                hint = "the variance would be negative at times"
                raise ModelError(message, hint=hint, path=(model.name, "std_mod"), about=("std",))


def check_rate(model: Model, word: str, rate: float, clock: Clock) -> None:
    """Refuse a rate that is too large for drawing the spikes of a step.

    Raises:
        ModelError: the rate, in Hz, is too large.
    """
    limit = LARGEST_MEAN * 1000.0 / clock.resolution
    if rate > limit:
        message = f"{model.name}.{word} = {rate:g} Hz: expected at most {limit:g} Hz, {LARGEST_MEAN:g} spikes per step"
        raise ModelError(message, path=(model.name, *words_of(word)))


def _check_ends(net: Network, part: Projection) -> None:
    source, target = net.populations[part.source].model, net.populations[part.target].model
    if not isinstance(target, Neuron):
        text = f"its target '{part.target}' is {a(target.name)}, which takes no input: expected neurons"
        refuse(part, text, f"write it from '{part.target}' to '{part.source}', if that is meant", "to")
    if isinstance(source, CurrentGenerator):
        if not target.states:
            refuse(
                part,
                f"a current from '{part.source}' into '{part.target}', {a(target.name)}: expected neurons with V_m",
                word="to",
            )
        if not target.takes_current:
            message = (
                f"a current from '{part.source}' into '{part.target}', {a(target.name)}, whose equations have no I"
            )
            refuse(part, f"{message}: expected neurons that take currents", "add + I/C_m to the equation of V_m", "to")
        if part.synapse.learns:
            refuse(
                part,
                f"{part.synapse.name} on a current from '{part.source}': expected a static synapse",
                "synapses learn from spikes only",
                part.synapse.name,
            )
        if isinstance(part.rule, grid):
            refuse(part, f"a grid on a current from '{part.source}': expected another rule", word="grid")


def _check_graded(net: Network, part: Projection) -> None:
    """Refuse graded spikes for parrots, for rules that learn from spikes, and for receptors chosen by sign."""
    source, target = net.populations[part.source].model, net.populations[part.target].model
    sides = [name for name, model in ((part.source, source), (part.target, target)) if model.graded]
    if part.synapse.learns and sides and not part.synapse.takes_graded:
        text = f"{part.synapse.name} with graded spikes of '{sides[0]}': expected a static synapse"
        refuse(part, text, "a spike with payload m counts as one spike, not as m", part.synapse.name)
    if not source.graded or not isinstance(target, Neuron):
        return
    if target.relay:
        text = f"graded spikes of '{part.source}' onto '{part.target}', {a(target.name)}: expected a graded neuron"
        refuse(part, text, "graded_vector repeats payloads", "to")
    receptor = named_by(part.synapse)
    if target.receptors > 1 and (receptor is None or receptor in target.conductances):
        candidates = [name for name in target.named_receptors() if name not in target.conductances]
        expected = (
            f"a synapse with 'receptor', {' or '.join(candidates)}" if candidates else "a neuron with one receptor"
        )
        text = (
            f"graded spikes of '{part.source}' onto '{part.target}', {a(target.name)} with {target.receptors} receptors"
        )
        hint = "payloads may be negative, so the sign of a weight cannot choose; iaf_psc_delta has one receptor"
        refuse(part, f"{text}: expected {expected}", hint, "to")


def _check_synapse(net: Network, part: Projection, shapes: Mapping[str, Shape]) -> None:
    synapse = part.synapse
    _check_class(part, SYNAPSES, type(synapse))
    if isinstance(part.rule, grid) and synapse.learns in ("pairs", "moves") and synapse.name not in LEARNING_KERNELS:
        text = f"{synapse.name} on a shared kernel: expected static, {', '.join(LEARNING_KERNELS)} or a rule for trials"
        refuse(part, text, "all_to_all gives each pair a weight", synapse.name)
    if isinstance(part.rule, grid) and synapse.learns == "pairs" and (words := synapse.per_synapse()):
        text = f"{synapse.name}.{words[0]} of each synapse on a shared kernel: expected a number"
        refuse(part, text, "all_to_all gives each pair its own rule", synapse.name)
    if isinstance(part.rule, grid) and synapse.delays:
        text = f"{synapse.name} on a shared kernel, which has one delay: expected another connection rule"
        refuse(part, text, "all_to_all gives each pair a delay", synapse.name)
    if synapse.learns == "trials" and net.trials_section is None:
        message = f"{synapse.name} learns at the end of trials: expected a section 'trials'"
        refuse(part, message, "add one, or use stdp", synapse.name, "trials")
    if synapse.learns in ("pairs", "moves", "chip") and net.trials_section is not None:
        shared = isinstance(part.rule, grid)
        if synapse.name not in LEARNING_IN_TRIALS or shared:
            label = f"{synapse.name} on a shared kernel" if shared else synapse.name
            expected = f"static, {', '.join(LEARNING_IN_TRIALS)} with a weight for each pair, or a rule for trials"
            hint = "each trial resets everything except weights, so other states of a rule would be lost"
            hint = "all_to_all gives each pair a weight" if shared else hint
            refuse(part, f"{label} in a network with trials: expected {expected}", hint, synapse.name, "trials")
    _check_weight(part)
    if isinstance(synapse, Modulated):
        check_dopamine(net, part, synapse, shapes)
    if isinstance(synapse, MoveRule):
        check_moves(net, part, synapse)


def _check_weight(part: Projection) -> None:
    """Check that a weight, if it is a number, is within the bounds of the rule."""
    weight = plain(part.weight)
    if isinstance(weight, (Distribution, of_distance)) or np.ndim(weight) or part.synapse.per_synapse():
        return
    low, high = part.synapse.bounds()
    if not low <= weight <= high:
        refuse(
            part,
            f"weight = {weight:g}: expected {part.synapse.expected_weight()}",
            f"change the weight or {part.synapse.name}.Wmax" if "Wmax" in part.synapse.parameters() else "",
            "weight",
            about=(part.synapse.name, "Wmax"),
        )


def _check_groups(net: Network, shapes: Mapping[str, Shape]) -> None:
    members: dict[str, str] = {}
    for part in net.groups.values():
        name, kind = part.choice.of, part.choice.name
        if name not in net.populations:
            error = unknown("population", name, net.populations, path=(kind, "of"))
            raise error.at(part.origin, f"group '{part.name}': {kind}.of")
        model = net.populations[name].model
        if "V_m" not in recordable(net.populations[name]) or "V_th" not in model.quantities():
            refuse(part, f"{kind} of '{name}', {a(model.name)}: expected neurons with V_m and V_th", word=kind)
        if isinstance(model, Neuron) and model.resets_in_step:
            message = f"{kind} of '{name}', {a(model.name)}, whose neurons reset themselves before a group can choose"
            refuse(part, f"{message}: expected neurons that a group resets", word=kind)
        if problem := part.choice.misfit(shapes[name]):
            refuse(part, problem, word=kind)
        if name in members:
            refuse(part, f"'{name}' is already in group '{members[name]}': expected one group for each population")
        members[name] = part.name


def named_by(synapse: Synapse) -> str | None:
    """Return the name of a synapse's receptor; None without one.

    If `receptor` is a number, it is a parameter of a third-party rule, and no name.
    """
    name = getattr(synapse, "receptor", None)
    return name if isinstance(name, str) else None


def receptor_of(synapse: Synapse, target: Population) -> Receptor | None:
    """Return the receptor named by a synapse; None if the sign of a weight chooses the receptor.

    Args:
        synapse: the model of the synapse.
        target: the population of target neurons.

    Raises:
        ModelError: the neurons have no such receptor, or have several and the synapse names none.
    """
    model = target.model
    assert isinstance(model, Neuron)
    receptors = model.named_receptors()
    name = named_by(synapse)
    if name is None:
        if len(receptors) > 2 or not model.signed:
            rule = synapse.name if hasattr(synapse, "receptor") else "static"
            message = f"{_with_model(target)} has {len(receptors)} receptors: the synapse must name one"
            raise ModelError(message, hint=f"write {rule} with 'receptor', one of {', '.join(receptors)}")
        return None
    if not receptors:
        text = f"{synapse.name}.receptor = '{name}': {_with_model(target)} has one input without a name"
        raise ModelError(f"{text}: expected no receptor", hint="leave it out", path=(synapse.name, "receptor"))
    if name not in receptors:
        raise _unknown_receptor(synapse, target, name, receptors)
    index, conductance = receptors.index(name), name in model.conductances
    # Models with two conductances expect negative numbers at the second conductance, as if the sign had chosen it.
    return Receptor(name, index, conductance, negated=conductance and len(receptors) == 2 and index == 1)


def receptor_of_current(synapse: Synapse, target: Population, source: str) -> Receptor | None:
    """Return the receptor that filters a current; None if the current acts on V_m directly.

    Raises:
        ModelError: the neurons have no such receptor.
    """
    model = target.model
    assert isinstance(model, Neuron)
    name = synapse.receptor if isinstance(synapse, static) else None
    if name is None:
        return None
    if not model.filters:
        message = (
            f"static.receptor = '{name}' of a current from '{source}': {_with_model(target)} takes currents at V_m"
        )
        raise ModelError(f"{message}: expected no receptor", hint="leave it out", path=("static", "receptor"))
    if name not in model.filters:
        raise _unknown_receptor(synapse, target, name, model.filters)
    return Receptor(name, model.named_receptors().index(name), conductance=False, negated=False)


def _with_model(target: Population) -> str:
    return f"'{target.name}' ({target.model.name})"


def _unknown_receptor(synapse: Synapse, target: Population, name: str, receptors: Iterable[str]) -> ModelError:
    error = unknown("receptor of", name, receptors, path=(synapse.name, "receptor"))
    return error.but(message=f"{_with_model(target)} has no receptor '{name}'")


def check_conductance(receptor: Receptor | None, *weights: NDArray[np.floating[Any]]) -> None:
    """Refuse negative weights to a named conductance. If `weights` are several arrays, the message has no index.

    Raises:
        ModelError: the first negative weight.
    """
    if receptor is None or not receptor.conductance:
        return
    for weight in weights:
        bad = np.flatnonzero(weight < 0.0)
        if not bad.size:
            continue
        first, place = weight[bad[0]], f"[{bad[0]}]" if len(weights) == 1 else ""
        message = f"weight{place} = {first:g} to receptor '{receptor.name}', a conductance: expected at least 0"
        hint = f"write {-first:g}, or leave out 'receptor', so that the sign chooses"
        raise ModelError(message, hint=hint, path=("weight",), about=("receptor",))
