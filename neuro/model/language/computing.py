"""Expressions between the brackets of `$(...)`: numbers and units, computed."""

from __future__ import annotations

import math
from collections.abc import Callable, Container
from dataclasses import dataclass
from fractions import Fraction

from neuro.core.errors import nearest
from neuro.core.grammar import Binary, Call, Expression, Hints, Name, Negative, Number, Tree, parse
from neuro.core.units import NONE, TENS, Dimension, scaled, times, told, unit_of

_HINTS = Hints(
    {"$": "inside the brackets names stand without $", "=": "only values are computed", "%": "write /100"},
    "give parts of it a name in 'parameters'",
)
FUNCTIONS = ("sqrt", "exp", "log", "round", "min", "max")


@dataclass(frozen=True, slots=True)
class Measure:
    """A number, in mV, ms and pA, and its dimension."""

    value: float
    dimension: Dimension = NONE

    def written(self) -> float | str:
        """As a description says it."""
        return self.value if self.dimension == NONE else f"{self.value!r} {unit_of(self.dimension).replace(' ', '*')}"


def computed(text: str, named: Callable[[Expression, Name], Measure], known: Container[str]) -> float | str:
    """The value of an expression, with its unit if it has one.

    Args:
        text: what stands between the brackets.
        named: gives the value of a name.
        known: all names.

    Raises:
        Misread: it is no expression, or has no finite value; it names the place.
    """
    whole = parse(text, _HINTS)
    return _Value(whole, named, known).of(whole.tree).written()


class _Value:
    def __init__(self, whole: Expression, named: Callable[[Expression, Name], Measure], known: Container[str]) -> None:
        self.whole, self.named, self.known = whole, named, known

    def of(self, tree: Tree) -> Measure:
        match tree:
            case Number(value, ""):
                return Measure(value)
            case Number(value, unit):
                if unit not in TENS:
                    message = f"found '{unit}' after a number: expected a unit or an operator"
                    hint = f"write *{unit}" if unit in self.known else nearest(unit, TENS)
                    raise self.whole.mistake(tree.at, message, hint)
                tens, dimension = TENS[unit]
                return self._finite(tree.at, scaled(repr(value), tens), dimension)
            case Name():
                return self.named(self.whole, tree)
            case Negative(of):
                inner = self.of(of)
                return Measure(-inner.value, inner.dimension)
            case Call():
                return self._call(tree)
            case Binary("^"):
                return self._power(tree)
            case Binary("*" | "/" as sign, left, right):
                return self._product(tree, sign, self.of(left), self.of(right))
            case Binary("+" | "-" as sign, left, right):
                a, b = self.of(left), self.of(right)
                self._alike(tree.at, a, b)
                return self._finite(tree.at, a.value + b.value if sign == "+" else a.value - b.value, a.dimension)
            case Binary(sign):
                raise self.whole.mistake(tree.at, f"found '{sign}': expected + - * / or **")

    def _product(self, tree: Binary, sign: str, a: Measure, b: Measure) -> Measure:
        if sign == "*":
            return self._finite(tree.at, a.value * b.value, times(a.dimension, b.dimension))
        if b.value == 0.0:
            raise self.whole.mistake(tree.at, "a division by 0: expected another divisor")
        return self._finite(tree.at, a.value / b.value, times(a.dimension, b.dimension, -1))

    def _power(self, tree: Binary) -> Measure:
        if self.whole.text[tree.at] == "^":
            raise self.whole.mistake(tree.at, "found '^': expected + - * / or **", "a power is written **")
        a, b = self.of(tree.left), self.of(tree.right)
        if b.dimension != NONE:
            message = f"an exponent {told(b.dimension)}: expected a number without unit"
            raise self.whole.mistake(tree.at, message)
        dimension = NONE
        if a.dimension != NONE:
            if b.value not in (-3.0, -2.0, -1.0, 0.5, 1.0, 2.0, 3.0):
                message = f"the power {b.value:g} of a value {told(a.dimension)}: expected -3 to 3 or 0.5"
                raise self.whole.mistake(tree.at, message)
            dimension = times(NONE, a.dimension, Fraction(b.value))
        if (a.value == 0.0 and b.value < 0.0) or (a.value < 0.0 and not b.value.is_integer()):
            raise self.whole.mistake(tree.at, f"{a.value:g}**{b.value:g} is no number")
        try:
            return self._finite(tree.at, a.value**b.value, dimension)
        except OverflowError:
            return self._finite(tree.at, math.inf, dimension)

    def _call(self, tree: Call) -> Measure:
        if tree.name not in FUNCTIONS:
            raise self.whole.mistake(tree.at, f"unknown function '{tree.name}'", nearest(tree.name, FUNCTIONS))
        found = [self.of(argument) for argument in tree.arguments]
        if tree.name in ("min", "max"):
            for other in found[1:]:
                self._alike(tree.at, found[0], other)
            best = min if tree.name == "min" else max
            return Measure(best(measure.value for measure in found), found[0].dimension)
        if len(found) != 1:
            raise self.whole.mistake(tree.at, f"{tree.name} takes 1 value: found {len(found)}")
        x = found[0]
        if tree.name == "sqrt":
            if x.value < 0.0:
                raise self.whole.mistake(tree.at, f"sqrt({x.value:g}) is no number: expected at least 0")
            return Measure(math.sqrt(x.value), times(NONE, x.dimension, Fraction(1, 2)))
        if x.dimension != NONE:
            message = f"{tree.name} of a value {told(x.dimension)}: expected a number without unit"
            raise self.whole.mistake(tree.at, message)
        if tree.name == "round":
            return Measure(float(round(x.value)))
        if tree.name == "log":
            if x.value <= 0.0:
                raise self.whole.mistake(tree.at, f"log({x.value:g}) is no number: expected more than 0")
            return Measure(math.log(x.value))
        return self._finite(tree.at, math.exp(x.value) if x.value < 709.0 else math.inf, NONE)

    def _alike(self, at: int, a: Measure, b: Measure) -> None:
        if a.dimension != b.dimension:
            message = f"a value {told(a.dimension)} and one {told(b.dimension)}: expected the same unit"
            raise self.whole.mistake(at, message)

    def _finite(self, at: int, value: float, dimension: Dimension) -> Measure:
        if not math.isfinite(value):
            raise self.whole.mistake(at, "the result is no finite number: expected one below 1.8e308")
        return Measure(value, dimension)
