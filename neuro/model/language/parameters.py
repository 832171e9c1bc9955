"""The `$names` of a description, resolved before anything else is checked."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, Where, nearest, unknown
from neuro.core.grammar import Binary, Call, Expression, Hints, Misread, Name, Negative, Number, Tree, parse
from neuro.core.units import NONE, TENS, Dimension, in_base, is_measure, scaled, times, told, unit_of
from neuro.core.values import shown
from neuro.model.language.reader import MAX_DEPTH, Node, found, mistake, put_at

MAX_PLACED = 1_000_000

_NAME = re.compile(r"[^\W\d]\w*")
_USE = re.compile(r"\$([^\W\d]\w*)")


def resolve(sections: Mapping[str, Node], overrides: Mapping[str, Any], where: Where) -> dict[str, Node]:
    """Put the values of parameters in place of their `$names`.

    Args:
        sections: of the description; `parameters` among them is left out of the result.
        overrides: values by name that take the place of the description's.
        where: the file, for errors about overrides.

    Raises:
        ModelError: a name is unknown, or an override has no effect.
    """
    if not isinstance(overrides, Mapping):
        raise ModelError(f"params = {shown(overrides)}: expected a mapping from names to values", where=where)
    given = sections["parameters"].value if "parameters" in sections else {}
    for name in overrides:
        if name not in given:
            raise unknown("parameter", name, given, where)
    names = _Names(given)
    for name, node in given.items():
        if not _NAME.fullmatch(name):
            message = f"parameter name {shown(name)}: expected letters, digits and '_', not a digit first"
            hint = f"write {name[1:]}; the $ stands where it is used" if name[:1] == "$" else ""
            raise ModelError(message, where=node.label, hint=hint)
        if node.value is None and name not in overrides:
            raise mistake(node, f"parameter '{name}' has no value")
        source = f"${name} is set at {node.label}"
        if name in overrides:
            node = _as_node(overrides[name], node)
            source = f"${name} is set by params"
        names.values[name] = names.put(node), source
    out = {section: names.put(node) for section, node in sections.items() if section != "parameters"}
    for name in overrides:
        if name not in names.used:
            message = f"the override of '{name}' has no effect: nothing uses ${name}"
            raise ModelError(message, where=given[name].label)
    return out


class _Names:
    def __init__(self, given: Mapping[str, Node]) -> None:
        self.given = given
        self.values: dict[str, tuple[Node, str]] = {}
        self.used: set[str] = set()
        self.placed = 0

    def put(self, node: Node) -> Node:
        """The node with values in place of names."""
        value = node.value
        if isinstance(value, str) and "$" in value:
            return self._value(node)
        if isinstance(value, list):
            return Node([self.put(item) for item in value], node.where, node.label, node.source)
        if isinstance(value, dict):
            return Node({word: self.put(item) for word, item in value.items()}, node.where, node.label, node.source)
        return node

    def _value(self, node: Node) -> Node:
        if node.value.startswith("$("):
            return self._computed(node)
        use = _USE.fullmatch(node.value)
        if use is None:
            hint = f"write $({node.value.replace('$', '')})" if _USE.search(node.value) else ""
            raise mistake(node, f"found '{node.value}': expected a $name that stands alone, or $(...)", hint)
        name = use[1]
        self._check(name, f"${name}", node)
        self.used.add(name)
        value, source = self.values[name]
        return self._moved(value, Node(None, node.where, node.label, source), 0)

    def _computed(self, node: Node) -> Node:
        """What stands between the brackets of `$(...)`, computed."""
        text = node.value
        if not text.endswith(")"):
            hint = "a text with ',' needs quotes" if text.count("(") > text.count(")") + 1 else ""
            raise mistake(node, f"found '{text}': expected '$(' and ')' around all of it", hint)
        try:
            value = computed(text[2:-1], lambda whole, name: self._measure(whole, name, node), self.given)
        except Misread as error:
            if node.text is None:
                raise put_at(node, error) from None
            where = Where(node.text.file, node.text.line, node.text.column + 2 + error.place)
            raise error.but(message=f"{shown(text)}: {error.bare}", where=where) from None
        return Node(value, node.where, node.label, f"{text} is {value}")

    def _measure(self, whole: Expression, name: Name, node: Node) -> Measure:
        """The number that a name stands for."""
        try:
            self._check(name.name, name.name, node)
        except ModelError as error:
            wrong = whole.mistake(name.at, error.message, error.hint)
            wrong.kind = error.kind
            raise wrong from None
        self.used.add(name.name)
        value = self.values[name.name][0].value
        if is_measure(value):
            try:
                return Measure(*in_base(value))
            except ModelError as error:
                raise whole.mistake(name.at, f"'{name.name}' = {value}: {error.message}", error.hint) from None
        if not is_number(value):
            text = found(self.values[name.name][0])
            raise whole.mistake(name.at, f"'{name.name}': {text}: expected a number, with its unit or without")
        return Measure(float(value))

    def _check(self, name: str, label: str, node: Node) -> None:
        """Refuse a name that stands for nothing yet."""
        if name in self.values:
            return
        if name in self.given:
            raise mistake(node, f"{label} is used before it is set", f"set it above, see {self.given[name].label}")
        sign = label.removesuffix(name)
        error = unknown("parameter", label, (f"{sign}{known}" for known in self.given))
        raise put_at(node, error if self.given else error.but(hint=f"add parameters: {{{name}: ...}}"))

    def _moved(self, value: Node, to: Node, depth: int) -> Node:
        """The value as if it stood where it is used."""
        self.placed += 1
        if self.placed > MAX_PLACED or depth > MAX_DEPTH:
            limit = f"{MAX_DEPTH} levels" if depth > MAX_DEPTH else f"{MAX_PLACED} values"
            raise ModelError(f"parameters stand for more than {limit}: expected fewer", where=to.where, hint=to.source)
        inner = value.value
        if isinstance(inner, list):
            inner = [self._moved(item, to, depth + 1) for item in inner]
        elif isinstance(inner, dict):
            inner = {word: self._moved(item, to, depth + 1) for word, item in inner.items()}
        return Node(inner, to.where, to.label, to.source)


def _as_node(value: Any, at: Node) -> Node:
    """A Python value as if it stood in the file."""
    if isinstance(value, (list, tuple)):
        value = [_as_node(item, at) for item in value]
    elif isinstance(value, Mapping):
        value = {str(word): _as_node(item, at) for word, item in value.items()}
    elif hasattr(value, "dtype") and getattr(value, "ndim", 1) == 0:
        value = value.item()
    return Node(value, at.where, at.label)


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
