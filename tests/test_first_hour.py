"""The first hour of who comes from NEST: our script does what the one for NEST does, and is no longer."""

import contextlib
import io
import runpy
from pathlib import Path

import pytest

from neuro import results

EXAMPLE = Path(__file__).parents[1] / "examples" / "first_hour.py"
NEST = """\
nest.SetKernelStatus({"resolution": 0.1, "rng_seed": 1, "print_time": False})
lif = {"tau_m": 20.0, "E_L": -65.0, "V_reset": -65.0, "V_th": -50.0, "V_m": nest.random.uniform(-65.0, -50.0)}
exc = nest.Create("iaf_psc_exp", positions=nest.spatial.grid([40, 20], extent=[2.0, 1.0]), params=lif)
inh = nest.Create("iaf_psc_exp", positions=nest.spatial.grid([20, 10], extent=[2.0, 1.0]), params=lif)
noise = nest.Create("noise_generator", params={"mean": 200.0, "std": 300.0})
nest.Connect(noise, exc)
nest.Connect(noise, inh)
recorder = nest.Create("weight_recorder")
nest.CopyModel("stdp_synapse", "plastic", {"Wmax": 60.0, "weight_recorder": recorder})
p = 0.3 * nest.spatial_distributions.gaussian(nest.spatial.distance, std=0.3)
near = {"rule": "pairwise_bernoulli", "p": p, "allow_autapses": False}
nest.Connect(exc, exc, near, {"synapse_model": "plastic", "weight": 30.0, "delay": 0.5 + 2.0 * nest.spatial.distance})
nest.Connect(exc, inh, near, {"weight": 30.0, "delay": 1.0})
nest.Connect(inh, exc, near, {"weight": -150.0, "delay": 1.0})
nest.Connect(inh, inh, near, {"weight": -150.0, "delay": 1.0})
multimeter = nest.Create("multimeter", params={"record_from": ["V_m", "I_syn_ex"], "interval": 1.0})
nest.Connect(multimeter, exc[:10])
spikes = nest.Create("spike_recorder")
nest.Connect(exc, spikes)
nest.Simulate(500.0)
times, ids = (spikes.get("events")[word] for word in ("times", "senders"))
sent = recorder.get("events")
"""


def ours():
    """The lines that do what those of NEST do."""
    lines = EXAMPLE.read_text("utf-8").splitlines()
    return lines[lines.index('net = neuro.Network("first-hour", resolution=0.1)') : lines.index("print(net)") - 1]


def test_no_line_is_longer_than_those_of_nest():
    theirs = NEST.splitlines()
    assert len(ours()) <= len(theirs)
    assert max(map(len, ours())) <= max(map(len, theirs))
    assert sum(map(len, ours())) <= sum(map(len, theirs))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """What is defined when the script has run, in a folder of its own."""
    printed = io.StringIO()
    folder = tmp_path_factory.mktemp("first-hour")
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        found = runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert "noise_generator" in printed.getvalue()
    return found | {"folder": folder}


def test_all_is_there_at_its_end(run):
    left = results.read(run["folder"] / "run.h5")
    assert left.spikes("exc", since=100.0)[0].tolist() == run["times"].tolist()
    assert left.trace("cells")[1]["V_m"].shape == (500, 10)
    assert left.trace("w")[1]["weight"].tolist() == run["sent"]["weight"].tolist()
    page = (run["folder"] / "run.html").read_text("utf-8")
    assert "first-hour" in page
    assert all((run["folder"] / name).read_bytes().startswith(b"\x89PNG") for name in ("glance.png", "weights.png"))


def test_the_network_does_what_that_of_nest_does(run, own_nest):
    there = {"nest": own_nest}
    exec(NEST, there)
    theirs = there["times"][there["times"] > 100.0].size
    assert run["times"].size == pytest.approx(theirs, rel=0.15)
    assert run["sent"]["weight"].mean() == pytest.approx(there["sent"]["weights"].mean(), rel=0.02)
