"""The report of a script's process. The script can write it, too, so it is read as data of a stranger."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from typing import Any, BinaryIO, TypeVar

from neuro.core.errors import Where

MOST_BYTES = 1 << 26
LONGEST = 10_000
"""Letters of a text."""
_NETWORK = re.compile(r"[0-9]{1,6}\.yaml|")

Item = TypeVar("Item")


class Damaged(ValueError):
    """No report of ours; the message says what is wrong."""


@dataclass(frozen=True, slots=True)
class Remark:
    """A message about a line of the script.

    Attributes:
        file: its file, "" if not known.
        line: from 1; 0 if not known.
        message: the text.
    """

    file: str
    line: int
    message: str

    @property
    def where(self) -> Where | None:
        """The place, if known."""
        return Where(self.file, self.line) if self.file else None


@dataclass(frozen=True, slots=True)
class Built:
    """A network that the script has built.

    Attributes:
        file: the name of its file, "" if it cannot come.
        problems: why it cannot come.
        notes: what is otherwise here.
        runs: ms, one for each call of `run`.
        line: of `setup`; 0 if not known.
    """

    file: str
    problems: tuple[Remark, ...]
    notes: tuple[Remark, ...]
    runs: tuple[float, ...]
    line: int


@dataclass(frozen=True, slots=True)
class Failure:
    """How the script has failed.

    Attributes:
        message: of the error.
        line: of the script; 0 if not known.
        harmless: whether its networks come nevertheless.
        kind: "raised", "exit", "memory", "refused", "time" or "".
    """

    message: str
    line: int = 0
    harmless: bool = False
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """What has come of a script."""

    networks: tuple[Built, ...] = ()
    failure: Failure | None = None

    def write(self, descriptor: int) -> None:
        """Write it to an open file, in the place of what is in it."""
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        with open(descriptor, "w", encoding="utf-8") as file:
            json.dump(asdict(self), file)

    @classmethod
    def read(cls, file: BinaryIO) -> Report | None:
        """The report in an open file; None if nothing is written there.

        Raises:
            Damaged: it is too long, no JSON, or of another form.
        """
        size = os.fstat(file.fileno()).st_size
        if size > MOST_BYTES:
            raise Damaged(f"{size:,} bytes: expected at most {MOST_BYTES:,}")
        file.seek(0)
        content = file.read(MOST_BYTES)
        if not content:
            return None
        try:
            values = json.loads(content.decode("utf-8"))
        except (ValueError, RecursionError):
            raise Damaged("no JSON") from None
        return _report(values, "report")


def printable(text: str) -> str:
    """A text with spaces for what would steer a terminal or break a line."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _words(value: Any, kind: type[Any], place: str) -> dict[str, Any]:
    names = {one.name for one in fields(kind)}
    if not isinstance(value, dict) or value.keys() != names:
        raise Damaged(f"{place}: expected {', '.join(sorted(names))}")
    return value


def _items(value: Any, item: Callable[[Any, str], Item], place: str) -> tuple[Item, ...]:
    if not isinstance(value, list):
        raise Damaged(f"{place}: expected a list")
    return tuple(item(each, f"{place}[{k}]") for k, each in enumerate(value))


def _text(value: Any, place: str) -> str:
    if not isinstance(value, str) or len(value) > LONGEST:
        raise Damaged(f"{place}: expected a text of at most {LONGEST:,} letters")
    return printable(value)


def _line(value: Any, place: str) -> int:
    if type(value) is not int or not 0 <= value < 1 << 31:
        raise Damaged(f"{place}: expected the number of a line")
    return value


def _ms(value: Any, place: str) -> float:
    if type(value) not in (int, float) or not 0 <= value < math.inf:
        raise Damaged(f"{place}: expected a time in ms")
    return float(value)


def _remark(value: Any, place: str) -> Remark:
    words = _words(value, Remark, place)
    return Remark(*(check(words[name], f"{place}.{name}") for name, check in _REMARK.items()))


_REMARK: dict[str, Callable[[Any, str], Any]] = {"file": _text, "line": _line, "message": _text}


def _built(value: Any, place: str) -> Built:
    words = _words(value, Built, place)
    problems = _items(words["problems"], _remark, f"{place}.problems")
    file = _text(words["file"], f"{place}.file")
    if not _NETWORK.fullmatch(file) or bool(file) == bool(problems):
        raise Damaged(f"{place}.file = {file[:100]!r}: expected a number and .yaml, or problems")
    notes, runs = _items(words["notes"], _remark, f"{place}.notes"), _items(words["runs"], _ms, f"{place}.runs")
    return Built(file, problems, notes, runs, _line(words["line"], f"{place}.line"))


def _failure(value: Any, place: str) -> Failure:
    words = _words(value, Failure, place)
    if not isinstance(words["harmless"], bool):
        raise Damaged(f"{place}.harmless: expected true or false")
    texts = (_text(words[name], f"{place}.{name}") for name in ("message", "kind"))
    return Failure(next(texts), _line(words["line"], f"{place}.line"), words["harmless"], next(texts))


def _report(value: Any, place: str) -> Report:
    words = _words(value, Report, place)
    failure = None if words["failure"] is None else _failure(words["failure"], "failure")
    return Report(_items(words["networks"], _built, "networks"), failure)
