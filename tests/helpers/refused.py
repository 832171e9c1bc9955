"""What is said of a call that is refused."""

import shlex
from collections.abc import Callable, Mapping
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


def refusals_of(calls: str, names: Mapping[str, Any], **places: object) -> dict[str, str]:
    """What a user reads of each call that is refused, a line each, by the call; `places` are named, not written out."""
    lines = [line.strip() for line in calls.strip().splitlines()]
    return {line: _named(refused(eval, line, dict(names)), places) for line in lines}


def mistakes_of(command: Callable[..., tuple[int, str, str]], lines: str, **places: object) -> dict[str, str]:
    """What commands print that end with status 2 and nothing else, a line each, by the line."""
    printed = {}
    for line in map(str.strip, lines.strip().splitlines()):
        status, out, err = command(*shlex.split(line.format(**places)))
        assert (status, out, err.startswith("error: "), "Traceback" in err) == (2, "", True, False), (line, out, err)
        printed[line] = _named(err, places)
    return printed


def _named(text: str, places: Mapping[str, object]) -> str:
    for name, place in places.items():
        text = text.replace(str(place), f"{{{name}}}")
    return text
