"""From `stdp`, its relatives and `stdp_dopa` to the programs of SpiNNaker's plastic synapses.

A weight w of the language is w g in the unit of the machine, nA or mV, where g is the factor that is in the words.
Additive amplitudes are absolute there: A_plus = lambda Wmax g; those of triplets are times Wmax.

The delay register of `iaf_psc_exp` holds a step more than the delay, and the machine's post spikes reach a synapse by
that register. So each pair is a step more apart or less; amplitudes make up for the step, A_plus exp(h / tau_plus) and
A_minus exp(-h / tau_minus), and the windows equal the float model's.

Dopamine of 1/tau_n becomes a synapse of concentration k 2^-11, and an eligibility of 1 becomes m units of a word. The
product k m follows from the rule, and events round both down. What dopamine loses moves weights down; what the
eligibility loses slows learning. So a signal, whose sources are chosen here, takes nearly all of the product; spikes,
which release one concentration, take its root.
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
"""Below this many units of a word flooring takes more than 6 % of a change by one pair: a warning."""


@dataclass(frozen=True, slots=True)
class Onto:
    """The neurons and the slots that a rule is made for.

    Attributes:
        h: length of a step in ms.
        extra: steps by which the delay register is longer than the delay.
        gain: nA or mV on the machine of a weight of 1.
        shift: of the slots of its receptor.
        tau_minus: of the target in ms.
        largest_n: the largest |n| in 1/ms that a signal will set.
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
class Mapped:
    """A rule of the machine that stands for a float synapse model.

    Attributes:
        rule: the rule.
        approximations: what differs, one sentence each.
        update: change of a weight by one pair in units of a word, the smallest of those that are not 0; with dopamine
            by the larger side and one of 1/tau_n, or the largest.
        n_scale: dopamine in 1/ms of one unit in s4.11.
    """

    rule: SpinnakerRule
    approximations: tuple[str, ...]
    update: float
    n_scale: float = 0.0


def mapped(synapse: Synapse, onto: Onto) -> Mapped:
    """Return the rule that does on SpiNNaker what a float synapse model does.

    Raises:
        ModelError: no program does it; the hint is a way out.
    """
    if isinstance(synapse, spinnaker_learning):
        return _program(synapse, onto)
    if isinstance(synapse, stdp_dopa):
        mapping = _dopamine(synapse, onto)
        return replace(mapping, approximations=(*mapping.approximations, *_shared(onto)))
    timing, dependence, numbers, notes = _maker(synapse)(synapse, onto)
    rule = rule_of(timing, dependence, {"w_min": 0.0} | numbers, dt=onto.h)
    notes += _rounded(rule, numbers, float(numbers["w_max"]) if timing == "triplet" else 1.0)
    return Mapped(rule, (*notes, *_shared(onto)), _smallest_change(rule, onto))


def _smallest_change(rule: SpinnakerRule, onto: Onto) -> float:
    """Return the smallest change by one pair that is not 0, in units of a word."""
    c = rule.constants
    scale = int(c[HIGH]) / PARTS if c[OF_WEIGHT] else 1.0
    changes = [abs(int(c[column])) * scale / PARTS / onto.unit for column in _AMPLITUDES]
    return min((change for change in changes if change > 0.0), default=math.inf)


def _program(p: spinnaker_learning, onto: Onto) -> Mapped:
    """The rule that a synapse in the words of the machine names."""
    largest = (p.c_max if p.taught else abs(p.Wmax)) * onto.gain
    share = largest if p.dependence == ADDITIVE and p.timing != "triplet" else 1.0
    steps = {"triplet": 4, "vogels": 1}.get(p.timing, 2)
    numbers = dict.fromkeys(_AMPLITUDES.values(), 0.0)
    numbers |= {word: getattr(p, word) * share for word in list(numbers)[:steps]}
    numbers |= {"w_min": (p.c_min if p.taught else abs(p.Wmin)) * onto.gain, "w_max": largest, "tau": p.tau_plus}
    bounds = {"w_min": abs(p.Wmin) * onto.gain, "w_max": abs(p.Wmax) * onto.gain}
    taught = {"tau_c": p.tau_c, "tau_d": p.tau_n, **bounds} if p.taught else None
    rule = rule_of(p.timing, p.dependence, p.parameters() | numbers, dt=onto.h, neuromodulation=taught)
    notes = _rounded(rule, numbers, largest if p.timing == "triplet" else 1.0)
    if p.timing == "recurrent":
        notes += ("one generator draws the windows of the projection, and on the machine one those of each core",)
    if onto.extra:
        notes += (f"post spikes and dopamine act {onto.extra} step later, since the delay register is longer",)
    rule = replace(rule, eligibility=onto.unit / onto.gain if p.taught else 1.0)
    if p.dopamine is not None:
        units = round(p.concentration * ONE)
        if not 0 < abs(units) < 16 * ONE:
            message = f"spinnaker_learning.concentration = {p.concentration:g}: {units} units of 2^-11"
            raise ModelError(f"{message}: expected 1 to {16 * ONE - 1} in size", path=("concentration",))
        off = units / ONE / p.concentration - 1.0
        notes += (f"concentration is {off:+.1%} off",) if abs(off) > 1e-3 else ()
        rule = replace(rule, concentrations=(units,))
    elif p.signal is not None:
        rule = replace(rule, concentrations=_levels(onto.largest_n * ONE / LEVELS))
    return Mapped(rule, notes, _smallest_change(rule, onto), 1.0 / ONE)


def _levels(units: float) -> tuple[int, ...]:
    """Return the concentrations of the sources that bring a signal, the smallest of so many units of s4.11."""
    unit = min(max(1, round(units)), ROOM * ONE // 2 // LEVELS)
    return tuple(unit << bit for bit in range(BITS))


def _shared(onto: Onto) -> tuple[str, ...]:
    """Differences of all rules."""
    return (
        f"weights are whole units of {onto.unit / onto.gain:.4g}; a packet rounds down what it has changed",
        "learning waits for the next spike of the source: post spikes after the last one change no weight",
        "a post neuron keeps its last 15 events; what is dropped is lost for sources that were silent since",
        "a post spike that arrives with a pre spike counts fully in the depression by it",
    )


def _maker(synapse: Synapse) -> Callable[[Any, Onto], _Made]:
    for kind, make in _MAKERS.items():
        if isinstance(synapse, kind):
            return make
    names = ", ".join(kind.__name__ for kind in (*_MAKERS, stdp_dopa))
    raise ModelError(
        f"no SpiNNaker program was released for it: there are those for {names}",
        hint=f"run it on event, or send static weights: {SAVE_FROZEN}",
    )


def _rounded(rule: SpinnakerRule, numbers: Mapping[str, Any], scale: float) -> tuple[str, ...]:
    """Errors of rounded amplitudes, numbers times a scale; an error if all of a side become 0."""
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
            off = abs(int(rule.constants[column])) / PARTS / amount - 1.0 if amount else 0.0
            notes += (f"{_AMPLITUDES[column]} is {off:+.1%} off",) if abs(off) > 1e-3 else ()
    return notes


_AMPLITUDES = {UP: "A_plus", DOWN: "A_minus", UP_TRIPLET: "A3_plus", DOWN_TRIPLET: "A3_minus"}
_Made = tuple[str, str, dict[str, Any], tuple[str, ...]]


def _windows(tau_plus: float, onto: Onto) -> tuple[float, float]:
    """Factors on potentiation and depression that make up for the later arrival of post spikes."""
    return math.exp(onto.extra * onto.h / tau_plus), math.exp(-onto.extra * onto.h / onto.tau_minus)


def _weight_dependent(p: Any, onto: Onto, timing: str) -> _Made:
    if p.mu_plus != p.mu_minus or p.mu_plus not in (0.0, 1.0):
        raise ModelError(
            f"{p.name}.mu_plus = {p.mu_plus:g} and mu_minus = {p.mu_minus:g}: expected both 0 (additive) or both 1",
            hint=f"mu_plus: {round(min(p.mu_plus, 1.0))}, mu_minus: {round(min(p.mu_plus, 1.0))}",
            path=("mu_plus",),
        )
    largest, up, down = abs(p.Wmax) * onto.gain, *_windows(p.tau_plus, onto)
    scale = 1.0 if p.mu_plus else largest
    numbers = {
        "w_max": largest,
        "A_plus": p.lambda_ * scale * up,
        "A_minus": p.alpha * p.lambda_ * scale * down,
        "tau_plus": p.tau_plus,
        "tau_minus": onto.tau_minus,
    }
    return timing, MULTIPLICATIVE if p.mu_plus else ADDITIVE, numbers, ()


def _pair(p: stdp, onto: Onto) -> _Made:
    return _weight_dependent(p, onto, "pair")


def _nearest(p: stdp_nn_symm | stdp_nn_restr, onto: Onto) -> _Made:
    notes: tuple[str, ...] = (
        () if p.pre_at_start else ("post spikes before the first pre spike pair with one at the start",)
    )
    if isinstance(p, stdp_nn_symm):
        notes += ("of the post spikes between two pre spikes only the first potentiates",)
    else:
        notes += ("a pre spike depresses by the last post spike also where it is not the first after it",)
    timing, dependence, numbers, _ = _weight_dependent(p, onto, "nearest")
    return timing, dependence, numbers, notes


def _triplet(p: stdp_triplet, onto: Onto) -> _Made:
    largest, up, down = abs(p.Wmax) * onto.gain, *_windows(p.tau_plus, onto)
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
    return "triplet", ADDITIVE, numbers, ("slow traces decay by blocks of 4 steps, of each interval by itself",)


def _vogels(p: vogels_sprekeler, onto: Onto) -> _Made:
    if p.tau != onto.tau_minus:
        raise ModelError(
            f"vogels_sprekeler.tau = {p.tau:g} ms and tau_minus = {onto.tau_minus:g} ms of the target: expected one",
            hint=f"tau_minus: {p.tau:g} of the target",
            path=("tau",),
        )
    numbers = {"w_max": abs(p.Wmax) * onto.gain, "A_plus": p.eta * onto.gain, "A_minus": 0.0, "tau": p.tau}
    notes: tuple[str, ...] = (
        "a weight that falls below 0 wraps to the largest word and is sent so, once; then it is Wmax",
        "a pre spike before any post spike does not weaken",
    )
    if onto.extra:
        notes += (f"pairs are {onto.extra} step later: post before pre counts more, pre before post less",)
    return "vogels", ADDITIVE, numbers | {"alpha": p.alpha}, notes


BITS = 5
"""Sources of reward, and of punishment, that bring a signal to a neuron: concentrations of 1, 2, 4, 8 and 16 units."""
LEVELS = 2**BITS - 1
"""Largest number of units that the sources bring together."""
PAIR_WORDS, PAIR_PARTS = 4.0, 16.0
"""The eligibility of one pair, at least, in units of a word and in s16.15, where a signal brings dopamine."""
ROOM = 16
"""Pairs, or dopamine spikes, for which a word or a trace has room."""


def _dopamine(p: stdp_dopa, onto: Onto) -> Mapped:
    """The rule of `stdp_dopa`, whose eligibility has one sign."""
    expected = {"b": (p.b == 0.0, "0, since dopamine has no baseline")}
    expected |= {"A_plus": (p.A_plus > 0.0, "above 0"), "A_minus": (p.A_minus >= 0.0, "at least 0")}
    for word, (fits, what) in expected.items():
        if not fits:
            raise ModelError(f"stdp_dopa.{word} = {getattr(p, word):g}: expected {what}", path=(word,))
    if p.A_minus > 0.0 and p.c_min != 0.0:
        raise ModelError(
            f"stdp_dopa.A_minus = {p.A_minus:g} with c_min = {p.c_min:g}: the words of the eligibility have no sign",
            hint="c_min: 0 leaves the positive one, also on event, or A_minus: 0",
            path=("c_min",),
        )
    by_signal = p.dopamine is None
    n_one = onto.largest_n if by_signal else 1.0 / p.tau_n
    amplitude = max(p.A_plus, p.A_minus)
    # Units of dopamine times units of the eligibility of one pair: what both must make together.
    both = amplitude * onto.gain / onto.unit * n_one * ONE
    if by_signal:
        pair = max(PAIR_WORDS, PAIR_PARTS / 2.0**onto.shift)
        concentrations = _levels(int(both / pair / LEVELS))
        units = float(sum(concentrations))
    else:
        units = min(max(1, round(math.sqrt(both)), math.ceil(both * ROOM / LARGEST_WORD)), 16 * ONE // ROOM)
        concentrations = (int(units),)
    of_pair = both / units
    if not 1.0 <= of_pair <= LARGEST_WORD / 4:
        way = "smaller A_plus and A_minus" if of_pair > 1.0 else "a larger A_plus, or scale weights and C_m up alike"
        raise ModelError(
            f"the eligibility of a pair is {of_pair:.3g} units: expected 1 to {LARGEST_WORD // 4}", hint=way
        )
    n_scale = n_one / units
    one, (up, down) = onto.gain * n_scale * ONE, _windows(p.tau_plus, onto)
    numbers = {
        "w_max": LARGEST_WORD * onto.unit,
        "A_plus": p.A_plus * one * up,
        "A_minus": p.A_minus * one * down,
        "tau_plus": p.tau_plus,
        "tau_minus": onto.tau_minus,
    }
    taught = {"tau_c": p.tau_c, "tau_d": p.tau_n, "w_min": p.Wmin * onto.gain, "w_max": p.Wmax * onto.gain}
    rule = rule_of("pair", ADDITIVE, {"w_min": 0.0} | numbers, dt=onto.h, neuromodulation=taught)
    rule = replace(rule, concentrations=concentrations, eligibility=onto.unit / one)
    notes: tuple[str, ...] = (
        f"the eligibility is whole units of {rule.eligibility:.4g}, from 0 to {LARGEST_WORD * rule.eligibility:.4g}",
        "tau_c decays by blocks of 16 steps and tau_n by blocks of 4, of each interval between events by itself",
        "dopamine acts after the delay of the synapse, whatever dopamine_delay is, and is kept for each neuron",
        "while events of the last steps wait for their delay, dopamine may be taken for a post spike, and the reverse",
        "each event rounds the dopamine of its neuron down to a unit of 2^-11",
        "the weight moves at spikes of the source and is clipped once for each",
    )
    if by_signal:
        notes += (
            f"a signal comes as spikes of {BITS} sources of reward and {BITS} of punishment for each neuron",
            f"they raise dopamine by 1, 2, ... {2 ** (BITS - 1)} units of {n_scale * concentrations[0]:.4g} 1/ms",
            f"a signal changes dopamine by at most {n_one:.4g} 1/ms; each of its spikes takes one of the 15 entries",
        )
    else:
        notes += (f"dopamine of a spike is {concentrations[0]} units of 2^-11; {16 * ONE // concentrations[0]} wrap",)
    moves = amplitude * n_one / (1.0 / p.tau_c + 1.0 / p.tau_n) * onto.gain / onto.unit
    return Mapped(rule, (*notes, *_rounded(rule, numbers, 1.0)), min(moves, of_pair, units), n_scale)


_MAKERS: Mapping[type[Synapse], Callable[[Any, Onto], _Made]] = {
    stdp: _pair,
    stdp_nn_symm: _nearest,
    stdp_nn_restr: _nearest,
    stdp_triplet: _triplet,
    vogels_sprekeler: _vogels,
}
"""What makes of each float synapse model the timing, the dependence, the numbers and what differs."""


def give_rules(
    program: Program, chip: Chip, cells: list[FixedPopulation], wires: dict[int, FixedProjection], options: Options
) -> Iterator[Problem]:
    """Give rules to the projections that learn; yield what is refused and what is approximated.

    Args:
        program: the whole network.
        chip: for which it is quantised.
        cells: the populations in registers.
        wires: the projections in words, by index; those that learn are replaced.
        options: what users set.
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
                mapping = _mapping(program, chip, index, cells, wires, options)
            except ModelError as error:
                yield refused(part, synapse.name, error.message, error.hint)
                continue
            first, rule = rules.setdefault(part.target, (part, mapping.rule))
            if not rule.is_as(mapping.rule) or _released(first) != _released(part):
                why = f"'{first.name}' has another rule or other dopamine: all that learn onto a population share one"
                yield refused(part, synapse.name, why, "give both one rule, or two populations")
                continue
            delivered = wires[index].delay < mapping.rule.slots  # with the spike
            wires[index] = replace(
                wires[index], rule=mapping.rule, n_scale=mapping.n_scale, words=wires[index].words * delivered
            )
            differs = "".join(f"\n    - {text}" for text in mapping.approximations)
            if differs:
                yield approximated(part, synapse.name, f"the chip's learning runs it otherwise:{differs}")
            yield from _held_back(program, part, wires[index], mapping.rule.slots)
            if mapping.update < COARSE_UPDATE:
                why = f"a change is {mapping.update:.2g} units of a word, of which flooring takes up to one"
                yield approximated(part, synapse.name, why, "learn faster, or set smaller `shifts` of the target")


def _mapping(
    program: Program,
    chip: Chip,
    index: int,
    cells: list[FixedPopulation],
    wires: Mapping[int, FixedProjection],
    options: Options,
) -> Mapped:
    """The rule of a projection, with slots and sign.

    Raises:
        ModelError: there is none.
    """
    part, own = program.projections[index], wires[index]
    native = isinstance(part.synapse, spinnaker_learning)
    if not native and not isinstance(part.synapse, stdp_dopa):
        _maker(part.synapse)
    described = {} if native else program.populations[part.target].parameters
    tau_minus = described.get("tau_minus", np.zeros(1))
    low, high = (float(np.min(end)) for end in part.synapse.bounds())
    inhibits = high <= 0.0 and low < 0.0
    step = own.step_below if inhibits else own.step
    if step.size > 1 or tau_minus.size > 1:
        raise ModelError("the target's neurons differ: a rule is one for the whole projection")
    if (low < 0.0 and not inhibits) or np.any(part.weight * (-1.0 if inhibits else 1.0) < 0.0):
        raise ModelError(
            f"weights of both signs between {low:g} and {high:g}: its words have none",
            hint="use Wmin: 0 and weights >= 0, or run on event",
        )
    shift = int(cells[part.target].registers["inh_shift" if inhibits else "exc_shift"][0])
    if max(high, -low) / step[0] > LARGEST_WORD:
        raise ModelError(
            f"Wmax = {high or low:g} is {max(high, -low) / step[0]:.0f} units of a word of 16 bits at shift {shift}",
            hint="use a larger shift, or leave it to be chosen",
        )
    extra = int(acts_late(program.populations[part.target].model))
    slots = slots_of(program, chip, part.target)
    largest_n = largest_signal(program, index, options)
    gain = 2.0**shift / (PARTS * float(step[0]))
    onto = Onto(program.resolution, extra, gain, shift, float(tau_minus[0]), largest_n)
    mapping = mapped(part.synapse, onto)
    rule = replace(mapping.rule, shift=shift, slots=slots, inhibits=inhibits)
    return replace(mapping, rule=rule)


def _released(part: Projection) -> tuple[int, int, bool]:
    """The sources of dopamine of a projection."""
    return part.signal, part.dopamine, part.dopamine_one_to_one


def _held_back(program: Program, part: Projection, own: FixedProjection, slots: int) -> Iterator[Problem]:
    """Synapses with a longer delay than there are slots, and those whose slots are stored as 0."""
    h, late = program.resolution, acts_late(program.populations[part.target].model)
    longest = int(own.delay.max(initial=1))
    if longest > slots:
        why = f"a neuron has {slots} slots: a core of its own holds such spikes back for {slots} steps, or a multiple"
        why += "; learning takes them for spikes of then"
        neurons = max(1, 1 << (SLOT_BITS - 1) >> longest.bit_length())
        way = f"use at most {(slots - 1 - late) * h:g} ms, or populations of at most {neurons} neurons"
        yield approximated(part, f"a delay of {(longest - late) * h:g} ms", why, way)
    for register in np.unique(own.delay[own.delay % slots == 0]).tolist():
        many = "as many as there are slots" if register == slots else f"a multiple of the {slots} slots"
        why = f"the register holds {register} steps, {many}: such synapses learn and send nothing"
        way = "use another delay"
        if register == longest == slots:
            way += f", or let a projection onto the same neurons have {(slots - late + 1) * h:g} ms or more"
        yield approximated(part, f"a delay of {(register - late) * h:g} ms", why, way)
