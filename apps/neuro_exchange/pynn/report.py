"""The report of the process that runs a script. The script can forge the report, so it is read as untrusted data."""

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
"""Largest size of a report in bytes."""
LONGEST = 10_000
"""Largest length of a text in characters."""
_NETWORK = re.compile(r"[0-9]{1,6}\.yaml|")


class Damaged(ValueError):
    """Raised for a report that does not have the expected form."""


@dataclass(frozen=True, slots=True)
class Remark:
    """A message about a line of the script.

    Attributes:
        file: name of the file; "" if unknown.
        line: number of the line, from 1; 0 if unknown.
        message: text of the message.
    """

    file: str
    line: int
    message: str

    @property
    def where(self) -> Where | None:
        """The file and line, or None if unknown."""
        return Where(self.file, self.line) if self.file else None


@dataclass(frozen=True, slots=True)
class BuiltNetwork:
    """A network that the script built.

    Attributes:
        file: name of the network's file; "" if the network cannot be converted.
        problems: reasons why the network cannot be converted.
        notes: differences between the network in PyNN and the converted network.
        runs: duration of each call of `run` in ms.
        line: line of `setup`; 0 if unknown.
    """

    file: str
    problems: tuple[Remark, ...]
    notes: tuple[Remark, ...]
    runs: tuple[float, ...]
    line: int


@dataclass(frozen=True, slots=True)
class Failure:
    """An error of the script.

    Attributes:
        message: message of the error.
        line: line of the script; 0 if unknown.
        harmless: whether the networks are complete in spite of the error.
        kind: cause of the failure: "raised", "exit", "memory", "refused" or "time"; "" for other causes.
    """

    message: str
    line: int = 0
    harmless: bool = False
    kind: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """The networks that a script built, and its error, if any."""

    networks: tuple[BuiltNetwork, ...] = ()
    failure: Failure | None = None

    def write(self, descriptor: int) -> None:
        """Replace the content of an open file by the report."""
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        with open(descriptor, "w", encoding="utf-8") as file:
            json.dump(asdict(self), file)

    @classmethod
    def read(cls, file: BinaryIO) -> Report | None:
        """Return the report of an open file, or None if the file is empty.

        Raises:
            Damaged: the content is too long, is not JSON, or does not have the form of a report.
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
            raise Damaged("not JSON") from None
        report: Report = _decoded(cls, values, "report")
        return report


def printable(text: str) -> str:
    """Return a text with spaces instead of control characters and line breaks."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _decoded(kind: Any, value: Any, place: str) -> Any:
    """Convert a value of JSON to a type of the report: a dataclass, a tuple, an optional, a text, a number or a bool.

    Raises:
        Damaged: the value does not have that type.
    """
    if isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind)
        if not isinstance(value, dict) or value.keys() != hints.keys():
            raise Damaged(f"{place}: expected {', '.join(sorted(hints))}")
        prefix = "" if kind is Report else f"{place}."
        fields = {name: _decoded(hint, value[name], prefix + name) for name, hint in hints.items()}
        if kind is BuiltNetwork and not (
            _NETWORK.fullmatch(fields["file"]) and bool(fields["file"]) != bool(fields["problems"])
        ):
            raise Damaged(f"{place}.file = {fields['file'][:100]!r}: expected a number and .yaml, or problems")
        return kind(**fields)
    if isinstance(kind, UnionType):
        return None if value is None else _decoded(get_args(kind)[0], value, place)
    expected, fits = {
        str: (f"a text of at most {LONGEST:,} characters", isinstance(value, str) and len(value) <= LONGEST),
        int: ("the number of a line", type(value) is int and 0 <= value < 1 << 31),
        float: ("a time in ms", type(value) in (int, float) and 0 <= value < math.inf),
        bool: ("true or false", isinstance(value, bool)),
    }.get(kind, ("a list", isinstance(value, list)))
    if not fits:
        raise Damaged(f"{place}: expected {expected}")
    if get_origin(kind) is tuple:
        return tuple(_decoded(get_args(kind)[0], item, f"{place}[{k}]") for k, item in enumerate(value))
    return printable(value) if kind is str else kind(value)
