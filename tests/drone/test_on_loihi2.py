"""The drone of one description learns on Loihi 2, by three factors."""

import re

import pytest
from typer.testing import CliRunner

from neuro.cli.commands import app


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")
def test_the_drone_learns_on_loihi2(tmp_path, monkeypatch):
    """The mean return of its first three episodes was 80, without learning it is 52."""
    monkeypatch.chdir(tmp_path)
    words = ["run", "drone", "--backend", "loihi2", "--set", "t_ref=0", "--episodes", "3"]
    found = CliRunner().invoke(app, words)
    assert found.exit_code == 0
    assert float(re.search(r"mean return of the last 3: (.*)", found.stdout)[1]) > 70.0
