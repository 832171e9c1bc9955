"""A rule of spike pairs in equations as a class like any other: traces, and what spikes do to the weight."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import field, make_dataclass
from typing import Any, ClassVar

from neuro.core.errors import ModelError, unknown
from neuro.core.values import shown
from neuro.model.equations.definition import at, check_name, expressions, mapping
from neuro.model.equations.dimensions import Dimensions
from neuro.model.equations.functions import ARGUMENTS, PUBLIC
from neuro.model.equations.generated import module
from neuro.model.equations.grammar import Expression
from neuro.model.equations.parameters import Parameter, read_parameters
from neuro.model.equations.units import NONE, TIME, Dimension
from neuro.model.equations.writing import Constants, function, local, written
from neuro.model.synapses.base import Synapse, Trace

WORDS = ("traces", "on_pre", "on_post", "parameters", "doc", "source")
WEIGHT = "w"
_CLASSES: dict[str, type[EquationSynapse]] = {}
_HEAD = f"from neuro.model.equations.functions import {', '.join(PUBLIC)}\n"


class EquationSynapse(Synapse):
    """Base of the rules in equations.

    Class attributes:
        definition: the words that define it, as they were given.
    """

    definition: ClassVar[Mapping[str, Any]] = {}

    @classmethod
    def identity(cls) -> str:
        """All words that decide what it does."""
        return json.dumps({k: v for k, v in cls.definition.items() if k not in ("doc", "source")}, default=repr)


def is_rule(said: Mapping[str, Any]) -> bool:
    """Whether words are those of a rule."""
    return any(word in said for word in ("traces", "on_pre", "on_post"))


def rule(name: str, said: Mapping[str, Any]) -> type[EquationSynapse]:
    """The class of a rule in equations; the same words give the same class.

    Raises:
        ModelError: the first mistake in the words.
    """
    key = json.dumps([name, said], default=repr)
    if key not in _CLASSES:
        _CLASSES[key] = _made(name, said)
    return _CLASSES[key]


def _made(name: str, said: Mapping[str, Any]) -> type[EquationSynapse]:
    mapping(said, WORDS, "a rule")
    parameters = read_parameters(said.get("parameters", {}), Synapse)
    traces = _traces(said.get("traces", {}), parameters)
    spikes = {word: expressions(said, word) for word in ("on_pre", "on_post")}
    _check(spikes, traces, parameters)
    pre, post = ({n: t for n, (of, t) in traces.items() if of == side} for side in ("pre", "post"))
    variables = {WEIGHT: local(WEIGHT)}
    variables |= {n: f"{side}[{k}]" for side, mine in (("pre", pre), ("post", post)) for k, n in enumerate(mine)}
    constants = Constants(parameters, 0, variables, lambda tree: tree)
    functions = [
        function(
            f"{word}(y, e, c, pre, post)", f"What a {word[3:]} spike does.", _lines(spikes[word], constants, variables)
        )
        for word in ("on_pre", "on_post")
    ]
    filled = list(constants.lines()) or ["pass"]
    functions.insert(0, function("constants(p, h, c)", "What is worked out once.", filled))
    arithmetic = module("\n\n".join([f'"""{name}"""\n{_HEAD}', *functions]))
    taus = {trace.tau for _, trace in traces.values()}
    fields = [
        (word, float, field(default=p.default, metadata={"quantity": p.quantity(word in taus, arrays=False)}))
        for word, p in parameters.items()
    ]
    namespace = {
        "__doc__": said.get("doc") or "A rule of spike pairs in equations.",
        "definition": said,
        "equation": "; ".join(f"{word[3:]}: {WEIGHT} = {e.text}" for word in spikes for e in spikes[word].values()),
        "source": said.get("source", ""),
        "learns": "pairs",
        "pre": tuple(pre.values()),
        "post": tuple(post.values()),
        "width": max(Synapse.width, len(constants.places)),
    }
    made: Any = make_dataclass(
        name, fields, bases=(EquationSynapse,), namespace=namespace, frozen=True, kw_only=True, eq=False
    )
    made.__module__ = arithmetic.__name__
    result: type[EquationSynapse] = made
    return result


def _traces(said: Any, parameters: Mapping[str, Parameter]) -> dict[str, tuple[str, Trace]]:
    """The side of each trace, and the trace."""
    found = {}
    if not isinstance(said, Mapping):
        raise ModelError(f"traces: found {shown(said)}: expected {{name: {{of: pre, tau: ...}}}}", path=("traces",))
    for name, words in said.items():
        with at("traces", str(name)):
            check_name(name)
            if name == WEIGHT or name in parameters or name in ARGUMENTS:
                raise ModelError(f"'{name}' means something else, too: expected another name")
            given = mapping(words, ("of", "tau", "nearest"), "a trace")
            if given.get("of") not in ("pre", "post"):
                raise ModelError(f"of = {shown(given.get('of'))}: expected pre or post")
            tau, nearest = given.get("tau", ""), given.get("nearest", False)
            own = {word: p for word, p in parameters.items() if p.unit == "ms"}
            known = [*own, *(["tau_minus"] if given["of"] == "post" else [])]
            if tau and tau not in known:
                raise unknown("parameter in ms", tau, known, path=("tau",))
            if not isinstance(nearest, bool):
                raise ModelError(f"nearest = {shown(nearest)}: expected true or false", path=("nearest",))
            found[str(name)] = given["of"], Trace(tau, nearest=nearest)
    return found


def _check(
    spikes: Mapping[str, Mapping[str, Expression]],
    traces: Mapping[str, tuple[str, Trace]],
    parameters: Mapping[str, Parameter],
) -> None:
    """Names and units: a trace is a number, a trace without time constant a time, and the weight in any unit."""
    known: dict[str, Dimension] = {name: NONE if trace.tau else TIME for name, (_, trace) in traces.items()}
    dims = Dimensions(known | {word: p.dimension for word, p in parameters.items()}, (WEIGHT,))
    for word, changes in spikes.items():
        for name, expression in changes.items():
            if name != WEIGHT:
                raise unknown("state of a synapse", name, [WEIGHT], path=(word, name))
            with at(word, name):
                dims.check(expression, dims.name(WEIGHT))


def _lines(changes: Mapping[str, Expression], constants: Constants, variables: dict[str, str]) -> list[str]:
    lines = [f"{local(WEIGHT)} = y[0, e]"] if changes else []
    lines += [f"y[0, e] = {written(e.tree, constants.leaf(variables))}" for e in changes.values()]
    return lines or ["pass"]
