"""The `$names` of a description, resolved before anything else is checked."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, Where, unknown
from neuro.core.values import shown
from neuro.model.language.reader import MAX_DEPTH, Node, found, mistake, put_at

if TYPE_CHECKING:
    from neuro.core.grammar import Expression, Name
    from neuro.model.language.computing import Measure

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
        from neuro.core.grammar import Misread
        from neuro.model.language.computing import computed

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
        from neuro.core.units import in_base, is_measure
        from neuro.model.language.computing import Measure

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
