"""The command line as a function."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

from neuro.cli.mistakes import telling

NETWORK = """\
neuro: 1
name: small
resolution: 0.1
parameters: {w: 300.0, rate: 100.0}
populations:
  noise: {model: {poisson_generator: {rate: $rate}}, shape: 20}
  current: {model: {dc_generator: {amplitude: 100.0}}, shape: 1}
  exc: {model: iaf_psc_exp, shape: [2, 4]}
  one: {model: {iaf_psc_exp: {I_e: 400.0}}, shape: 1}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: $w, delay: 1.0, synapse: {stdp: {Wmax: 1000.0}}}
  current_exc: {from: current, to: exc, rule: all_to_all, weight: 1.0, delay: 1.0}
  exc_one: {from: exc, to: one, rule: {pairs: {pre: [0, 3], post: [0, 0]}}, weight: [10.0, 20.0], delay: 2.0}
probes:
  v: {of: exc, record: V_m, every: 1.0}
  v_one: {of: one, record: V_m}
"""


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
                status = app(standalone_mode=False) or 0
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
