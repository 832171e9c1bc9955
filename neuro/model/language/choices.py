"""Nodes to models, rules, synapses and distributions, and to the values of their parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from neuro.coding.codes import CHOICES
from neuro.core.choice import Choice
from neuro.core.errors import unknown
from neuro.core.hints import ELSEWHERE
from neuro.core.quantities import Quantity
from neuro.core.values import shown
from neuro.model.distributions import DISTRIBUTIONS
from neuro.model.language.files import array, of_program, recording
from neuro.model.language.nodes import about, found, mistake, plain, put_at, words
from neuro.model.language.reader import Node
from neuro.model.language.trains import train
from neuro.model.neurons import MODELS
from neuro.model.parts import GROUPS
from neuro.model.rules import RULES
from neuro.model.space import MASKS, PROFILES, of_distance
from neuro.model.synapses import SYNAPSES

TABLES: dict[str, Mapping[str, type[Choice]]] = {
    "model": MODELS,
    "rule": RULES,
    "synapse": SYNAPSES,
    "group": GROUPS,
    "distribution": DISTRIBUTIONS,
    "profile": PROFILES,
    "mask": MASKS,
    "code": CHOICES,
}
FILE = ("file", "key")
"""The words of an array in a file."""
C = TypeVar("C", bound=Choice)
_CALL = re.compile(r"(\w+)\s*\((.*)\)")


def choice(node: Node, kind: str, own: Mapping[str, type[Choice]] | None = None) -> Any:
    """What a name, or `{name: {parameters}}`, stands for.

    Args:
        node: the name or the mapping.
        kind: what is chosen, a key of `TABLES`.
        own: those of the network itself, by name.
    """
    own = own or {}
    if isinstance(node.value, Choice):
        return node.value
    if isinstance(node.value, str):
        cls = _named(node.value, node, kind, own)
        return with_parameters(cls, Node({}, node.where, node.where, node.source))
    if not isinstance(node.value, dict) or len(node.value) != 1:
        raise mistake(
            node, f"{kind}: {found(node)}: expected a name, or {{name: {{parameters}}}}", _regroup(node, kind)
        )
    [(name, inner)] = node.value.items()
    cls = _named(name, Node(name, inner.label, inner.label, node.source), kind, own)
    if inner.value is None:
        raise mistake(inner, f"{name} has no parameters here", f"write '{name}' alone")
    return with_parameters(cls, inner)


def with_parameters(cls: type[C], node: Node) -> C:
    """Make a choice from the mapping of its parameters."""
    if isinstance(node.value, cls):
        return node.value
    name, known = cls.called(), cls.quantities()
    if not known and node.value != {}:
        raise mistake(node, f"{name} has no parameters", f"write '{name}' alone")
    if not isinstance(node.value, dict):
        needed = [word for word in known if word not in cls.defaults()]
        hint = f"write {{{name}: {{{needed[0]}: {plain(node)}}}}}" if len(needed) == 1 else ""
        raise mistake(node, f"{name}: {found(node)}: expected its parameters, {{word: value}}", hint)
    if cls.file_of:
        node = _with_array(cls, node)
    said = words(node, known, name, kind=f"parameter of {name}")
    values = {word: value(known[word], inner, f"{name}.{word}") for word, inner in said.items()}
    with about(node):
        return cls.from_words(values)


FILED = ("ids", "times", "moments", "series", "graded_train")
"""Kinds of parameters that are lists, which a file may hold."""


def value(q: Quantity, node: Node, what: str) -> Any:
    """The value of one parameter; whether it is accepted is checked where it is used.

    Args:
        q: the parameter.
        node: what is said of it.
        what: its full name, for messages.
    """
    if q.part is not None:
        return with_parameters(q.part, node)
    if q.kind == "codes":
        return codes(node)
    if q.kind == "file" and isinstance(node.value, str):
        return recording(node, node.value)
    if q.kind == "events":
        return of_program(node, what)
    if isinstance(node.value, dict) and "file" in node.value and q.kind == "train":
        return train(node)
    if q.choice is not None and (q.at_least is None or isinstance(node.value, (str, dict))):
        return choice(node, q.choice.kind)
    if q.of_distance and isinstance(node.value, dict) and of_distance.called() in node.value:
        said = words(node, (of_distance.called(),), what)
        return of_distance(choice(said[of_distance.called()], "profile"))
    if isinstance(node.value, dict) and "file" in node.value and (q.arrays or q.kind in FILED):
        return array(node)
    if q.arrays and isinstance(node.value, dict):
        _refuse_bare_parameters(node, what)
        return choice(node, "distribution")
    if q.arrays and isinstance(node.value, str) and _first_word(node.value) in DISTRIBUTIONS:
        return choice(node, "distribution")
    return plain(node)


def codes(node: Node) -> tuple[Any, ...]:
    """A code, or each of a list."""
    items = node.value if isinstance(node.value, list) else [node]
    return tuple(choice(item, "code") for item in items)


def _with_array(cls: type[Choice], node: Node) -> Node:
    """The mapping with `{file, key}` as the array that these words among its own stand for."""
    said = words(node, [*cls.quantities(), *FILE], cls.called(), kind=f"parameter of {cls.called()}")
    inner = {word: said[word] for word in FILE if word in said}
    if not inner:
        return node
    first = next(iter(inner.values()))
    if cls.file_of in said:
        message = f"{cls.called()}: found both '{cls.file_of}' and '{next(iter(inner))}': expected one of them"
        raise mistake(first, message)
    if "file" not in said:
        raise mistake(first, f"{cls.called()}: found 'key' without 'file': expected both")
    rest = {word: value for word, value in said.items() if word not in inner}
    array = Node(inner, first.where, first.label, first.source)
    return Node({cls.file_of: array, **rest}, node.where, node.label, node.source)


def part(node: Node, known: Iterable[str], what: str, needs: Iterable[str]) -> dict[str, Node]:
    """The words of a part, see `words`; a parameter that strayed out of its choice is sent back there."""
    names = list(known)
    for word, inner in node.value.items() if isinstance(node.value, dict) else ():
        if word not in names and (home := _home(node, word)):
            raise unknown(f"word of {what}", word, names, inner.label).but(hint=f"write {home}", suggestion="")
    return words(node, names, what, needs)


def _home(node: Node, word: str) -> str:
    """The choice in a part that has a parameter of this name, as it should be written."""
    for kind, table in TABLES.items():
        chosen = node.value.get(kind)
        name = chosen if chosen is None else chosen.value
        if isinstance(name, dict):
            name = next(iter(name), None)
        if isinstance(name, str) and name in table and (ours := _ours(word, table[name])):
            return f"{kind}: {{{name}: {{{ours}: {shown(plain(node.value[word]))}}}}}"
    return ""


def _ours(word: str, cls: type[Choice]) -> str:
    """The parameter of a choice that a word, of ours or of another tool, stands for; "" if there is none."""
    known = cls.quantities()
    return next((one for one in (word, *ELSEWHERE.get(word.lower(), ())) if one in known), "")


def _named(name: str, node: Node, kind: str, own: Mapping[str, type[Choice]]) -> type[Choice]:
    if name in own:
        return own[name]
    table = TABLES[kind]
    if name in table:
        return table[name]
    error = unknown(kind, name, [*own, *table])
    words = (name,) if error.suggestion else (name, *ELSEWHERE.get(name.lower(), ()))
    others = [f"'{w}' is a {other}, not a {kind}" for w in words for other, names in TABLES.items() if w in names]
    hint = others[0] if others else error.hint
    if hint.endswith(", ..."):
        hint = "'neuro models' lists those there are"
    if kind == "distribution" and name in PROFILES:
        hint = f"'{name}' is a profile, write {{of_distance: {{{name}: ...}}}}"
    call = _CALL.fullmatch(name)
    if call and call[1] in table:
        hint = f"write {{{call[1]}: {{{call[2].replace('=', ': ')}}}}}"
        if not call[2].strip():
            hint = f"write '{call[1]}' alone"
        elif "=" not in call[2]:
            hint = f"write {{{call[1]}: {{word: value}}}} with the words " + ", ".join(table[call[1]].quantities())
    raise put_at(node, error.but(hint=hint, suggestion=error.suggestion if hint == error.hint else ""))


def _regroup(node: Node, kind: str) -> str:
    """How `{name, parameter: value}` or `{type: name, parameter: value}` is meant."""
    if not isinstance(node.value, dict):
        return ""
    table = TABLES[kind]
    names = [word for word in node.value if word in table]
    names += [n.value for n in node.value.values() if isinstance(n.value, str) and n.value in table]
    if len(names) != 1:
        return ""
    rest = {
        _ours(w, table[names[0]]) or w: plain(n) for w, n in node.value.items() if w != names[0] and n.value != names[0]
    }
    return f"write {shown({names[0]: rest})}"


def _refuse_bare_parameters(node: Node, what: str) -> None:
    """Refuse `{mean: 1, std: 2}`, which lacks the name of the distribution."""
    if any(word in DISTRIBUTIONS for word in node.value):
        return
    fitting = [name for name, cls in DISTRIBUTIONS.items() if set(node.value) <= set(cls.quantities())]
    if fitting and node.value:
        found_ = shown(plain(node))
        raise mistake(
            node, f"{what} = {found_}: expected the name of a distribution", f"write {{{fitting[0]}: {found_}}}"
        )


def _first_word(text: str) -> str:
    return text.partition("(")[0].strip()
