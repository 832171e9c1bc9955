"""Creation of model classes for learning rules of spike pairs that are defined by equations.

A definition has traces, states, and the effects of spikes and of a signal.

Between spikes the states decay, and the signal changes the weight. The weight is integrated exactly. Its rate of change
must therefore be a sum of products of exponentially decaying quantities.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from neuro.core.errors import ModelError, here, unknown
from neuro.core.grammar import Expression, Name, Tree
from neuro.core.quantities import field_of
from neuro.core.units import CONDUCTANCE, CURRENT, NONE, TIME, VOLTAGE, Dimension, phrase_of, times, unit_of
from neuro.core.values import shown
from neuro.model.equations.algebra import innermost_misfit, names, polynomial, subtrees
from neuro.model.equations.definition import check_name, expressions, mapping, under_path
from neuro.model.equations.dimensions import Dimensions, refuse, text_of
from neuro.model.equations.divisions import Divisions, InEquations, Words
from neuro.model.equations.functions import ARGUMENTS, PUBLIC
from neuro.model.equations.parameters import Parameter, read_parameters, refuse_attributes
from neuro.model.equations.writing import Constants, function, local, module, to_python
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Synapse, Trace

WORDS = ("traces", "states", "on_pre", "on_post", "on_signal", "initial", "parameters", "doc", "source")
SPIKES = ("on_pre", "on_post")
WEIGHT, SIGNAL = "w", "n"
"""Names of the weight and of the value of the signal."""
DECAY_OF_SIGNAL = "tau_n"
"""Name of the optional parameter with the time constant of the signal."""
RESERVED = ("weight", "delay", "K_plus")
"""Names of other quantities of `sim.get`; states cannot have these names."""
MAX_STATES = 8


@dataclass(frozen=True)
class Pairs:
    """A rule of spike pairs as syntax trees.

    Attributes:
        traces: for each name of a trace, the side ("pre" or "post") and the trace.
        states: for each state of a synapse other than its weight, the parameter with its time constant, or "" for a
            constant state.
        spikes: the changes by a pre spike and by a post spike.
        drift: the derivative of the weight under the signal, or None for a rule without a signal.
        dimensions: dimension of each state, or None for a dimension that depends on the unit of the weight.
        plain: the words of the definition, as the user wrote them.
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
    def changes_between_spikes(self) -> bool:
        """True if the weight or states change between spikes."""
        return self.drift is not None or any(self.states.values())

    def side(self, side_name: str) -> dict[str, Trace]:
        """Return the traces of the spikes of one side."""
        return {name: trace for name, (side, trace) in self.traces.items() if side == side_name}


def read(name: str, words: Mapping[str, Any]) -> Pairs:
    """Parse the words of a rule.

    Raises:
        ModelError: the first mistake, with the column for a mistake in an expression.
    """
    mapping(words, WORDS, "a rule")
    parameters = read_parameters(words.get("parameters", {}))
    for word, parameter in parameters.items():
        _check_special(word, parameter)
    traces = _traces(words.get("traces", {}), parameters)
    states = _states(words.get("states", {}), parameters, traces)
    spikes = {word: expressions(words, word) for word in SPIKES}
    changes = expressions(words, "on_signal")
    for word in changes:
        if word != WEIGHT:
            raise unknown("change by a signal", word, [WEIGHT], path=("on_signal", word))
    if "on_signal" in words:
        for word in (*parameters, *traces, *states):
            if word == SIGNAL:
                raise ModelError(f"'{SIGNAL}' is the value of the signal: expected another name", path=("on_signal",))
    pairs = Pairs(
        name,
        parameters,
        traces,
        states,
        spikes,
        changes.get(WEIGHT),
        expressions(words, "initial"),
        {},
        dict(words),
    )
    return _check_dimensions(pairs)


def _check_special(word: str, parameter: Parameter) -> None:
    """Raise an error for a parameter with a reserved name, or with a wrong unit for its special name."""
    if word == WEIGHT or word in ARGUMENTS:
        with under_path("parameters", word):
            raise ModelError(f"'{word}' is reserved: expected another name")
    if word in ("Wmin", "Wmax") and parameter.factor != 1.0:
        message = f"{word} is in '{parameter.unit}': expected pA, nS or mV, the units of weights"
        raise ModelError(message, path=("parameters", word))
    if word == DECAY_OF_SIGNAL and parameter.unit != "ms":
        raise ModelError(f"{word} is in '{parameter.unit}': expected ms", path=("parameters", word))


def _traces(section: Any, parameters: Mapping[str, Parameter]) -> dict[str, tuple[str, Trace]]:
    """Return the side and the trace for each name of a trace."""
    traces = {}
    for name, words in _items(section, "traces", "{name: {of: pre, tau: ...}}"):
        with under_path("traces", name):
            _refuse_name(name, parameters)
            trace_words = mapping(words, ("of", "tau", "nearest"), "a trace")
            if trace_words.get("of") not in ("pre", "post"):
                raise ModelError(f"of = {shown(trace_words.get('of'))}: expected pre or post")
            nearest = trace_words.get("nearest", False)
            tau = _tau(trace_words, parameters, ["tau_minus"] if trace_words["of"] == "post" else [])
            if not isinstance(nearest, bool):
                raise ModelError(f"nearest = {shown(nearest)}: expected true or false", path=("nearest",))
            traces[name] = trace_words["of"], Trace(tau, nearest=nearest)
    return traces


def _states(section: Any, parameters: Mapping[str, Parameter], traces: Mapping[str, object]) -> dict[str, str]:
    """Return the parameter with the time constant of each state."""
    states: dict[str, str] = {}
    for name, words in _items(section, "states", "{name: {tau: ...}}"):
        with under_path("states", name):
            _refuse_name(name, parameters)
            if name in traces or name in RESERVED:
                raise ModelError(f"'{name}' is reserved: expected another name")
            states[name] = _tau(mapping(words, ("tau",), "a state of a synapse"), parameters, [])
    if len(states) > MAX_STATES:
        raise ModelError(f"found {len(states)} states: expected at most {MAX_STATES}", path=("states",))
    return states


def _items(value: Any, section: str, expected: str) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, Mapping):
        raise ModelError(f"{section}: found {shown(value)}: expected {expected}", path=(section,))
    yield from ((str(name), words) for name, words in value.items())


def _refuse_name(name: str, parameters: Mapping[str, Parameter]) -> None:
    check_name(name)
    if name == WEIGHT or name in parameters or name in ARGUMENTS:
        raise ModelError(f"'{name}' is reserved: expected another name")


def _tau(words: Mapping[str, Any], parameters: Mapping[str, Parameter], extra_names: list[str]) -> str:
    """Return the name of the time constant in the words of a trace or state, or "" if there is none."""
    tau: str = words.get("tau", "")
    names = [*(word for word, p in parameters.items() if p.unit == "ms"), *extra_names]
    if tau and tau not in names:
        error = unknown("parameter in ms", tau, names, path=("tau",))
        hint = error.hint if names else "write tau: tau_plus, and tau_plus: 20 ms among the parameters"
        raise error.but(hint=hint)
    return tau


def _check_dimensions(pairs: Pairs) -> Pairs:
    """Return the rule with the dimensions of its states.

    A trace with a time constant has no unit. A trace without a time constant is a time.

    Raises:
        ModelError: a name is unknown, or units do not match.
    """
    traces = {name: NONE if trace.tau else TIME for name, (_, trace) in pairs.traces.items()}
    parameters: dict[str, Dimension] = {word: p.dimension for word, p in pairs.parameters.items()}
    changeable = (WEIGHT, *pairs.states)
    dims = Dimensions(parameters | traces, (*changeable, *([SIGNAL] if pairs.drift is not None else [])))
    for word, changes in pairs.spikes.items():
        for name, expression in changes.items():
            if name not in changeable:
                raise unknown("state of a synapse", name, list(changeable), path=(word, name))
            with dims.under_path(word, name):
                if pairs.drift is not None:
                    _refuse(expression, (SIGNAL,), "is the signal, which acts between spikes", "use it in on_signal")
                dims.check(expression, dims.name(name))
                _check_weight(expression, dims)
    if pairs.drift is not None:
        with dims.under_path("on_signal", WEIGHT):
            hint = "keep it in a state, which on_pre or on_post sets"
            _refuse(pairs.drift, traces, "is a trace, which is known at spikes only", hint)
            dims.check(pairs.drift, dims.name(WEIGHT, -1))
            _check_weight(pairs.drift, dims)
    for name, expression in pairs.initial.items():
        if name not in pairs.states:
            raise unknown("state of a synapse", name, list(pairs.states), path=("initial", name))
        with dims.under_path("initial", name):
            dims.only(parameters).check(expression, dims.name(name))
    dims.refuse()
    return Pairs(**{**vars(pairs), "dimensions": {name: dims.dimension(name) for name in pairs.states}})


def _check_weight(expression: Expression, dims: Dimensions) -> None:
    """Record a mistake if the derived unit of the weight is not a unit of weights."""
    dimension = dims.dimension(WEIGHT)
    if dimension not in (None, NONE, CURRENT, CONDUCTANCE, VOLTAGE):
        assert dimension is not None
        message = f"'{WEIGHT}' would be {phrase_of(dimension)}: expected it in pA, nS or mV, or without unit"
        factors = ", ".join(unit_of(times(unit, dimension, -1)) for unit in (CURRENT, CONDUCTANCE, VOLTAGE, NONE))
        hint = f"multiply the change of '{WEIGHT}' by a number in {factors}"
        dims.names[WEIGHT] = dims.mistake(expression.mistake(0, message, hint))


def _refuse(expression: Expression, names: Collection[str], reason: str, hint: str) -> None:
    """Raise an error for names that are not available in an expression."""
    for part in subtrees(expression.tree):
        if isinstance(part, Name) and part.name in names:
            raise expression.mistake(part.at, f"'{part.name}' {reason}", hint)


_HEAD = f"from neuro.model.equations.functions import {', '.join(PUBLIC)}\n"
_OF_RULES = ("traces", "states", *SPIKES, "on_signal")
"""Words that only the definition of a rule has. A definition with one of them is a rule, else a neuron."""


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
        """Return the initial states of the definition."""
        values = [0.0] * len(cls.states)
        arithmetic: Any = cls.arithmetic
        arithmetic.begin([float(parameters[word]) for word in cls.numbers()], values)
        return {state.name: value for state, value in zip(cls.states, values, strict=True)}


class _Between(EquationSynapse, Modulated):
    """Base of the rules that change weight or states between spikes."""


def is_rule(words: Mapping[str, Any]) -> bool:
    """Return whether words define a rule."""
    return any(word in words for word in _OF_RULES)


def rule(name: str, words: Mapping[str, Any]) -> type[EquationSynapse]:
    """Create the class of a rule in equations.

    Raises:
        ModelError: the first mistake in the words.
    """
    pairs = read(name, words)
    base = _Between if pairs.changes_between_spikes else EquationSynapse
    refuse_attributes(pairs.parameters, base)
    for state in pairs.states:
        with under_path("states", state):
            if state in base.quantities():
                raise ModelError(f"'{state}' is a parameter of these rules: expected another name")
    constants = Constants(pairs.parameters, 0, {WEIGHT, *pairs.traces, *pairs.states}, lambda tree: tree)
    time_constants = {trace.tau for _, trace in pairs.traces.values()} | {DECAY_OF_SIGNAL}
    # `taus` has also the time constants of states. They may be 0 if the definition allows it, so
    # divisions by them are not checked here.
    taus = time_constants | {*pairs.states.values()}
    tree_of: dict[Words, Expression] = {
        ("parameters", word): Expression(word, Name(word, 0)) for word in pairs.parameters if word in time_constants
    }
    constants_of_time = [*tree_of]
    if pairs.drift is not None:
        tree_of["on_signal", WEIGHT] = pairs.drift
    for section, expressions_by_name in (*pairs.spikes.items(), ("initial", pairs.initial)):
        tree_of |= {(section, word): expression for word, expression in expressions_by_name.items()}
    divisions = Divisions(pairs.parameters, constants.variables, {}, tree_of, constants_of_time)
    refuse(divisions.mistakes({name: p.default for name, p in pairs.parameters.items()}))
    arithmetic = module(_text(pairs, constants))
    fields = [
        (field_of(word), float, field(default=p.default, metadata={"quantity": p.quantity(word in taus, arrays=False)}))
        for word, p in pairs.parameters.items()
    ]
    texts = [f"{word[3:]}: {name} = {e.text}" for word in pairs.spikes for name, e in pairs.spikes[word].items()]
    texts += [] if pairs.drift is None else [f"{WEIGHT}' = {pairs.drift.text}"]
    result: type[EquationSynapse] = base.create(
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
                f"decays with {tau}" if tau else "changes at spikes only",
            )
            for name, tau in pairs.states.items()
        ),
        width=max(Synapse.width, len(constants.places)),
    )
    return result


def _text(pairs: Pairs, constants: Constants) -> str:
    """Return the text of the module."""
    functions = [
        function(f"{word}(y, e, c, pre, post)", f"Handle a {word[3:]} spike.", _spike_lines(pairs, word, constants))
        for word in SPIKES
    ]
    if pairs.changes_between_spikes:
        with under_path("on_signal", WEIGHT):
            lines = advance_lines(pairs, constants)
        functions.append(function("advance(y, e, c, begin, end, n, grid)", "Integrate between spikes.", lines))
    rows = {name: k for k, name in enumerate(pairs.states)}
    begin = [f"z[{rows[name]}] = {constants.of_parameters(e.tree)}" for name, e in pairs.initial.items()]
    functions.append(function("begin(p, z)", "Set the states at step 0.", [*constants.locals(), *begin] or ["pass"]))
    constant_lines = list(constants.lines()) or ["pass"]
    functions.insert(0, function("constants(p, h, c)", "Compute the constants.", constant_lines))
    return "\n\n".join([f'"""{pairs.name}"""\n{_HEAD}', *functions])


def _spike_lines(pairs: Pairs, word: str, constants: Constants) -> list[str]:
    """Return the lines for the changes by a spike. Each change is computed from the values before the spike."""
    changes, rows = pairs.spikes[word], {name: k for k, name in enumerate((WEIGHT, *pairs.states))}
    variables = {name: local(name) for name in rows}
    for side in ("pre", "post"):
        variables |= {name: f"{side}[{k}]" for k, name in enumerate(pairs.side(side))}
    unpacked_rows = {name for expression in changes.values() for name in names(expression.tree)}
    lines = [f"{local(name)} = y[{row}, e]" for name, row in rows.items() if name in unpacked_rows]
    lines += [f"y[{rows[name]}, e] = {to_python(e.tree, constants.leaf(variables))}" for name, e in changes.items()]
    return lines or ["pass"]


DEGREE = 4
"""Largest number of decaying factors in a product of the rate. A factor is a state or the signal."""


def advance_lines(pairs: Pairs, constants: Constants) -> list[str]:
    """Return the body of `advance`."""
    rows = {name: k for k, name in enumerate((WEIGHT, *pairs.states))}
    lines = [f"passed = (end - begin) * {constants.place_of('h')}"]
    names_in_drift = set() if pairs.drift is None else {WEIGHT, *names(pairs.drift.tree)}
    decaying = [name for name, tau in pairs.states.items() if tau]
    lines += [f"{local(name)} = y[{rows[name]}, e]" for name in rows if name in names_in_drift or name in decaying]
    if pairs.drift is not None:
        lines.append(f"{local(WEIGHT)} += {_weight_change(pairs, pairs.drift, constants)}")
        lines.append(f"y[0, e] = {_clipped_weight(pairs, constants)}")
    for name in decaying:
        tau = constants.place(Name(pairs.states[name], 0))
        lines.append(f"y[{rows[name]}, e] = {local(name)} * of_exp(divided(-passed, {tau}))")
    return lines


def _weight_change(pairs: Pairs, drift: Expression, constants: Constants) -> str:
    """Return the expression of the change of the weight."""
    taus = {name: tau for name, tau in pairs.states.items() if tau}
    if DECAY_OF_SIGNAL in pairs.parameters:
        taus[SIGNAL] = DECAY_OF_SIGNAL

    def fits(tree: Tree) -> bool:
        return WEIGHT not in names(tree) and polynomial(tree, taus, DEGREE) is not None

    coefficients = polynomial(drift.tree, taus, DEGREE)
    if coefficients is None or not fits(drift.tree):
        misfit = innermost_misfit(drift.tree, fits)
        form = f"a sum of products of at most {DEGREE} of {', '.join(taus) or 'the states'}"
        message = (
            f"a rate without {WEIGHT}" if WEIGHT in names(misfit) else f"{form}, whose decay is integrated exactly"
        )
        hint = "Wmin and Wmax keep the weight within bounds" if WEIGHT in names(misfit) else ""
        raise drift.mistake(misfit.at, f"found '{text_of(misfit)}': expected {message}", hint)
    variables = {**{name: local(name) for name in pairs.states}, SIGNAL: SIGNAL}
    leaf = constants.leaf(variables)
    terms = []
    for product, factor in coefficients.items():
        integral = _decay_integral([constants.of_parameters(Name(taus[name], 0)) for name in product], constants)
        terms.append(" * ".join([f"({to_python(factor, leaf)})", *(variables[name] for name in product), integral]))
    return " + ".join(terms)


def _decay_integral(taus: list[str], constants: Constants) -> str:
    """Return the integral over the elapsed time of a product of exponential decays. `taus` are their time constants."""
    if not taus:
        return "passed"
    tau = constants.place_of(
        taus[0] if len(taus) == 1 else f"1.0 / ({' + '.join(f'divided(1.0, {tau})' for tau in taus)})"
    )
    return f"{tau} * -of_expm1(divided(-passed, {tau}))"


def _clipped_weight(pairs: Pairs, constants: Constants) -> str:
    """Return the weight clipped to the range of Wmin (by default 0) and Wmax. A negative Wmax is the lower end."""
    if "Wmax" not in pairs.parameters:
        return local(WEIGHT)
    ends = f"{local('Wmin') if 'Wmin' in pairs.parameters else '0.0'}, {local('Wmax')}"
    low, high = constants.place_of(f"min({ends})"), constants.place_of(f"max({ends})")
    return f"min(max({local(WEIGHT)}, {low}), {high})"
