"""The report of a script's process. The script can write it, too, so it is read as data of a stranger."""

from __future__ import annotations

import json
import math
import os
import re
from dataclasses import asdict, dataclass, is_dataclass
from types import UnionType
from typing import Any, BinaryIO, get_args, get_origin, get_type_hints

from neuro.apps import Where

MOST_BYTES = 1 << 26
LONGEST = 10_000
"""Letters of a text."""
_NETWORK = re.compile(r"[0-9]{1,6}\.yaml|")


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
        report: Report = _decoded(cls, values, "report")
        return report


def printable(text: str) -> str:
    """A text with spaces for what would steer a terminal or break a line."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _decoded(kind: Any, value: Any, place: str) -> Any:
    """Return a value of JSON as a part of a report: a dataclass, a tuple, a part or None, a text, a number or a truth.

    Raises:
        Damaged: the value is none of that kind.
    """
    if isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind)
        if not isinstance(value, dict) or value.keys() != hints.keys():
            raise Damaged(f"{place}: expected {', '.join(sorted(hints))}")
        inside = "" if kind is Report else f"{place}."
        words = {name: _decoded(hint, value[name], inside + name) for name, hint in hints.items()}
        if kind is Built and not (_NETWORK.fullmatch(words["file"]) and bool(words["file"]) != bool(words["problems"])):
            raise Damaged(f"{place}.file = {words['file'][:100]!r}: expected a number and .yaml, or problems")
        return kind(**words)
    if isinstance(kind, UnionType):
        return None if value is None else _decoded(get_args(kind)[0], value, place)
    wish, fits = {
        str: (f"a text of at most {LONGEST:,} letters", isinstance(value, str) and len(value) <= LONGEST),
        int: ("the number of a line", type(value) is int and 0 <= value < 1 << 31),
        float: ("a time in ms", type(value) in (int, float) and 0 <= value < math.inf),
        bool: ("true or false", isinstance(value, bool)),
    }.get(kind, ("a list", isinstance(value, list)))
    if not fits:
        raise Damaged(f"{place}: expected {wish}")
    if get_origin(kind) is tuple:
        return tuple(_decoded(get_args(kind)[0], each, f"{place}[{k}]") for k, each in enumerate(value))
    return printable(value) if kind is str else kind(value)
