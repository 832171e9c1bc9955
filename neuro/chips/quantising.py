"""Conversion of a float program to a chip's integers, with a report of the differences.

Every difference is reported: missing features of the chip are refused, features that the chip computes differently are
approximations, and so is rounding beyond the limits below. All problems of a program are found at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from neuro.chips.arithmetic import Arithmetic, options_of
from neuro.chips.description import Chip
from neuro.chips.fixed import FixedPopulation, FixedProjection, worst_rounding
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.inputs import Inputs, Options, approximated, refused
from neuro.chips.known import arithmetic_of
from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.model.equations import EquationNeuron
from neuro.model.equations.twin import Twin
from neuro.model.neurons import Model, Neuron, iaf_psc_exp_adaptive_threshold, parrot_neuron
from neuro.program.backend import TAKE_PAYLOADS, Problem, own_generators, ungraded
from neuro.program.currents import Currents
from neuro.program.program import Floats, Population, Program

__all__ = ["LIMITS", "quantise", "requantise"]

RECEPTORS = 2
"""Number of receptors of a neuron on a chip."""

_Parts = tuple[tuple[FixedPopulation, ...], tuple[FixedProjection | None, ...], tuple[Problem, ...], tuple[str, ...]]
_CACHE: WeakKeyDictionary[Program, dict[tuple[str, bool], _Parts]] = WeakKeyDictionary()
"""Results by program, and by the chip's table with the options and whether the results include words.

The key has the whole table, because a user can edit a table while the program exists. The results hold no reference to
the program, since a reference would keep the weak key alive.
"""


def quantise(program: Program, chip: Chip, **options: Any) -> FixedProgram:
    """Convert a program to a chip's integers.

    Args:
        program: a compiled program.
        chip: a chip with an emulated arithmetic.
        options: scales and other options of the user, by part; `neuro.chips.arithmetic.Option` describes them.

    Returns:
        Registers, words and delays. `problems` lists all refusals and approximations.

    Raises:
        ModelError: the chip has no emulated arithmetic, or an option names no part.
    """
    return FixedProgram(chip, program, *_parts(program, chip, options, words=True))


def refusals(program: Program, chip: Chip) -> tuple[Problem, ...]:
    """Return all refusals of `quantise`, without the words of synapses that do not learn."""
    return tuple(problem for problem in _parts(program, chip, {}, words=False)[2] if problem.refused)


def _parts(described: Program, chip: Chip, options: Mapping[str, Any], words: bool) -> _Parts:
    """Quantise a program, or return the cached result; without `words` only the problems are stored."""
    arithmetic, program = arithmetic_of(chip), as_built_in(described)
    chosen = options_of(program, chip, arithmetic, options)
    cache, key = _CACHE.setdefault(described, {}), repr((chip, sorted(options.items())))
    for has_words in (True, words):
        if (key, has_words) in cache:
            return cache[key, has_words]
    populations: list[FixedPopulation] = []
    projections: dict[int, FixedProjection] = {}
    problems: list[Problem] = []
    for index, part in enumerate(program.populations):
        if part.kind != "neuron":
            populations.append(FixedPopulation(part.name, "current" if part.kind == "current" else "source"))
            continue
        fixed, onto, more = _population(Inputs(program, index, check_only=not words), chip, arithmetic, chosen)
        populations.append(fixed)
        projections |= onto
        problems += more
    problems += [*own_generators(program), *_trial_problems(program)]
    problems += [] if arithmetic.graded else [p for p in ungraded(program) if p.what not in {q.what for q in problems}]
    problems += arithmetic.give_rules(program, chip, populations, projections, chosen)
    wires = tuple(projections.get(index) for index in range(len(program.projections)))
    problems += _delays(program, chip, wires)
    notes: tuple[str, ...] = ()
    if words and not any(p.refused for p in problems):
        problems += [*merged(program, arithmetic), *losses(program, arithmetic, populations, wires)]
        notes = tuple(_notes(program, chip, arithmetic, wires))
    cache[key, words] = (tuple(populations), wires, tuple(problems), notes) if words else ((), (), tuple(problems), ())
    return cache[key, words]


def _population(
    inputs: Inputs, chip: Chip, arithmetic: Arithmetic, options: Options
) -> tuple[FixedPopulation, dict[int, FixedProjection], list[Problem]]:
    """Quantise a population of neurons and the projections onto it."""
    part = inputs.part
    if part.model.chip == arithmetic.name:
        wires, problems = {}, []
        for index in inputs.spikes:
            wires[index], more = arithmetic.native_projection(inputs, index)
            problems += more
        reason = "neurons described in registers take no current in pA"
        sources = [inputs.program.projections[index] for index in inputs.currents]
        problems += [refused(source, "a current", reason, "set a bias or offset register") for source in sources]
        problems += _initial_state_problems(part, arithmetic.state_limit)
        return arithmetic.native(part), wires, problems
    if isinstance(part.model, parrot_neuron):
        relays = {index: arithmetic.relay_projection(inputs, index) for index in inputs.spikes}
        return FixedPopulation(part.name, "relay"), relays, []
    if not isinstance(part.model, arithmetic.models):
        names = ", ".join(model.__name__ for model in arithmetic.models)
        reason = f"{chip.name} has no such neuron: it has {names} and parrot_neuron"
        way_out = f"backend '{part.model.chip}' runs it" if part.model.chip else "use iaf_psc_exp, or run on event"
        if part.model.graded:
            way_out = TAKE_PAYLOADS
        if isinstance(part.model, iaf_psc_exp_adaptive_threshold):
            way_out = "adapt on event, then use iaf_psc_exp here, with V_th + theta of each neuron as its V_th"
        if isinstance(error := twin(part.model), ModelError):
            reason = f"{chip.name} takes equations of {names} only, and {error.message}"
            way_out = error.hint or f"use {names}, or run on event"
        return FixedPopulation(part.name, "none"), {}, [refused(part, part.model.name, reason, way_out)]
    if isinstance(part.model, Neuron) and part.model.receptors > RECEPTORS:
        feature = f"{part.model.name} with {part.model.receptors} receptors"
        reason = f"neurons of {chip.name} have {RECEPTORS}: for excitation and for inhibition"
        return FixedPopulation(part.name, "none"), {}, [refused(part, feature, reason, "run on event")]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        fixed, wires, problems = arithmetic.population(inputs, options)
        if inputs.currents:
            # Rounding of the generators' currents in the bias register, at their described amplitudes.
            described = Currents(inputs.program).full(inputs.index)
            unit = 2.0 ** fixed.registers.get("bias_exp", np.zeros(1)) / fixed.drive
            actual = np.rint(described / unit) * unit
            rounding = worst_rounding("dc", "pA", described, actual, float(np.abs(described).max()))
            fixed = replace(fixed, rounding=(*fixed.rounding, rounding))
    return fixed, wires, problems


def _trial_problems(program: Program) -> Iterator[Problem]:
    """Yield problems of learning in trials: later spikes, dopamine, and weights without bounds.

    The words of a projection have one scale, which follows from the bounds of its weights.
    """
    if program.trials is not None and program.trials.spikes == "each":
        reason = "the host stores only the first spike of each neuron in a trial"
        yield Problem(True, "trials: spikes: each", reason, "set spikes: first, or run on event", program.trials.origin)
    if program.trials is not None and program.trials.anew:
        reason = "the chip's learning engine keeps its traces from trial to trial"
        yield Problem(True, "trials: synapses that learn by dopamine", reason, "run it on event", program.trials.origin)
    for part in program.projections:
        bounds = part.synapse.parameters()
        ends = [word for word in ("Wmin", "Wmax") if not np.all(np.isfinite(bounds.get(word, np.inf)))]
        if part.synapse.learns == "trials" and not part.synapse.delays and ends:
            yield refused(
                part,
                f"{part.synapse.name} without a finite {' and '.join(ends)}",
                "a weight's word needs a scale, which follows from the bounds",
                "give it Wmin and Wmax, or run it on event",
            )


def _initial_state_problems(part: Population, limit: int) -> Iterator[Problem]:
    """Yield a problem for each initial state beyond the state registers."""
    for name, values in part.initial.items():
        bad = np.flatnonzero((values != np.rint(values)) | (np.abs(values) > limit))
        if bad.size:
            state_text = f"{name} = {values[bad[0]]:.10g} at step 0"
            reason = f"a state register holds whole numbers from -{limit} to {limit}"
            yield refused(part, state_text, reason, "use an initial value in this range")


def _delays(program: Program, chip: Chip, wires: tuple[FixedProjection | None, ...]) -> Iterator[Problem]:
    longest = chip.limit("delay_max")
    for part, fixed in zip(program.projections, wires, strict=True):
        if fixed is None or longest is None or not fixed.delay.size:
            continue
        _, longest_delay = part.delay_range(program.resolution)
        extra = int(fixed.delay.max()) - int(part.delay.max())
        steps = longest_delay + extra
        if steps <= longest:
            continue
        yield refused(
            part,
            f"a delay of {longest_delay * program.resolution:g} ms",
            f"{steps} steps in the delay register, which holds at most {longest} on {chip.name}",
            f"use at most {(longest - extra) * program.resolution:g} ms, a coarser resolution, or a chain of parrots",
        )


def _notes(
    program: Program, chip: Chip, arithmetic: Arithmetic, wires: tuple[FixedProjection | None, ...]
) -> Iterator[str]:
    """Yield the tasks of the host, and other notes on the run."""
    if any(p.kind in ("poisson", "listed") for p in program.populations):
        yield "the host sends the spikes of generators"
    if any(p.kind == "current" for p in program.populations):
        yield "the host writes currents of dc_generators into the bias registers when they change"
    for group in program.groups:
        message = f"the host decides group '{group.name}' from the voltages of the step"
        yield f"{message}; the chip has no {group.choice.noun}"
    if program.trials is not None:
        yield f"the host resets {', '.join(program.trials.reset) or 'nothing'} before each trial"
    for part in program.projections:
        if part.synapse.delays:
            moment = "between trials" if part.synapse.learns == "trials" else "after each step"
            yield f"the host applies {part.synapse.name} to '{part.name}' {moment} and writes delay registers and tags"
        elif part.synapse.learns == "trials":
            yield (
                f"the host applies {part.synapse.name} to '{part.name}' between trials and writes the weights, rounded "
                "stochastically: the chip cannot tie weights in learning"
            )
    yield from arithmetic.notes(program)
    native = chip.limit("delay_native")
    if native is not None and any(w.delay.max(initial=0) > native for w in wires if w is not None):
        yield f"delays above {native} ticks need delay extensions, whose cores are not placed"


def requantise(
    fixed: FixedProgram, population: int, parameters: Mapping[str, Floats], weights: Mapping[int, Floats]
) -> tuple[FixedPopulation, dict[int, FixedProjection], list[Problem]]:
    """Quantise a population with new parameters, at its present scale, exponents and shifts.

    Args:
        fixed: the quantised program.
        population: index of the population.
        parameters: all parameters of the population.
        weights: present weights of the projections whose weights differ from the program.
    """
    program, cells = fixed.program, fixed.populations[population]
    projections = tuple(
        replace(part, weight=weights.get(index, part.weight)) for index, part in enumerate(program.projections)
    )
    part = replace(program.populations[population], parameters=dict(parameters))
    populations = (*program.populations[:population], part, *program.populations[population + 1 :])
    changed = as_built_in(replace(program, populations=populations, projections=projections))
    modes = {w.name: w.sign_mode for w in fixed.projections if w is not None and w.sign_mode}
    arithmetic = arithmetic_of(fixed.chip)
    options = arithmetic.scale_options(cells, tuple(w for w in fixed.projections if w is not None))
    return _population(Inputs(changed, population, modes), fixed.chip, arithmetic, options)


_TWINS: dict[type[Model], Twin | ModelError] = {}


def twin(model: Model) -> Twin | ModelError | None:
    """Return the built-in model with the same equations, or an error if none has them; None for other models."""
    kind = type(model)
    if not isinstance(model, EquationNeuron):
        return None
    if kind not in _TWINS:
        try:
            _TWINS[kind] = model.twin()
        except ModelError as error:
            _TWINS[kind] = error
    return _TWINS[kind]


def as_built_in(program: Program) -> Program:
    """Return the program with built-in models in place of models with the same equations."""
    if not any(isinstance(part.model, EquationNeuron) for part in program.populations):
        return program
    populations = []
    for part in program.populations:
        match = twin(part.model)
        if isinstance(match, Twin):
            model = match.model()
            parameters = match.parameters({word: part.parameters[word] for word in part.model.quantities()})
            for word in match.words:
                values = parameters[word]
                value = values if values.size > 1 else float(values[0])
                check(model.quantities()[word], value, f"population '{part.name}': {word} of its equations")
            initial = {state.name: np.zeros(1) for state in model.states}
            for state_name, names in match.states.items():
                initial |= zip(names, shares(part.initial[state_name], names), strict=True)
            part = replace(part, model=model, parameters=parameters, initial=initial)
        populations.append(part)
    return replace(program, populations=tuple(populations))


def names_of(part: Population) -> dict[str, tuple[str, ...]]:
    """Return, for each state of a population, the states of the chip's model that it is the sum of."""
    match = twin(part.model)
    if isinstance(match, Twin):
        return dict(match.states)
    return {state.name: (state.name,) for state in part.model.states}


def shares(values: Floats, names: tuple[str, ...]) -> list[Floats]:
    """Split a state into the states whose sum equals it; two states get the parts above and below 0."""
    return [values] if len(names) == 1 else [np.maximum(values, 0.0), np.minimum(values, 0.0)]


@dataclass(frozen=True, slots=True)
class Limit:
    """Limit above which a rounding error is reported.

    Attributes:
        share: largest error without a warning.
        text: description of the error, for the message.
        way_out: hint on how to reduce the error.
    """

    share: float
    text: str
    way_out: str


_WEIGHTS = "raise the small weights, or lower the largest one, which sets the scale"
_DECAY = "use a coarser resolution: a decay register has few steps where little decays in a step"
_SCALE = "choose a larger scale, which is limited by the largest V_th - E_L, current, V_m and weight of the population"

HOPELESS = 10.0
"""Largest error of the threshold, relative to V_th - E_L. A network with a larger error is refused."""

LIMITS = {
    "zeroed": Limit(0.01, "of the weights other than 0 become 0", _WEIGHTS),
    "rms": Limit(0.02, "is the rms error of the weights", _WEIGHTS),
    "tau_m": Limit(0.02, "is the error of the membrane time constant", _DECAY),
    "tau_syn_ex": Limit(0.02, "is the error of the synaptic time constant", _DECAY),
    "tau_syn_in": Limit(0.02, "is the error of the synaptic time constant", _DECAY),
    "V_th": Limit(0.001, "of the distance from E_L to V_th is the error of the threshold", _SCALE),
    "V_reset": Limit(0.001, "of the distance from E_L to V_th is the error of V_reset", "scale the potentials up"),
    "C_m": Limit(0.02, "is the error of the membrane capacity", "lower C_m, and weights and currents with it"),
    "I_e": Limit(0.02, "is the error of the constant current", "raise the current, or leave it out"),
    "dc": Limit(0.02, "is the error of the current of generators", "raise its amplitude, or leave it out"),
    "merged": Limit(
        0.01,
        "of the generator's spikes share a step with another of the same neuron and become one",
        "use a finer resolution or several generators of a lower rate",
    ),
}
"""Errors above which rounding is reported as an approximation: of weights, time constants, potentials and spikes."""


def losses(
    program: Program,
    arithmetic: Arithmetic,
    populations: Sequence[FixedPopulation],
    wires: Sequence[FixedProjection | None],
) -> Iterator[Problem]:
    """Yield the roundings beyond the limits."""
    for part, cells in zip(program.populations, populations, strict=True):
        for r in cells.rounding:
            limit = LIMITS.get(r.quantity)
            if r.quantity == "V_th" and abs(r.error) > HOPELESS:
                feature = f"V_th = {r.exact:g} becomes {r.got:.6g} {r.unit}"
                why = f"{cells.volt:.3g} units per mV leave no threshold: its largest weight or current takes all bits"
                yield refused(part, feature, why, "lower weights and currents beyond V_th - E_L, or set another scale")
            elif limit is not None and abs(r.error) > limit.share:
                feature = f"{r.quantity} = {r.exact:g} becomes {r.got:.6g} {r.unit}"
                yield approximated(part, feature, f"{abs(r.error):.1%} {limit.text}", limit.way_out)
    for projection, fixed in zip(program.projections, wires, strict=True):
        if fixed is None:
            continue
        for name in ("zeroed", "rms"):
            value, limit = getattr(fixed.rounding, name), LIMITS[name]
            if value > limit.share:
                way_out = arithmetic.lossless(fixed) if fixed.native else limit.way_out
                yield approximated(projection, "", f"{value:.1%} {limit.text}", way_out)


def merged(program: Program, arithmetic: Arithmetic) -> Iterator[Problem]:
    """Yield a problem for each Poisson generator with too many spikes merged in a step; a spike is one bit."""
    if not arithmetic.one_bit:
        return
    limit = LIMITS["merged"]
    for part in program.populations:
        if part.kind != "poisson":
            continue
        mean = part.largest("rate") * program.resolution / 1000.0
        share = 1.0 - -np.expm1(-mean) / mean if mean > 0.0 else 0.0
        if share > limit.share:
            reason = f"{share:.1%} {limit.text}, since a spike on {arithmetic.title} is one bit"
            reason += "; counts().native has their number"
            yield approximated(part, part.model.name, reason, limit.way_out)
