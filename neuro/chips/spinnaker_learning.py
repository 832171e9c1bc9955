"""Conversion of `stdp`, its variants and `stdp_dopa` to the programs of SpiNNaker's plastic synapses.

A weight w of a description becomes w g on the machine, in nA or mV. The factor g is constant for all synapses.
Additive amplitudes are absolute on the machine: A_plus = lambda Wmax g. Amplitudes of triplets are multiplied by Wmax.

The delay register of `iaf_psc_exp` is one step longer than the delay, and post spikes of the machine reach a synapse
after that register. The spikes of a pair are therefore one step further apart or closer. The amplitudes A_plus exp(h
/ tau_plus) and A_minus exp(-h / tau_minus) compensate for the step, so that the windows equal those of the float model.

Dopamine of 1/tau_n becomes a synapse of concentration k 2^-11, and an eligibility of 1 becomes m units of a word. The
rule determines the product k m, but not its factors. Events round both factors down. Rounding of dopamine moves weights
down; rounding of the eligibility slows learning. For a signal, whose sources are chosen here, k is therefore as large
as possible and m is small. For dopamine by spikes, which release one concentration, k and m are about equal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.fixed import FixedPopulation, FixedProjection
from neuro.chips.inputs import (
    LEARN_ELSEWHERE,
    Options,
    acts_late,
    approximated,
    foreign,
    largest_signal,
    no_rule,
    refused,
)
from neuro.chips.spinnaker_core import SLOT_BITS, slots_of
from neuro.chips.spinnaker_rule import (
    ADDITIVE,
    DOWN,
    DOWN_TRIPLET,
    HIGH,
    MULTIPLICATIVE,
    OF_WEIGHT,
    ONE,
    PARTS,
    UP,
    UP_TRIPLET,
    SpinnakerRule,
    rule_of,
)
from neuro.core.errors import ModelError
from neuro.model.synapses import (
    Synapse,
    spinnaker_learning,
    stdp,
    stdp_dopa,
    stdp_nn_restr,
    stdp_nn_symm,
    stdp_triplet,
    vogels_sprekeler,
)
from neuro.program.backend import SAVE_FROZEN, Problem
from neuro.program.program import Program, Projection

LARGEST_WORD = 65535
COARSE_UPDATE = 8.0
"""Changes by one pair below this number of units lose more than 6 % by rounding down. A problem is reported."""


@dataclass(frozen=True, slots=True)
class TargetUnits:
    """Units of the neurons and slots of a rule.

    Attributes:
        h: length of a step in ms.
        extra: delay register minus delay, in steps.
        gain: nA or mV on the machine for a weight of 1.
        shift: shift of the slots of the receptor.
        tau_minus: time constant of the target in ms.
        largest_n: largest |n| that a signal will set, in 1/ms.
    """

    h: float
    extra: int
    gain: float
    shift: int
    tau_minus: float
    largest_n: float = 0.0

    @property
    def unit(self) -> float:
        """Weight of one unit of a word, in nA or mV."""
        return 2.0**self.shift / PARTS


@dataclass(frozen=True, slots=True)
class MappedRule:
    """A rule of the machine that replaces a float synapse model.

    Attributes:
        rule: the rule.
        approximations: differences from the float model, one sentence each.
        update: smallest nonzero change of a weight by one pair, in units of a word. With dopamine: the change for the
            larger of A_plus and A_minus, for dopamine of 1/tau_n (spikes) or the largest dopamine (signal); at most
            the units of the eligibility of a pair, and of dopamine.
        n_scale: dopamine in 1/ms per unit in s4.11.
    """

    rule: SpinnakerRule
    approximations: tuple[str, ...]
    update: float
    n_scale: float = 0.0


def map_rule(synapse: Synapse, onto: TargetUnits) -> MappedRule:
    """Return the rule of SpiNNaker that approximates a float synapse model.

    Raises:
        ModelError: no program can run the model; the hint names another way.
    """
    if isinstance(synapse, spinnaker_learning):
        return _native_rule(synapse, onto)
    if isinstance(synapse, stdp_dopa):
        mapping = _dopamine_rule(synapse, onto)
        return replace(mapping, approximations=(*mapping.approximations, *_common_notes(onto)))
    timing, dependence, numbers, notes = _maker(synapse)(synapse, onto)
    rule = rule_of(timing, dependence, {"w_min": 0.0} | numbers, dt=onto.h)
    notes += _rounding_notes(rule, numbers, float(numbers["w_max"]) if timing == "triplet" else 1.0)
    return MappedRule(rule, (*notes, *_common_notes(onto)), _smallest_change(rule, onto))


def _smallest_change(rule: SpinnakerRule, onto: TargetUnits) -> float:
    """Return the smallest nonzero change by one pair, in units of a word."""
    c = rule.constants
    scale = int(c[HIGH]) / PARTS if c[OF_WEIGHT] else 1.0
    changes = [abs(int(c[column])) * scale / PARTS / onto.unit for column in _AMPLITUDES]
    return min((change for change in changes if change > 0.0), default=math.inf)


def _native_rule(p: spinnaker_learning, onto: TargetUnits) -> MappedRule:
    """Return the rule of a `spinnaker_learning` synapse, which names its program."""
    largest = (p.c_max if p.taught else abs(p.Wmax)) * onto.gain
    share = largest if p.dependence == ADDITIVE and p.timing != "triplet" else 1.0
    steps = {"triplet": 4, "vogels": 1}.get(p.timing, 2)
    numbers = dict.fromkeys(_AMPLITUDES.values(), 0.0)
    numbers |= {word: getattr(p, word) * share for word in list(numbers)[:steps]}
    numbers |= {"w_min": (p.c_min if p.taught else abs(p.Wmin)) * onto.gain, "w_max": largest, "tau": p.tau_plus}
    bounds = {"w_min": abs(p.Wmin) * onto.gain, "w_max": abs(p.Wmax) * onto.gain}
    taught = {"tau_c": p.tau_c, "tau_d": p.tau_n, **bounds} if p.taught else None
    rule = rule_of(p.timing, p.dependence, p.parameters() | numbers, dt=onto.h, neuromodulation=taught)
    notes = _rounding_notes(rule, numbers, largest if p.timing == "triplet" else 1.0)
    if p.timing == "recurrent":
        notes += ("one generator draws the windows of the projection; on the machine each core has its own generator",)
    if onto.extra:
        notes += (f"post spikes and dopamine act {onto.extra} step later, because the delay register is longer",)
    rule = replace(rule, eligibility=onto.unit / onto.gain if p.taught else 1.0)
    if p.dopamine is not None:
        units = round(p.concentration * ONE)
        if not 0 < abs(units) < 16 * ONE:
            message = f"spinnaker_learning.concentration = {p.concentration:g}: {units} units of 2^-11"
            raise ModelError(f"{message}: expected 1 to {16 * ONE - 1} in size", path=("concentration",))
        error = units / ONE / p.concentration - 1.0
        notes += (f"concentration is {error:+.1%} off",) if abs(error) > 1e-3 else ()
        rule = replace(rule, concentrations=(units,))
    elif p.signal is not None:
        rule = replace(rule, concentrations=_levels(onto.largest_n * ONE / LEVELS))
    return MappedRule(rule, notes, _smallest_change(rule, onto), 1.0 / ONE)


def _levels(units: float) -> tuple[int, ...]:
    """Return the concentrations of a signal's sources. The smallest has about `units` of s4.11."""
    unit = min(max(1, round(units)), ROOM * ONE // 2 // LEVELS)
    return tuple(unit << bit for bit in range(BITS))


def _common_notes(onto: TargetUnits) -> tuple[str, ...]:
    """Return the differences common to all rules."""
    return (
        f"weights are whole units of {onto.unit / onto.gain:.4g}; each packet rounds changed weights down",
        "weights change at the next spike of the source: post spikes after its last spike change no weight",
        "a post neuron stores its last 15 events; sources that were silent since lose older events",
        "a post spike that arrives together with a pre spike counts fully in the depression by that pre spike",
    )


def _maker(synapse: Synapse) -> Callable[[Any, TargetUnits], _Form]:
    for kind, make in _MAKERS.items():
        if isinstance(synapse, kind):
            return make
    names = ", ".join(kind.__name__ for kind in (*_MAKERS, stdp_dopa))
    raise ModelError(
        f"no SpiNNaker program was released for this model: expected one of {names}",
        hint=f"run it on event, or send static weights: {SAVE_FROZEN}",
    )


def _rounding_notes(rule: SpinnakerRule, numbers: Mapping[str, Any], scale: float) -> tuple[str, ...]:
    """Return notes on the rounding of amplitudes, times a scale.

    Raises:
        ModelError: all nonzero amplitudes of potentiation, or of depression, become 0.
    """
    notes: tuple[str, ...] = ()
    for columns in ((UP, UP_TRIPLET), (DOWN, DOWN_TRIPLET)):
        amounts = {column: abs(numbers.get(_AMPLITUDES[column], 0.0)) * scale for column in columns}
        if any(amounts.values()) and not any(rule.constants[column] for column in columns):
            name, largest = _AMPLITUDES[columns[0]], max(amounts.values())
            raise ModelError(
                f"{name} = {largest:.3g} on the machine: the smallest is {1 / PARTS:.3g}",
                hint="learn faster, or scale weights and C_m up by the same factor",
            )
        for column, amount in amounts.items():
            error = abs(int(rule.constants[column])) / PARTS / amount - 1.0 if amount else 0.0
            notes += (f"{_AMPLITUDES[column]} is {error:+.1%} off",) if abs(error) > 1e-3 else ()
    return notes


_AMPLITUDES = {UP: "A_plus", DOWN: "A_minus", UP_TRIPLET: "A3_plus", DOWN_TRIPLET: "A3_minus"}
_Form = tuple[str, str, dict[str, Any], tuple[str, ...]]


def _window_factors(tau_plus: float, onto: TargetUnits) -> tuple[float, float]:
    """Return factors for potentiation and depression that compensate for the later arrival of post spikes."""
    return math.exp(onto.extra * onto.h / tau_plus), math.exp(-onto.extra * onto.h / onto.tau_minus)


def _weight_dependent(p: Any, onto: TargetUnits, timing: str) -> _Form:
    if p.mu_plus != p.mu_minus or p.mu_plus not in (0.0, 1.0):
        raise ModelError(
            f"{p.name}.mu_plus = {p.mu_plus:g} and mu_minus = {p.mu_minus:g}: expected both 0 (additive) or both 1",
            hint=f"mu_plus: {round(min(p.mu_plus, 1.0))}, mu_minus: {round(min(p.mu_plus, 1.0))}",
            path=("mu_plus",),
        )
    largest, up, down = abs(p.Wmax) * onto.gain, *_window_factors(p.tau_plus, onto)
    scale = 1.0 if p.mu_plus else largest
    numbers = {
        "w_max": largest,
        "A_plus": p.lambda_ * scale * up,
        "A_minus": p.alpha * p.lambda_ * scale * down,
        "tau_plus": p.tau_plus,
        "tau_minus": onto.tau_minus,
    }
    return timing, MULTIPLICATIVE if p.mu_plus else ADDITIVE, numbers, ()


def _pair(p: stdp, onto: TargetUnits) -> _Form:
    return _weight_dependent(p, onto, "pair")


def _nearest(p: stdp_nn_symm | stdp_nn_restr, onto: TargetUnits) -> _Form:
    notes: tuple[str, ...] = (
        () if p.pre_at_start else ("post spikes before the first pre spike pair with a pre spike at step 0",)
    )
    if isinstance(p, stdp_nn_symm):
        notes += ("only the first of several post spikes between two pre spikes potentiates",)
    else:
        notes += ("every pre spike pairs with the last post spike for depression, not only the first one after it",)
    timing, dependence, numbers, _ = _weight_dependent(p, onto, "nearest")
    return timing, dependence, numbers, notes


def _triplet(p: stdp_triplet, onto: TargetUnits) -> _Form:
    largest, up, down = abs(p.Wmax) * onto.gain, *_window_factors(p.tau_plus, onto)
    numbers = {
        "w_max": largest,
        "A_plus": p.Aplus / abs(p.Wmax) * up,
        "A_minus": p.Aminus / abs(p.Wmax) * down,
        "A3_plus": p.Aplus_triplet / abs(p.Wmax) * up,
        "A3_minus": p.Aminus_triplet / abs(p.Wmax) * down,
        "tau_plus": p.tau_plus,
        "tau_minus": onto.tau_minus,
        "tau_x": p.tau_plus_triplet,
        "tau_y": p.tau_minus_triplet,
    }
    return "triplet", ADDITIVE, numbers, ("slow traces decay in blocks of 4 steps, counted anew in each interval",)


def _vogels(p: vogels_sprekeler, onto: TargetUnits) -> _Form:
    if p.tau != onto.tau_minus:
        raise ModelError(
            f"vogels_sprekeler.tau = {p.tau:g} ms and tau_minus = {onto.tau_minus:g} ms of the target: expected one",
            hint=f"set tau_minus: {p.tau:g} in the target",
            path=("tau",),
        )
    numbers = {"w_max": abs(p.Wmax) * onto.gain, "A_plus": p.eta * onto.gain, "A_minus": 0.0, "tau": p.tau}
    notes: tuple[str, ...] = (
        "a weight below 0 wraps to the largest word, with which one spike is sent; the weight is Wmax afterwards",
        "a pre spike before any post spike causes no depression",
    )
    if onto.extra:
        notes += (f"post spikes arrive {onto.extra} step later: post-pre pairs count more, pre-post pairs less",)
    return "vogels", ADDITIVE, numbers | {"alpha": p.alpha}, notes


BITS = 5
"""Number of a signal's sources of reward for a neuron, and of punishment: sources of 1, 2, 4, 8 and 16 units."""
LEVELS = 2**BITS - 1
"""Largest sum of the units of all sources."""
PAIR_WORDS, PAIR_PARTS = 4.0, 16.0
"""Two lower bounds of the eligibility of one pair, for dopamine by a signal: units of a word, and units of s16.15."""
ROOM = 16
"""Number of pairs, or of dopamine spikes, that a word or a trace can hold."""


def _dopamine_rule(p: stdp_dopa, onto: TargetUnits) -> MappedRule:
    """Return the rule of `stdp_dopa`, whose eligibility has one sign on the machine."""
    expected = {"b": (p.b == 0.0, "0, because dopamine has no baseline")}
    expected |= {"A_plus": (p.A_plus > 0.0, "above 0"), "A_minus": (p.A_minus >= 0.0, "at least 0")}
    for word, (fits, expectation) in expected.items():
        if not fits:
            raise ModelError(f"stdp_dopa.{word} = {getattr(p, word):g}: expected {expectation}", path=(word,))
    if p.A_minus > 0.0 and p.c_min != 0.0:
        raise ModelError(
            f"stdp_dopa.A_minus = {p.A_minus:g} with c_min = {p.c_min:g}: the words of the eligibility have no sign",
            hint="c_min: 0 keeps only positive eligibility, also on event; or set A_minus: 0",
            path=("c_min",),
        )
    by_signal = p.dopamine is None
    n_one = onto.largest_n if by_signal else 1.0 / p.tau_n
    amplitude = max(p.A_plus, p.A_minus)
    # The required product of the units of dopamine and the units of one pair's eligibility.
    product = amplitude * onto.gain / onto.unit * n_one * ONE
    if by_signal:
        pair = max(PAIR_WORDS, PAIR_PARTS / 2.0**onto.shift)
        concentrations = _levels(int(product / pair / LEVELS))
        units = float(sum(concentrations))
    else:
        units = min(max(1, round(math.sqrt(product)), math.ceil(product * ROOM / LARGEST_WORD)), 16 * ONE // ROOM)
        concentrations = (int(units),)
    of_pair = product / units
    if not 1.0 <= of_pair <= LARGEST_WORD / 4:
        hint = "smaller A_plus and A_minus" if of_pair > 1.0 else "a larger A_plus, or scale weights and C_m up alike"
        raise ModelError(
            f"the eligibility of a pair is {of_pair:.3g} units: expected 1 to {LARGEST_WORD // 4}", hint=hint
        )
    n_scale = n_one / units
    unit_gain, (up, down) = onto.gain * n_scale * ONE, _window_factors(p.tau_plus, onto)
    numbers = {
        "w_max": LARGEST_WORD * onto.unit,
        "A_plus": p.A_plus * unit_gain * up,
        "A_minus": p.A_minus * unit_gain * down,
        "tau_plus": p.tau_plus,
        "tau_minus": onto.tau_minus,
    }
    taught = {"tau_c": p.tau_c, "tau_d": p.tau_n, "w_min": p.Wmin * onto.gain, "w_max": p.Wmax * onto.gain}
    rule = rule_of("pair", ADDITIVE, {"w_min": 0.0} | numbers, dt=onto.h, neuromodulation=taught)
    rule = replace(rule, concentrations=concentrations, eligibility=onto.unit / unit_gain)
    notes: tuple[str, ...] = (
        f"the eligibility is whole units of {rule.eligibility:.4g}, from 0 to {LARGEST_WORD * rule.eligibility:.4g}",
        "eligibility decays in blocks of 16 steps and dopamine in blocks of 4, counted anew in each interval",
        "dopamine acts after the delay of the synapse, independent of dopamine_delay, separately for each neuron",
        "while recent events wait for their delay, dopamine can be mistaken for a post spike, and vice versa",
        "each event rounds the dopamine of its neuron down to a unit of 2^-11",
        "the weight changes at spikes of the source, where it is clipped once",
    )
    if by_signal:
        notes += (
            f"each neuron receives a signal as spikes of {BITS} sources of reward and {BITS} of punishment",
            f"the sources add 1, 2, ... {2 ** (BITS - 1)} units of {n_scale * concentrations[0]:.4g} 1/ms to dopamine",
            f"a signal changes dopamine by at most {n_one:.4g} 1/ms; each of its spikes uses one of the 15 events",
        )
    else:
        notes += (
            f"dopamine of a spike is {concentrations[0]} units of 2^-11; {16 * ONE // concentrations[0]} spikes wrap",
        )
    moves = amplitude * n_one / (1.0 / p.tau_c + 1.0 / p.tau_n) * onto.gain / onto.unit
    return MappedRule(rule, (*notes, *_rounding_notes(rule, numbers, 1.0)), min(moves, of_pair, units), n_scale)


_MAKERS: Mapping[type[Synapse], Callable[[Any, TargetUnits], _Form]] = {
    stdp: _pair,
    stdp_nn_symm: _nearest,
    stdp_nn_restr: _nearest,
    stdp_triplet: _triplet,
    vogels_sprekeler: _vogels,
}
"""Functions by float synapse model. Each returns the timing, dependence, numbers and notes of the model's program."""


def give_rules(
    program: Program, chip: Chip, cells: list[FixedPopulation], wires: dict[int, FixedProjection], options: Options
) -> Iterator[Problem]:
    """Set the rules of the projections that learn; yield refusals and approximations.

    Args:
        program: the whole network.
        chip: the chip for which the network is quantised.
        cells: the quantised populations.
        wires: quantised projections by index. Projections that learn are replaced by copies with a rule.
        options: options that users set.
    """
    rules: dict[int, tuple[Projection, SpinnakerRule]] = {}
    for index, part in enumerate(program.projections):
        synapse = part.synapse
        if (problem := foreign(program, chip, index) or no_rule(program, index)) is not None:
            yield problem
        elif synapse.delays:
            yield refused(part, synapse.name, f"delays do not change while {chip.name} runs", LEARN_ELSEWHERE)
        elif synapse.learns in ("pairs", "chip") and index in wires:
            try:
                mapping = _map_projection(program, chip, index, cells, wires, options)
            except ModelError as error:
                yield refused(part, synapse.name, error.message, error.hint)
                continue
            other, rule = rules.setdefault(part.target, (part, mapping.rule))
            if not rule.is_as(mapping.rule) or _dopamine_source(other) != _dopamine_source(part):
                reason = f"'{other.name}' has another rule or other dopamine: all rules onto a population must be equal"
                yield refused(part, synapse.name, reason, "give both one rule, or two populations")
                continue
            delivered = wires[index].delay < mapping.rule.slots  # longer delays are held back
            wires[index] = replace(
                wires[index], rule=mapping.rule, n_scale=mapping.n_scale, words=wires[index].words * delivered
            )
            differences = "".join(f"\n    - {text}" for text in mapping.approximations)
            if differences:
                yield approximated(part, synapse.name, f"differences on the chip:{differences}")
            yield from _delay_problems(program, part, wires[index], mapping.rule.slots)
            if mapping.update < COARSE_UPDATE:
                reason = f"a change is {mapping.update:.2g} units of a word, and rounding down loses up to one"
                yield approximated(part, synapse.name, reason, "learn faster, or set smaller `shifts` of the target")


def _map_projection(
    program: Program,
    chip: Chip,
    index: int,
    cells: list[FixedPopulation],
    wires: Mapping[int, FixedProjection],
    options: Options,
) -> MappedRule:
    """Return the rule of a projection, with slots and sign.

    Raises:
        ModelError: no program can run the rule.
    """
    part, projection = program.projections[index], wires[index]
    native = isinstance(part.synapse, spinnaker_learning)
    if not native and not isinstance(part.synapse, stdp_dopa):
        _maker(part.synapse)
    parameters = {} if native else program.populations[part.target].parameters
    tau_minus = parameters.get("tau_minus", np.zeros(1))
    low, high = (float(np.min(end)) for end in part.synapse.bounds())
    inhibits = high <= 0.0 and low < 0.0
    step = projection.step_below if inhibits else projection.step
    if step.size > 1 or tau_minus.size > 1:
        raise ModelError("the target's neurons differ: expected equal neurons, because a projection has one rule")
    if (low < 0.0 and not inhibits) or np.any(part.weight * (-1.0 if inhibits else 1.0) < 0.0):
        raise ModelError(
            f"weights of both signs between {low:g} and {high:g}: words of plastic synapses have no sign",
            hint="use Wmin: 0 and weights >= 0, or run on event",
        )
    shift = int(cells[part.target].registers["inh_shift" if inhibits else "exc_shift"][0])
    if max(high, -low) / step[0] > LARGEST_WORD:
        raise ModelError(
            f"Wmax = {high or low:g} is {max(high, -low) / step[0]:.0f} units of a word of 16 bits at shift {shift}",
            hint="use a larger shift, or leave out the option 'shifts'",
        )
    extra = int(acts_late(program.populations[part.target].model))
    slots = slots_of(program, chip, part.target)
    largest_n = largest_signal(program, index, options)
    gain = 2.0**shift / (PARTS * float(step[0]))
    onto = TargetUnits(program.resolution, extra, gain, shift, float(tau_minus[0]), largest_n)
    mapping = map_rule(part.synapse, onto)
    rule = replace(mapping.rule, shift=shift, slots=slots, inhibits=inhibits)
    return replace(mapping, rule=rule)


def _dopamine_source(part: Projection) -> tuple[int, int, bool]:
    """Return the source of a projection's dopamine: the signal, the population, and the kind of its connection."""
    return part.signal, part.dopamine, part.dopamine_one_to_one


def _delay_problems(program: Program, part: Projection, projection: FixedProjection, slots: int) -> Iterator[Problem]:
    """Yield problems with delays beyond the slots, and with delays that are stored as 0."""
    h, extra = program.resolution, acts_late(program.populations[part.target].model)
    longest = int(projection.delay.max(initial=1))
    if longest > slots:
        reason = f"a neuron has {slots} slots: a separate core delays such spikes by a multiple of {slots} steps, "
        reason += "and learning sees them at that later time"
        neurons = max(1, 1 << (SLOT_BITS - 1) >> longest.bit_length())
        way_out = f"use at most {(slots - 1 - extra) * h:g} ms, or populations of at most {neurons} neurons"
        yield approximated(part, f"a delay of {(longest - extra) * h:g} ms", reason, way_out)
    for register in np.unique(projection.delay[projection.delay % slots == 0]).tolist():
        relation = "the number of slots" if register == slots else f"a multiple of the {slots} slots"
        reason = f"the register holds {register} steps, {relation}: such synapses learn but send nothing"
        way_out = "use another delay"
        if register == longest == slots:
            way_out += f", or let a projection onto the same neurons have {(slots - extra + 1) * h:g} ms or more"
        yield approximated(part, f"a delay of {(register - extra) * h:g} ms", reason, way_out)
