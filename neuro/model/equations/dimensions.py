"""Whether the terms of every sum, both sides of every comparison and of every equation have one dimension.

The dimensions of parameters are known, those of states follow: each sum, comparison and equation is one linear
equation between powers, solved as it is met. So no state needs a unit of its own.

A mistake is kept and its dimension taken as unknown. So all mistakes are found, and what is around a sum tells which of
its terms are wrong.
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
from neuro.core.units import NONE, UNITS, Dimension, times, told, unit_of
from neuro.model.equations.functions import ARGUMENTS
from neuro.model.equations.parameters import FUNCTION_HINTS, NAME_HINTS

_MAX_POWER = 100
_SAME = {"min", "max", "abs", "where"}
"""Functions whose result has the dimension of their arguments; the others take and give numbers."""


@dataclass(frozen=True)
class Powers:
    """A dimension of which a part is not known yet: what is known times powers of unknown ones."""

    known: Dimension
    unknown: Mapping[str, Fraction]

    def times(self, other: Powers, power: Fraction | int = 1) -> Powers:
        """The dimension of a product of this and a power of another."""
        names = dict.fromkeys((*self.unknown, *other.unknown))
        powers = {n: self.unknown.get(n, Fraction(0)) + power * other.unknown.get(n, Fraction(0)) for n in names}
        return Powers(times(self.known, other.known, power), {n: p for n, p in powers.items() if p})


@dataclass(frozen=True)
class Sum:
    """A sum or a comparison whose terms differ.

    Attributes:
        terms: with the signs before them (the first has none) and their dimensions.
        of: the dimension of the sum, which what is around it tells.
    """

    whole: Expression
    terms: tuple[tuple[Binary | None, Tree, Powers], ...]
    of: Powers


class Dimensions:
    """The dimensions of all names of a model, found by and by.

    Args:
        known: those of parameters and of the current.
        unknown: names whose dimension follows from what is checked.
    """

    def __init__(self, known: Mapping[str, Dimension], unknown: tuple[str, ...]) -> None:
        self.names = {name: Powers(dimension, {}) for name, dimension in known.items()}
        self.names |= {name: Powers(NONE, {name: Fraction(1)}) for name in unknown}
        self.found: dict[str, Powers] = {}
        self.count = count()
        self.path: tuple[str, ...] = ()
        self.wrong: list[tuple[tuple[str, ...], ModelError | Sum]] = []

    def only(self, names: Mapping[str, object]) -> Self:
        """The same, which knows some of the names."""
        fewer = copy(self)
        fewer.names = {name: powers for name, powers in self.names.items() if name in names}
        return fewer

    @contextmanager
    def at(self, *path: str) -> Iterator[None]:
        """Say where in the words an expression stands; a mistake in it is kept."""
        before, self.path = self.path, path
        try:
            yield
        except ModelError as error:
            self.wrong.append((path, error))
        self.path = before

    def refuse(self) -> None:
        """Raise what was kept.

        Raises:
            ModelError: the first mistake, with the others.
        """
        refuse(placed(error, path) for path, wrong in self.wrong for error in self._errors(wrong))

    def _errors(self, wrong: ModelError | Sum) -> Iterator[ModelError]:
        """What is wrong with each term that is not what the sum is, or else the first term that has a dimension."""
        if isinstance(wrong, ModelError):
            yield wrong
            return
        tells = map(self.reduced, (wrong.of, *(powers for _, _, powers in wrong.terms)))
        of = next((of for of in tells if not of.unknown and all(p.denominator == 1 for p in of.known)), wrong.of)
        so_far = True
        for sign, tree, powers in wrong.terms:
            if self.same(powers, of):
                continue
            place, message = _begin(tree), f"'{text_of(tree)}' is {self.told(powers)}: expected it {self.told(of)}"
            if so_far and sign is not None:
                left, right = f"'{text_of(sign.left)}' is {self.told(of)}", f"'{text_of(tree)}' {self.told(powers)}"
                place, message = sign.at, f"{left}, {right}: expected the same unit"
            so_far = False
            yield wrong.whole.mistake(place, message, self.factor(wrong.whole, tree, powers, of))

    def unknown(self, what: str) -> Powers:
        """A dimension that what is around it tells."""
        return Powers(NONE, {f"{what} {next(self.count)}": Fraction(1)})

    def mistake(self, error: ModelError) -> Powers:
        """Keep a mistake; the dimension of what is wrong may be any."""
        self.wrong.append((self.path, error))
        return self.unknown("mistake")

    def factor(self, whole: Expression, tree: Tree, found: Powers, expected: Powers) -> str:
        """How a part of an expression gets the dimension that is expected."""
        missing = self.reduced(expected.times(found, -1))
        if missing.unknown:
            return ""
        unit = unit_of(missing.known)
        if _number(tree) is None or any(power.denominator > 1 for power in missing.known):
            part = "the whole" if tree is whole.tree else f"'{text_of(tree)}'"
            return f"multiply {part} by a number in {unit}"
        over, _, under = unit.replace(" ", "*").partition("/")
        return f"write {text_of(tree)}{f' {over}' * (over != '1')}{f'/{under}' * bool(under)}"

    def of(self, name: str) -> Dimension | None:
        """The dimension of a name, None if it is unknown."""
        powers = self.reduced(self.names[name])
        return None if powers.unknown else powers.known

    def check(self, whole: Expression, expected: Powers) -> None:
        """An expression has a dimension; else that is kept with both dimensions and the column."""
        found = self.powers(whole, whole.tree, expected)
        if not self.same(found, expected):
            what = f"the whole is {self.told(found)}: expected it {self.told(expected)}"
            self.mistake(whole.mistake(_begin(whole.tree), what, self.factor(whole, whole.tree, found, expected)))

    def name(self, name: str, power_of_time: int = 0) -> Powers:
        """The dimension of a name, times a power of time."""
        time = (Fraction(0), Fraction(power_of_time), Fraction(0))
        return self.names[name].times(Powers(time, {}))

    def reduced(self, powers: Powers) -> Powers:
        """With what was found in place of the unknown."""
        while named := next((n for n in powers.unknown if n in self.found), ""):
            power = powers.unknown[named]
            rest = {n: p for n, p in powers.unknown.items() if n != named}
            powers = Powers(powers.known, rest).times(self.found[named], power)
        return powers

    def same(self, a: Powers, b: Powers) -> bool:
        """Whether two dimensions can be one; what follows from that is kept."""
        rest = self.reduced(a.times(b, -1))
        if not rest.unknown:
            return rest.known == NONE
        name, power = list(rest.unknown.items())[-1]
        others = Powers(rest.known, {n: p for n, p in rest.unknown.items() if n != name})
        self.found[name] = Powers(NONE, {}).times(others, -1 / power)
        return True

    def told(self, powers: Powers) -> str:
        """A dimension in a sentence."""
        powers = self.reduced(powers)
        return told(powers.known) if not powers.unknown else "in a unit that nothing determines"

    def powers(self, whole: Expression, tree: Tree, expected: Powers | None = None) -> Powers:
        """The dimension of a part of an expression, of which one may be expected; what is wrong with it is kept."""
        match tree:
            case Number(0.0, ""):
                return self.unknown("0 number")
            case Number(_, ""):
                return Powers(NONE, {})
            case Number(_, unit):
                if unit not in UNITS:
                    hint = f"write *{unit}" if unit in self.names else nearest(unit, UNITS)
                    message = f"found '{unit}' after a number: expected a unit or an operator"
                    return self.mistake(whole.mistake(tree.at, message, hint))
                return Powers(UNITS[unit][1], {})
            case Name(name):
                return self._of_name(whole, name, tree.at)
            case Negative(of):
                return self.powers(whole, of)
            case Call():
                return self._of_call(whole, tree)
            case Binary("^"):
                return self._of_power(whole, tree)
            case Binary("*" | "/" as sign, left, right):
                return self.powers(whole, left).times(self.powers(whole, right), 1 if sign == "*" else -1)
            case Binary(sign) if sign in COMPARISONS:
                self._alike(whole, [(None, tree.left), (tree, tree.right)])
                return Powers(NONE, {})
            case Binary():
                return self._alike(whole, list(_terms(tree)), expected)

    def _of_name(self, whole: Expression, name: str, at: int) -> Powers:
        if name in self.names:
            return self.names[name]
        if name in UNITS:
            return Powers(UNITS[name][1], {})
        if name in ARGUMENTS:
            message, hint = f"found '{name}' alone: expected its arguments", f"write {name}(...)"
        else:
            message, hint = f"unknown name '{name}'", NAME_HINTS.get(name) or nearest(name, self.names)
        return self.mistake(whole.mistake(at, message, hint))

    def _alike(
        self, whole: Expression, terms: list[tuple[Binary | None, Tree]], expected: Powers | None = None
    ) -> Powers:
        """The dimension that all terms have; those without one of their own take that of the others."""
        found = [(sign, tree, self.powers(whole, tree)) for sign, tree in terms]
        own = [self.reduced(powers) for _, _, powers in found]
        of = next((powers for powers in own if not powers.unknown), own[0])
        if expected is not None and not self.reduced(expected).unknown and any(powers.unknown for powers in own):
            of = self.reduced(expected)
        if any(not powers.unknown and powers != of for powers in own):
            of = self.unknown("sum") if expected is None else expected
            self.wrong.append((self.path, Sum(whole, tuple(found), of)))
            own = [powers for powers in own if powers.unknown]
        for powers in own:
            self.same(powers, of)
        return of

    def _without_unit(self, whole: Expression, tree: Tree, found: Powers, at: int, what: str) -> None:
        """A part of an expression is a number without unit."""
        if not self.same(found, Powers(NONE, {})):
            hint = self.factor(whole, tree, found, Powers(NONE, {}))
            message = what.format(text_of(tree), self.told(found))
            self.mistake(whole.mistake(at, f"{message}: expected a number without unit", hint))

    def _of_call(self, whole: Expression, tree: Call) -> Powers:
        if tree.name not in ARGUMENTS:
            if tree.name in self.names:
                message, hint = f"'{tree.name}' is no function", f"write {tree.name}*(...)"
            else:
                message = f"unknown function '{tree.name}'"
                hint = FUNCTION_HINTS.get(tree.name) or nearest(tree.name, ARGUMENTS)
            return self.mistake(whole.mistake(tree.at, message, hint))
        count = ARGUMENTS[tree.name]
        if len(tree.arguments) != count:
            return self.mistake(whole.mistake(tree.at, f"{tree.name} takes {count}: found {len(tree.arguments)}"))
        arguments = tree.arguments
        if tree.name == "where":
            if not is_comparison(arguments[0]):
                self.mistake(whole.mistake(_begin(arguments[0]), "expected a comparison, e.g. V_m > 0 mV"))
            self.powers(whole, arguments[0])
            arguments = arguments[1:]
        if tree.name not in _SAME:
            found = self.powers(whole, arguments[0])
            self._without_unit(whole, arguments[0], found, tree.at, f"{tree.name} of '{{}}', which is {{}}")
            return Powers(NONE, {})
        if len(arguments) == 1:
            return self.powers(whole, arguments[0])
        left, right = arguments
        return self._alike(whole, [(None, left), (Binary(",", left, right, tree.at), right)])

    def _of_power(self, whole: Expression, tree: Binary) -> Powers:
        base, exponent = self.powers(whole, tree.left), self.powers(whole, tree.right)
        self._without_unit(whole, tree.right, exponent, tree.at, "an exponent {1}")
        number = _number(tree.right)
        if number is None:
            self._without_unit(whole, tree.left, base, tree.at, "'{}' is {} and its exponent is not a number")
            return Powers(NONE, {})
        if abs(number) > _MAX_POWER:
            message = f"an exponent of {number:g}: expected at most {_MAX_POWER}"
            return self.mistake(whole.mistake(tree.at, message))
        return Powers(NONE, {}).times(base, Fraction(number).limit_denominator(1000))


def refuse(errors: Iterable[ModelError]) -> None:
    """Raise the first of some errors with the others, if there is one."""
    found = [*errors]
    if found:
        found[0].others = tuple(found[1:])
        raise found[0]


def placed(error: ModelError, path: tuple[str, ...]) -> ModelError:
    """An error with the place in the words before it."""
    message = f"{'.'.join(path)}{', ' if isinstance(error, Misread) else ': '}{error.message}"
    return error.but(message=message, path=(*path, *error.path))


def _terms(tree: Tree) -> Iterator[tuple[Binary | None, Tree]]:
    """The terms of a sum with the signs before them."""
    if isinstance(tree, Binary) and tree.sign in ("+", "-"):
        yield from _terms(tree.left)
        yield tree, tree.right
    else:
        yield None, tree


def is_comparison(tree: Tree) -> bool:
    """Whether a tree is a comparison."""
    return isinstance(tree, Binary) and tree.sign in COMPARISONS


def refuse_inner_comparisons(whole: Expression, tree: Tree, allowed: bool = False) -> None:
    """Comparisons stand first in `where` and in thresholds only.

    Raises:
        ModelError: one stands elsewhere.
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
    """A tree as text, without needless brackets."""
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
            mine = _BINDING[sign]
            space = " " if mine < 3 else ""
            return f"{_bracketed(left, mine)}{space}{sign}{space}{_bracketed(right, mine + 1)}"


_BINDING = {**dict.fromkeys(COMPARISONS, 1), "+": 2, "-": 2, "*": 3, "/": 3, "^": 5}


def _bracketed(tree: Tree, binding: int) -> str:
    own = _BINDING[tree.sign] if isinstance(tree, Binary) else (4 if isinstance(tree, Negative) else 6)
    return f"({text_of(tree)})" if own < binding else text_of(tree)


def unit_unknown(name: str) -> ModelError:
    """The error for a state of unknown unit."""
    message = f"nothing determines the unit of '{name}'"
    hint = f"write it in 'initial', e.g. {{{name}: 0 mV}}"
    return ModelError(message, hint=hint, path=(name,), about=("initial", name))
