"""Trees of parameters as sums of products of powers, in which a common factor can be divided out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from neuro.core.grammar import Binary, Call, Name, Negative, Number, Tree
from neuro.core.units import UNITS
from neuro.model.equations.algebra import ONE, ZERO, added, divided, multiplied
from neuro.model.equations.dimensions import text_of

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
        powers = {text: self.powers.get(text, 0) + power * other.powers.get(text, 0) for text in _texts(self, other)}
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


def products(tree: Tree, parameters: Iterable[str]) -> list[Product]:
    """The products of which a tree is the sum; what is no parameter is a unit."""
    known = set(parameters)
    return _products(tree, known)


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
    return _merged(found)


def _factor(tree: Tree) -> Product:
    text = text_of(tree)
    return Product(1.0, {text: 1}, {text: tree})


def _texts(a: Product, b: Product) -> list[str]:
    return list(dict.fromkeys((*a.powers, *b.powers)))


def _negative(found: list[Product]) -> list[Product]:
    return [Product(-x.number, x.powers, x.factors) for x in found]


def _merged(found: list[Product]) -> list[Product]:
    """Products of the same powers as one, without those that are 0."""
    by_powers: dict[frozenset[tuple[str, int]], Product] = {}
    for x in found:
        key = frozenset(x.powers.items())
        before = by_powers[key].number if key in by_powers else 0.0
        by_powers[key] = Product(before + x.number, x.powers, x.factors)
    return [x for x in by_powers.values() if x.number != 0.0]
