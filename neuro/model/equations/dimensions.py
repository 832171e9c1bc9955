"""Whether the two sides of every sum, comparison and equation have one dimension.

The dimensions of parameters are known, those of states follow: each sum, comparison and equation is one linear
equation between powers, solved as it is met. So no state needs a unit of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from neuro.core.errors import ModelError
from neuro.core.grammar import COMPARISONS, Binary, Call, Expression, Name, Negative, Number, Tree
from neuro.core.hints import nearest
from neuro.core.units import NONE, UNITS, Dimension, times, told
from neuro.model.equations import habits
from neuro.model.equations.functions import ARGUMENTS

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
        self.zeros = 0

    def of(self, name: str) -> Dimension | None:
        """The dimension of a name, None if nothing tells it."""
        powers = self.reduced(self.names[name])
        return None if powers.unknown else powers.known

    def check(self, whole: Expression, expected: Powers) -> None:
        """An expression has a dimension.

        Raises:
            ModelError: it has another one, or its parts do not fit; it tells both and the column.
        """
        found = self.powers(whole, whole.tree)
        if not self.same(found, expected):
            what = f"the whole is {self.told(found)}: expected it {self.told(expected)}"
            raise whole.mistake(_begin(whole.tree), what)

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
        return told(powers.known) if not powers.unknown else "in a unit that nothing tells"

    def powers(self, whole: Expression, tree: Tree) -> Powers:
        """The dimension of a part of an expression."""
        match tree:
            case Number(0.0, ""):
                self.zeros += 1
                return Powers(NONE, {f"0 number {self.zeros}": Fraction(1)})
            case Number(_, ""):
                return Powers(NONE, {})
            case Number(_, unit):
                if unit not in UNITS:
                    hint = f"write *{unit}" if unit in self.names else nearest(unit, UNITS)
                    raise whole.mistake(tree.at, f"found '{unit}' after a number: expected a unit or an operator", hint)
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
            case Binary(_, left, right):
                a, b = self.powers(whole, left), self.powers(whole, right)
                self._alike(whole, tree, a, b)
                return Powers(NONE, {}) if tree.sign in COMPARISONS else a

    def _of_name(self, whole: Expression, name: str, at: int) -> Powers:
        if name in self.names:
            return self.names[name]
        if name in UNITS:
            return Powers(UNITS[name][1], {})
        if name in ARGUMENTS:
            raise whole.mistake(at, f"found '{name}' alone: expected its arguments", f"write {name}(...)")
        raise whole.mistake(at, f"unknown name '{name}'", habits.NAMES.get(name) or nearest(name, self.names))

    def _alike(self, whole: Expression, tree: Binary, a: Powers, b: Powers) -> None:
        if not self.same(a, b):
            left, right = text_of(tree.left), text_of(tree.right)
            message = f"'{left}' is {self.told(a)}, '{right}' {self.told(b)}: expected the same unit"
            raise whole.mistake(tree.at, message)

    def _of_call(self, whole: Expression, tree: Call) -> Powers:
        if tree.name not in ARGUMENTS:
            if tree.name in self.names:
                raise whole.mistake(tree.at, f"'{tree.name}' is no function", f"write {tree.name}*(...)")
            hint = habits.FUNCTIONS.get(tree.name) or nearest(tree.name, ARGUMENTS)
            raise whole.mistake(tree.at, f"unknown function '{tree.name}'", hint)
        count = ARGUMENTS[tree.name]
        if len(tree.arguments) != count:
            raise whole.mistake(tree.at, f"{tree.name} takes {count}: found {len(tree.arguments)}")
        arguments = tree.arguments
        if tree.name == "where":
            if not is_comparison(arguments[0]):
                raise whole.mistake(_begin(arguments[0]), "expected a comparison, e.g. V_m > 0 mV")
            self.powers(whole, arguments[0])
            arguments = arguments[1:]
        found = [self.powers(whole, argument) for argument in arguments]
        if tree.name not in _SAME:
            if not self.same(found[0], Powers(NONE, {})):
                message = f"{tree.name} of '{text_of(arguments[0])}', which is {self.told(found[0])}"
                raise whole.mistake(tree.at, f"{message}: expected a number without unit")
            return Powers(NONE, {})
        if len(found) == 2 and not self.same(*found):
            left, right = (text_of(argument) for argument in arguments)
            message = f"'{left}' is {self.told(found[0])}, '{right}' {self.told(found[1])}"
            raise whole.mistake(tree.at, f"{message}: expected the same unit")
        return found[0]

    def _of_power(self, whole: Expression, tree: Binary) -> Powers:
        base, exponent = self.powers(whole, tree.left), self.powers(whole, tree.right)
        if not self.same(exponent, Powers(NONE, {})):
            told_ = self.told(exponent)
            raise whole.mistake(tree.at, f"an exponent {told_}: expected a number without unit")
        number = _number(tree.right)
        if number is None:
            if not self.same(base, Powers(NONE, {})):
                message = f"'{text_of(tree.left)}' is {self.told(base)} and its exponent is no number"
                raise whole.mistake(tree.at, f"{message}: expected a number without unit")
            return Powers(NONE, {})
        if abs(number) > _MAX_POWER:
            raise whole.mistake(tree.at, f"an exponent of {number:g}: expected at most {_MAX_POWER}")
        return Powers(NONE, {}).times(base, Fraction(number).limit_denominator(1000))


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
    """The error for a state of which nothing tells the unit."""
    return ModelError(
        f"nothing tells the unit of '{name}'", hint=f"write it in 'initial', e.g. {{{name}: 0 mV}}", path=(name,)
    )
