"""One name for an option everywhere: the table of the page on options against what the commands take."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from neuro.cli import commands


def test_the_word_of_another_tool_is_answered_with_ours(neuro, messages):
    """More are among the mistakes of commands of the core."""
    for words in yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text("utf-8"))["apps"]:
        messages({words: neuro(*words.split()).err})


PAGE = Path(__file__).parents[2] / "docs/reference/options.md"
ROW = re.compile(r"^\| `(--[^`]+)` \| (.+) \| (.+) \|$", re.MULTILINE)
KINDS = ({"FILE", "FOLDER", "PATH", "SCENES"}, {"FORMAT", "TOOL"}, {"NAME", "NAME=FROM"})
"""Values of one kind that help calls by several words."""


def leaves(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """All commands that do something, by their names."""
    for name, inner in getattr(command, "commands", {}).items():
        yield from leaves(inner, f"{path} {name}".strip())
    if not hasattr(command, "commands"):
        yield path, command


@pytest.fixture(scope="module")
def root() -> Any:
    """All commands, also those of packages of apps."""
    command: Any = typer.main.get_command(commands.app)
    command.commands.update({name: commands.load(entry) for name, entry in commands.apps().items()})
    return command


@pytest.fixture(scope="module")
def taken(root: Any) -> dict[str, tuple[set[str], set[str]]]:
    """The values of each option, and the commands that take it."""
    found: dict[str, tuple[set[str], set[str]]] = defaultdict(lambda: (set(), set()))
    for path, command in leaves(root):
        for one in command.params:
            if one.opts[0].startswith("-") and one.opts[0] != "--with":
                values, paths = found[one.opts[0]]
                values.add("" if getattr(one, "is_flag", False) else one.metavar or "no metavar")
                paths.add(path)
    return found


def test_the_page_lists_all_options_with_their_values_and_commands(taken):
    listed = {option: set(re.findall("`([^`]+)`", where)) for option, _, where in ROW.findall(PAGE.read_text("utf-8"))}
    expected = {
        f"{name} {' or '.join(sorted(values))}".strip().replace("|", "\\|"): paths
        for name, (values, paths) in taken.items()
    }
    assert listed == expected


def test_an_option_takes_one_kind_of_value(taken):
    mixed = {name: values for name, (values, _) in taken.items() if len(values) > 1}
    assert {name for name, values in mixed.items() if not any(values <= kind for kind in KINDS)} == set()


def test_an_option_has_no_second_name(root):
    second = {word for _, command in leaves(root) for one in command.params for word in one.opts[1:]}
    assert second == {"-f", "-e", "-o"}  # of `neuro events tohdf5`, as in the thesis


def test_help_shows_no_type_behind_a_flag_and_breaks_no_sentence():
    root: Any = typer.main.get_command(commands.app)
    with typer.Context(root) as context:
        for name in root.list_commands(context):
            _, command, _ = root.resolve_command(context, [name])
            for path, each in leaves(command, name):
                assert not re.search(r"[^\n]\n[^\n]", each.help or ""), path
                flags = [one for one in each.get_params(typer.Context(each)) if getattr(one, "is_flag", False)]
                assert {one.metavar for one in flags} == {""}, path
