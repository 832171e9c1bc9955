"""Parser of expressions: text to trees. The text is never run as code.

    expression  = sum [("<" | "<=" | ">" | ">=") sum]
    sum         = product {("+" | "-") product}
    product     = signed {("*" | "/") signed}
    signed      = ("-" | "+") signed | power
    power       = atom [("^" | "**") signed]
    atom        = number [unit] | name | name "(" expression {"," expression} ")" | "(" expression ")"

Letters are those of ASCII. Read by precedence climbing (Pratt, Top Down Operator Precedence, POPL 1973).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from neuro.core.errors import ModelError, words_of

# Limits of an expression, and the number of its characters in a message.
MAX_CHARACTERS = 2000
MAX_TOKENS = 400
MAX_DEPTH = 40
_WINDOW = 60


@dataclass(frozen=True, slots=True)
class Number:
    """A number; `unit` is the name of its unit, or "". In all trees, `at` is an index in the text, from 0."""

    value: float
    unit: str
    at: int


@dataclass(frozen=True, slots=True)
class Name:
    """A state, a parameter, an abbreviation or a unit."""

    name: str
    at: int


@dataclass(frozen=True, slots=True)
class Negative:
    """A tree with a minus sign."""

    of: Tree
    at: int


@dataclass(frozen=True, slots=True)
class Binary:
    """`left sign right`; the sign is one of + - * / ^ < <= > >=; `at` is the place of the sign."""

    sign: str
    left: Tree
    right: Tree
    at: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function of one or more trees."""

    name: str
    arguments: tuple[Tree, ...]
    at: int


Tree: TypeAlias = Number | Name | Negative | Binary | Call
COMPARISONS = ("<=", ">=", "<", ">")
_BINDING = {**dict.fromkeys(COMPARISONS, 1), "+": 2, "-": 2, "*": 3, "/": 3, "^": 5}
# Strength with which a minus sign binds, between those of * and ^ in _BINDING.
_SIGNED = 4
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|(?P<name>[A-Za-z][A-Za-z0-9_]*)"
    r"|(?P<sign>\*\*|<=|>=|[-+*/^<>(),]))",
    re.ASCII,
)
_TOKEN_OR_VIEW = re.compile(
    _TOKEN.pattern.replace("(),]", "(),=]").replace(
        "[A-Za-z][A-Za-z0-9_]*", r'(?:[A-Za-z][A-Za-z0-9_]*|"[^"]*")(?:\[(?:[^][]|\[[^][]*\])*\])?'
    ),
    re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Expression:
    """The text of an expression and its tree."""

    text: str
    tree: Tree

    def mistake(self, at: int, message: str, hint: str = "") -> Misread:
        """Return the error for a place in the text."""
        return mistake(self.text, at, message, hint)


class Misread(ModelError):
    """A mistake at a place in an expression.

    Attributes:
        place: index of the wrong character, from 0.
        bare: the message without the place.
    """

    def __init__(self, message: str, hint: str, place: int, bare: str) -> None:
        super().__init__(message, hint=hint)
        self.place, self.bare = place, bare


def mistake(text: str, at: int, message: str, hint: str = "") -> Misread:
    """Return an error that shows its place.

    Args:
        text: the expression.
        at: index of the wrong character, from 0.
        message: what was found and what was expected.
        hint: what to do.
    """
    begin = max(0, min(at - _WINDOW // 2, len(text) - _WINDOW))
    line = "".join(letter if letter.isprintable() else " " for letter in text[begin : begin + _WINDOW])
    sentence = f"column {at + 1}: {message}\n    {line}\n    {' ' * (at - begin)}^"
    wrong = Misread(sentence, hint, at, message)
    wrong.about = words_of(text)
    return wrong


@dataclass(frozen=True, slots=True)
class Hints:
    """Hints in the errors of a parser, for one purpose of expressions.

    Attributes:
        signs: hint for each sign that is not an operator.
        shorter: hint for an expression that is too long.
        names: name and position of the argument that may have a name, by function, e.g. `after(a, b, within=20)`.
    """

    signs: Mapping[str, str] = field(default_factory=dict)
    shorter: str = ""
    names: Mapping[str, tuple[str, int]] = field(default_factory=dict)


def parse(text: object, hints: Hints = Hints(), views: bool = False) -> Expression:
    """Read an expression.

    Args:
        text: the expression.
        hints: hints for errors.
        views: whether a name may have an index, which becomes a part of the name, e.g. `motors[0, 1]`, and may be
            quoted, e.g. `"s-1"`.

    Raises:
        ModelError: the text is no expression, is too long, or is nested too deeply. The message names the column.
    """
    if isinstance(text, int | float) and not isinstance(text, bool):
        text = repr(text)
    if not isinstance(text, str):
        raise ModelError(f"found {text!r:.40}: expected an expression as text")
    if len(text) > MAX_CHARACTERS:
        message = f"found {len(text)} characters: expected at most {MAX_CHARACTERS}"
        raise mistake(text, MAX_CHARACTERS, message, hints.shorter)
    return Expression(text, _Parser(text, hints, _TOKEN_OR_VIEW if views else _TOKEN).parse_all())


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    at: int


class _Parser:
    def __init__(self, text: str, hints: Hints, token: re.Pattern[str]) -> None:
        self.text, self.hints, self.pattern, self.next = text, hints, token, 0
        self.tokens = self._tokens()

    def _tokens(self) -> list[_Token]:
        tokens: list[_Token] = []
        position, end = 0, len(self.text.rstrip())
        while position < end:
            match = self.pattern.match(self.text, position)
            if match is None or match.lastgroup is None:
                position += len(self.text[position:]) - len(self.text[position:].lstrip())
                raise self.mistake(position, *self.unexpected(self.text[position]))
            kind = match.lastgroup
            tokens.append(_Token(kind, match[kind].replace("**", "^"), match.start(kind)))
            if len(tokens) > MAX_TOKENS:
                message = f"found more than {MAX_TOKENS} numbers, names and signs: expected fewer"
                raise self.mistake(tokens[-1].at, message, self.hints.shorter)
            position = match.end()
        return [*tokens, _Token("end", "the end", end)]

    def mistake(self, at: int, message: str, hint: str = "") -> Misread:
        return mistake(self.text, at, message, hint)

    def unexpected(self, letter: str) -> tuple[str, str]:
        """Return message and hint for a character that cannot start a token."""
        character = f"'{letter}'" if letter.isascii() and letter.isprintable() else f"the character U+{ord(letter):04X}"
        message = f"found {character}: expected a number, a name or an operator"
        ascii_only = "" if letter.isascii() else "names consist of the letters A to Z and a to z, digits and '_'"
        return message, self.hints.signs.get(letter, ascii_only)

    @property
    def token(self) -> _Token:
        return self.tokens[self.next]

    def take(self) -> _Token:
        token = self.token
        self.next += 1
        return token

    def parse_all(self) -> Tree:
        tree = self.parse_expression(0, 0)
        if self.token.kind != "end":
            text = self.token.text
            raise self.mistake(
                self.token.at, f"found '{text}': expected an operator or the end", self.hints.signs.get(text, "")
            )
        return tree

    def parse_expression(self, binding: int, depth: int) -> Tree:
        """Parse an expression up to an operator that binds no tighter than `binding`."""
        if depth > MAX_DEPTH:
            raise self.mistake(self.token.at, f"found more than {MAX_DEPTH} levels: expected fewer")
        left = self.parse_operand(depth)
        while self.token.kind == "sign" and _BINDING.get(self.token.text, 0) > binding:
            sign = self.take()
            binding_of_sign = _BINDING[sign.text]
            right = self.parse_expression(_SIGNED - 1 if sign.text == "^" else binding_of_sign, depth + 1)
            left = Binary(sign.text, left, right, sign.at)
            if sign.text in COMPARISONS and self.token.text in COMPARISONS:
                raise self.mistake(self.token.at, f"found a second '{self.token.text}': expected one comparison")
        return left

    def parse_operand(self, depth: int) -> Tree:
        token = self.take()
        if token.kind == "number":
            return self.parse_number(token)
        if token.kind == "name":
            return self.parse_call(token, depth) if self.token.text == "(" else Name(token.text, token.at)
        if token.text == "-":
            return Negative(self.parse_expression(_SIGNED - 1, depth + 1), token.at)
        if token.text == "+":
            return self.parse_expression(_SIGNED - 1, depth + 1)
        if token.text == "(":
            tree = self.parse_expression(0, depth + 1)
            self.expect(")")
            return tree
        raise self.mistake(token.at, f"found {_quoted(token)}: expected a number, a name or '('")

    def parse_number(self, token: _Token) -> Number:
        value = float(token.text)
        if math.isinf(value):
            raise self.mistake(token.at, f"found {token.text:.40}: expected a number below 1.8e308")
        unit = self.take().text if self.token.kind == "name" else ""
        return Number(value, unit, token.at)

    def parse_call(self, name: _Token, depth: int) -> Call:
        self.take()
        arguments = [self.parse_expression(0, depth + 1)]
        word, position = self.hints.names.get(name.text, ("", 0))
        while self.token.text == ",":
            self.take()
            if len(arguments) == position and self.token.text == word and self.tokens[self.next + 1].text == "=":
                self.next += 2
            arguments.append(self.parse_expression(0, depth + 1))
        self.expect(")")
        return Call(name.text, tuple(arguments), name.at)

    def expect(self, sign: str) -> None:
        token = self.take()
        if token.text != sign:
            message = f"found {_quoted(token)}: expected '{sign}'"
            raise self.mistake(token.at, message, self.hints.signs.get(token.text, ""))


def _quoted(token: _Token) -> str:
    return token.text if token.kind == "end" else f"'{token.text}'"
