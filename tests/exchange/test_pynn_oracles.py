"""Scripts of PyNN on PyNN's own simulators: exported ones, and those that others wrote; by `make test-oracles`."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import neuro
import pynn_networks

if not all(find_spec(name) for name in ("pyNN", "nest", "brian2")):
    pytest.skip("PyNN with NEST and Brian2 is not installed: make test-oracles", allow_module_level=True)

SCRIPTS = Path(__file__).parents[3] / "shared" / "reference" / "pynn"
DURATION = 200.0
ON_GRID = """
import runpy, sys, numpy as np, pyNN.nest as sim
from pyNN.nest import control, populations
from pyNN.parameters import LazyArray
columns = LazyArray.by_column
LazyArray.by_column = lambda *args: (one if one is True else np.atleast_1d(one) for one in columns(*args))
kept, setup, make = [], sim.setup, populations.Population.__init__
def on_grid(*args, **words):
    kept.clear()
    return setup(*args, **words | {"spike_precision": "on_grid"})
def recorded(self, *args, **words):
    make(self, *args, **words)
    self.record("spikes")
    kept.append(self)
def dump(*args, **words):
    spikes = {}
    for k, one in enumerate(kept):
        trains = one.get_data("spikes").segments[0].spiketrains
        spikes[f"{k}.times"] = np.concatenate([np.asarray(train.magnitude) for train in trains])
        spikes[f"{k}.ids"] = np.repeat(np.arange(len(trains)), [len(train) for train in trains])
    np.savez(out, **spikes)
    sys.exit()
out, script = sys.argv[1:3]
sys.argv = [script, "nest"] + sys.argv[3:]
sim.setup = control.setup = on_grid
populations.Population.__init__ = recorded
sim.end = control.end = dump
runpy.run_path(script, run_name="__main__")
"""
"""Runs a script on pyNN.nest on the grid, with all spikes recorded until `end`; see `recorder` about columns."""
EXAMPLES = {
    "StepCurrentSource": (),
    "inhomogeneous_network": (),
    "simpleRandomNetwork": (),
    "specific_network": (),
    "simple_STDP": (),
    "Izhikevich": (),
    "brunel": (),
    "VAbenchmarks": ("CUBA",),
    "VAbenchmarks COBA": ("COBA",),
}
"""Those that pyNN.nest runs, with their arguments; the others draw currents, or never run."""


def run(arguments, folder):
    (folder / "brian_preferences").write_text("codegen.target = 'numpy'\n")
    environment = os.environ | {"MPLBACKEND": "Agg"}
    done = subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]


def steps(times, ids, h):
    """Spikes as pairs of step and neuron."""
    return set(
        zip(np.rint(np.asarray(times) / h).astype(int).tolist(), np.asarray(ids).astype(int).tolist(), strict=True)
    )


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """By number the folder of a network's script, and its spikes here by population."""
    done = {}

    def export(number):
        if number not in done:
            folder = tmp_path_factory.mktemp(f"net{number}")
            net = pynn_networks.network(number)
            neuro.to_pynn(net, folder / "net.py", seed=number, duration=DURATION)
            sim = neuro.compile(net, seed=number)
            sim.run(DURATION)
            done[number] = folder, {name: sim.spikes(name) for name in ("excite", "inhibit")}
        return done[number]

    return export


@pytest.mark.parametrize("number", range(1, 21))
def test_exported_networks_have_the_same_spikes_on_nest(exported, number):
    folder, ours = exported(number)
    run(["net.py", "nest", str(DURATION), "nest.npz"], folder)
    theirs = np.load(folder / "nest.npz")
    for name, (times, ids) in ours.items():
        assert len(times) > 5 or name == "inhibit"
        assert steps(times, ids, 0.1) == steps(theirs[f"{name}.times"], theirs[f"{name}.ids"], 0.1)


@pytest.mark.parametrize("number", [k for k in range(1, 21) if k not in pynn_networks.LEARNS])
def test_exported_networks_have_nearly_the_same_spikes_on_brian2(exported, number):
    folder, ours = exported(number)
    exact = number % len(pynn_networks.MODELS) in (0, 1, 6)  # others are integrated by Euler's method there
    share = 0.95 if exact else 0.7
    run(["net.py", "brian2", str(DURATION), "brian2.npz"], folder)
    theirs = np.load(folder / "brian2.npz")
    for name, (times, ids) in ours.items():
        near = steps(theirs[f"{name}.times"] + 0.1, theirs[f"{name}.ids"], 0.1)  # Brian2 stamps the beginning of a step
        mine = steps(times, ids, 0.1)
        wide = {(step + shift, neuron) for step, neuron in near for shift in range(-10, 11)}
        if name == "excite":
            assert abs(len(near) - len(mine)) <= 3 + 0.1 * len(mine)
            assert len(mine & wide) >= share * len(mine)


@pytest.mark.parametrize("name", EXAMPLES)
def test_scripts_of_others_have_the_same_spikes_as_on_pynn_nest(tmp_path, name):
    script = SCRIPTS / "examples" / f"{name.split()[0]}.py"
    if not script.exists():
        pytest.skip("PyNN's examples are not there")
    (tmp_path / "run.py").write_text(ON_GRID)
    (tmp_path / "Results").mkdir()
    run(["run.py", "spikes.npz", str(script), *EXAMPLES[name]], tmp_path)
    net = neuro.from_pynn(script, run_script=True, arguments=["nest", *EXAMPLES[name]])
    spikes, h = np.load(tmp_path / "spikes.npz"), net.resolution
    duration = float(net.verdicts.heading.partition("runs for ")[2].split()[0])
    names = [name for name, part in net.populations.items() if part.model.role != "current"]
    for k, part in enumerate(names):
        model = net.populations[part].model
        if model.role != "neuron":  # the spikes that pyNN.nest's generators have really emitted
            times, ids = spikes[f"{k}.times"], spikes[f"{k}.ids"]
            rows = [np.sort(np.rint(times[ids == n] / h) * h).tolist() for n in range(net.populations[part].ids.size)]
            object.__setattr__(net.populations[part], "model", neuro.spike_generator(spike_times=rows))
    sim = neuro.compile(net)
    sim.run(duration)
    found = 0
    for k, part in enumerate(names):
        if net.populations[part].model.role == "neuron":
            theirs = steps(spikes[f"{k}.times"], spikes[f"{k}.ids"], h)
            assert steps(*sim.spikes(part), h) == theirs
            found += len(theirs)
    assert found > 0
