"""A neuron as its author says it, read from plain words into trees; what is unknown or does not fit is refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from neuro.core.checks import check
from neuro.core.errors import ModelError, unknown
from neuro.core.grammar import Binary, Expression, Name, Tree
from neuro.core.quantities import Quantity
from neuro.core.units import CONDUCTANCE, CURRENT, TIME, VOLTAGE, Dimension
from neuro.core.values import shown
from neuro.model.equations import algebra
from neuro.model.equations.dimensions import (
    Dimensions,
    Powers,
    is_comparison,
    placed,
    refuse_inner_comparisons,
    unit_unknown,
)
from neuro.model.equations.functions import ARGUMENTS
from neuro.model.equations.parameters import NAME, REFRACTORY, RIGHT_SIDE, WORD_HINTS, Parameter, parse, read_parameters

CURRENT_NAME = "I"
"""The name of the current from outside."""
HELD = "refractory"
KERNELS = ("exp", "alpha", "delta")
INTEGRATORS: Mapping[str, Mapping[str, float]] = {
    "exact": {},
    "euler": {},
    "exponential_euler": {},
    "rk4": {"substeps": 1},
    "rkf45": {"tolerance": 1e-6, "slope_tolerance": 0.0},
}
"""The integrators and the options of each."""
WORDS = (
    "equations",
    "let",
    "receptors",
    "threshold",
    "reset",
    "refractory",
    "parameters",
    "initial",
    "integrator",
    "doc",
    "source",
)
_SETTINGS = {
    "substeps": Quantity(doc="parts of a step", kind="integer", at_least=1, at_most=1000),
    "tolerance": Quantity(doc="largest error of a part of a step, in mV, pA, nS", above=0),
    "slope_tolerance": Quantity(doc="what is added to it, a share of |h y'|; NEST's aeif neurons have one", at_least=0),
}
MAX_SIZE = 4000
MAX_RECEPTORS = 16


@dataclass(frozen=True)
class Receptor:
    """What a spike does: it steps a state `name` (exp, alpha), or the state of an equation (delta).

    `magnitude`: a conductance grows by |w|, whatever the sign of the weight.
    """

    name: str
    kernel: str
    tau: Expression | None
    magnitude: bool = False


@dataclass(frozen=True)
class Definition:
    """A neuron in trees.

    Attributes:
        states: those of the equations, V_m first, and their right sides.
        let: abbreviations in terms of what is defined before them.
        hold: the states that stay while the neuron is refractory; None for a neuron without refractoriness.
        dimensions: of all states.
        plain: the words as they were given.
    """

    name: str
    states: Mapping[str, Expression]
    let: dict[str, Expression]
    receptors: tuple[Receptor, ...]
    threshold: Expression | None
    reset: Mapping[str, Expression]
    hold: tuple[str, ...] | None
    parameters: Mapping[str, Parameter]
    initial: Mapping[str, Expression]
    integrator: str
    settings: Mapping[str, float]
    dimensions: Mapping[str, Dimension]
    plain: Mapping[str, Any]

    def full(self, tree: Tree) -> Tree:
        """A tree with all abbreviations written out.

        Raises:
            ModelError: it becomes too long.
        """
        for name in reversed(self.let):
            tree = algebra.replaced(tree, {name: self.let[name].tree})
            if algebra.size(tree) > MAX_SIZE:
                raise ModelError(f"more than {MAX_SIZE} parts with 'let' written out: expected fewer", path=("let",))
        return tree

    @property
    def takes_current(self) -> bool:
        """Whether the current from outside acts on it."""
        return any(CURRENT_NAME in algebra.names(self.full(e.tree)) for e in self.states.values())


@contextmanager
def at(*path: str) -> Iterator[None]:
    """Say where in the words an error raised inside stands."""
    try:
        yield
    except ModelError as error:
        raise placed(error, path) from None


def read(name: str, said: Mapping[str, Any]) -> Definition:
    """Read the words of a neuron.

    Raises:
        ModelError: the first mistake, with the column where it is one of an expression.
    """
    mapping(said, WORDS, "a model")
    if "equations" not in said:
        raise ModelError("a model needs 'equations', e.g. {V_m: (E_L - V_m)/tau_m + I/C_m}")
    parameters = read_parameters(said.get("parameters", {}))
    states, let = expressions(said, "equations"), expressions(said, "let")
    if not states:
        raise ModelError("no equation: expected at least one", path=("equations",))
    states = {key: states[key] for key in sorted(states, key=lambda key: key != "V_m")}
    receptors = _receptors(said.get("receptors", {}))
    for kind, names in (("equations", states), ("let", let), ("receptors", [r.name for r in receptors])):
        for word in names:
            with at(kind, word):
                _refuse_name(word, kind, parameters, states, let, receptors)
    threshold = None
    if "threshold" in said:
        with at("threshold"):
            threshold = parse(said["threshold"])
    refractory = _refractory(said.get("refractory"), states, parameters)
    integrator, settings = _integrator(said.get("integrator"))
    definition = Definition(
        name,
        states,
        let,
        receptors,
        threshold,
        expressions(said, "reset"),
        refractory,
        parameters,
        expressions(said, "initial"),
        integrator,
        settings,
        {},
        dict(said),
    )
    return _checked(definition)


def mapping(said: Any, words: tuple[str, ...], what: str) -> Mapping[str, Any]:
    """The words of a mapping.

    Raises:
        ModelError: it is none, or has another word.
    """
    if not isinstance(said, Mapping):
        raise ModelError(f"found {shown(said)}: expected the words of {what}: {', '.join(words)}")
    for word in said:
        if word not in words:
            error = unknown(f"word of {what}", word, words, path=(str(word),))
            raise error.but(hint=WORD_HINTS.get(str(word), error.hint))
    return said


def expressions(said: Mapping[str, Any], section: str) -> dict[str, Expression]:
    """The expressions of a section, by name.

    Raises:
        ModelError: one cannot be read.
    """
    texts = said.get(section, {})
    if not isinstance(texts, Mapping):
        hint = RIGHT_SIDE if isinstance(texts, str) else ""
        raise ModelError(f"{section}: found {shown(texts)}: expected {{name: expression}}", hint=hint, path=(section,))
    found = {}
    for name, text in texts.items():
        with at(section, str(name)):
            found[str(name)] = parse(text)
            refuse_inner_comparisons(found[str(name)], found[str(name)].tree)
    return found


def _receptors(said: Any) -> tuple[Receptor, ...]:
    with at("receptors"):
        if not isinstance(said, Mapping) or len(said) > MAX_RECEPTORS:
            many = f"at most {MAX_RECEPTORS}, {{name: {{kernel: exp, tau: ...}}}}"
            raise ModelError(f"found {shown(said)}: expected {many}")
    found = []
    for name, words in said.items():
        with at("receptors", str(name)):
            given = mapping(words, ("kernel", "tau"), "a receptor")
            kernel = given.get("kernel")
            if kernel not in KERNELS:
                raise ModelError(f"kernel = {shown(kernel)}: expected one of {', '.join(KERNELS)}")
            if ("tau" in given) == (kernel == "delta"):
                needs = "has no 'tau': expected one" if kernel != "delta" else "has 'tau': expected none"
                raise ModelError(f"kernel {kernel} {needs}")
        tau = None
        if "tau" in given:
            with at("receptors", str(name), "tau"):
                tau = parse(given["tau"])
                refuse_inner_comparisons(tau, tau.tree)
        found.append(Receptor(str(name), kernel, tau))
    return tuple(found)


def _refractory(said: Any, states: Mapping[str, Any], parameters: Mapping[str, Parameter]) -> tuple[str, ...] | None:
    if said is None:
        return None
    with at("refractory"):
        if not isinstance(said, Mapping):
            text = f"found {shown(said)}: expected the words of refractory: time, hold"
            raise ModelError(text, hint=REFRACTORY)
        given = mapping(said, ("time", "hold"), "refractory")
        if given.get("time") != "t_ref" or "t_ref" not in parameters:
            hint = "" if "t_ref" in parameters else "add it to 'parameters', e.g. t_ref: 2 ms"
            message = f"time = {shown(given.get('time'))}: expected t_ref, a parameter on the grid of steps"
            raise ModelError(message, hint=hint, path=("time",), about=("t_ref",))
        if parameters["t_ref"].unit != "ms":
            period = parameters["t_ref"]
            hint = f"write t_ref: {period.default * period.factor:g} ms" if period.dimension == TIME else ""
            message = f"t_ref is in '{period.unit}': expected ms"
            raise ModelError(message, hint=hint, path=("time",), about=("t_ref",))
        hold = given.get("hold", [])
        if not isinstance(hold, list | tuple):
            raise ModelError(f"hold = {shown(hold)}: expected a list of states", path=("hold",))
        for name in hold:
            if not isinstance(name, str) or name not in states:
                raise unknown("state", name, states, path=("hold",))
        return tuple(hold)


def _integrator(said: Any) -> tuple[str, dict[str, float]]:
    """The name and the settings of `rk4` or `{rk4: {substeps: 4}}`."""
    if said is None:
        return "", {}
    if isinstance(said, str):
        said = {said: {}}
    with at("integrator"):
        name = next(iter(said), "") if isinstance(said, Mapping) and len(said) == 1 else ""
        if name not in INTEGRATORS:
            known = ", ".join(INTEGRATORS)
            raise ModelError(f"found {shown(said)}: expected one of {known}", hint="write e.g. {rk4: {substeps: 4}}")
        defaults = INTEGRATORS[name]
        found = {**defaults, **mapping(said[name], tuple(defaults), name)}
        for word, value in found.items():
            check(_SETTINGS[word], value, f"{name}.{word}", (name, word))
        return name, found


def _refuse_name(
    word: str,
    kind: str,
    parameters: Mapping[str, Any],
    states: Mapping[str, Any],
    let: Mapping[str, Any],
    receptors: tuple[Receptor, ...],
) -> None:
    """A name means one thing."""
    check_name(word)
    if word in (CURRENT_NAME, HELD) or word in ARGUMENTS:
        what = {CURRENT_NAME: "the current from outside", HELD: "the steps left to hold"}.get(word, "a function")
        raise ModelError(f"'{word}' is {what}: expected another name")
    if word in parameters:
        raise ModelError(f"'{word}' is a parameter, too: expected another name", found=word)
    if kind == "let" and word in states:
        raise ModelError(f"'{word}' has an equation, too: expected another name", found=word)
    if kind == "receptors":
        delta = next(r for r in receptors if r.name == word).kernel == "delta"
        if delta and word not in states:
            raise unknown("state", word, states)
        if not delta and (word in states or word in let):
            raise ModelError(f"'{word}' has an equation, too: expected a name of its own, its kernel is its equation")


def check_name(word: str) -> None:
    """Refuse what can be no name in an expression.

    Raises:
        ModelError: it is none.
    """
    tree = parse(word).tree
    if not isinstance(tree, Name) or tree.name != word or word.endswith("_") or "__" in word:
        raise ModelError(f"name {shown(word)}: {NAME}")


def _checked(d: Definition) -> Definition:
    """The definition with its dimensions.

    Raises:
        ModelError: names are unknown, or units do not fit; all of these.
    """
    kernels = [r.name for r in d.receptors if r.kernel != "delta"]
    states = (*d.states, *kernels)
    for name in d.initial:
        if name not in states:
            raise unknown("state", name, states, path=("initial", name))
    known = {name: p.dimension for name, p in d.parameters.items()} | {CURRENT_NAME: CURRENT}
    potential = {"V_m": VOLTAGE} if "V_m" in d.states else {}
    dims = Dimensions(known | potential, tuple(name for name in states if name not in potential))
    for receptor in d.receptors:
        if receptor.tau is not None:
            with dims.at("receptors", receptor.name, "tau"):
                dims.only(known).check(receptor.tau, Powers(TIME, {}))
    for name, expression in d.let.items():
        with dims.at("let", name):
            dims.names[name] = dims.powers(expression, expression.tree)
    for name, expression in d.states.items():
        with dims.at("equations", name):
            dims.check(expression, dims.name(name, -1))
    _check_spike(d, dims)
    for name, expression in d.initial.items():
        with dims.at("initial", name):
            dims.only(d.parameters).check(expression, dims.name(name))
    dims.refuse()
    found = {}
    for name in states:
        dimension = dims.of(name)
        if dimension is None:
            raise unit_unknown(name)
        found[name] = dimension
    receptors = tuple(
        Receptor(r.name, r.kernel, r.tau, r.kernel != "delta" and found[r.name] == CONDUCTANCE) for r in d.receptors
    )
    return Definition(**{**vars(d), "dimensions": found, "receptors": receptors})


def _check_spike(d: Definition, dims: Dimensions) -> None:
    if d.threshold is None:
        for section in ("reset", "refractory"):
            if section in d.plain:
                message = f"{section} without 'threshold': expected one, e.g. V_m >= V_th"
                raise ModelError(message, path=(section,), about=("threshold",))
        return
    with dims.at("threshold"):
        if not is_comparison(d.threshold.tree):
            raise d.threshold.mistake(0, "expected a comparison, e.g. V_m >= V_th")
        assert isinstance(d.threshold.tree, Binary)
        for side in (d.threshold.tree.left, d.threshold.tree.right):
            refuse_inner_comparisons(d.threshold, side)
        dims.powers(d.threshold, d.threshold.tree)
    for word, text in {"threshold": d.threshold, **{f"reset.{name}": e for name, e in d.reset.items()}}.items():
        if CURRENT_NAME in algebra.names(d.full(text.tree)):
            with dims.at(*word.split(".")):
                raise ModelError(f"found {CURRENT_NAME}, the current from outside: expected states and parameters")
    for name, expression in d.reset.items():
        if name not in dims.names or name in d.parameters or name in d.let or name == CURRENT_NAME:
            raise unknown("state", name, [*d.states, *(r.name for r in d.receptors)], path=("reset", name))
        with dims.at("reset", name):
            dims.check(expression, dims.name(name))
