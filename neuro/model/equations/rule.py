"""A rule of spike pairs in equations as a class like any other: traces, states, what spikes and a signal do to them.

Between spikes its states decay, and the weight moves under the signal. The rate of the weight is a sum of products of
what decays exponentially, so its integral is exact.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import field, make_dataclass
from typing import Any

from neuro.core.errors import ModelError, here
from neuro.core.grammar import Expression, Name, Tree
from neuro.core.quantities import field_of
from neuro.core.units import unit_of
from neuro.model.equations.algebra import culprit, names, polynomial
from neuro.model.equations.definition import at
from neuro.model.equations.dimensions import refuse, text_of
from neuro.model.equations.divisions import Divisions, InEquations, Words
from neuro.model.equations.functions import PUBLIC
from neuro.model.equations.pairs import DECAY_OF_SIGNAL, SIGNAL, SPIKES, WEIGHT, Pairs, read
from neuro.model.equations.parameters import refuse_attributes
from neuro.model.equations.writing import Constants, function, local, module, written
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Synapse

_CLASSES: dict[str, type[EquationSynapse]] = {}
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
    """The class of a rule in equations; the same words give the same class.

    Raises:
        ModelError: the first mistake in the words.
    """
    key = json.dumps([name, said], default=repr)
    if key not in _CLASSES:
        _CLASSES[key] = _made(read(name, said))
    return _CLASSES[key]


def _made(pairs: Pairs) -> type[EquationSynapse]:
    base = _Between if pairs.between else EquationSynapse
    refuse_attributes(pairs.parameters, base)
    for name in pairs.states:
        with at("states", name):
            if name in base.quantities():
                raise ModelError(f"'{name}' is a parameter of such rules, too: expected another name")
    constants = Constants(pairs.parameters, 0, {WEIGHT, *pairs.traces, *pairs.states}, lambda tree: tree)
    lasting = {trace.tau for _, trace in pairs.traces.values()} | {DECAY_OF_SIGNAL}
    taus = lasting | {*pairs.states.values()}  # a state may last no time, where its author says so
    divisions = Divisions(pairs.parameters, constants.variables, {}, *_expressions(pairs, lasting))
    refuse(divisions.mistakes({name: p.default for name, p in pairs.parameters.items()}))
    arithmetic = module(_text(pairs, constants))
    fields = [
        (field_of(word), float, field(default=p.default, metadata={"quantity": p.quantity(word in taus, arrays=False)}))
        for word, p in pairs.parameters.items()
    ]
    namespace = {
        "__doc__": pairs.plain.get("doc") or "A rule of spike pairs in equations.",
        "definition": pairs.plain,
        "divisions": divisions,
        "equation": _told(pairs),
        "source": pairs.plain.get("source", ""),
        "learns": "pairs",
        "pre": tuple(pairs.side("pre").values()),
        "post": tuple(pairs.side("post").values()),
        "states": tuple(_state(pairs, name) for name in pairs.states),
        "width": max(Synapse.width, len(constants.places)),
    }
    made: Any = make_dataclass(
        pairs.name, fields, bases=(base,), namespace=namespace, frozen=True, kw_only=True, eq=False
    )
    made.__module__ = arithmetic.__name__
    result: type[EquationSynapse] = made
    return result


def _expressions(pairs: Pairs, taus: Collection[str]) -> tuple[dict[Words, Expression], list[Words]]:
    """All expressions by the words that lead to them, and which of them are time constants."""
    found: dict[Words, Expression] = {
        ("parameters", word): Expression(word, Name(word, 0)) for word in pairs.parameters if word in taus
    }
    last = [*found]
    if pairs.drift is not None:
        found["on_signal", WEIGHT] = pairs.drift
    for section, expressions in (*pairs.spikes.items(), ("initial", pairs.initial)):
        found |= {(section, name): expression for name, expression in expressions.items()}
    return found, last


def _told(pairs: Pairs) -> str:
    parts = [f"{word[3:]}: {name} = {e.text}" for word in pairs.spikes for name, e in pairs.spikes[word].items()]
    parts += [] if pairs.drift is None else [f"{WEIGHT}' = {pairs.drift.text}"]
    return "; ".join(parts)


def _state(pairs: Pairs, name: str) -> State:
    dimension, tau = pairs.dimensions[name], pairs.states[name]
    return State(name, unit_of(dimension) if dimension else "", f"decays with {tau}" if tau else "as spikes leave it")


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
    functions.append(function("begin(p, z)", "The states at step 0.", _begin_lines(pairs, constants)))
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
    lines += [f"y[{rows[name]}, e] = {_value(e, constants, variables)}" for name, e in changes.items()]
    return lines or ["pass"]


def _value(expression: Expression, constants: Constants, variables: Mapping[str, str]) -> str:
    return written(expression.tree, constants.leaf(variables))


def _begin_lines(pairs: Pairs, constants: Constants) -> list[str]:
    rows = {name: k for k, name in enumerate(pairs.states)}
    lines = [f"z[{rows[name]}] = {constants.of_parameters(e.tree)}" for name, e in pairs.initial.items()]
    return [*constants.locals(), *lines] or ["pass"]


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
