"""The built-in model with the same equations, so that chips can run them as that model; or why there is none."""

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
from neuro.model.equations.algebra import ONE, ZERO, added, divided, multiplied
from neuro.model.equations.definition import CURRENT_NAME, Definition, Receptor
from neuro.model.equations.dimensions import text_of
from neuro.model.equations.exact import REST, System, system
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
    """A model of the package with the same equations.

    Attributes:
        model: iaf_psc_exp or iaf_psc_delta.
        states: the built-in states that each state of the equations corresponds to; two: it is their sum.
        words: its parameters that follow from those of the equations.
        arithmetic: has `twin(p, q)`, which works these out.
    """

    model: type[Neuron]
    states: Mapping[str, tuple[str, ...]]
    words: tuple[str, ...]
    arithmetic: ModuleType

    def parameters(self, own: Mapping[str, Floats]) -> dict[str, Floats]:
        """Its parameters, from all those of the equations in order, `tau_minus` first; shape (1,) or one a neuron."""
        rows = np.broadcast_arrays(*own.values())
        values = np.zeros((len(self.words), rows[0].size))
        for k, p in enumerate(zip(*rows, strict=True)):
            self.arithmetic.twin([float(value) for value in p], values[:, k])
        found = {word: np.full(1, value) for word, value in self.model.defaults().items()}
        return {**found, "tau_minus": own["tau_minus"], **dict(zip(self.words, values, strict=True))}


def twin(d: Definition) -> Twin:
    """The model of the package that has the equations of a neuron.

    Raises:
        ModelError: none has; it says why.
    """
    linear = system(d)
    if linear is None:
        variables = {*d.states, *(receptor.name for receptor in d.receptors), CURRENT_NAME}

        def is_linear(tree: Tree) -> bool:
            return algebra.affine(tree, variables) is not None

        name, tree = next((n, d.full(e.tree)) for n, e in d.states.items() if not is_linear(d.full(e.tree)))
        raise ModelError(f"its equation of {name} is not linear, see '{text_of(algebra.culprit(tree, is_linear))}'")
    if d.integrator not in ("", "exact"):
        hint = "leave out 'integrator': it is linear, and solved exactly"
        raise ModelError(f"its integrator is {d.integrator}", hint=hint)
    if len(d.states) > 1:
        others = ", ".join(list(d.states)[1:])
        raise ModelError(f"it has equations of {others} beside that of {next(iter(d.states))}")
    potential = next(iter(d.states))
    receptors = _receptors(d, linear, potential)
    trees = _membrane(d, linear.rows[potential], potential, receptors) | _spike(d, potential)
    states: dict[str, tuple[str, ...]] = {potential: ("V_m",)}
    if receptors and receptors[0].kernel == "exp":
        shares = [_CURRENTS] if len(receptors) == 1 else [(name,) for name in _CURRENTS]
        states |= {receptor.name: share for receptor, share in zip(receptors, shares, strict=True)}
        taus = [receptor.tau.tree for receptor in receptors if receptor.tau is not None]
        trees |= {word: taus[-1 if word == "tau_syn_in" else 0] for word in _TAUS}
        model: type[Neuron] = iaf_psc_exp
    else:
        model = iaf_psc_delta
    constants = Constants(d.parameters, 1, {*d.states, *d.let, *(r.name for r in d.receptors), CURRENT_NAME}, d.full)
    lines = [f"q[{k}] = {constants.of_parameters(tree)}" for k, tree in enumerate(trees.values())]
    body = [*constants.locals(), *lines]
    doc = f"The parameters of {model.__name__}."
    return Twin(model, states, tuple(trees), module(f"{_HEAD}\n\n{function('twin(p, q)', doc, body)}"))


def _receptors(d: Definition, linear: System, potential: str) -> tuple[Receptor, ...]:
    """Its receptors, if they act as those of one model do."""
    kernels = {receptor.kernel for receptor in d.receptors}
    if "alpha" in kernels:
        name = next(receptor.name for receptor in d.receptors if receptor.kernel == "alpha")
        raise ModelError(f"{name} has an alpha kernel, which is two states", hint="use kernel exp")
    if len(kernels) > 1:
        raise ModelError("it has receptors of kernels exp and delta", hint="use one kernel for both")
    if any(receptor.magnitude for receptor in d.receptors[1:]):
        raise ModelError(f"{d.receptors[1].name} is a conductance, which takes |w|", hint="use currents, in pA")
    for receptor in d.receptors:
        if receptor.kernel == "exp" and receptor.name not in linear.rows[potential]:
            raise ModelError(f"{receptor.name} does not act on {potential}")
    return d.receptors


def _membrane(
    d: Definition, row: Mapping[str, Tree], potential: str, receptors: tuple[Receptor, ...]
) -> dict[str, Tree]:
    """The time constant, the capacity, the resting potential and the constant current."""
    leak = products(algebra.negative(row.get(potential, algebra.ZERO)), d.parameters)
    if not leak:
        raise ModelError(f"{potential} has no leak", hint=f"add one, e.g. (E_L - {potential})/tau_m")
    rest = products(row.get(REST, algebra.ZERO), d.parameters)
    currents = [CURRENT_NAME, *(receptor.name for receptor in receptors if receptor.kernel == "exp")]
    gains = {name: products(row[name], d.parameters) for name in currents if name in row}
    constant: list[Product] = []
    trees = {"tau_m": ratio([UNITY], leak)}
    if gains:
        (first, gain), *others = gains.items()
        for name, other in others:
            if not same(gain, other):
                raise ModelError(f"{first} and {name} act on {potential} by factors that differ")
        constant = [term for term in rest if _is_current(term, leak, gain)]
        trees |= {"C_m": ratio([UNITY], gain), "I_e": ratio(constant, gain)}
    return {**trees, "E_L": ratio([term for term in rest if term not in constant], leak)}


def _is_current(term: Product, leak: list[Product], gain: list[Product]) -> bool:
    """Whether a constant term is a current, as it is written: it is simpler in terms of one than of a potential."""
    if len(leak) > 1 or len(gain) > 1:
        return False
    return len(term.times(gain[0], -1).powers) < len(term.times(leak[0], -1).powers)


def _spike(d: Definition, potential: str) -> dict[str, Tree]:
    """The threshold, the reset and the refractory period."""
    if d.threshold is None:
        raise ModelError("it has no threshold", hint=f"add threshold: {potential} >= V_th")
    tree = d.threshold.tree
    assert isinstance(tree, Binary)
    parameters = {*d.parameters}
    limit = d.full(tree.right)
    if tree.sign != ">=" or not (isinstance(tree.left, Name) and tree.left.name == potential):
        raise ModelError(f"its threshold is {d.threshold.text.strip()}", hint=f"write {potential} >= V_th")
    reset = {name: d.full(expression.tree) for name, expression in d.reset.items()}
    if [*reset] != [potential]:
        raise ModelError(f"a spike resets {', '.join(reset) or 'nothing'}", hint=f"reset {potential} alone")
    for what, of in (("threshold", limit), (f"reset of {potential}", reset[potential])):
        moving = [name for name in algebra.names(of) if name not in parameters and name not in UNITS]
        if moving:
            raise ModelError(f"its {what} follows {moving[0]}", hint="use parameters alone")
    if d.hold is not None and potential not in d.hold:
        raise ModelError(f"{potential} is not held while it is refractory", hint=f"write hold: [{potential}]")
    period = Name("t_ref", 0) if d.hold is not None else algebra.ZERO
    return {"V_th": limit, "V_reset": reset[potential], "t_ref": period}


MOST = 64
"""Products of one sum; a longer one stays as it is, a factor."""


@dataclass(frozen=True)
class Product:
    """A number times powers of factors, each a name or a part that is no product, by its text."""

    number: float
    powers: Mapping[str, int]
    factors: Mapping[str, Tree]

    def times(self, other: Product, power: int = 1) -> Product:
        """The product with a power of another."""
        powers = {
            text: self.powers.get(text, 0) + power * other.powers.get(text, 0)
            for text in {**self.powers, **other.powers}
        }
        kept = {text: power for text, power in powers.items() if power}
        return Product(self.number * other.number**power, kept, {**self.factors, **other.factors})

    def tree(self) -> Tree:
        """It as a tree."""
        over: Tree = ONE if self.number == 1.0 else Number(self.number, "", 0)
        under: Tree = ONE
        for text, power in self.powers.items():
            for _ in range(abs(power)):
                if power > 0:
                    over = multiplied(over, self.factors[text])
                else:
                    under = multiplied(under, self.factors[text])
        return over if under == ONE else divided(over, under)


UNITY = Product(1.0, {}, {})


def products(tree: Tree, parameters: Iterable[str]) -> list[Product]:
    """The products of which a tree is the sum; what is no parameter is a unit."""
    return _products(tree, set(parameters))


def ratio(found: list[Product], by: list[Product]) -> Tree:
    """The sum of products divided by the sum of others, as a tree; common factors are left out if that is one."""
    if len(by) == 1:
        return _summed(x.times(by[0], -1) for x in found)
    return divided(_summed(found), _summed(by))


def same(a: list[Product], b: list[Product]) -> bool:
    """Whether two sums are the same, term by term."""
    return {(x.number, frozenset(x.powers.items())) for x in a} == {(x.number, frozenset(x.powers.items())) for x in b}


def _summed(found: Iterable[Product]) -> Tree:
    whole: Tree = ZERO
    for product in found:
        whole = added(whole, product.tree())
    return whole


def _products(tree: Tree, known: set[str]) -> list[Product]:
    match tree:
        case Number(value, unit):
            return [Product(value * UNITS[unit][0] if unit else value, {}, {})] if value else []
        case Name(name) if name not in known:
            return [Product(UNITS[name][0], {}, {})]
        case Negative(of):
            return _negative(_products(of, known))
        case Binary("+" | "-" as sign, left, right):
            others = _products(right, known)
            found = [*_products(left, known), *(others if sign == "+" else _negative(others))]
        case Binary("*", left, right):
            a, b = _products(left, known), _products(right, known)
            found = [x.times(y) for x in a for y in b] if len(a) * len(b) <= MOST else [_factor(tree)]
        case Binary("/", left, right):
            by = _products(right, known)
            found = [x.times(by[0] if len(by) == 1 else _factor(right), -1) for x in _products(left, known)]
        case Name() | Call() | Binary():
            found = [_factor(tree)]
    # Products of the same powers become one; those that are 0 go.
    by_powers: dict[frozenset[tuple[str, int]], Product] = {}
    for x in found:
        key = frozenset(x.powers.items())
        before = by_powers[key].number if key in by_powers else 0.0
        by_powers[key] = Product(before + x.number, x.powers, x.factors)
    return [x for x in by_powers.values() if x.number != 0.0]


def _factor(tree: Tree) -> Product:
    text = text_of(tree)
    return Product(1.0, {text: 1}, {text: tree})


def _negative(found: list[Product]) -> list[Product]:
    return [Product(-x.number, x.powers, x.factors) for x in found]
