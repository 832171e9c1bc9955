"""The command line as a function."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from neuro.cli import main

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


@dataclass(frozen=True)
class Answer:
    """What a command left: exit status, standard output and error."""

    status: int
    out: str
    err: str


@pytest.fixture
def neuro(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Answer]:
    """Run `neuro` with some words in this process."""

    def run(*words: object) -> Answer:
        capsys.readouterr()
        monkeypatch.setattr(sys, "argv", ["neuro", *map(str, words)])
        with pytest.raises(SystemExit) as leaving:
            main()
        code = leaving.value.code
        return Answer(code if isinstance(code, int) else 0, *capsys.readouterr())

    return run


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a small network in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NETWORK)
    return "net.yaml"
