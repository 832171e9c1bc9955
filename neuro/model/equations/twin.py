"""Find a built-in model with the equations of a neuron in equations. Chips run that model instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.grammar import Binary, Call, Name, Negative, Number, Tree
from neuro.core.units import UNITS
from neuro.model.equations import algebra
from neuro.model.equations.algebra import ONE, ZERO, add, divide, multiply
from neuro.model.equations.definition import CURRENT_NAME, Definition, Receptor
from neuro.model.equations.dimensions import text_of
from neuro.model.equations.exact import CONSTANT, System, system
from neuro.model.equations.functions import PUBLIC
from neuro.model.equations.writing import Constants, function, module
from neuro.model.neurons.base import Neuron
from neuro.model.neurons.currents import iaf_psc_exp
from neuro.model.neurons.potentials import iaf_psc_delta

_HEAD = f"from neuro.model.equations.functions import {', '.join(PUBLIC)}\n"
_CURRENTS = ("I_syn_ex", "I_syn_in")
_TAUS = ("tau_syn_ex", "tau_syn_in")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Twin:
    """A built-in model with the same equations.

    Attributes:
        model: iaf_psc_exp or iaf_psc_delta.
        states: for each state of the equations, the built-in state, or two built-in states whose sum it is.
        words: parameters of the model, computed from the parameters of the equations.
        arithmetic: module with `twin(p, q)`, which computes these parameters.
    """

    model: type[Neuron]
    states: Mapping[str, tuple[str, ...]]
    words: tuple[str, ...]
    arithmetic: ModuleType

    def parameters(self, equation_parameters: Mapping[str, Floats]) -> dict[str, Floats]:
        """Return the parameters of the model in order, `tau_minus` first, from all parameters of the equations.

        Arrays have the shape (1,) or one value per neuron.
        """
        rows = np.broadcast_arrays(*equation_parameters.values())
        values = np.zeros((len(self.words), rows[0].size))
        for k, p in enumerate(zip(*rows, strict=True)):
            self.arithmetic.twin([float(value) for value in p], values[:, k])
        parameters = {word: np.full(1, value) for word, value in self.model.defaults().items()}
        return {
            **parameters,
            "tau_minus": equation_parameters["tau_minus"],
            **dict(zip(self.words, values, strict=True)),
        }


def twin(definition: Definition) -> Twin:
    """Return the built-in model with the equations of a neuron.

    Raises:
        ModelError: there is no such model. The message is the reason.
    """
    linear = system(definition)
    if linear is None:
        variables = {*definition.states, *(receptor.name for receptor in definition.receptors), CURRENT_NAME}

        def is_linear(tree: Tree) -> bool:
            return algebra.affine(tree, variables) is not None

        name, tree = next(
            (n, definition.full(e.tree)) for n, e in definition.states.items() if not is_linear(definition.full(e.tree))
        )
        raise ModelError(
            f"its equation of {name} is not linear, see '{text_of(algebra.innermost_misfit(tree, is_linear))}'"
        )
    if definition.integrator not in ("", "exact"):
        hint = "leave out 'integrator': the equations are linear and are solved exactly"
        raise ModelError(f"its integrator is {definition.integrator}", hint=hint)
    if len(definition.states) > 1:
        others = ", ".join(list(definition.states)[1:])
        raise ModelError(f"it has equations of {others} in addition to {next(iter(definition.states))}")
    potential = next(iter(definition.states))
    receptors = _receptors(definition, linear, potential)
    trees = _membrane(definition, linear.rows[potential], potential, receptors) | _spike(definition, potential)
    states: dict[str, tuple[str, ...]] = {potential: ("V_m",)}
    if receptors and receptors[0].kernel == "exp":
        built_in_states = [_CURRENTS] if len(receptors) == 1 else [(name,) for name in _CURRENTS]
        states |= {receptor.name: share for receptor, share in zip(receptors, built_in_states, strict=True)}
        taus = [receptor.tau.tree for receptor in receptors if receptor.tau is not None]
        trees |= {word: taus[-1 if word == "tau_syn_in" else 0] for word in _TAUS}
        model: type[Neuron] = iaf_psc_exp
    else:
        model = iaf_psc_delta
    constants = Constants(
        definition.parameters,
        1,
        {*definition.states, *definition.let, *(r.name for r in definition.receptors), CURRENT_NAME},
        definition.full,
    )
    lines = [f"q[{k}] = {constants.of_parameters(tree)}" for k, tree in enumerate(trees.values())]
    body = [*constants.locals(), *lines]
    doc = f"The parameters of {model.__name__}."
    return Twin(model, states, tuple(trees), module(f"{_HEAD}\n\n{function('twin(p, q)', doc, body)}"))


def _receptors(definition: Definition, linear: System, potential: str) -> tuple[Receptor, ...]:
    """Return the receptors if a built-in model has receptors with the same effects."""
    kernels = {receptor.kernel for receptor in definition.receptors}
    if "alpha" in kernels:
        name = next(receptor.name for receptor in definition.receptors if receptor.kernel == "alpha")
        raise ModelError(f"{name} has an alpha kernel, which has two states", hint="use kernel exp")
    if len(kernels) > 1:
        raise ModelError("it has receptors of kernels exp and delta", hint="use one kernel for both")
    if any(receptor.magnitude for receptor in definition.receptors[1:]):
        raise ModelError(
            f"{definition.receptors[1].name} is a conductance, which grows by |w|", hint="use currents, in pA"
        )
    for receptor in definition.receptors:
        if receptor.kernel == "exp" and receptor.name not in linear.rows[potential]:
            raise ModelError(f"{receptor.name} does not act on {potential}")
    return definition.receptors


def _membrane(
    definition: Definition, row: Mapping[str, Tree], potential: str, receptors: tuple[Receptor, ...]
) -> dict[str, Tree]:
    """Return the expressions of the time constant, capacity, resting potential and constant current."""
    leak = products(algebra.negate(row.get(potential, algebra.ZERO)), definition.parameters)
    if not leak:
        raise ModelError(f"{potential} has no leak", hint=f"add one, e.g. (E_L - {potential})/tau_m")
    constants = products(row.get(CONSTANT, algebra.ZERO), definition.parameters)
    currents = [CURRENT_NAME, *(receptor.name for receptor in receptors if receptor.kernel == "exp")]
    gains = {name: products(row[name], definition.parameters) for name in currents if name in row}
    constant: list[Product] = []
    trees = {"tau_m": ratio([UNITY], leak)}
    if gains:
        (first, gain), *other_terms = gains.items()
        for name, other in other_terms:
            if not same(gain, other):
                raise ModelError(f"{first} and {name} act on {potential} with different factors")
        constant = [term for term in constants if _is_current(term, leak, gain)]
        trees |= {"C_m": ratio([UNITY], gain), "I_e": ratio(constant, gain)}
    return {**trees, "E_L": ratio([term for term in constants if term not in constant], leak)}


def _is_current(term: Product, leak: list[Product], gain: list[Product]) -> bool:
    """Return whether a constant term is a current rather than a potential.

    The term is a current if it has fewer factors after division by the gain than after division by the leak. With the
    gain 1/C and the leak 1/tau, I_0/C gives I_0 (one factor) and I_0*tau/C (three factors), so I_0/C is a current.
    """
    if len(leak) > 1 or len(gain) > 1:
        return False
    return len(term.times(gain[0], -1).powers) < len(term.times(leak[0], -1).powers)


def _spike(definition: Definition, potential: str) -> dict[str, Tree]:
    """Return the expressions of the threshold, the reset and the refractory period."""
    if definition.threshold is None:
        raise ModelError("it has no threshold", hint=f"add threshold: {potential} >= V_th")
    tree = definition.threshold.tree
    assert isinstance(tree, Binary)
    parameters = {*definition.parameters}
    limit = definition.full(tree.right)
    if tree.sign != ">=" or not (isinstance(tree.left, Name) and tree.left.name == potential):
        raise ModelError(f"its threshold is {definition.threshold.text.strip()}", hint=f"write {potential} >= V_th")
    reset = {name: definition.full(expression.tree) for name, expression in definition.reset.items()}
    if [*reset] != [potential]:
        raise ModelError(f"a spike resets {', '.join(reset) or 'nothing'}", hint=f"reset only {potential}")
    for label, tree in (("threshold", limit), (f"reset of {potential}", reset[potential])):
        names = [name for name in algebra.names(tree) if name not in parameters and name not in UNITS]
        if names:
            raise ModelError(f"its {label} depends on {names[0]}", hint="use only parameters")
    if definition.hold is not None and potential not in definition.hold:
        raise ModelError(f"{potential} is not constant during refractoriness", hint=f"write hold: [{potential}]")
    period = Name("t_ref", 0) if definition.hold is not None else algebra.ZERO
    return {"V_th": limit, "V_reset": reset[potential], "t_ref": period}


MAX_PRODUCTS = 64
"""Largest number of products in an expanded sum. A longer sum is not expanded and counts as a factor."""


@dataclass(frozen=True)
class Product:
    """A number times powers of factors: 2*a/b has the number 2 and the powers {"a": 1, "b": -1}.

    A factor is a name, or a subtree that is not a product. The key of a factor is the text of the factor.
    """

    number: float
    powers: Mapping[str, int]
    factors: Mapping[str, Tree]

    def times(self, other: Product, power: int = 1) -> Product:
        """Return the product with a power of another product."""
        powers = {
            text: self.powers.get(text, 0) + power * other.powers.get(text, 0)
            for text in {**self.powers, **other.powers}
        }
        nonzero_powers = {text: power for text, power in powers.items() if power}
        return Product(self.number * other.number**power, nonzero_powers, {**self.factors, **other.factors})

    def tree(self) -> Tree:
        """Return the product as a tree."""
        numerator: Tree = ONE if self.number == 1.0 else Number(self.number, "", 0)
        denominator: Tree = ONE
        for text, power in self.powers.items():
            for _ in range(abs(power)):
                if power > 0:
                    numerator = multiply(numerator, self.factors[text])
                else:
                    denominator = multiply(denominator, self.factors[text])
        return numerator if denominator == ONE else divide(numerator, denominator)


UNITY = Product(1.0, {}, {})


def products(tree: Tree, parameters: Iterable[str]) -> list[Product]:
    """Return a tree expanded into a sum of products. Names that are not parameters are units."""
    return _products(tree, set(parameters))


def ratio(numerator: list[Product], denominator: list[Product]) -> Tree:
    """Return the quotient of two sums of products as a tree.

    If the divisor is a single product, common factors cancel.
    """
    if len(denominator) == 1:
        return _sum_tree(x.times(denominator[0], -1) for x in numerator)
    return divide(_sum_tree(numerator), _sum_tree(denominator))


def same(a: list[Product], b: list[Product]) -> bool:
    """Return whether two sums are equal term by term."""
    return {(x.number, frozenset(x.powers.items())) for x in a} == {(x.number, frozenset(x.powers.items())) for x in b}


def _sum_tree(terms: Iterable[Product]) -> Tree:
    total: Tree = ZERO
    for product in terms:
        total = add(total, product.tree())
    return total


def _products(tree: Tree, parameters: set[str]) -> list[Product]:
    match tree:
        case Number(value, unit):
            return [Product(value * UNITS[unit][0] if unit else value, {}, {})] if value else []
        case Name(name) if name not in parameters:
            return [Product(UNITS[name][0], {}, {})]
        case Negative(of):
            return _negative(_products(of, parameters))
        case Binary("+" | "-" as sign, left, right):
            others = _products(right, parameters)
            terms = [*_products(left, parameters), *(others if sign == "+" else _negative(others))]
        case Binary("*", left, right):
            a, b = _products(left, parameters), _products(right, parameters)
            terms = [x.times(y) for x in a for y in b] if len(a) * len(b) <= MAX_PRODUCTS else [_factor(tree)]
        case Binary("/", left, right):
            divisors = _products(right, parameters)
            terms = [
                x.times(divisors[0] if len(divisors) == 1 else _factor(right), -1) for x in _products(left, parameters)
            ]
        case Name() | Call() | Binary():
            terms = [_factor(tree)]
    # Products with the same powers are added, and products that are 0 are dropped.
    by_powers: dict[frozenset[tuple[str, int]], Product] = {}
    for x in terms:
        key = frozenset(x.powers.items())
        earlier_number = by_powers[key].number if key in by_powers else 0.0
        by_powers[key] = Product(earlier_number + x.number, x.powers, x.factors)
    return [x for x in by_powers.values() if x.number != 0.0]


def _factor(tree: Tree) -> Product:
    text = text_of(tree)
    return Product(1.0, {text: 1}, {text: tree})


def _negative(terms: list[Product]) -> list[Product]:
    return [Product(-x.number, x.powers, x.factors) for x in terms]
