"""Parsing of YAML into nodes with positions. Only words, numbers, lists and mappings are constructed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import yaml

from neuro.core.errors import ModelError, Where, unknown
from neuro.core.hdf5 import is_hdf5
from neuro.core.inputs import record_input
from neuro.core.system import uncollected
from neuro.core.values import shown
from neuro.model.language.published import missing

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
        where: position of the value.
        label: position of the word before the value, or of the value if no word precedes.
        text: position of the first letter of a word; None if the word has escapes, which shift its letters.
        source: origin of a value that replaced a parameter, such as "$w is set at net.yaml:4:3".
    """

    value: Any
    where: Where
    label: Where
    source: str = ""
    text: Where | None = None


@uncollected()
def read(
    path: Path, expected: str = "a network", begin: str = "neuro: 1", repeated_words: list[ModelError] | None = None
) -> Node:
    """Read a YAML file.

    Args:
        path: the file.
        expected: the expected content, for messages.
        begin: an example of the first line, for messages.
        repeated_words: list to which errors of repeated words are added. The first value of a repeated word is used. If
            the list is None, these errors are raised.

    Raises:
        ModelError: the file cannot be read, is empty, or uses YAML features beyond plain data.
    """
    text = _text(path)
    return _Reader(text, str(path), repeated_words).document(expected, begin)


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
        raise missing(path) from None
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
        place = _place_after(data[: error.start].decode("utf-8", "replace"), str(path))
        if is_hdf5(data):
            hint = f"if it has results, neuro report {path} shows them"
            raise ModelError("found HDF5: expected a YAML file", where=Where(str(path)), hint=hint) from None
        message = f"found the byte 0x{data[error.start]:02x}: expected a YAML file in UTF-8"
        raise ModelError(message, where=place) from None
    if unprintable := _UNPRINTABLE.search(text):
        place = _place_after(text[: unprintable.start()], str(path))
        raise ModelError(f"found the character U+{ord(unprintable[0]):04X}: expected text", where=place)
    return text


def _place_after(before: str, file: str) -> Where:
    """Return the position after the text `before`."""
    return Where(file, before.count("\n") + 1, len(before) - before.rfind("\n"))


class _Reader:
    """Converter of the parser's events to nodes, with errors for YAML features beyond plain data."""

    def __init__(self, text: str, file: str, repeated_words: list[ModelError] | None) -> None:
        self.lines, self.file, self.repeated_words = text.splitlines(), file, repeated_words
        self.loader = _LOADER(text)
        self.next = self.loader.get_event

    def document(self, expected: str, begin: str) -> Node:
        try:
            return self.read_one_document(expected, begin)
        except yaml.MarkedYAMLError as error:
            from neuro.model.language.syntax import syntax_error

            raise syntax_error(error, self.lines, self.file) from None
        except yaml.YAMLError as error:
            raise ModelError(f"not YAML: {error}", where=Where(self.file)) from None
        finally:
            self.loader.dispose()

    def read_one_document(self, expected: str, begin: str) -> Node:
        self.next()
        if isinstance(self.next(), yaml.StreamEndEvent):
            message = f"the file is empty: expected {expected}"
            raise ModelError(message, where=Where(self.file, 1, 1), hint=f"begin: {begin}", kind="empty")
        root = self.read_node(self.next(), 0)
        self.next()
        next_event = self.next()
        if not isinstance(next_event, yaml.StreamEndEvent):
            raise ModelError("found a second document: expected one", where=self.place_of(next_event.start_mark))
        return root

    def place_of(self, mark: Any) -> Where:
        return Where(self.file, mark.line + 1, mark.column + 1)

    def read_node(self, event: Any, depth: int, label: Where | None = None) -> Node:
        mark = event.start_mark
        where = Where(self.file, mark.line + 1, mark.column + 1)
        kind = type(event)
        if kind is yaml.AliasEvent or event.anchor is not None or event.tag is not None:
            self.refuse_feature(event, where)
        if depth > MAX_DEPTH:
            raise ModelError(f"found more than {MAX_DEPTH} levels: expected fewer", where=where)
        if kind is yaml.ScalarEvent:
            value: Any = scalar(event.value, where) if event.implicit[0] else event.value
            return Node(value, where, label or where, "", _text_position(event, where))
        if kind is yaml.SequenceStartEvent:
            value = []
            while type(item := self.next()) is not yaml.SequenceEndEvent:
                value.append(self.read_node(item, depth + 1))
        else:
            value = self.read_mapping(depth)
        return Node(value, where, label or where)

    def read_mapping(self, depth: int) -> dict[str, Node]:
        words: dict[str, Node] = {}
        while type(key := self.next()) is not yaml.MappingEndEvent:
            mark = key.start_mark
            where = Where(self.file, mark.line + 1, mark.column + 1)
            if type(key) is yaml.AliasEvent or key.anchor is not None or key.tag is not None:
                self.refuse_feature(key, where)
            if type(key) is not yaml.ScalarEvent or not key.value:
                raise ModelError("expected a word before ':'", where=where)
            if key.value == "<<" and key.implicit[0]:
                raise ModelError("found '<<': the language does not merge mappings: write the words out", where=where)
            node = self.read_node(self.next(), depth + 1, where)
            if key.value in words:
                first = words[key.value].label
                error = ModelError(f"'{key.value}' is defined twice", where=where, hint=f"first at {first}")
                if self.repeated_words is None:
                    raise error
                self.repeated_words.append(error)
            else:
                words[key.value] = node
        return words

    def refuse_feature(self, event: Any, where: Where) -> NoReturn:
        """Raise the error for an anchor, an alias or a tag."""
        if isinstance(event, yaml.AliasEvent):
            description, hint = f"the alias '*{event.anchor}': expected a value", "use parameters and $names"
        elif event.anchor is not None:
            description, hint = f"the anchor '&{event.anchor}': expected a value", "use parameters and $names"
        else:
            description, hint = (
                f"the tag '{event.tag.replace('tag:yaml.org,2002:', '!!')}': expected a value without one",
                "",
            )
        raise ModelError(f"found {description}", where=where, hint=hint)


def _text_position(event: Any, where: Where) -> Where | None:
    """Return the position of a word's first letter, or None if escapes shift its letters."""
    quotes = 1 if event.style else 0
    begin, end = event.start_mark, event.end_mark
    is_literal = begin.line == end.line and end.column - begin.column == len(event.value) + 2 * quotes
    if not is_literal:
        return None
    return Where(where.file, where.line, where.column + quotes) if quotes else where


def scalar(text: str, where: Where) -> bool | int | float | str | None:
    """Return the value of a word without quotes. Only true and false are booleans; yes, no, on and off are words."""
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
    """Return the plain value of a node, without positions."""
    if isinstance(node.value, list):
        return [plain(item) for item in node.value]
    if isinstance(node.value, dict):
        return {word: plain(item) for word, item in node.value.items()}
    return node.value


def mistake(node: Node, message: str, hint: str = "") -> ModelError:
    """Return an error at the position of a node."""
    return ModelError(message, where=place(node), hint=_join_hints(hint, node.source))


def put_at(node: Node, error: ModelError) -> ModelError:
    """Return an error with the position of a node."""
    return error.but(where=place(node), hint=_join_hints(error.hint, node.source))


def place(node: Node) -> Where:
    """Return the position of the value, or of the word before a missing value."""
    return node.label if node.value is None else node.where


def found_text(node: Node) -> str:
    """Return the text "found VALUE" for messages."""
    if node.value is None:
        return "found nothing"
    return f"found {shown(plain(node))}"


def words(node: Node, known: Iterable[str], label: str, needs: Iterable[str] = (), kind: str = "") -> dict[str, Node]:
    """Return the words of a mapping.

    Args:
        node: the mapping.
        known: the accepted words.
        label: thing that the mapping describes, for messages.
        needs: the required words.
        kind: the kind of the words, for messages. The default is "word of LABEL".

    Raises:
        ModelError: the node is not a mapping, or a word is unknown, has no value or is missing.
    """
    known_words = list(known)
    if not isinstance(node.value, dict):
        raise mistake(node, f"{found_text(node)}: expected the words of {label}: {', '.join(known_words)}")
    for word, value in node.value.items():
        if word not in known_words:
            raise _unknown_word(word, value, known_words, kind or f"word of {label}")
        if value.value is None:
            raise put_at(value, ModelError(f"{word} has no value", hint="write it after the ':'", found=word))
    for word in needs:
        if word not in node.value:
            raise ModelError(f"{label} needs '{word}'", where=node.label, missing=word)
    return node.value


def _unknown_word(word: str, value: Node, names: list[str], kind: str) -> ModelError:
    error = unknown(kind, word, names, value.label)
    name, colon, text_after_colon = word.partition(":")
    if colon and name in names and value.value is None:
        return error.but(hint=f"write '{name}: {text_after_colon}', with a space after ':'", suggestion="")
    if word.endswith(")"):
        return error.but(hint="write parameters as {name: {word: value}}, without a call", suggestion="")
    return error


@contextmanager
def about(node: Node, context: str = "") -> Iterator[None]:
    """Add a position to errors that are raised inside: that of the value at the path of the error, from `node`."""

    def with_position(error: ModelError) -> ModelError:
        error_node = follow(node, error.path)
        return put_at(error_node, error.at(None, context)).but(path=(), others=tuple(map(with_position, error.others)))

    try:
        yield
    except ModelError as error:
        raise with_position(error) from None


@contextmanager
def within(context: str) -> Iterator[None]:
    """Put `context` before the messages of errors that are raised inside."""
    try:
        yield
    except ModelError as error:
        raise error.at(None, context) from None


def follow(node: Node, path: Iterable[str]) -> Node:
    """Return the node at a path of words and indices, or the last existing node on the path."""
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


def _join_hints(*hints: str) -> str:
    return "; ".join(hint for hint in hints if hint)
