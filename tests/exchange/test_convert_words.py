"""`neuro convert` without options, and its messages in the words of the command line."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec

import numpy as np
import pytest
from typer.testing import CliRunner

import neuro
from neuro.cli.commands import app

PYTHON = re.compile(
    r"\b(from_|for_|dt|run_script|duration) ?=|=True|\b(from|to|save)_(nir|pynn|c|netx|sonata)\b|\ba dt\b"
)
"""Words of calls in Python."""


def convert(*words: str):
    return CliRunner().invoke(app, ["convert", *words])


@pytest.fixture
def net(tmp_path, monkeypatch):
    """The working folder has net.nir, of which nothing says who wrote it, and net.yaml."""
    nir = pytest.importorskip("nir", reason="nir is not installed")
    monkeypatch.chdir(tmp_path)
    one = np.ones(3)
    cells = nir.LIF(tau=0.01 * one, r=one, v_leak=0.2 * one, v_threshold=0.3 * one, v_reset=0.1 * one)
    synaptic = nir.CubaLIF(one * 0.005, one * 0.01, one, 0 * one, 0.1 * one, 0 * one, 2 * one)
    weights = nir.Linear(np.random.default_rng(0).uniform(0.0, 2.0, (3, 3)))
    nir.write("net.nir", nir.NIRGraph.from_list(nir.Input({"input": np.array([3])}), weights, cells, weights, synaptic))
    neuro.from_nir("net.nir", dt=1.0, from_="nir").save("net.yaml")


@pytest.mark.usefixtures("net")
def test_without_options_the_equations_of_nir_hold_in_steps_of_1_ms():
    done = convert("net.nir", "own.yaml")
    assert done.exit_code == 0, done.exception
    assert neuro.load("own.yaml").resolution == 1.0
    assert convert("net.nir", "same.yaml", "--resolution", "1", "--from", "nir").exit_code == 0
    own, same = (neuro.load(name) for name in ("own.yaml", "same.yaml"))
    assert own.populations["lif"].model == same.populations["lif"].model
    assert "net.nir: from nir, steps of 1 ms" in done.stdout
    assert (
        "net.nir: assuming the equations of NIR, since the file does not name its tool (--from TOOL); "
        "steps of 1 ms, since NIR has no steps (--resolution MS)."
    ) in done.stdout
    run = re.search(
        r"In 200 steps of random input nir has ([\d,]+) spikes, norse ([\d,]+) spikes, ([\d,]+) at", done.stdout
    )
    counts = [int(number.replace(",", "")) for number in run.groups()]
    assert min(counts) > 0
    assert counts[2] < max(counts)
    assert "snntorch refuses it: node 'lif' (LIF): v_leak is not 0, which snnTorch does not have" in done.stdout
    assert "sinabs refuses it: node 'cubalif' (CubaLIF): Sinabs does not have CubaLIF" in done.stdout
    assert "--from TOOL" in json.loads(convert("net.nir", "own.yaml", "--json").stdout)["note"]


@pytest.mark.usefixtures("net")
def test_what_is_named_is_not_assumed():
    assert "--from" not in convert("net.nir", "a.yaml", "--from", "norse").stdout
    assert "--resolution MS" in convert("net.nir", "a.yaml", "--from", "norse").stdout
    assert "--resolution" not in convert("net.nir", "a.yaml", "--resolution", "0.5").stdout
    assert convert("net.yaml", "ours.nir").exit_code == 0
    done = convert("ours.nir", "a.yaml")
    assert done.exit_code == 0
    assert "--from" not in done.stdout
    assert "--resolution" not in done.stdout


@pytest.mark.filterwarnings("ignore:backend 'spinnaker'")
@pytest.mark.usefixtures("net")
def test_messages_are_in_the_words_of_the_command_line(answer, messages, tmp_path):
    (tmp_path / "script.py").write_text(
        "import pyNN.nest as sim\nsim.setup()\nsim.Population(1, sim.IF_curr_exp())\nsim.run(1.0)\n"
    )
    drawn = neuro.Network("drawn", resolution=1.0)
    drawn.population("gamma", 2, neuro.gamma_sup_generator(rate=10.0, gamma_shape=2, n_proc=3))
    drawn.save("poisson.yaml")
    told = {}
    for case in messages.cases:
        if "script.py" in case and find_spec("pyNN") is None:
            continue
        status, out, told[case] = answer(*case.split())
        assert status == 2, case
        assert not PYTHON.search(told[case].replace("(in Python run_script=True)", "") + out), case
    messages(told)
