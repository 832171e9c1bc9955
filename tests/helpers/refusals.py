"""Calls that are refused and what they say: the tables of `tests/refusals.yaml`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from neuro import ModelError

TABLES = yaml.safe_load((Path(__file__).parents[1] / "refusals.yaml").read_text(encoding="utf-8"))


def refusals(table: str) -> pytest.MarkDecorator:
    """Run a test for each `call` of a table with the `message` of its error."""
    return pytest.mark.parametrize(("call", "message"), TABLES[table].items(), ids=range(len(TABLES[table])))


def refusal(call: str, scope: Mapping[str, Any]) -> str:
    """The message of the error of a call, by names of a scope."""
    return message_of(eval, call, dict(scope))


def message_of(call: Callable[..., Any], *args: Any, **words: Any) -> str:
    """The message of the error of a call, without the place in a test."""
    with pytest.raises((ModelError, TypeError)) as error:
        call(*args, **words)
    return str(error.value).removeprefix(f"{getattr(error.value, 'where', '')}: ")
