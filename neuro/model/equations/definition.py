"""Definition of a neuron by equations: parsing of its words into syntax trees, with checks of names and units."""

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
    refuse_inner_comparisons,
    unit_unknown,
    with_path,
)
from neuro.model.equations.functions import ARGUMENTS
from neuro.model.equations.parameters import NAME, REFRACTORY, RIGHT_SIDE, WORD_HINTS, Parameter, parse, read_parameters

CURRENT_NAME = "I"
"""Name of the current from generators in equations."""
REFRACTORY_STEPS = "refractory"
"""Name of the hidden state that counts the remaining refractory steps."""
KERNELS = ("exp", "alpha", "delta")
"""Shapes of the response to a spike. exp and alpha add states to the neuron, delta is a jump of a state."""
INTEGRATORS: Mapping[str, Mapping[str, float]] = {
    "exact": {},
    "euler": {},
    "exponential_euler": {},
    "rk4": {"substeps": 1},
    "rkf45": {"tolerance": 1e-6, "slope_tolerance": 0.0},
}
"""Integrators and the defaults of their options."""
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
    "substeps": Quantity(doc="number of substeps per step", kind="integer", at_least=1, at_most=1000),
    "tolerance": Quantity(doc="largest error of a substep, in mV, pA, nS", above=0),
    "slope_tolerance": Quantity(doc="additional tolerance relative to |h y'|, as in NEST's aeif neurons", at_least=0),
}
MAX_SIZE = 4000
"""Largest number of numbers, names and operations of an expression after expanding abbreviations."""
MAX_RECEPTORS = 16


@dataclass(frozen=True)
class Receptor:
    """Effect of an incoming spike: a jump of the state `name` (exp, alpha) or of the state of an equation (delta).

    With `magnitude` the state is a conductance and grows by |w|, independent of the sign of the weight w.
    """

    name: str
    kernel: str
    tau: Expression | None
    magnitude: bool = False


@dataclass(frozen=True)
class Definition:
    """Definition of a neuron as syntax trees.

    Attributes:
        states: the states of the equations, V_m first, with the right sides.
        let: abbreviations. An abbreviation may use the abbreviations before it.
        hold: the states that are constant during refractoriness, or None for a neuron without refractoriness.
        dimensions: dimensions of all states, those of kernels included.
        plain: the words of the definition, as the user wrote them.
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
        """Expand all abbreviations in a tree.

        Raises:
            ModelError: the expanded tree is too large.
        """
        for name in reversed(self.let):
            tree = algebra.substitute(tree, {name: self.let[name].tree})
            if algebra.size(tree) > MAX_SIZE:
                raise ModelError(
                    f"more than {MAX_SIZE} operations after expanding 'let': expected fewer", path=("let",)
                )
        return tree

    @property
    def takes_current(self) -> bool:
        """True if the equations contain the current of generators."""
        return any(CURRENT_NAME in algebra.names(self.full(e.tree)) for e in self.states.values())


@contextmanager
def under_path(*path: str) -> Iterator[None]:
    """Add a path within the words to errors raised in the block."""
    try:
        yield
    except ModelError as error:
        raise with_path(error, path) from None


def read(name: str, words: Mapping[str, Any]) -> Definition:
    """Parse the words of a neuron.

    Raises:
        ModelError: the first mistake, with the column for a mistake in an expression.
    """
    mapping(words, WORDS, "a model")
    if "equations" not in words:
        raise ModelError("a model needs 'equations', e.g. {V_m: (E_L - V_m)/tau_m + I/C_m}")
    parameters = read_parameters(words.get("parameters", {}))
    states, let = expressions(words, "equations"), expressions(words, "let")
    if not states:
        raise ModelError("no equation: expected at least one", path=("equations",))
    states = {key: states[key] for key in sorted(states, key=lambda key: key != "V_m")}
    receptors = _receptors(words.get("receptors", {}))
    for kind, names in (("equations", states), ("let", let), ("receptors", [r.name for r in receptors])):
        for word in names:
            with under_path(kind, word):
                _refuse_name(word, kind, parameters, states, let, receptors)
    threshold = None
    if "threshold" in words:
        with under_path("threshold"):
            threshold = parse(words["threshold"])
    refractory = _refractory(words.get("refractory"), states, parameters)
    integrator, settings = _integrator(words.get("integrator"))
    definition = Definition(
        name,
        states,
        let,
        receptors,
        threshold,
        expressions(words, "reset"),
        refractory,
        parameters,
        expressions(words, "initial"),
        integrator,
        settings,
        {},
        dict(words),
    )
    return _check_dimensions(definition)


def mapping(value: Any, words: tuple[str, ...], label: str) -> Mapping[str, Any]:
    """Return the words of a mapping.

    Raises:
        ModelError: the value is not a mapping, or has an unknown word.
    """
    if not isinstance(value, Mapping):
        raise ModelError(f"found {shown(value)}: expected the words of {label}: {', '.join(words)}")
    for word in value:
        if word not in words:
            error = unknown(f"word of {label}", word, words, path=(str(word),))
            raise error.but(hint=WORD_HINTS.get(str(word), error.hint))
    return value


def expressions(words: Mapping[str, Any], section: str) -> dict[str, Expression]:
    """Parse the expressions of a section, and return the expressions by name.

    Raises:
        ModelError: an expression cannot be parsed.
    """
    texts = words.get(section, {})
    if not isinstance(texts, Mapping):
        hint = RIGHT_SIDE if isinstance(texts, str) else ""
        raise ModelError(f"{section}: found {shown(texts)}: expected {{name: expression}}", hint=hint, path=(section,))
    parsed = {}
    for name, text in texts.items():
        with under_path(section, str(name)):
            parsed[str(name)] = parse(text)
            refuse_inner_comparisons(parsed[str(name)], parsed[str(name)].tree)
    return parsed


def _receptors(section: Any) -> tuple[Receptor, ...]:
    with under_path("receptors"):
        if not isinstance(section, Mapping) or len(section) > MAX_RECEPTORS:
            limit = f"at most {MAX_RECEPTORS}, {{name: {{kernel: exp, tau: ...}}}}"
            raise ModelError(f"found {shown(section)}: expected {limit}")
    receptors = []
    for name, words in section.items():
        with under_path("receptors", str(name)):
            receptor_words = mapping(words, ("kernel", "tau"), "a receptor")
            kernel = receptor_words.get("kernel")
            if kernel not in KERNELS:
                raise ModelError(f"kernel = {shown(kernel)}: expected one of {', '.join(KERNELS)}")
            if ("tau" in receptor_words) == (kernel == "delta"):
                needs = "has no 'tau': expected one" if kernel != "delta" else "has 'tau': expected none"
                raise ModelError(f"kernel {kernel} {needs}")
        tau = None
        if "tau" in receptor_words:
            with under_path("receptors", str(name), "tau"):
                tau = parse(receptor_words["tau"])
                refuse_inner_comparisons(tau, tau.tree)
        receptors.append(Receptor(str(name), kernel, tau))
    return tuple(receptors)


def _refractory(value: Any, states: Mapping[str, Any], parameters: Mapping[str, Parameter]) -> tuple[str, ...] | None:
    if value is None:
        return None
    with under_path("refractory"):
        if not isinstance(value, Mapping):
            text = f"found {shown(value)}: expected the words of refractory: time, hold"
            raise ModelError(text, hint=REFRACTORY)
        words = mapping(value, ("time", "hold"), "refractory")
        if words.get("time") != "t_ref" or "t_ref" not in parameters:
            hint = "" if "t_ref" in parameters else "add it to 'parameters', e.g. t_ref: 2 ms"
            message = f"time = {shown(words.get('time'))}: expected t_ref, a parameter on the grid of steps"
            raise ModelError(message, hint=hint, path=("time",), about=("t_ref",))
        if parameters["t_ref"].unit != "ms":
            period = parameters["t_ref"]
            hint = f"write t_ref: {period.default * period.factor:g} ms" if period.dimension == TIME else ""
            message = f"t_ref is in '{period.unit}': expected ms"
            raise ModelError(message, hint=hint, path=("time",), about=("t_ref",))
        hold = words.get("hold", [])
        if not isinstance(hold, list | tuple):
            raise ModelError(f"hold = {shown(hold)}: expected a list of states", path=("hold",))
        for name in hold:
            if not isinstance(name, str) or name not in states:
                raise unknown("state", name, states, path=("hold",))
        return tuple(hold)


def _integrator(option: Any) -> tuple[str, dict[str, float]]:
    """Return name and options of an integrator from `rk4` or `{rk4: {substeps: 4}}`."""
    if option is None:
        return "", {}
    if isinstance(option, str):
        option = {option: {}}
    with under_path("integrator"):
        name = next(iter(option), "") if isinstance(option, Mapping) and len(option) == 1 else ""
        if name not in INTEGRATORS:
            names = ", ".join(INTEGRATORS)
            raise ModelError(f"found {shown(option)}: expected one of {names}", hint="write e.g. {rk4: {substeps: 4}}")
        defaults = INTEGRATORS[name]
        options = {**defaults, **mapping(option[name], tuple(defaults), name)}
        for word, value in options.items():
            check(_SETTINGS[word], value, f"{name}.{word}", (name, word))
        return name, options


def _refuse_name(
    word: str,
    kind: str,
    parameters: Mapping[str, Any],
    states: Mapping[str, Any],
    let: Mapping[str, Any],
    receptors: tuple[Receptor, ...],
) -> None:
    """Raise an error for a name that is already used or reserved."""
    check_name(word)
    if word in (CURRENT_NAME, REFRACTORY_STEPS) or word in ARGUMENTS:
        reserved = {CURRENT_NAME: "the current of generators", REFRACTORY_STEPS: "the remaining refractory steps"}
        meaning = reserved.get(word, "a function")
        raise ModelError(f"'{word}' is {meaning}: expected another name")
    if word in parameters:
        raise ModelError(f"'{word}' is also a parameter: expected another name", found=word)
    if kind == "let" and word in states:
        raise ModelError(f"'{word}' also has an equation: expected another name", found=word)
    if kind == "receptors":
        is_delta = next(r for r in receptors if r.name == word).kernel == "delta"
        if is_delta and word not in states:
            raise unknown("state", word, states)
        if not is_delta and (word in states or word in let):
            raise ModelError(f"'{word}' also has an equation: expected another name, because a kernel is an equation")


def check_name(word: str) -> None:
    """Raise an error unless a word is a valid name in expressions.

    Raises:
        ModelError: the name is not valid.
    """
    tree = parse(word).tree
    if not isinstance(tree, Name) or tree.name != word or word.endswith("_") or "__" in word:
        raise ModelError(f"name {shown(word)}: {NAME}")


def _check_dimensions(definition: Definition) -> Definition:
    """Return the definition with its dimensions.

    Raises:
        ModelError: names are unknown, or units do not match. All such mistakes are reported.
    """
    kernels = [r.name for r in definition.receptors if r.kernel != "delta"]
    states = (*definition.states, *kernels)
    for name in definition.initial:
        if name not in states:
            raise unknown("state", name, states, path=("initial", name))
    known_dimensions = {name: p.dimension for name, p in definition.parameters.items()} | {CURRENT_NAME: CURRENT}
    potential = {"V_m": VOLTAGE} if "V_m" in definition.states else {}
    dims = Dimensions(known_dimensions | potential, tuple(name for name in states if name not in potential))
    for receptor in definition.receptors:
        if receptor.tau is not None:
            with dims.under_path("receptors", receptor.name, "tau"):
                dims.only(known_dimensions).check(receptor.tau, Powers(TIME, {}))
    for name, expression in definition.let.items():
        with dims.under_path("let", name):
            dims.names[name] = dims.powers(expression, expression.tree)
    for name, expression in definition.states.items():
        with dims.under_path("equations", name):
            dims.check(expression, dims.name(name, -1))
    _check_spike(definition, dims)
    for name, expression in definition.initial.items():
        with dims.under_path("initial", name):
            dims.only(definition.parameters).check(expression, dims.name(name))
    dims.refuse()
    dimensions = {}
    for name in states:
        dimension = dims.dimension(name)
        if dimension is None:
            raise unit_unknown(name)
        dimensions[name] = dimension
    receptors = tuple(
        Receptor(r.name, r.kernel, r.tau, r.kernel != "delta" and dimensions[r.name] == CONDUCTANCE)
        for r in definition.receptors
    )
    return Definition(**{**vars(definition), "dimensions": dimensions, "receptors": receptors})


def _check_spike(definition: Definition, dims: Dimensions) -> None:
    if definition.threshold is None:
        for section in ("reset", "refractory"):
            if section in definition.plain:
                message = f"{section} without 'threshold': expected one, e.g. V_m >= V_th"
                raise ModelError(message, path=(section,), about=("threshold",))
        return
    with dims.under_path("threshold"):
        if not is_comparison(definition.threshold.tree):
            raise definition.threshold.mistake(0, "expected a comparison, e.g. V_m >= V_th")
        assert isinstance(definition.threshold.tree, Binary)
        for side in (definition.threshold.tree.left, definition.threshold.tree.right):
            refuse_inner_comparisons(definition.threshold, side)
        dims.powers(definition.threshold, definition.threshold.tree)
    for word, text in {
        "threshold": definition.threshold,
        **{f"reset.{name}": e for name, e in definition.reset.items()},
    }.items():
        if CURRENT_NAME in algebra.names(definition.full(text.tree)):
            with dims.under_path(*word.split(".")):
                raise ModelError(f"found {CURRENT_NAME}, the current of generators: expected states and parameters")
    for name, expression in definition.reset.items():
        if name not in dims.names or name in definition.parameters or name in definition.let or name == CURRENT_NAME:
            raise unknown(
                "state", name, [*definition.states, *(r.name for r in definition.receptors)], path=("reset", name)
            )
        with dims.under_path("reset", name):
            dims.check(expression, dims.name(name))
