"""Arithmetic in `$(...)`: expressions of numbers, units and parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Container
from dataclasses import dataclass
from fractions import Fraction

from neuro.core.errors import nearest
from neuro.core.grammar import Binary, Call, Expression, Hints, Name, Negative, Number, Tree, parse
from neuro.core.units import NONE, TENS, Dimension, phrase_of, scaled, times, unit_of

_HINTS = Hints(
    {"$": "write names without $ inside the brackets", "=": "write an expression without =", "%": "write /100"},
    "split the expression into several parameters",
)
FUNCTIONS = ("sqrt", "exp", "log", "round", "min", "max")


@dataclass(frozen=True, slots=True)
class Measure:
    """A number in the base units (mV, ms, pA, ...) and its dimension."""

    value: float
    dimension: Dimension = NONE

    def as_value(self) -> float | str:
        """Return the number, or text with number and unit such as "2.5 mV"."""
        return self.value if self.dimension == NONE else f"{self.value!r} {unit_of(self.dimension).replace(' ', '*')}"


def evaluate(text: str, lookup: Callable[[Expression, Name], Measure], names: Container[str]) -> float | str:
    """Return the value of an expression, with the unit if there is one.

    Args:
        text: the expression between the brackets.
        lookup: returns the value of a name.
        names: all names, for hints.

    Raises:
        Misread: the text is not an expression, or its value is not finite. The error has the position in the text.
    """
    expression = parse(text, _HINTS)
    return _Evaluator(expression, lookup, names).evaluate(expression.tree).as_value()


class _Evaluator:
    def __init__(
        self, expression: Expression, lookup: Callable[[Expression, Name], Measure], names: Container[str]
    ) -> None:
        self.expression, self.lookup, self.names = expression, lookup, names

    def evaluate(self, tree: Tree) -> Measure:
        match tree:
            case Number(value, ""):
                return Measure(value)
            case Number(value, unit):
                if unit not in TENS:
                    message = f"found '{unit}' after a number: expected a unit or an operator"
                    hint = f"write *{unit}" if unit in self.names else nearest(unit, TENS)
                    raise self.expression.mistake(tree.at, message, hint)
                tens, dimension = TENS[unit]
                return self._finite(tree.at, scaled(repr(value), tens), dimension)
            case Name():
                return self.lookup(self.expression, tree)
            case Negative(of):
                inner = self.evaluate(of)
                return Measure(-inner.value, inner.dimension)
            case Call():
                return self._call(tree)
            case Binary("^"):
                return self._power(tree)
            case Binary("*" | "/" as sign, left, right):
                return self._product(tree, sign, self.evaluate(left), self.evaluate(right))
            case Binary("+" | "-" as sign, left, right):
                a, b = self.evaluate(left), self.evaluate(right)
                self._check_same_unit(tree.at, a, b)
                return self._finite(tree.at, a.value + b.value if sign == "+" else a.value - b.value, a.dimension)
            case Binary(sign):
                raise self.expression.mistake(tree.at, f"found '{sign}': expected + - * / or **")

    def _product(self, tree: Binary, sign: str, a: Measure, b: Measure) -> Measure:
        if sign == "*":
            return self._finite(tree.at, a.value * b.value, times(a.dimension, b.dimension))
        if b.value == 0.0:
            raise self.expression.mistake(tree.at, "division by 0: expected another divisor")
        return self._finite(tree.at, a.value / b.value, times(a.dimension, b.dimension, -1))

    def _power(self, tree: Binary) -> Measure:
        if self.expression.text[tree.at] == "^":
            raise self.expression.mistake(tree.at, "found '^': expected + - * / or **", "a power is written **")
        a, b = self.evaluate(tree.left), self.evaluate(tree.right)
        if b.dimension != NONE:
            message = f"an exponent {phrase_of(b.dimension)}: expected a number without unit"
            raise self.expression.mistake(tree.at, message)
        dimension = NONE
        if a.dimension != NONE:
            if b.value not in (-3.0, -2.0, -1.0, 0.5, 1.0, 2.0, 3.0):
                message = f"the power {b.value:g} of a value {phrase_of(a.dimension)}: expected -3 to 3 or 0.5"
                raise self.expression.mistake(tree.at, message)
            dimension = times(NONE, a.dimension, Fraction(b.value))
        if (a.value == 0.0 and b.value < 0.0) or (a.value < 0.0 and not b.value.is_integer()):
            raise self.expression.mistake(tree.at, f"{a.value:g}**{b.value:g} is undefined: expected a real number")
        try:
            return self._finite(tree.at, a.value**b.value, dimension)
        except OverflowError:
            return self._finite(tree.at, math.inf, dimension)

    def _call(self, tree: Call) -> Measure:
        if tree.name not in FUNCTIONS:
            raise self.expression.mistake(tree.at, f"unknown function '{tree.name}'", nearest(tree.name, FUNCTIONS))
        values = [self.evaluate(argument) for argument in tree.arguments]
        if tree.name in ("min", "max"):
            for other in values[1:]:
                self._check_same_unit(tree.at, values[0], other)
            choose = min if tree.name == "min" else max
            return Measure(choose(measure.value for measure in values), values[0].dimension)
        if len(values) != 1:
            raise self.expression.mistake(tree.at, f"{tree.name} takes 1 value: found {len(values)}")
        x = values[0]
        if tree.name == "sqrt":
            if x.value < 0.0:
                raise self.expression.mistake(tree.at, f"sqrt({x.value:g}) is undefined: expected at least 0")
            return Measure(math.sqrt(x.value), times(NONE, x.dimension, Fraction(1, 2)))
        if x.dimension != NONE:
            message = f"{tree.name} of a value {phrase_of(x.dimension)}: expected a number without unit"
            raise self.expression.mistake(tree.at, message)
        if tree.name == "round":
            return Measure(float(round(x.value)))
        if tree.name == "log":
            if x.value <= 0.0:
                raise self.expression.mistake(tree.at, f"log({x.value:g}) is undefined: expected more than 0")
            return Measure(math.log(x.value))
        return self._finite(tree.at, math.exp(x.value) if x.value < 709.0 else math.inf, NONE)

    def _check_same_unit(self, at: int, a: Measure, b: Measure) -> None:
        if a.dimension != b.dimension:
            message = f"a value {phrase_of(a.dimension)} and one {phrase_of(b.dimension)}: expected the same unit"
            raise self.expression.mistake(at, message)

    def _finite(self, at: int, value: float, dimension: Dimension) -> Measure:
        if not math.isfinite(value):
            raise self.expression.mistake(at, "the result is not finite: expected a number below 1.8e308")
        return Measure(value, dimension)
