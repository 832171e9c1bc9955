"""Parts of a network that NEST cannot run as described, parameters that NEST refuses, and alternatives for each."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import a, some
from neuro.model.neurons import CurrentGenerator
from neuro.model.rules import fixed_total_number
from neuro.program.backend import Problem, floats_only, unnoted
from neuro.program.program import Floats, Population, Program, Projection
from neuro_nest.tables import (
    FIXED_TRUE,
    NODES,
    OF_TARGET,
    RECEPTORS_OF_CURRENTS,
    RK4,
    SYNAPSE_MODELS,
    SYNAPSES,
    TICKS_PER_MS,
    UNREADABLE,
)

Values = Mapping[str, Floats]

LARGEST_EXPONENT = math.log(sys.float_info.max / 1e20)
"""Largest (V_peak - V_th) / Delta_T that NEST's aeif neurons accept."""

LARGEST_GROWTH = math.log(sys.float_info.max)
"""Largest exponent in NEST's propagators. Above it V_m is NaN, or wrong without an error (iaf_psc_exp)."""


@dataclass(frozen=True, slots=True)
class Limit:
    """A check of a model of NEST.

    Attributes:
        names: names of the checked parameters, in the order of the message.
        refuses: function of the parameters of a population and the length of a step in ms, which returns the neurons
            that NEST refuses.
        why: what NEST expects.
        way_out: what the user can write instead.
    """

    names: tuple[str, ...]
    refuses: Callable[[Values, float], NDArray[np.bool_]]
    why: str
    way_out: str


SHARP = Limit(
    ("Delta_T", "V_peak", "V_th"),
    lambda p, _: (p["Delta_T"] > 0.0) & ((p["V_peak"] - p["V_th"]) / p["Delta_T"] >= LARGEST_EXPONENT),
    f"NEST expects (V_peak - V_th) / Delta_T < {LARGEST_EXPONENT:.1f}, so that no exponential overflows",
    "use a larger Delta_T, a lower V_peak, or Delta_T = 0, which fires at V_th",
)
PEAK = Limit(("V_peak", "V_th"), lambda p, _: p["V_peak"] < p["V_th"], "NEST expects V_peak >= V_th", "raise V_peak")
HOLDS = Limit(
    ("t_ref",), lambda p, h: np.rint(p["t_ref"] / h) < 1.0, "NEST expects t_ref > 0 ms", "set t_ref to one step"
)
RESET = Limit(
    ("V_reset", "V_th", "E_L"),
    lambda p, _: p["V_reset"] - p["E_L"] >= p["V_th"] - p["E_L"],
    "NEST holds potentials relative to E_L, in which these two are equal",
    "choose an E_L nearer to them",
)


def _differs(name: str) -> Limit:
    text = f"NEST expects that tau_m and {name} differ"
    return Limit((name, "tau_m"), lambda p, _: p[name] == p["tau_m"], text, f"multiply {name} by 1.000001")


def _too_fast(name: str) -> Limit:
    text = f"NEST's propagator overflows where a step is longer than {LARGEST_GROWTH:.0f} {name}"
    grows = lambda p, h: h / p[name] - h / p["tau_m"] > LARGEST_GROWTH  # noqa: E731
    return Limit((name, "tau_m"), grows, text, f"use a larger {name}")


STEP_LIMITS = (_too_fast("tau_syn_ex"), _too_fast("tau_syn_in"))

LIMITS: Mapping[str, tuple[Limit, ...]] = {
    **dict.fromkeys(("aeif_cond_exp", "aeif_psc_exp"), (PEAK, SHARP)),
    "mat2_psc_exp": (HOLDS, _differs("tau_syn_ex"), _differs("tau_syn_in"), *STEP_LIMITS),
    "iaf_psc_delta": (RESET,),
    **dict.fromkeys(("iaf_psc_exp", "iaf_psc_alpha"), (RESET, *STEP_LIMITS)),
}
"""Checks of each model that values within our bounds may fail, in NEST's order."""


def refused_values(part: Population, values: Values, resolution: float) -> Iterator[tuple[Limit, str]]:
    """Yield each limit that some neurons exceed, and the values of the first such neuron as text.

    Args:
        part: the population.
        values: all its parameters, shape (1,) or (size,).
        resolution: length of a step in ms.
    """
    for limit in LIMITS.get(part.model.name, ()):
        with np.errstate(all="ignore"):
            is_refused = np.broadcast_to(limit.refuses(values, resolution), part.size)
        if is_refused.any():
            first = int(np.argmax(is_refused))
            units = {name: q.unit for name, q in part.model.quantities().items()}
            texts = [
                f"{name} = {np.broadcast_to(values[name], part.size)[first]:g} {units[name]}" for name in limit.names
            ]
            yield limit, ", ".join(texts)


def refuses_weight(part: Projection) -> bool:
    """Return whether NEST refuses weights of 0. If Wmax is negative, NEST counts 0 as a positive weight."""
    limits = part.synapse.parameters()
    return bool(np.any((np.asarray(limits.get("Wmax", 0.0)) < 0.0) & (np.asarray(part.weight) >= 0.0)))


ELSEWHERE = "backend 'event' runs it"
NO_LEAK = "with an infinite tau_m NEST's propagator of a current, tau_m / C_m (1 - exp(-h / tau_m)), is no number"
RKF45_ONLY = "NEST integrates by RKF45"
BY_SIGN = "NEST sends weights above 0 to ex and weights below 0 to in"
NO_DRAW = "leave 'draw' out"
FINITE = "use a large tau_m, say 1e6"


def problems(program: Program) -> list[Problem]:
    """Return an error for each part that NEST cannot run, and a warning if NEST draws synapses."""
    chips = floats_only(program)
    if chips:
        return chips
    result = [*_network_problems(program), *unnoted(program)]
    for index, part in enumerate(program.populations):
        result += _population_problems(program, index, part)
    for projection in program.projections:
        result += _projection_problems(program, projection)
    return [*result, *_copy_problems(program), *_target_problems(program), *_rule_problems(program)]


def _refused(subject: str, reason: str, way_out: str, part: object) -> Problem:
    return Problem(True, subject, reason, way_out, getattr(part, "origin", None))


def _network_problems(program: Program) -> Iterator[Problem]:
    ticks = program.resolution * TICKS_PER_MS
    if abs(ticks - round(ticks)) > 1e-9:
        yield _refused(
            f"resolution = {program.resolution:g} ms",
            "NEST's clock ticks in 0.001 ms",
            "use a multiple of 1 us",
            None,
        )
    for group in program.groups:
        yield _refused(f"group '{group.name}'", f"NEST has no {group.choice.noun}", ELSEWHERE, group)
    if program.trials is not None:
        yield _refused("trials", "NEST cannot drop spikes under way", ELSEWHERE, program.trials)
    for probe in program.probes:
        if probe.record in UNREADABLE:
            label = f"probe '{probe.name}': {probe.record}"
            yield _refused(label, "NEST does not show it between steps", "probe V_m", probe)


def _population_problems(program: Program, index: int, part: Population) -> Iterator[Problem]:
    message = f"population '{part.name}'"
    if part.model.name not in NODES:
        yield _refused(f"{message}: {part.model.name}", "NEST has no such model", ELSEWHERE, part)
        return
    if np.any(part.parameters.get(RK4, 0.0) != 0.0):
        yield _refused(f"{message}: {RK4}", RKF45_ONLY, f"leave it out, or {ELSEWHERE}", part)
    if np.any(part.parameters.get("reset_by_subtraction", 0.0) != 0.0):
        yield _refused(f"{message}: reset_by_subtraction", "NEST's model resets to V_reset", ELSEWHERE, part)
    for name, values in part.initial.items():
        if name in UNREADABLE and np.any(values != 0.0):
            yield _refused(f"{message}: initial {name}", "NEST starts it at 0", ELSEWHERE, part)
    for limit, text in refused_values(part, part.parameters, program.resolution):
        yield _refused(f"{message}: {text}", limit.why, f"{limit.way_out}, or {ELSEWHERE}", part)
    if _without_leak(part.parameters) and _has_current(program, index, part):
        yield _refused(f"{message}: a current without leak", NO_LEAK, FINITE, part)


def _without_leak(parameters: Mapping[str, Floats]) -> bool:
    return bool(np.isinf(parameters.get("tau_m", 0.0)).any())


def has_new_current(old_parameters: Mapping[str, Floats], change: Mapping[str, Floats]) -> bool:
    """Return whether a change of parameters gives a current to neurons without leak."""
    new_parameters = {**old_parameters, **change}
    return _without_leak(new_parameters) and bool(np.any(new_parameters["I_e"] != 0.0))


def _has_current(program: Program, index: int, part: Population) -> bool:
    """Return whether a population is driven by more than spikes through delta or exponential synapses."""
    sources = [program.populations[p.source].model for p in program.projections if p.target == index]
    is_driven = bool(np.any(part.parameters["I_e"] != 0.0)) or any(isinstance(m, CurrentGenerator) for m in sources)
    return is_driven or part.model.name == "iaf_psc_alpha"


def _projection_problems(program: Program, part: Projection) -> Iterator[Problem]:
    message = f"projection '{part.name}'"
    if part.synapse.name not in SYNAPSES:
        yield _refused(f"{message}: {part.synapse.name}", "NEST has no such rule", ELSEWHERE, part)
        return
    if part.grid is not None and part.synapse.learns:
        label = f"{message}: {part.synapse.name} on a shared kernel"
        yield _refused(label, "NEST's synapses share no weight that learns", ELSEWHERE, part)
    if part.carries == "current":
        # NEST filters currents with only one of the time constants.
        name = program.populations[part.target].model.name
        if part.receptor is not None and (name, part.receptor.name) not in RECEPTORS_OF_CURRENTS:
            label = f"{message}: a current to receptor '{part.receptor.name}' of {a(name)}"
            yield _refused(label, "NEST has no current to it", ELSEWHERE, part)
    elif part.receptor is not None and not program.share.every(part.as_by_sign(part.weight)):
        yield _refused(f"{message}: receptor '{part.receptor.name}' by name", BY_SIGN, ELSEWHERE, part)
    if refuses_weight(part):
        way_out = f"begin at a weight just below 0, or {ELSEWHERE}"
        yield _refused(
            f"{message}: weight = 0 with Wmax below 0", "NEST expects weights with the sign of Wmax", way_out, part
        )
    if np.isfinite(part.synapse.parameters().get("c_min", -np.inf)):
        label = f"{message}: {part.synapse.name}.c_min"
        yield _refused(label, "NEST's eligibility has no bound", f"leave it out, or {ELSEWHERE}", part)
    for number in FIXED_TRUE & set(part.synapse.numbers()):
        if not part.synapse.parameters()[number]:
            label = f"{message}: {part.synapse.name}.{number} = false"
            yield _refused(label, "NEST acts as if it were true", f"set {number}: true, or {ELSEWHERE}", part)


def _copy_problems(program: Program) -> Iterator[Problem]:
    """Yield an error if there are too many copies of the synapse model: each separate dopamine input needs one."""
    modulated = [part for part in program.projections if part.synapse.modulated]
    copies = sum(program.populations[p.target].size if p.dopamine_one_to_one else 1 for p in modulated)
    if copies > SYNAPSE_MODELS:
        part = next(p for p in modulated if p.dopamine_one_to_one)
        yield _refused(
            f"projection '{part.name}': dopamine_rule = one_to_one",
            f"the network needs {copies} copies of NEST's synapse model, and NEST holds {SYNAPSE_MODELS}",
            "write each neuron's dopamine by a signal",
            part,
        )


def _target_problems(program: Program) -> Iterator[Problem]:
    """Yield an error for each number that NEST stores per neuron and that differs between rules onto a population."""
    first_values: dict[tuple[int, str], tuple[float, str]] = {}
    for part in program.projections:
        for number in OF_TARGET & set(part.synapse.numbers()):
            value = part.synapse.parameters()[number]
            first, name = first_values.setdefault((part.target, number), (value, part.name))
            if value != first:
                yield _refused(
                    f"projection '{part.name}': {part.synapse.name}.{number} = {value:g}",
                    f"NEST has one value per neuron, and '{name}' onto the same population has {first:g}",
                    f"give both the same value, or {ELSEWHERE.replace(' it', ' them')}",
                    part,
                )


def _rule_problems(program: Program) -> Iterator[Problem]:
    """Yield errors and a warning for synapses that NEST draws."""
    parts = [part for part in program.projections if part.undrawn is not None]
    for part in parts:
        assert part.undrawn is not None
        rule, message = part.undrawn.rule, f"projection '{part.name}': draw = backend"
        if part.carries == "current":
            yield _refused(f"{message}: a current", "each of its connections has a node", NO_DRAW, part)
        if isinstance(rule, fixed_total_number) and not rule.multapses:
            yield _refused(f"{message}: {rule.name}.multapses = false", "NEST's rule draws pairs twice", NO_DRAW, part)
    if parts:
        names = ", ".join(f"'{part.name}'" for part in parts[:3])
        label = f"the synapses of {some(len(parts), 'projection')} ({names}{', ...' * (len(parts) > 3)})"
        reason = "drawn by NEST: equal in distribution, but not the synapses that neuro draws"
        yield Problem(False, label, reason, f"if they are to be equal, {NO_DRAW}", parts[0].origin)


_NO_LEAK = "a current without leak"
_TRIALS = "trials: NEST cannot drop spikes under way"
_GROUP = "NEST has no winner-take-all"
_RIVALS = "NEST has no lateral reset"
_RULE = "NEST's stdp_synapse would apply them to earlier post spikes, too"
_AT_PRE = "learning weights can be read between steps only"
_MOMENT = "NEST updates synapses with dopamine every 0.7 ms"

_LAWS = (
    *("a_seed_repeats", "seeds_differ", "threads_do_not_matter", "a_reset_repeats", "a_reset_keeps_weights"),
    *("another_population_does_not_matter", "counts_follow_from_spikes", "cutting_does_not_matter_when_steered"),
)
_SAVING = ("a_saved_state_continues", "a_state_saved_after_a_change_continues")

UNSUPPORTED: dict[str, str] = {
    "exact_refractory_periods": _NO_LEAK,
    "exact_currents": _NO_LEAK,
    "alpha_neuron_equal_time_constants": _NO_LEAK,
    "initial_states": "initial I_syn_ex: NEST starts it at 0",
    "states_and_parameters_change": "I_syn_ex of 'cells': NEST neither shows nor sets it between steps",
    "currents_to_both_receptors": "a current to receptor 'in' of an iaf_psc_exp: NEST has no current to it",
    **dict.fromkeys(("stdp_changes", "synapses_that_come_to_differ"), _RULE),
    "several_states_means_and_rates": "I_syn_ex: NEST does not show it between steps",
    **dict.fromkeys(("weights_at_pre_spikes", "states_at_pre_spikes"), _AT_PRE),
    "single_plastic_weights_change": _RULE,
    "ports_go_on_after_a_restore": "NEST has no way to write or read its state",
    **dict.fromkeys(("first_to_fire", "exact_best_of_each_step"), _GROUP),
    "local_winners_without_trials": "NEST has no competition",
    **dict.fromkeys(("maps_that_reset_each_other", "exact_lateral_reset"), _RIVALS),
    **dict.fromkeys((f"{law}_of_fixed_weights" for law in (*_LAWS, *_SAVING)), _GROUP),
    **dict.fromkeys((f"{law}_of_fixed_weights" for law in ("cutting_does_not_matter", "probes_do_not_matter")), _GROUP),
    **dict.fromkeys((*_LAWS, *(f"{law}_of_learning" for law in _LAWS)), _RULE),
    **dict.fromkeys((*_SAVING, *(f"{law}_of_learning" for law in _SAVING)), "a process has one NEST"),
    **dict.fromkeys(("cutting_does_not_matter", "probes_do_not_matter"), _MOMENT),
    **dict.fromkeys(
        (
            *("silent_trials", "rewarded_learning", "rescued_learning"),
            *("dropout_of_each_trial", "rewarded_learning_with_padding", "rewarded_learning_of_all_pairs"),
            *("rewarded_learning_by_channel",),
            *("rewarded_learning_with_delays", "rewarded_learning_from_a_layer", "states_that_go_on"),
            *("learning_without_labels", "learning_at_the_peak"),
            *("exact_decisions", "exact_full_trials", "exact_rewards", "exact_rescue", "exact_growth"),
            *("exact_run_after_a_decision",),
            *("exact_local_winners", "exact_local_winners_to_the_last"),
            *("local_winners_learn", "local_winners_are_rewarded"),
            *("saved_trials_continue", "cutting_a_batch_does_not_matter"),
        ),
        _TRIALS,
    ),
}
