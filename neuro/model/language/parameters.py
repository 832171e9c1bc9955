"""Substitution of the `$names` in a description, before other checks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, Where, unknown
from neuro.core.values import shown
from neuro.model.language.reader import MAX_DEPTH, Node, found_text, mistake, put_at

if TYPE_CHECKING:
    from neuro.core.grammar import Expression, Name
    from neuro.model.language.computing import Measure

MAX_SUBSTITUTED = 1_000_000

_NAME = re.compile(r"[^\W\d]\w*")
_USE = re.compile(r"\$([^\W\d]\w*)")


def resolve(sections: Mapping[str, Node], overrides: Mapping[str, Any], origin: Where) -> dict[str, Node]:
    """Replace all `$names` by the values of the parameters.

    Args:
        sections: sections of the description.
        overrides: values by name, instead of the values in the description.
        origin: the file, for errors about overrides.

    Raises:
        ModelError: a name is unknown, or an override has no effect.
    """
    if not isinstance(overrides, Mapping):
        raise ModelError(f"params = {shown(overrides)}: expected a mapping from names to values", where=origin)
    parameters = sections["parameters"].value if "parameters" in sections else {}
    for name in overrides:
        if name not in parameters:
            raise unknown("parameter", name, parameters, origin)
    names = _Names(parameters)
    for name, node in parameters.items():
        if not _NAME.fullmatch(name):
            message = f"parameter name {shown(name)}: expected letters, digits and '_', not a digit first"
            hint = f"define it as {name[1:]} and use it as {name}" if name[:1] == "$" else ""
            raise ModelError(message, where=node.label, hint=hint)
        if node.value is None and name not in overrides:
            raise mistake(node, f"parameter '{name}' has no value")
        source = f"${name} is set at {node.label}"
        if name in overrides:
            node = as_node(overrides[name], node)
            source = f"${name} is set by params or --set"
        names.values[name] = names.put(node), source
    out = {section: names.put(node) for section, node in sections.items() if section != "parameters"}
    for name in overrides:
        if name not in names.used:
            message = f"the override of '{name}' has no effect: nothing uses ${name}"
            raise ModelError(message, where=parameters[name].label)
    return out


class _Names:
    """Values of the parameters that were read so far, and which of the names are used."""

    def __init__(self, nodes: Mapping[str, Node]) -> None:
        self.nodes = nodes
        self.values: dict[str, tuple[Node, str]] = {}
        self.used: set[str] = set()
        self.n_substituted = 0

    def put(self, node: Node) -> Node:
        """Return a copy of the node in which names are replaced by values."""
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
            raise mistake(node, f"found '{node.value}': expected only a $name, or $(...)", hint)
        name = use[1]
        self._check(name, f"${name}", node)
        self.used.add(name)
        value, source = self.values[name]
        return self._value_at(value, Node(None, node.where, node.label, source), 0)

    def _computed(self, node: Node) -> Node:
        """Return a node with the value of `$(...)`."""
        from neuro.core.grammar import Misread
        from neuro.model.language.computing import evaluate

        text = node.value
        if not text.endswith(")"):
            hint = "put an expression with ',' in quotes" if text.count("(") > text.count(")") + 1 else ""
            raise mistake(node, f"found '{text}': expected '$(' and ')' around the whole expression", hint)
        try:
            value = evaluate(text[2:-1], lambda expression, name: self._measure(expression, name, node), self.nodes)
        except Misread as error:
            if node.text is None:
                raise put_at(node, error) from None
            where = Where(node.text.file, node.text.line, node.text.column + 2 + error.place)
            raise error.but(message=f"{shown(text)}: {error.bare}", where=where) from None
        return Node(value, node.where, node.label, f"{text} is {value}")

    def _measure(self, expression: Expression, name: Name, node: Node) -> Measure:
        """Return the number and dimension of a parameter."""
        from neuro.core.units import in_base, is_measure
        from neuro.model.language.computing import Measure

        try:
            self._check(name.name, name.name, node)
        except ModelError as error:
            located_error = expression.mistake(name.at, error.message, error.hint)
            located_error.kind = error.kind
            raise located_error from None
        self.used.add(name.name)
        value = self.values[name.name][0].value
        if is_measure(value):
            try:
                return Measure(*in_base(value))
            except ModelError as error:
                raise expression.mistake(name.at, f"'{name.name}' = {value}: {error.message}", error.hint) from None
        if not is_number(value):
            text = found_text(self.values[name.name][0])
            raise expression.mistake(name.at, f"'{name.name}': {text}: expected a number, with its unit or without")
        return Measure(float(value))

    def _check(self, name: str, label: str, node: Node) -> None:
        """Raise an error if a name has no value yet."""
        if name in self.values:
            return
        if name in self.nodes:
            raise mistake(node, f"{label} is used before it is set", f"set it above, see {self.nodes[name].label}")
        sign = label.removesuffix(name)
        error = unknown("parameter", label, (f"{sign}{defined}" for defined in self.nodes))
        raise put_at(node, error if self.nodes else error.but(hint=f"add parameters: {{{name}: ...}}"))

    def _value_at(self, value: Node, at: Node, depth: int) -> Node:
        """Return a copy of a parameter's value with the position of the node `at`, where the name is used."""
        self.n_substituted += 1
        if self.n_substituted > MAX_SUBSTITUTED or depth > MAX_DEPTH:
            limit = f"{MAX_DEPTH} levels" if depth > MAX_DEPTH else f"{MAX_SUBSTITUTED} values"
            raise ModelError(f"parameters expand to more than {limit}: expected fewer", where=at.where, hint=at.source)
        inner = value.value
        if isinstance(inner, list):
            inner = [self._value_at(item, at, depth + 1) for item in inner]
        elif isinstance(inner, dict):
            inner = {word: self._value_at(item, at, depth + 1) for word, item in inner.items()}
        return Node(inner, at.where, at.label, at.source)


def as_node(value: Any, position: Node) -> Node:
    """Return a Python value as a node at the position of another node."""
    if isinstance(value, (list, tuple)):
        value = [as_node(item, position) for item in value]
    elif isinstance(value, Mapping):
        value = {str(word): as_node(item, position) for word, item in value.items()}
    elif hasattr(value, "dtype") and getattr(value, "ndim", 1) == 0:
        value = value.item()
    return Node(value, position.where, position.label)
