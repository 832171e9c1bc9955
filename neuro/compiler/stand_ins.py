"""Where the words of a description stand, and what stands in for mistaken ones while the rest is judged.

Each has two: a message that only follows from a mistake differs between the two, or is missing with one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias

from neuro.compiler.probes import ALONE
from neuro.core.errors import ModelError, Where
from neuro.model.language.choices import TABLES
from neuro.model.language.reader import Node
from neuro.model.neurons import MODELS, Neuron, spike_generator

_MODEL = ("iaf_psc_delta", "iaf_psc_exp")
_SHAPE = (1, 2)
_RULE = ({"fixed_total_number": {"n": 1}}, {"pairs": {"pre": [0, 0], "post": [0, 0]}})
_WORDS: Mapping[Words, tuple[Any, Any]] = {
    ("resolution",): (0.1, 0.05),
    ("populations", "shape"): _SHAPE,
    ("projections", "rule"): _RULE,
    ("projections", "weight"): (0.0, 0.0),
    ("trials", "duration"): (10.0, 20.0),
}
_PARTS = {"from": (), "to": (Neuron,), "of": (), "input": (spike_generator,), "output": ()}
"""Words that name a population, and of which model it is."""
_SETTINGS = ("trials", "readout")
"""Sections that are no parts by name."""


def stand_in(sections: Mapping[str, Node], path: Words, gone: Node | None, error: ModelError, turn: int) -> Any:
    """A plain value that stands in for what is mistaken; None if it is left out.

    Args:
        sections: of the description.
        path: the words that lead to it.
        gone: what stood there, if anything did.
        error: what was wrong with it.
        turn: 0 or 1, the first or the second stand-in.
    """
    if path in (("parameters",), ("populations",)):
        return None
    if path[0] == "parameters":
        return turn + 1
    if path[0] == "populations" and path[2:] in ((), ("model",)):
        model = "spike_generator" if _shown(sections) == path[1] else _MODEL[turn]
        return model if path[2:] else {"model": model, "shape": _SHAPE[turn]}
    if path[0] == "probes" and path[2:] == ("record",):
        return error.suggestion or next((word for word in error.expected if word not in ALONE), None)
    place = (path[0], *path[2:]) if path[0] not in _SETTINGS else path
    if place in _WORDS:
        return _WORDS[place][turn]
    if path[-1] in _PARTS and (len(path) == 3 or path[0] in ("groups", *_SETTINGS)):
        return _named(sections, path[-1], error)
    return _needed(path[-2], path[-1], turn) if len(path) > 3 else None


def chosen_from(sections: Mapping[str, Node], path: Words) -> str:
    """The population of which a path leads to an index; "" if it leads elsewhere."""
    populations = sections["populations"].value if "populations" in sections else {}
    known = len(path) == 4 and path[2] in ("from", "to", "of", "pre", "post") and path[3] in populations
    return path[3] if known else ""


def some_neurons(population: str, turn: int) -> Any:
    """All neurons of a population, or one of it: what depends on how many are chosen differs."""
    return population if turn == 0 else {population: 0}


def _shown(sections: Mapping[str, Node]) -> Any:
    """The name of the population that trials show their input to."""
    trials = sections["trials"].value if "trials" in sections else None
    return trials["input"].value if isinstance(trials, dict) and "input" in trials else None


def _needed(name: str, word: str, turn: int) -> Any:
    """A number that a parameter can be which has no default."""
    cls = next((table[name] for table in TABLES.values() if name in table), None)
    if cls is None or word not in cls.quantities() or word in cls.defaults():
        return None
    q = cls.quantities()[word]
    if q.kind == "shape":
        return [turn + 1, turn + 1]
    low = next((bound for bound in (q.at_least, q.above) if bound is not None), 0.0)
    high = next((bound for bound in (q.at_most, q.below) if bound is not None), low + 4.0)
    number = low + (high - low) * (turn + 1) / 4.0
    return int(number) if q.kind == "integer" or q.whole else number


def _named(sections: Mapping[str, Node], word: str, error: ModelError) -> str | None:
    """The population that is meant, or another that may stand there."""
    there = sections["populations"].value if "populations" in sections else {}
    if not isinstance(there, dict):
        return None
    fitting = [name for name, node in there.items() if issubclass(_model(node), _PARTS[word] or object)]
    return error.suggestion if error.suggestion in there else next(iter([*fitting, *there]), None)


def _model(node: Node) -> type[Any]:
    """The class of a population's model, as far as its node states it."""
    said = node.value.get("model") if isinstance(node.value, dict) else None
    name = said and (next(iter(said.value), "") if isinstance(said.value, dict) else said.value)
    return MODELS[name] if isinstance(name, str) and name in MODELS else object


def as_node(value: Any, at: Node) -> Node:
    """A plain value as if it stood at the place of another."""
    if isinstance(value, dict):
        value = {word: as_node(inner, at) for word, inner in value.items()}
    elif isinstance(value, list):
        value = [as_node(inner, at) for inner in value]
    return Node(value, at.where, at.label)


Words: TypeAlias = tuple[str, ...]

_WORD = re.compile(r"[\w.-]+")
_DEFAULTED = ("weight", "delay", "record")
"""Words of parts that a mistake may be about where they are not said."""


class WordPlaces:
    """Where each word of a tree stands, and each value."""

    def __init__(self, *trees: Node) -> None:
        self.words: dict[Where, Words] = {}
        self.values: dict[Where, Words] = {}
        for tree in trees:
            self._walk(tree, ())

    def _walk(self, node: Node, path: Words, listed: bool = False) -> None:
        """Add what a path leads to; what is in a list has the path of the list."""
        self.values.setdefault(node.where, path)
        if isinstance(node.value, dict):
            for word, inner in node.value.items():
                here = path if listed else (*path, word)
                self.words.setdefault(inner.label, here)
                self._walk(inner, here, listed)
        elif isinstance(node.value, list):
            for item in node.value:
                self._walk(item, path, listed=True)

    def of(self, error: ModelError) -> Words:
        """The words that lead to what a mistake is about; none if it is about no word."""
        path = self._at(error)
        return (*path, error.missing) if path and error.missing else path

    def _at(self, error: ModelError) -> Words:
        if error.where is None:
            return ()
        word, value = self.words.get(error.where, ()), self.values.get(error.where, ())
        if not (word or value):
            value = self._around(error.where)
        if not word or not value or len(value) < 2:
            return word or value
        # A mapping that begins on a line of its own begins where its first word does.
        return word if error.found == word[-1] else value

    def _around(self, where: Where) -> Words:
        """The value within which a place lies, as a character of a formula does."""
        before = [
            at for at in self.values if (at.file, at.line) == (where.file, where.line) and at.column < where.column
        ]
        return self.values[max(before, key=lambda at: at.column)] if before else ()


def subject(root: Node, part: Words, error: ModelError) -> Words:
    """The words that an error of the compiler for a part is about, as far as they are said; else the whole part.

    Args:
        root: what the words lead into.
        part: the words that lead to the part.
        error: its path begins with a word of the part, or with a choice somewhere in it, as a model.
    """
    if not error.path:
        return part
    first, *rest = error.path
    head = next((path for name, path in _words_below(at(root, part), part) if name == first), None)
    if head is None:
        return (*part, first) if first in _DEFAULTED else part
    for word in rest:
        inner = at(root, head).value
        if not isinstance(inner, dict):
            break
        # What is not said has its default, and another word that it depends on is said.
        head = next(((*head, name) for name in (word, *error.about) if name in inner), head)
    return head


def _words_below(node: Node, path: Words) -> Iterator[tuple[str, Words]]:
    """All words below a node with the paths to them, and those that stand for a value, the nearest first."""
    level = [(node, path)]
    while level:
        below = []
        for node, path in level:
            if isinstance(node.value, str):
                yield node.value, path
            elif isinstance(node.value, dict):
                yield from ((word, (*path, word)) for word in node.value)
                below += [(inner, (*path, word)) for word, inner in node.value.items()]
        level = below


def has(root: Node, path: Words) -> bool:
    """Whether a tree has what a path leads to."""
    try:
        return bool(path) and at(root, path) is not None
    except (KeyError, TypeError):
        return False


def at(root: Node, path: Words) -> Node:
    """What a path leads to."""
    for word in path:
        root = root.value[word]
    return root


def names(node: Node) -> Iterator[str]:
    """All words below a node, in whatever they stand."""
    if isinstance(node.value, dict):
        for word, inner in node.value.items():
            yield from _WORD.findall(word)
            yield from names(inner)
    elif isinstance(node.value, list):
        for item in node.value:
            yield from names(item)
    elif isinstance(node.value, str):
        yield node.value
        yield from _WORD.findall(node.value)
