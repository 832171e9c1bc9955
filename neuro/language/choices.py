"""Nodes to models, rules, synapses and distributions, and to the values of their parameters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from neuro.distributions import DISTRIBUTIONS
from neuro.errors import unknown
from neuro.language.files import array
from neuro.language.nodes import about, found, mistake, plain, words
from neuro.language.reader import Node
from neuro.quantities import Choice, Quantity

_CALL = re.compile(r"(\w+)\s*\((.*)\)")


def choice(node: Node, table: Mapping[str, type[Any]], kind: str) -> Any:
    """What a name, or `{name: {parameters}}`, stands for.

    Args:
        node: the name or the mapping.
        table: what can be chosen, by name.
        kind: what it is, for messages.
    """
    if isinstance(node.value, Choice):
        return node.value
    if isinstance(node.value, str):
        return with_parameters(_named(node.value, node, table, kind), Node({}, node.where, node.where, node.source))
    if not isinstance(node.value, dict):
        raise mistake(node, f"{kind}: {found(node)}: expected a name, or {{name: {{parameters}}}}")
    if len(node.value) != 1:
        raise mistake(
            node, f"{kind}: {found(node)}: expected a name, or {{name: {{parameters}}}}", _regroup(node, table)
        )
    [(name, inner)] = node.value.items()
    cls = _named(name, Node(name, inner.label, inner.label, node.source), table, kind)
    if inner.value is None:
        raise mistake(inner, f"{name} has no parameters here", f"write '{name}' alone")
    return with_parameters(cls, inner)


def with_parameters(cls: type[Choice], node: Node) -> Choice:
    """Make a choice from the mapping of its parameters."""
    name = cls.called()
    if not isinstance(node.value, dict):
        first = next(iter(cls.quantities()), "")
        hint = f"write {{{name}: {{{first}: {plain(node)}}}}}" if first else f"write '{name}' alone"
        raise mistake(node, f"{name}: {found(node)}: expected its parameters in braces", hint)
    if not cls.quantities() and node.value:
        raise mistake(node, f"{name} has no parameters", f"write '{name}' alone")
    said = words(node, cls.quantities(), name)
    values = {word: value(cls.quantities()[word], inner, f"{name}.{word}") for word, inner in said.items()}
    with about(node):
        return cls.from_words(values)


def value(q: Quantity, node: Node, what: str) -> Any:
    """The value of one parameter; whether it is accepted is checked where it is used."""
    if q.arrays and isinstance(node.value, str) and node.value in DISTRIBUTIONS:
        return choice(node, DISTRIBUTIONS, "distribution")
    if not isinstance(node.value, dict):
        return plain(node)
    if q.part is not None:
        return with_parameters(q.part, node)
    if "file" in node.value and (q.arrays or q.kind in ("ids", "times")):
        return array(node)
    if q.arrays:
        return choice(node, DISTRIBUTIONS, f"{what}: distribution")
    return plain(node)


def _named(name: str, node: Node, table: Mapping[str, type[Any]], kind: str) -> type[Choice]:
    if name in table:
        return table[name]
    error = unknown(kind.rpartition(": ")[2], name, table)
    hint = error.hint
    call = _CALL.fullmatch(name)
    if call and call[1] in table:
        inside = call[2].replace("=", ": ")
        hint = f"write {{{call[1]}: {{{inside}}}}}" if inside.strip() else f"write {call[1]}"
    raise mistake(node, error.message, hint)


def _regroup(node: Node, table: Mapping[str, type[Any]]) -> str:
    """How `{name, parameter: value}` is meant."""
    names = [word for word in node.value if word in table]
    names += [str(n.value) for n in node.value.values() if isinstance(n.value, str) and n.value in table]
    if len(names) != 1:
        return ""
    rest = {w: plain(n) for w, n in node.value.items() if w != names[0] and n.value != names[0]}
    return f"write {{{names[0]}: {{{', '.join(f'{w}: {v}' for w, v in rest.items())}}}}}"
