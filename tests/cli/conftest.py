"""The command line as a function."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

from neuro.cli.mistakes import telling
from small_networks import NETWORK


@pytest.fixture
def neuro(answer: Callable[..., tuple[int, str, str]]) -> Callable[..., tuple[int, str, str]]:
    """Run `neuro` with some words in this process."""
    return answer


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run a command without the others; exit status, output and error."""

    def run(command: Callable[..., None], *words: object) -> tuple[int, str, str]:
        app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
        app.command()(command)
        monkeypatch.setattr(sys, "argv", [command.__name__, *map(str, words)])
        capsys.readouterr()
        try:
            with telling():
                status = app(standalone_mode=False, prog_name=command.__name__) or 0
        except SystemExit as leaving:
            status = leaving.code
        return status, *capsys.readouterr()

    return run


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a small network in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NETWORK)
    return "net.yaml"
