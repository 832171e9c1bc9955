"""A rule of spike pairs in equations as a class like any other: traces, states, what spikes and a signal do to them.

Between spikes its states decay, and the weight moves under the signal. The rate of the weight is a sum of products of
what decays exponentially, so its integral is exact.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from neuro.core.errors import ModelError, here, unknown
from neuro.core.grammar import Expression, Name, Tree
from neuro.core.quantities import field_of
from neuro.core.units import CONDUCTANCE, CURRENT, NONE, TIME, VOLTAGE, Dimension, times, told, unit_of
from neuro.core.values import shown
from neuro.model.equations.algebra import culprit, names, polynomial, within
from neuro.model.equations.definition import at, check_name, expressions, mapping
from neuro.model.equations.dimensions import Dimensions, refuse, text_of
from neuro.model.equations.divisions import Divisions, InEquations, Words
from neuro.model.equations.functions import ARGUMENTS, PUBLIC
from neuro.model.equations.parameters import Parameter, read_parameters, refuse_attributes
from neuro.model.equations.writing import Constants, function, local, module, written
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Synapse, Trace

WORDS = ("traces", "states", "on_pre", "on_post", "on_signal", "initial", "parameters", "doc", "source")
SPIKES = ("on_pre", "on_post")
WEIGHT, SIGNAL = "w", "n"
"""The names of the weight and of what a signal sets."""
DECAY_OF_SIGNAL = "tau_n"
"""The parameter with which the signal decays, if there is one."""
READ_OTHERWISE = ("weight", "delay", "K_plus")
"""What `sim.get` reads under these names is no state of a rule in equations."""
MAX_STATES = 8


@dataclass(frozen=True)
class Pairs:
    """A rule of spike pairs in trees.

    Attributes:
        traces: the side of each, and the trace.
        states: those of a synapse beside its weight: the parameter with which each decays, "" for one that stays.
        spikes: what a pre spike and a post spike change.
        drift: how fast the weight changes under the signal; None for a rule that takes none.
        dimensions: of the states; None where it is unknown, as it is one of the weight.
        plain: the words as they were given.
    """

    name: str
    parameters: Mapping[str, Parameter]
    traces: Mapping[str, tuple[str, Trace]]
    states: Mapping[str, str]
    spikes: Mapping[str, Mapping[str, Expression]]
    drift: Expression | None
    initial: Mapping[str, Expression]
    dimensions: Mapping[str, Dimension | None]
    plain: Mapping[str, Any]

    @property
    def between(self) -> bool:
        """Whether anything happens between spikes."""
        return self.drift is not None or any(self.states.values())

    def side(self, of: str) -> dict[str, Trace]:
        """The traces of the spikes of one side."""
        return {name: trace for name, (side, trace) in self.traces.items() if side == of}


def read(name: str, said: Mapping[str, Any]) -> Pairs:
    """Read the words of a rule.

    Raises:
        ModelError: the first mistake, with the column where it is one of an expression.
    """
    mapping(said, WORDS, "a rule")
    parameters = read_parameters(said.get("parameters", {}))
    for word, parameter in parameters.items():
        _check_special(word, parameter)
    traces = _traces(said.get("traces", {}), parameters)
    states = _states(said.get("states", {}), parameters, traces)
    spikes = {word: expressions(said, word) for word in SPIKES}
    changes = expressions(said, "on_signal")
    for word in changes:
        if word != WEIGHT:
            raise unknown("change by a signal", word, [WEIGHT], path=("on_signal", word))
    if "on_signal" in said:
        for word in (*parameters, *traces, *states):
            if word == SIGNAL:
                raise ModelError(f"'{SIGNAL}' is what the signal sets: expected another name", path=("on_signal",))
    pairs = Pairs(
        name,
        parameters,
        traces,
        states,
        spikes,
        changes.get(WEIGHT),
        expressions(said, "initial"),
        {},
        dict(said),
    )
    return _checked(pairs)


def _check_special(word: str, parameter: Parameter) -> None:
    """Refuse parameters that have another meaning in expressions or outside of them (numbers in pA, mV and ms)."""
    if word == WEIGHT or word in ARGUMENTS:
        with at("parameters", word):
            raise ModelError(f"'{word}' means something else, too: expected another name")
    if word in ("Wmin", "Wmax") and parameter.factor != 1.0:
        message = f"{word} is in '{parameter.unit}': expected pA, nS or mV, in which weights are said"
        raise ModelError(message, path=("parameters", word))
    if word == DECAY_OF_SIGNAL and parameter.unit != "ms":
        raise ModelError(f"{word} is in '{parameter.unit}': expected ms", path=("parameters", word))


def _traces(said: Any, parameters: Mapping[str, Parameter]) -> dict[str, tuple[str, Trace]]:
    """The side of each trace, and the trace."""
    found = {}
    for name, words in _named(said, "traces", "{name: {of: pre, tau: ...}}"):
        with at("traces", name):
            _refuse_name(name, parameters)
            given = mapping(words, ("of", "tau", "nearest"), "a trace")
            if given.get("of") not in ("pre", "post"):
                raise ModelError(f"of = {shown(given.get('of'))}: expected pre or post")
            nearest = given.get("nearest", False)
            tau = _tau(given, parameters, ["tau_minus"] if given["of"] == "post" else [])
            if not isinstance(nearest, bool):
                raise ModelError(f"nearest = {shown(nearest)}: expected true or false", path=("nearest",))
            found[name] = given["of"], Trace(tau, nearest=nearest)
    return found


def _states(said: Any, parameters: Mapping[str, Parameter], traces: Mapping[str, object]) -> dict[str, str]:
    """The parameter with which each state decays."""
    found: dict[str, str] = {}
    for name, words in _named(said, "states", "{name: {tau: ...}}"):
        with at("states", name):
            _refuse_name(name, parameters)
            if name in traces or name in READ_OTHERWISE:
                raise ModelError(f"'{name}' means something else, too: expected another name")
            found[name] = _tau(mapping(words, ("tau",), "a state of a synapse"), parameters, [])
    if len(found) > MAX_STATES:
        raise ModelError(f"found {len(found)} states: expected at most {MAX_STATES}", path=("states",))
    return found


def _named(said: Any, section: str, expected: str) -> Iterator[tuple[str, Any]]:
    if not isinstance(said, Mapping):
        raise ModelError(f"{section}: found {shown(said)}: expected {expected}", path=(section,))
    yield from ((str(name), words) for name, words in said.items())


def _refuse_name(name: str, parameters: Mapping[str, Parameter]) -> None:
    check_name(name)
    if name == WEIGHT or name in parameters or name in ARGUMENTS:
        raise ModelError(f"'{name}' means something else, too: expected another name")


def _tau(given: Mapping[str, Any], parameters: Mapping[str, Parameter], more: list[str]) -> str:
    """The time constant that is said, "" if none is."""
    tau: str = given.get("tau", "")
    known = [*(word for word, p in parameters.items() if p.unit == "ms"), *more]
    if tau and tau not in known:
        error = unknown("parameter in ms", tau, known, path=("tau",))
        hint = error.hint if known else "write tau: tau_plus, and tau_plus: 20 ms among the parameters"
        raise error.but(hint=hint)
    return tau


def _checked(pairs: Pairs) -> Pairs:
    """The rule with the dimensions of its states: a trace is a number, one without time constant a time.

    Raises:
        ModelError: a name is unknown, or units do not fit.
    """
    traces = {name: NONE if trace.tau else TIME for name, (_, trace) in pairs.traces.items()}
    own: dict[str, Dimension] = {word: p.dimension for word, p in pairs.parameters.items()}
    changed = (WEIGHT, *pairs.states)
    dims = Dimensions(own | traces, (*changed, *([SIGNAL] if pairs.drift is not None else [])))
    for word, changes in pairs.spikes.items():
        for name, expression in changes.items():
            if name not in changed:
                raise unknown("state of a synapse", name, list(changed), path=(word, name))
            with dims.at(word, name):
                if pairs.drift is not None:
                    _refuse(expression, (SIGNAL,), "is the signal, which acts between spikes", "use it in on_signal")
                dims.check(expression, dims.name(name))
                _check_weight(expression, dims)
    if pairs.drift is not None:
        with dims.at("on_signal", WEIGHT):
            way = "keep it in a state, which on_pre or on_post sets"
            _refuse(pairs.drift, traces, "is a trace, which is known at spikes only", way)
            dims.check(pairs.drift, dims.name(WEIGHT, -1))
            _check_weight(pairs.drift, dims)
    for name, expression in pairs.initial.items():
        if name not in pairs.states:
            raise unknown("state of a synapse", name, list(pairs.states), path=("initial", name))
        with dims.at("initial", name):
            dims.only(own).check(expression, dims.name(name))
    dims.refuse()
    return Pairs(**{**vars(pairs), "dimensions": {name: dims.of(name) for name in pairs.states}})


def _check_weight(expression: Expression, dims: Dimensions) -> None:
    """What an expression tells of the weight's unit is one in which weights are said."""
    found = dims.of(WEIGHT)
    if found not in (None, NONE, CURRENT, CONDUCTANCE, VOLTAGE):
        assert found is not None
        message = f"'{WEIGHT}' would be {told(found)}: expected it in pA, nS or mV, or without unit"
        factors = ", ".join(unit_of(times(unit, found, -1)) for unit in (CURRENT, CONDUCTANCE, VOLTAGE, NONE))
        hint = f"multiply what changes '{WEIGHT}' by a number in {factors}"
        dims.names[WEIGHT] = dims.mistake(expression.mistake(0, message, hint))


def _refuse(expression: Expression, names: Collection[str], what: str, way: str) -> None:
    """Names that are not known here."""
    for part in within(expression.tree):
        if isinstance(part, Name) and part.name in names:
            raise expression.mistake(part.at, f"'{part.name}' {what}", way)


_HEAD = f"from neuro.model.equations.functions import {', '.join(PUBLIC)}\n"
_OF_RULES = ("traces", "states", *SPIKES, "on_signal")


class EquationSynapse(InEquations, Synapse):
    """Base of the rules in equations."""

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            refuse(self.divisions.mistakes(self.parameters()))
        except ModelError as error:
            raise error.at(here(), self.name) from None

    @classmethod
    def initial(cls, parameters: Mapping[str, Any]) -> dict[str, float]:
        """The states as the definition says."""
        values = [0.0] * len(cls.states)
        arithmetic: Any = cls.arithmetic
        arithmetic.begin([float(parameters[word]) for word in cls.numbers()], values)
        return {state.name: value for state, value in zip(cls.states, values, strict=True)}


class _Between(EquationSynapse, Modulated):
    """Base of those in which something happens between spikes."""


def is_rule(said: Mapping[str, Any]) -> bool:
    """Whether words are those of a rule."""
    return any(word in said for word in _OF_RULES)


def rule(name: str, said: Mapping[str, Any]) -> type[EquationSynapse]:
    """Make the class of a rule in equations.

    Raises:
        ModelError: the first mistake in the words.
    """
    pairs = read(name, said)
    base = _Between if pairs.between else EquationSynapse
    refuse_attributes(pairs.parameters, base)
    for state in pairs.states:
        with at("states", state):
            if state in base.quantities():
                raise ModelError(f"'{state}' is a parameter of such rules, too: expected another name")
    constants = Constants(pairs.parameters, 0, {WEIGHT, *pairs.traces, *pairs.states}, lambda tree: tree)
    lasting = {trace.tau for _, trace in pairs.traces.values()} | {DECAY_OF_SIGNAL}
    taus = lasting | {*pairs.states.values()}  # a state may last no time, where its author says so
    tree_of: dict[Words, Expression] = {
        ("parameters", word): Expression(word, Name(word, 0)) for word in pairs.parameters if word in lasting
    }
    constants_of_time = [*tree_of]
    if pairs.drift is not None:
        tree_of["on_signal", WEIGHT] = pairs.drift
    for section, named in (*pairs.spikes.items(), ("initial", pairs.initial)):
        tree_of |= {(section, word): expression for word, expression in named.items()}
    divisions = Divisions(pairs.parameters, constants.variables, {}, tree_of, constants_of_time)
    refuse(divisions.mistakes({name: p.default for name, p in pairs.parameters.items()}))
    arithmetic = module(_text(pairs, constants))
    fields = [
        (field_of(word), float, field(default=p.default, metadata={"quantity": p.quantity(word in taus, arrays=False)}))
        for word, p in pairs.parameters.items()
    ]
    texts = [f"{word[3:]}: {name} = {e.text}" for word in pairs.spikes for name, e in pairs.spikes[word].items()]
    texts += [] if pairs.drift is None else [f"{WEIGHT}' = {pairs.drift.text}"]
    result: type[EquationSynapse] = base.made(
        pairs.name,
        fields,
        arithmetic,
        __doc__=pairs.plain.get("doc") or "A rule of spike pairs in equations.",
        definition=pairs.plain,
        divisions=divisions,
        equation="; ".join(texts),
        source=pairs.plain.get("source", ""),
        learns="pairs",
        pre=tuple(pairs.side("pre").values()),
        post=tuple(pairs.side("post").values()),
        states=tuple(
            State(
                name,
                unit_of(dimension) if (dimension := pairs.dimensions[name]) else "",
                f"decays with {tau}" if tau else "as spikes leave it",
            )
            for name, tau in pairs.states.items()
        ),
        width=max(Synapse.width, len(constants.places)),
    )
    return result


def _text(pairs: Pairs, constants: Constants) -> str:
    """The module."""
    functions = [
        function(f"{word}(y, e, c, pre, post)", f"What a {word[3:]} spike does.", _spike_lines(pairs, word, constants))
        for word in SPIKES
    ]
    if pairs.between:
        with at("on_signal", WEIGHT):
            lines = advance_lines(pairs, constants)
        functions.append(function("advance(y, e, c, begin, end, n, grid)", "What happens between spikes.", lines))
    rows = {name: k for k, name in enumerate(pairs.states)}
    begin = [f"z[{rows[name]}] = {constants.of_parameters(e.tree)}" for name, e in pairs.initial.items()]
    functions.append(function("begin(p, z)", "The states at step 0.", [*constants.locals(), *begin] or ["pass"]))
    filled = list(constants.lines()) or ["pass"]
    functions.insert(0, function("constants(p, h, c)", "What is worked out once.", filled))
    return "\n\n".join([f'"""{pairs.name}"""\n{_HEAD}', *functions])


def _spike_lines(pairs: Pairs, word: str, constants: Constants) -> list[str]:
    """What a spike changes, all from the values before it."""
    changes, rows = pairs.spikes[word], {name: k for k, name in enumerate((WEIGHT, *pairs.states))}
    variables = {name: local(name) for name in rows}
    for side in ("pre", "post"):
        variables |= {name: f"{side}[{k}]" for k, name in enumerate(pairs.side(side))}
    used = {name for expression in changes.values() for name in names(expression.tree)}
    lines = [f"{local(name)} = y[{row}, e]" for name, row in rows.items() if name in used]
    lines += [f"y[{rows[name]}, e] = {written(e.tree, constants.leaf(variables))}" for name, e in changes.items()]
    return lines or ["pass"]


DEGREE = 4
"""How many states, and the signal where it decays, a product of the rate may have."""


def advance_lines(pairs: Pairs, constants: Constants) -> list[str]:
    """The body of `advance`."""
    rows = {name: k for k, name in enumerate((WEIGHT, *pairs.states))}
    lines = [f"passed = (end - begin) * {constants.place_of('h')}"]
    used = set() if pairs.drift is None else {WEIGHT, *names(pairs.drift.tree)}
    decaying = [name for name, tau in pairs.states.items() if tau]
    lines += [f"{local(name)} = y[{rows[name]}, e]" for name in rows if name in used or name in decaying]
    if pairs.drift is not None:
        lines.append(f"{local(WEIGHT)} += {_moved(pairs, pairs.drift, constants)}")
        lines.append(f"y[0, e] = {_bounded(pairs, constants)}")
    for name in decaying:
        tau = constants.place(Name(pairs.states[name], 0))
        lines.append(f"y[{rows[name]}, e] = {local(name)} * of_exp(divided(-passed, {tau}))")
    return lines


def _moved(pairs: Pairs, drift: Expression, constants: Constants) -> str:
    """By how much the weight changes."""
    taus = {name: tau for name, tau in pairs.states.items() if tau}
    if DECAY_OF_SIGNAL in pairs.parameters:
        taus[SIGNAL] = DECAY_OF_SIGNAL

    def fits(tree: Tree) -> bool:
        return WEIGHT not in names(tree) and polynomial(tree, taus, DEGREE) is not None

    found = polynomial(drift.tree, taus, DEGREE)
    if found is None or not fits(drift.tree):
        odd = culprit(drift.tree, fits)
        summed = f"a sum of products of at most {DEGREE} of {', '.join(taus) or 'the states'}"
        message = f"a rate without {WEIGHT}" if WEIGHT in names(odd) else f"{summed}, whose decay is integrated exactly"
        hint = "Wmin and Wmax keep the weight within bounds" if WEIGHT in names(odd) else ""
        raise drift.mistake(odd.at, f"found '{text_of(odd)}': expected {message}", hint)
    variables = {**{name: local(name) for name in pairs.states}, SIGNAL: SIGNAL}
    leaf = constants.leaf(variables)
    terms = []
    for product, factor in found.items():
        lasts = _lasting([constants.of_parameters(Name(taus[name], 0)) for name in product], constants)
        terms.append(" * ".join([f"({written(factor, leaf)})", *(variables[name] for name in product), lasts]))
    return " + ".join(terms)


def _lasting(taus: list[str], constants: Constants) -> str:
    """The integral of a product of decays, by their time constants, over what has passed."""
    if not taus:
        return "passed"
    tau = constants.place_of(
        taus[0] if len(taus) == 1 else f"1.0 / ({' + '.join(f'divided(1.0, {tau})' for tau in taus)})"
    )
    return f"{tau} * -of_expm1(divided(-passed, {tau}))"


def _bounded(pairs: Pairs, constants: Constants) -> str:
    """The weight within Wmin, or 0, and Wmax; Wmax below 0 is the smallest."""
    if "Wmax" not in pairs.parameters:
        return local(WEIGHT)
    ends = f"{local('Wmin') if 'Wmin' in pairs.parameters else '0.0'}, {local('Wmax')}"
    low, high = constants.place_of(f"min({ends})"), constants.place_of(f"max({ends})")
    return f"min(max({local(WEIGHT)}, {low}), {high})"
