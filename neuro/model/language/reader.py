"""YAML text to nodes that know their place. Only words, numbers, lists and mappings are constructed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import yaml

from neuro.core.errors import ModelError, Where, nearest, unknown
from neuro.core.hdf5 import is_hdf5
from neuro.core.inputs import record_input
from neuro.core.system import uncollected
from neuro.core.values import shown

MAX_BYTES = 32 * 2**20
MAX_DEPTH = 32
MAX_DIGITS = 18

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_WHOLE = re.compile(r"[-+]?[0-9]+")
_NUMBER = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_CONSTANTS = {
    **dict.fromkeys(("", "~", "null"), None),
    "true": True,
    "false": False,
    ".inf": math.inf,
    "+.inf": math.inf,
    "-.inf": -math.inf,
    ".nan": math.nan,
}
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(slots=True)
class Node:
    """A value of the document.

    Attributes:
        value: None, a boolean, number or word, a list of nodes, or a mapping from words to nodes.
        where: where it stands.
        label: where the word before it stands, if it has one.
        text: where the first letter of a word stands; None if the others do not follow it as they are in the value.
        source: what else decides on it: "$w is set at net.yaml:4:3" for a value put in place of a parameter.
    """

    value: Any
    where: Where
    label: Where
    source: str = ""
    text: Where | None = None


@uncollected()
def read(
    path: Path, expected: str = "a network", begin: str = "neuro: 1", twice: list[ModelError] | None = None
) -> Node:
    """Read a file.

    Args:
        path: the file.
        expected: what it describes, for messages.
        begin: how such a description may begin.
        twice: takes the mistakes of words that are said twice, the first of which then counts; else they are raised.

    Raises:
        ModelError: it cannot be read, is empty, or is not plain YAML.
    """
    text = _text(path)
    return _Reader(text, str(path), twice).document(expected, begin)


def _bytes(path: Path) -> bytes:
    where = Where(str(path))
    try:
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "neither file nor folder"
        else:
            with path.open("rb") as file:
                record_input(path)
                return file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        beside = [p.name for p in path.parent.glob("*.y*ml")] if path.parent.is_dir() else []
        raise ModelError("no such file", where=where, hint=nearest(path.name, beside) if beside else "") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ModelError(f"cannot be read: {reason}", where=where) from None
    raise ModelError(f"found {kind}: expected a YAML file", where=where)


def _text(path: Path) -> str:
    data = _bytes(path)
    if len(data) > MAX_BYTES:
        message = f"found more than {MAX_BYTES // 2**20} MiB: expected a shorter description"
        hint = "put large arrays into an HDF5 file: {file: w.h5, key: name}"
        raise ModelError(message, where=Where(str(path)), hint=hint)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        place = _place(data[: error.start].decode("utf-8", "replace"), str(path))
        results = "an HDF5 file, as results are: neuro report FILE tells what these hold, and their bill"
        message = f"found the byte 0x{data[error.start]:02x}: expected UTF-8 text"
        raise ModelError(message, where=place, hint=results if is_hdf5(data) else "") from None
    if odd := _UNPRINTABLE.search(text):
        place = _place(text[: odd.start()], str(path))
        raise ModelError(f"found the character U+{ord(odd[0]):04X}: expected text", where=place)
    return text


def _place(before: str, file: str) -> Where:
    """The place after the text `before`."""
    return Where(file, before.count("\n") + 1, len(before) - before.rfind("\n"))


class _Reader:
    """Turns the parser's events into nodes, and refuses what is no plain data on the way."""

    def __init__(self, text: str, file: str, twice: list[ModelError] | None) -> None:
        self.lines, self.file, self.twice = text.splitlines(), file, twice
        self.loader = _LOADER(text)
        self.next = self.loader.get_event

    def document(self, expected: str, begin: str) -> Node:
        try:
            return self.one_document(expected, begin)
        except yaml.MarkedYAMLError as error:
            from neuro.model.language.syntax import syntax_error

            raise syntax_error(error, self.lines, self.file) from None
        except yaml.YAMLError as error:
            raise ModelError(f"not YAML: {error}", where=Where(self.file)) from None
        finally:
            self.loader.dispose()

    def one_document(self, expected: str, begin: str) -> Node:
        self.next()
        if isinstance(self.next(), yaml.StreamEndEvent):
            message = f"the file is empty: expected {expected}"
            raise ModelError(message, where=Where(self.file, 1, 1), hint=f"begin: {begin}", kind="empty")
        root = self.node(self.next(), 0)
        self.next()
        after = self.next()
        if not isinstance(after, yaml.StreamEndEvent):
            raise ModelError("found a second document: expected one", where=self.place(after.start_mark))
        return root

    def place(self, mark: Any) -> Where:
        return Where(self.file, mark.line + 1, mark.column + 1)

    def node(self, event: Any, depth: int, label: Where | None = None) -> Node:
        mark = event.start_mark
        where = Where(self.file, mark.line + 1, mark.column + 1)
        kind = type(event)
        if kind is yaml.AliasEvent or event.anchor is not None or event.tag is not None:
            self.refuse(event, where)
        if depth > MAX_DEPTH:
            raise ModelError(f"found more than {MAX_DEPTH} levels: expected fewer", where=where)
        if kind is yaml.ScalarEvent:
            value: Any = scalar(event.value, where) if event.implicit[0] else event.value
            return Node(value, where, label or where, "", _letters(event, where))
        if kind is yaml.SequenceStartEvent:
            value = []
            while type(item := self.next()) is not yaml.SequenceEndEvent:
                value.append(self.node(item, depth + 1))
        else:
            value = self.mapping(depth)
        return Node(value, where, label or where)

    def mapping(self, depth: int) -> dict[str, Node]:
        words: dict[str, Node] = {}
        while type(key := self.next()) is not yaml.MappingEndEvent:
            mark = key.start_mark
            where = Where(self.file, mark.line + 1, mark.column + 1)
            if type(key) is yaml.AliasEvent or key.anchor is not None or key.tag is not None:
                self.refuse(key, where)
            if type(key) is not yaml.ScalarEvent or not key.value:
                raise ModelError("expected a word before ':'", where=where)
            if key.value == "<<" and key.implicit[0]:
                raise ModelError("'<<' merges mappings, which the language has not: write the words out", where=where)
            node = self.node(self.next(), depth + 1, where)
            if key.value in words:
                first = words[key.value].label
                error = ModelError(f"'{key.value}' is said twice", where=where, hint=f"first at {first}")
                if self.twice is None:
                    raise error
                self.twice.append(error)
            else:
                words[key.value] = node
        return words

    def refuse(self, event: Any, where: Where) -> NoReturn:
        """Refuse an anchor, an alias or a tag."""
        if isinstance(event, yaml.AliasEvent):
            found, hint = f"the alias '*{event.anchor}': expected a value", "use parameters and $names"
        elif event.anchor is not None:
            found, hint = f"the anchor '&{event.anchor}': expected a value", "use parameters and $names"
        else:
            found, hint = f"the tag '{event.tag.replace('tag:yaml.org,2002:', '!!')}': expected a value without one", ""
        raise ModelError(f"found {found}", where=where, hint=hint)


def _letters(event: Any, where: Where) -> Where | None:
    """Where the letters of a word begin, if they stand in the file as they are in its value."""
    quotes = 1 if event.style else 0
    begin, end = event.start_mark, event.end_mark
    as_it_is = begin.line == end.line and end.column - begin.column == len(event.value) + 2 * quotes
    if not as_it_is:
        return None
    return Where(where.file, where.line, where.column + quotes) if quotes else where


def scalar(text: str, where: Where) -> bool | int | float | str | None:
    """What a word without quotes means: yes, no, on and off are words, only true and false are booleans."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if text[0] not in "+-.0123456789":
        return text
    if _WHOLE.fullmatch(text) and len(text) <= MAX_DIGITS:
        return int(text)
    if _NUMBER.fullmatch(text):
        number = float(text)
        if math.isinf(number):
            message = f"found {text if len(text) < 40 else text[:37] + '...'}: expected a number below 1.8e308"
            raise ModelError(message, where=where, hint="infinity is .inf")
        return number
    return text


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
