"""A rule of spike pairs as its author says it, read from plain words into trees; what does not fit is refused."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from neuro.core.errors import ModelError, unknown
from neuro.core.grammar import Expression, Name
from neuro.core.units import CONDUCTANCE, CURRENT, NONE, TIME, VOLTAGE, Dimension, times, told, unit_of
from neuro.core.values import shown
from neuro.model.equations.algebra import within
from neuro.model.equations.definition import at, check_name, expressions, mapping
from neuro.model.equations.dimensions import Dimensions
from neuro.model.equations.functions import ARGUMENTS
from neuro.model.equations.parameters import Parameter, read_parameters
from neuro.model.synapses.base import Trace

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
