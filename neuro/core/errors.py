"""The error class of mistakes in descriptions and calls, and text for its messages.

```
ValueError
└── ModelError     a network, a parameter or a call that is invalid
```
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, ParamSpec, TypeVar

from neuro.core.hints import close_names, nearest

__all__ = ["ModelError", "Where", "here", "nearest", "printable", "unknown", "words_of"]

P = ParamSpec("P")
R = TypeVar("R")
_BACKENDS = ("neuro_chip", "neuro_event", "neuro_nest", "neuro_reference", "neuro_torch")
_APPS = ("neuro_doctor", "neuro_events", "neuro_exchange", "neuro_live", "neuro_predict", "neuro_sweeps")
_STEERING = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
_PACKAGES = ("neuro", *_BACKENDS, *_APPS, "dataclasses", "contextlib")


class Where(NamedTuple):
    """A place in the user's text: file, line and column (both from 1; 0 = not known)."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        parts = [self.file, *(str(n) for n in (self.line, self.column) if n)]
        return ":".join(parts)


class ModelError(ValueError):
    """Error for a mistake in a description or a call, with all that is needed to correct it.

    Attributes:
        message: one sentence with the value found and the value expected.
        where: place in the YAML file or the Python source, if known.
        hint: nearest valid name, or an instruction; "" for none.
        path: words and list positions from the part to the value, e.g. `("initial", "V_m", "3")`.
        kind: code for programs, e.g. `"unit"` or `"unknown population"`, see `unknown`; "" for none.
        found: the unknown name, or the name that lacks a value; "" if none.
        expected: known names, sorted.
        suggestion: nearest known name; "" if none is near.
        missing: required word that is absent.
        about: other words of the part that contribute to the mistake.
        others: mistakes reported together, e.g. all unit errors of a model, or all problems on a backend.

    Programs use the attributes, never the text of a message.
    """

    def __init__(
        self,
        message: str,
        *,
        where: Where | None = None,
        hint: str = "",
        path: tuple[str, ...] = (),
        kind: str = "",
        found: str = "",
        expected: tuple[str, ...] = (),
        suggestion: str = "",
        missing: str = "",
        about: tuple[str, ...] = (),
        others: tuple[ModelError, ...] = (),
    ) -> None:
        self.message, self.where, self.hint, self.path, self.others = message, where, hint, path, others
        self.kind, self.found, self.expected, self.suggestion = kind, found, expected, suggestion
        self.missing, self.about = missing, about
        super().__init__(str(self))

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        own_text = place + self.message + (f"\n  hint: {self.hint}" if self.hint else "")
        return "\n".join([own_text, *map(str, self.others)])

    def at(self, where: Where | None, context: str = "") -> ModelError:
        """Return a copy with the place `where`, if none is known, and with the prefix `context: `, if it is missing."""
        is_new = context and not self.message.startswith(context)
        message = f"{context}: {self.message}" if is_new else self.message
        others = tuple(other.at(where, context) for other in self.others)
        return self.but(message=message, where=self.where or where, others=others)

    def alone(self) -> str:
        """Return the place and the message in one line, without hint and other errors."""
        return str(self.but(hint="", others=()))

    def but(self, **changes: Any) -> ModelError:
        """Return a copy of the same class with some attributes changed."""
        copy = type(self).__new__(type(self))
        vars(copy).update(vars(self) | changes)
        copy.args = (str(copy),)
        return copy


def unknown(
    subject: str, name: object, known: Iterable[str], where: Where | None = None, path: tuple[str, ...] = ()
) -> ModelError:
    """Return the error for an unknown name.

    For `subject` = "population" the error's `kind` is "unknown population". For "parameter of filter 'tar'" the kind is
    "unknown parameter of", and the message begins with the part: "filter 'tar': unknown parameter 'tua'".
    """
    names, (head, separator, owner) = tuple(sorted(known)), subject.partition(" of ")
    return ModelError(
        f"{owner}: unknown {head} '{name}'" if owner.endswith("'") else f"unknown {subject} '{name}'",
        where=where,
        hint=nearest(str(name), names),
        path=path,
        kind=f"unknown {head}{separator}".rstrip(),
        found=str(name),
        expected=names,
        suggestion=next(iter(close_names(str(name), names)), ""),
    )


def words_of(label: str) -> tuple[str, ...]:
    """Split a full name into words, e.g. `("iaf_psc_exp", "tau_m")` for "iaf_psc_exp.tau_m[3]"."""
    return tuple(re.findall(r"[^\W\d]\w*", label))


def naming_words(function: Callable[P, R]) -> Callable[P, R]:
    """Wrap a function so that an unknown keyword argument raises an error with the nearest known argument."""
    known = function.__annotations__.keys() - {"return"}

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        for word in kwargs:
            if word not in known:
                raise unknown(f"word of {function.__qualname__}", word, known, here())
        return function(*args, **kwargs)

    return call


def here() -> Where | None:
    """Return file and line of the nearest caller outside this library, for messages only."""
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        module = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if module not in _PACKAGES and not frame.f_code.co_filename.startswith("<"):
            return Where(Path(frame.f_code.co_filename).name, frame.f_lineno)
        frame = frame.f_back
    return None


def a(name: str) -> str:
    """Return a name with its article, e.g. "a poisson_generator" or "an iaf_psc_exp"."""
    return f"{'an' if name[:1].lower() in 'aeio' else 'a'} {name}"


def some(n: int, noun: str) -> str:
    """Return a number with its noun, e.g. "1 synapse" or "1,000 synapses"."""
    return f"{n:,} {noun}{'s' * (n != 1)}"


def printable(text: str) -> str:
    """Replace characters that control a terminal or change the direction of text by their Python escapes."""
    return _STEERING.sub(lambda match: match[0].encode("unicode_escape").decode(), text)
