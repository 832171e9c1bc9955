"""What is said of a call that is refused."""

import re
import shlex
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import pytest

from neuro import ModelError


def error_of(call: Callable[..., object], *args: object, **words: object) -> ModelError:
    """The error that a call ends with."""
    with pytest.raises(ModelError) as error:
        call(*args, **words)
    return error.value


def refused(call: Callable[..., object], *args: object, **words: object) -> str:
    """What a user reads of that error: its place, message and hint."""
    return str(error_of(call, *args, **words))


def without_place(call: Callable[..., object], *args: object, **words: object) -> str:
    """The message of the error of a call, without the place in a test."""
    with pytest.raises((ModelError, TypeError, AttributeError)) as error:
        call(*args, **words)
    place = str(getattr(error.value, "where", ""))
    return str(error.value).removeprefix(f"{place}: ") if ".py" in place else str(error.value)


def refusals_of(calls: Iterable[str], names: Mapping[str, Any], **places: object) -> dict[str, str]:
    """What a user reads of each call that is refused, by the call; `places` are named, not written out."""
    place = re.compile(r"\b\w+\.py:\d+: ")  # in a test, which an edit of it moves
    return {call: place.sub("", _named(refused(eval, call, dict(names)), places)) for call in calls}


def mistakes_of(command: Callable[..., tuple[int, str, str]], lines: Iterable[str], **places: object) -> dict[str, str]:
    """What each command prints, by its line: status 2, an error, and nothing else."""
    printed = {}
    for line in lines:
        status, out, err = command(*shlex.split(line.format(**places)))
        assert (status, out, err.startswith("error: "), "Traceback" in err) == (2, "", True, False), (line, out, err)
        printed[line] = _named(err, places)
    return printed


def _named(text: str, places: Mapping[str, object]) -> str:
    for name, place in places.items():
        text = text.replace(str(place), f"{{{name}}}")
    return text
