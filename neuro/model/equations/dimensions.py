"""Checks of dimensions: the terms of a sum, and the sides of a comparison or an equation, must have equal dimensions.

The dimensions of parameters are known, and those of states are derived, so states need no declared unit. Each sum,
comparison and equation requires that two dimensions are equal. This gives a linear equation for the powers of the
unknown dimensions, which is solved before the next part is read: from `a + x` with a in mV follows x in mV.

A mistake is recorded, and the wrong part then has an unknown dimension, so the check goes on to the next mistake. If
the terms of a sum differ, the context of the sum decides which of them are wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from typing import Self

from neuro.core.errors import ModelError
from neuro.core.grammar import COMPARISONS, Binary, Call, Expression, Misread, Name, Negative, Number, Tree
from neuro.core.hints import nearest
from neuro.core.units import NONE, UNITS, Dimension, phrase_of, times, unit_of
from neuro.model.equations.functions import ARGUMENTS
from neuro.model.equations.parameters import FUNCTION_HINTS, NAME_HINTS

_MAX_POWER = 100
_KEEP_DIMENSION = {"min", "max", "abs", "where"}
"""Functions whose result has the dimension of their arguments. Other functions map numbers to numbers."""


@dataclass(frozen=True)
class Powers:
    """A known dimension times powers of unknown dimensions, e.g. ms times the square of the dimension of w."""

    known: Dimension
    unknown: Mapping[str, Fraction]

    def times(self, other: Powers, power: Fraction | int = 1) -> Powers:
        """Return the product of this dimension and a power of another dimension."""
        names = dict.fromkeys((*self.unknown, *other.unknown))
        powers = {n: self.unknown.get(n, Fraction(0)) + power * other.unknown.get(n, Fraction(0)) for n in names}
        return Powers(times(self.known, other.known, power), {n: p for n, p in powers.items() if p})


@dataclass(frozen=True)
class Sum:
    """A sum or a comparison whose terms have different dimensions.

    Attributes:
        expression: the expression.
        terms: for each term the sign before it (None for the first), the term and its dimension.
        dimension: the dimension of the sum, which follows from its context.
    """

    expression: Expression
    terms: tuple[tuple[Binary | None, Tree, Powers], ...]
    dimension: Powers


class Dimensions:
    """The dimensions of all names of a model, derived step by step.

    Args:
        known: dimensions of parameters and of the current.
        unknown: names whose dimensions are derived.
    """

    def __init__(self, known: Mapping[str, Dimension], unknown: tuple[str, ...]) -> None:
        self.names = {name: Powers(dimension, {}) for name, dimension in known.items()}
        self.names |= {name: Powers(NONE, {name: Fraction(1)}) for name in unknown}
        self.solved: dict[str, Powers] = {}
        self.count = count()
        self.path: tuple[str, ...] = ()
        self.mistakes: list[tuple[tuple[str, ...], ModelError | Sum]] = []

    def only(self, names: Mapping[str, object]) -> Self:
        """Return a copy that knows only some of the names."""
        restricted = copy(self)
        restricted.names = {name: powers for name, powers in self.names.items() if name in names}
        return restricted

    @contextmanager
    def under_path(self, *path: str) -> Iterator[None]:
        """Set the path of an expression within the words, and record a mistake that is raised inside."""
        previous_path, self.path = self.path, path
        try:
            yield
        except ModelError as error:
            self.mistakes.append((path, error))
        self.path = previous_path

    def refuse(self) -> None:
        """Raise the recorded mistakes.

        Raises:
            ModelError: the first mistake. The attribute `others` has the other mistakes.
        """
        refuse(with_path(error, path) for path, mistake in self.mistakes for error in self._errors(mistake))

    def _errors(self, mistake: ModelError | Sum) -> Iterator[ModelError]:
        """Yield an error for each term whose dimension differs from the sum's.

        If the dimension of the sum is unknown, the first term with a known dimension decides.
        """
        if isinstance(mistake, ModelError):
            yield mistake
            return
        candidates = map(self.reduced, (mistake.dimension, *(powers for _, _, powers in mistake.terms)))
        expected = next(
            (
                expected
                for expected in candidates
                if not expected.unknown and all(p.denominator == 1 for p in expected.known)
            ),
            mistake.dimension,
        )
        is_first = True
        for sign, tree, powers in mistake.terms:
            if self.same(powers, expected):
                continue
            place, message = (
                _begin(tree),
                f"'{text_of(tree)}' is {self.text(powers)}: expected it {self.text(expected)}",
            )
            if is_first and sign is not None:
                left, right = (
                    f"'{text_of(sign.left)}' is {self.text(expected)}",
                    f"'{text_of(tree)}' {self.text(powers)}",
                )
                place, message = sign.at, f"{left}, {right}: expected the same unit"
            is_first = False
            yield mistake.expression.mistake(place, message, self.factor(mistake.expression, tree, powers, expected))

    def unknown(self, what: str) -> Powers:
        """Return a new unknown dimension, to be derived from the context."""
        return Powers(NONE, {f"{what} {next(self.count)}": Fraction(1)})

    def mistake(self, error: ModelError) -> Powers:
        """Record a mistake. Return an unknown dimension for the wrong part."""
        self.mistakes.append((self.path, error))
        return self.unknown("mistake")

    def factor(self, expression: Expression, tree: Tree, dimension: Powers, expected: Powers) -> str:
        """Return a hint with the unit by which a part must be multiplied to get the expected dimension, or ""."""
        missing = self.reduced(expected.times(dimension, -1))
        if missing.unknown:
            return ""
        unit = unit_of(missing.known)
        if _number(tree) is None or any(power.denominator > 1 for power in missing.known):
            part = "the expression" if tree is expression.tree else f"'{text_of(tree)}'"
            return f"multiply {part} by a number in {unit}"
        numerator, _, divisor = unit.replace(" ", "*").partition("/")
        return f"write {text_of(tree)}{f' {numerator}' * (numerator != '1')}{f'/{divisor}' * bool(divisor)}"

    def dimension(self, name: str) -> Dimension | None:
        """Return the dimension of a name, or None if it is unknown."""
        powers = self.reduced(self.names[name])
        return None if powers.unknown else powers.known

    def check(self, expression: Expression, expected: Powers) -> None:
        """Check that an expression has a dimension. A mistake is recorded with both dimensions and the column."""
        dimension = self.powers(expression, expression.tree, expected)
        if not self.same(dimension, expected):
            message = f"found an expression {self.text(dimension)}: expected an expression {self.text(expected)}"
            hint = self.factor(expression, expression.tree, dimension, expected)
            self.mistake(expression.mistake(_begin(expression.tree), message, hint))

    def name(self, name: str, power_of_time: int = 0) -> Powers:
        """Return the dimension of a name times a power of time, e.g. power -1 for a derivative."""
        time = (Fraction(0), Fraction(power_of_time), Fraction(0))
        return self.names[name].times(Powers(time, {}))

    def reduced(self, powers: Powers) -> Powers:
        """Replace solved unknowns in a dimension by their solutions."""
        while name := next((n for n in powers.unknown if n in self.solved), ""):
            power = powers.unknown[name]
            other_powers = {n: p for n, p in powers.unknown.items() if n != name}
            powers = Powers(powers.known, other_powers).times(self.solved[name], power)
        return powers

    def same(self, a: Powers, b: Powers) -> bool:
        """Return whether two dimensions can be equal. An unknown dimension in them is then solved for."""
        quotient = self.reduced(a.times(b, -1))
        if not quotient.unknown:
            return quotient.known == NONE
        name, power = list(quotient.unknown.items())[-1]
        other_powers = Powers(quotient.known, {n: p for n, p in quotient.unknown.items() if n != name})
        self.solved[name] = Powers(NONE, {}).times(other_powers, -1 / power)
        return True

    def text(self, powers: Powers) -> str:
        """Return a dimension as text for messages, such as "in mV"."""
        powers = self.reduced(powers)
        return phrase_of(powers.known) if not powers.unknown else "in a unit that nothing determines"

    def powers(self, expression: Expression, tree: Tree, expected: Powers | None = None) -> Powers:
        """Return the dimension of a part of an expression, and record mistakes in it.

        `expected` is the dimension of the context.
        """
        match tree:
            case Number(0.0, ""):
                return self.unknown("0 number")
            case Number(_, ""):
                return Powers(NONE, {})
            case Number(_, unit):
                if unit not in UNITS:
                    hint = f"write *{unit}" if unit in self.names else nearest(unit, UNITS)
                    message = f"found '{unit}' after a number: expected a unit or an operator"
                    return self.mistake(expression.mistake(tree.at, message, hint))
                return Powers(UNITS[unit][1], {})
            case Name(name):
                return self._name_powers(expression, name, tree.at)
            case Negative(of):
                return self.powers(expression, of)
            case Call():
                return self._call_powers(expression, tree)
            case Binary("^"):
                return self._power_powers(expression, tree)
            case Binary("*" | "/" as sign, left, right):
                return self.powers(expression, left).times(self.powers(expression, right), 1 if sign == "*" else -1)
            case Binary(sign) if sign in COMPARISONS:
                self._common_dimension(expression, [(None, tree.left), (tree, tree.right)])
                return Powers(NONE, {})
            case Binary():
                return self._common_dimension(expression, list(_terms(tree)), expected)

    def _name_powers(self, expression: Expression, name: str, at: int) -> Powers:
        if name in self.names:
            return self.names[name]
        if name in UNITS:
            return Powers(UNITS[name][1], {})
        if name in ARGUMENTS:
            message, hint = f"found '{name}' alone: expected its arguments", f"write {name}(...)"
        else:
            message, hint = f"unknown name '{name}'", NAME_HINTS.get(name) or nearest(name, self.names)
        return self.mistake(expression.mistake(at, message, hint))

    def _common_dimension(
        self, expression: Expression, terms: list[tuple[Binary | None, Tree]], expected: Powers | None = None
    ) -> Powers:
        """Return the common dimension of all terms. Terms of unknown dimension get the same dimension."""
        terms_with_powers = [(sign, tree, self.powers(expression, tree)) for sign, tree in terms]
        dimensions = [self.reduced(powers) for _, _, powers in terms_with_powers]
        common = next((powers for powers in dimensions if not powers.unknown), dimensions[0])
        if expected is not None and not self.reduced(expected).unknown and any(powers.unknown for powers in dimensions):
            common = self.reduced(expected)
        if any(not powers.unknown and powers != common for powers in dimensions):
            common = self.unknown("sum") if expected is None else expected
            self.mistakes.append((self.path, Sum(expression, tuple(terms_with_powers), common)))
            dimensions = [powers for powers in dimensions if powers.unknown]
        for powers in dimensions:
            self.same(powers, common)
        return common

    def _without_unit(self, expression: Expression, tree: Tree, dimension: Powers, at: int, label: str) -> None:
        """Record a mistake unless a part of an expression is a number without unit."""
        if not self.same(dimension, Powers(NONE, {})):
            hint = self.factor(expression, tree, dimension, Powers(NONE, {}))
            message = label.format(text_of(tree), self.text(dimension))
            self.mistake(expression.mistake(at, f"{message}: expected a number without unit", hint))

    def _call_powers(self, expression: Expression, tree: Call) -> Powers:
        if tree.name not in ARGUMENTS:
            if tree.name in self.names:
                message, hint = f"'{tree.name}' is not a function", f"write {tree.name}*(...)"
            else:
                message = f"unknown function '{tree.name}'"
                hint = FUNCTION_HINTS.get(tree.name) or nearest(tree.name, ARGUMENTS)
            return self.mistake(expression.mistake(tree.at, message, hint))
        count = ARGUMENTS[tree.name]
        if len(tree.arguments) != count:
            return self.mistake(expression.mistake(tree.at, f"{tree.name} takes {count}: found {len(tree.arguments)}"))
        arguments = tree.arguments
        if tree.name == "where":
            if not is_comparison(arguments[0]):
                self.mistake(expression.mistake(_begin(arguments[0]), "expected a comparison, e.g. V_m > 0 mV"))
            self.powers(expression, arguments[0])
            arguments = arguments[1:]
        if tree.name not in _KEEP_DIMENSION:
            dimension = self.powers(expression, arguments[0])
            self._without_unit(expression, arguments[0], dimension, tree.at, f"{tree.name} of '{{}}', which is {{}}")
            return Powers(NONE, {})
        if len(arguments) == 1:
            return self.powers(expression, arguments[0])
        left, right = arguments
        return self._common_dimension(expression, [(None, left), (Binary(",", left, right, tree.at), right)])

    def _power_powers(self, expression: Expression, tree: Binary) -> Powers:
        base, exponent = self.powers(expression, tree.left), self.powers(expression, tree.right)
        self._without_unit(expression, tree.right, exponent, tree.at, "an exponent {1}")
        number = _number(tree.right)
        if number is None:
            self._without_unit(expression, tree.left, base, tree.at, "'{}' is {} and its exponent is not a number")
            return Powers(NONE, {})
        if abs(number) > _MAX_POWER:
            message = f"an exponent of {number:g}: expected at most {_MAX_POWER}"
            return self.mistake(expression.mistake(tree.at, message))
        return Powers(NONE, {}).times(base, Fraction(number).limit_denominator(1000))


def refuse(errors: Iterable[ModelError]) -> None:
    """Raise the first of several errors, with the other errors as its `others`. Do nothing if there are none."""
    all_errors = [*errors]
    if all_errors:
        all_errors[0].others = tuple(all_errors[1:])
        raise all_errors[0]


def with_path(error: ModelError, path: tuple[str, ...]) -> ModelError:
    """Return an error with a path of words before the message and the path of the error."""
    message = f"{'.'.join(path)}{', ' if isinstance(error, Misread) else ': '}{error.message}"
    return error.but(message=message, path=(*path, *error.path))


def _terms(tree: Tree) -> Iterator[tuple[Binary | None, Tree]]:
    """Yield the terms of a sum, each with the sign before it."""
    if isinstance(tree, Binary) and tree.sign in ("+", "-"):
        yield from _terms(tree.left)
        yield tree, tree.right
    else:
        yield None, tree


def is_comparison(tree: Tree) -> bool:
    """Return whether a tree is a comparison."""
    return isinstance(tree, Binary) and tree.sign in COMPARISONS


def refuse_inner_comparisons(whole: Expression, tree: Tree, allowed: bool = False) -> None:
    """Raise an error for a comparison, except in a threshold and in the first argument of `where`.

    Raises:
        ModelError: a comparison is in another place.
    """
    match tree:
        case Binary(sign, left, right):
            if sign in COMPARISONS and not allowed:
                raise whole.mistake(tree.at, f"found '{sign}': expected a value", "write where(a > b, value, other)")
            refuse_inner_comparisons(whole, left)
            refuse_inner_comparisons(whole, right)
        case Negative(of):
            refuse_inner_comparisons(whole, of)
        case Call(name, arguments):
            for k, argument in enumerate(arguments):
                refuse_inner_comparisons(whole, argument, name == "where" and k == 0)


def _number(tree: Tree) -> float | None:
    match tree:
        case Number(value, ""):
            return value
        case Negative(Number(value, "")):
            return -value
    return None


def _begin(tree: Tree) -> int:
    return _begin(tree.left) if isinstance(tree, Binary) else tree.at


def text_of(tree: Tree) -> str:
    """Return a tree as text, without redundant brackets."""
    match tree:
        case Number(value, unit):
            return f"{value:g} {unit}".strip()
        case Name(name):
            return name
        case Negative(of):
            return f"-{_bracketed(of, 4)}"
        case Call(name, arguments):
            return f"{name}({', '.join(map(text_of, arguments))})"
        case Binary(sign, left, right):
            binding = _BINDING[sign]
            space = " " if binding < 3 else ""
            return f"{_bracketed(left, binding)}{space}{sign}{space}{_bracketed(right, binding + 1)}"


_BINDING = {**dict.fromkeys(COMPARISONS, 1), "+": 2, "-": 2, "*": 3, "/": 3, "^": 5}


def _bracketed(tree: Tree, binding: int) -> str:
    own_binding = _BINDING[tree.sign] if isinstance(tree, Binary) else (4 if isinstance(tree, Negative) else 6)
    return f"({text_of(tree)})" if own_binding < binding else text_of(tree)


def unit_unknown(name: str) -> ModelError:
    """Return the error for a state with a unit that cannot be derived."""
    message = f"nothing determines the unit of '{name}'"
    hint = f"write a value with a unit in 'initial', e.g. {{{name}: 0 mV}}"
    return ModelError(message, hint=hint, path=(name,), about=("initial", name))
