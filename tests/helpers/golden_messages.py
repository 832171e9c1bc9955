"""Exact wordings of messages: one golden file, `tests/messages.yaml`, which `pytest --renew-messages` writes anew.

A test gives the messages that it collected (`refused.refused`) to the fixture `messages`; all other tests look at the
kind of an error, its place and its suggestion. A renewed file is read in the diff before it is committed.

The cases of a test may also stand in the file alone, as expressions of Python or as texts that the test reads
(`messages.calls`, `messages.of`): a new case is a line `"expression": ""` there, whose message a renewal adds.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import neuro
from refused import without_place

FILE = Path(__file__).parents[1] / "messages.yaml"
HEAD = "# What is said, by test and case. `pytest --renew-messages` writes the cases of the tests that it runs anew.\n"

IN_A_TEST = re.compile(r"\btest_\w+\.py:\d+: ")
"""A place in a test, which moves with it and is left out."""
COMMON = {"neuro": neuro, "np": np}
"""Names that the cases of every test know."""


class _Dumper(yaml.SafeDumper):
    """Texts of several lines as blocks, so that a diff shows the line that changed."""


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None)


_Dumper.add_representer(str, _text)


def dump(messages: dict[str, dict[str, str]]) -> str:
    """The golden file as text: tests and their cases in alphabetical order."""
    return HEAD + yaml.dump(messages, Dumper=_Dumper, allow_unicode=True, width=1 << 30)


def read(file: Path = FILE) -> dict[str, dict[str, str]]:
    """The messages of each test by case."""
    return yaml.load(file.read_text("utf-8"), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)) or {}


class Messages:
    """The messages of one test: a call compares those of some cases, and reports all that differ.

    Args:
        test: the key of the golden file: path of the test's file below `tests`, and its function.
        renew: whether the file is written instead of compared; tests must then run in one process.
    """

    def __init__(self, test: str, renew: bool) -> None:
        self._test, self._renew = test, renew

    @property
    def cases(self) -> list[str]:
        """The cases that the golden file has of this test, where these are calls or commands: new ones are written
        there, with no text, and renewed."""
        cases = list(read().get(self._test, {}))
        assert cases, f"tests/messages.yaml has no cases of {self._test}"
        return cases

    def __call__(self, messages: dict[str, str]) -> None:
        texts = {
            case: "\n".join(map(str.rstrip, IN_A_TEST.sub("", text).splitlines())) for case, text in messages.items()
        }
        golden = read()
        if self._renew:
            FILE.write_text(dump(golden | {self._test: golden.get(self._test, {}) | texts}), "utf-8")
            return
        expected = golden.get(self._test, {})
        wrong = [
            f"{case}\n  expected: {expected.get(case)}\n  found:    {text}"
            for case, text in texts.items()
            if text != expected.get(case)
        ]
        if wrong:
            pytest.fail(f"{len(wrong)} messages differ from tests/messages.yaml:\n" + "\n".join(wrong), pytrace=False)

    def of(self, message: Callable[[str], str]) -> None:
        """Compare the messages that a function gives for each case of the file."""
        self({case: message(case) for case in self.cases})

    def calls(self, scope: Mapping[str, Any] | Callable[[], Mapping[str, Any]]) -> None:
        """Compare the errors of the cases of the file, expressions by names of a scope, or of a new one for each."""
        self.of(lambda case: without_place(eval, case, COMMON | dict(scope() if callable(scope) else scope)))


def messages_of(request: Any) -> Messages:
    """The comparer of a test."""
    path = request.path.relative_to(FILE.parent)
    return Messages(f"{path}::{request.function.__name__}", request.config.getoption("--renew-messages"))
