"""Where the words of a description stand, and which of them a mistake is about."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TypeAlias

from neuro.core.errors import ModelError, Where
from neuro.model.language.reader import Node

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
    head = next((path for name, path in _named(at(root, part), part) if name == first), None)
    if head is None:
        return (*part, first) if first in _DEFAULTED else part
    for word in rest:
        inner = at(root, head).value
        if not isinstance(inner, dict):
            break
        # What is not said has its default, and another word that it depends on is said.
        head = next(((*head, name) for name in (word, *error.about) if name in inner), head)
    return head


def _named(node: Node, path: Words) -> Iterator[tuple[str, Words]]:
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
