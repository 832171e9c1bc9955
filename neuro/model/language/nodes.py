"""Nodes to plain values, and errors to the node that they are about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from neuro.core.errors import ModelError, Where, unknown
from neuro.core.values import shown
from neuro.model.language.reader import Node


def plain(node: Node) -> Any:
    """The value without its places."""
    if isinstance(node.value, list):
        return [plain(item) for item in node.value]
    if isinstance(node.value, dict):
        return {word: plain(item) for word, item in node.value.items()}
    return node.value


def mistake(node: Node, message: str, hint: str = "") -> ModelError:
    """The error for a node."""
    return ModelError(message, where=place(node), hint=_joined(hint, node.source))


def put_at(node: Node, error: ModelError) -> ModelError:
    """An error as one for a node."""
    return error.but(where=place(node), hint=_joined(error.hint, node.source))


def place(node: Node) -> Where:
    """Where the value stands, or the word before it where there is none."""
    return node.label if node.value is None else node.where


def found(node: Node) -> str:
    """What stands there, for messages."""
    if node.value is None:
        return "found nothing"
    return f"found {shown(plain(node))}"


def words(node: Node, known: Iterable[str], what: str, needs: Iterable[str] = (), kind: str = "") -> dict[str, Node]:
    """The words of a mapping, of which only `known` ones are accepted.

    Args:
        node: the mapping.
        known: all words that have a meaning here.
        what: what the mapping describes, for messages.
        needs: the words that must be there.
        kind: what a word is, for messages; "word of ..." if not given.
    """
    names = list(known)
    if not isinstance(node.value, dict):
        listed = ", ".join(names)
        raise mistake(node, f"{found(node)}: expected the words of {what}: {listed}")
    for word, value in node.value.items():
        if word not in names:
            raise _unknown_word(word, value, names, kind or f"word of {what}")
        if value.value is None:
            raise put_at(value, ModelError(f"{word} has no value", hint="write it after the ':'", found=word))
    for word in needs:
        if word not in node.value:
            raise ModelError(f"{what} needs '{word}'", where=node.label, missing=word)
    return node.value


def _unknown_word(word: str, value: Node, names: list[str], kind: str) -> ModelError:
    error = unknown(kind, word, names, value.label)
    before, colon, after = word.partition(":")
    if colon and before in names and value.value is None:
        return error.but(hint=f"write '{before}: {after}', with a space after ':'", suggestion="")
    if word.endswith(")"):
        return error.but(hint="',' ends a value; a choice is no call: write {name: {word: value}}", suggestion="")
    return error


@contextmanager
def about(node: Node, context: str = "") -> Iterator[None]:
    """Give an error raised inside the place of the value of `node` that its path leads to."""

    def told(error: ModelError) -> ModelError:
        at = follow(node, error.path)
        return put_at(at, error.at(None, context)).but(path=(), others=tuple(map(told, error.others)))

    try:
        yield
    except ModelError as error:
        raise told(error) from None


@contextmanager
def within(context: str) -> Iterator[None]:
    """Begin the message of an error raised inside with `context`."""
    try:
        yield
    except ModelError as error:
        raise error.at(None, context) from None


def follow(node: Node, path: Iterable[str]) -> Node:
    """The node that a path of words and positions leads to, as far as it goes."""
    for step in path:
        inner: Node | None = None
        if isinstance(node.value, dict):
            inner = node.value.get(step)
        elif isinstance(node.value, list) and step.isdecimal() and int(step) < len(node.value):
            inner = node.value[int(step)]
        if inner is None:
            return node
        node = inner
    return node


def _joined(*hints: str) -> str:
    return "; ".join(hint for hint in hints if hint)
