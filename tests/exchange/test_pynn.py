"""Scripts of PyNN as networks, and back. What PyNN's own simulators make of them: `test_pynn_oracles`."""

import os
import subprocess
import sys
import warnings
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import neuro
import pynn_networks
from neuro.cli.commands import app
from refused import error_of, refused

needs_pynn = pytest.mark.skipif(find_spec("pyNN") is None, reason="PyNN is not installed")

SCRIPT = """
import pylab
import numpy as np
from pyNN.random import NumpyRNG, RandomDistribution
import pyNN.nest as sim

sim.setup(timestep=0.1, min_delay=0.5)
rng = NumpyRNG(seed=5)
stimulus = sim.Population(4, sim.SpikeSourceArray(spike_times=[[1.0, 2.05], [3.0], [], [4.0]]), label="in")
noise = sim.Population(2, sim.SpikeSourcePoisson(rate=[10.0, 20.0], start=5.0, duration=45.0), label="noise")
cells = sim.Population(5, sim.IF_curr_exp(tau_m=RandomDistribution("uniform", low=9.0, high=11.0, rng=rng), cm=0.5))
other = sim.Population(3, sim.IF_cond_exp(tau_m=20.0, cm=1.0), initial_values={"v": -60.0}, label="other cells")
more = sim.Population(2, sim.IF_curr_exp(), label="more")
both = cells + more
static = sim.StaticSynapse(weight=0.5, delay=1.0)
sim.Projection(stimulus, cells[1:], sim.OneToOneConnector(), static)
sim.Projection(noise, both, sim.AllToAllConnector(), sim.StaticSynapse(weight=0.01, delay=0.73))
rule = sim.STDPMechanism(sim.SpikePairRule(tau_plus=17.0, tau_minus=33.0, A_plus=0.01, A_minus=0.02),
                         sim.MultiplicativeWeightDependence(w_max=0.04), weight=0.02)
learnt = sim.Projection(cells, other, sim.FixedProbabilityConnector(0.5, rng=rng), rule, label="learnt")
sim.Projection(other, cells, sim.FromListConnector([(0, 1, -0.1, 0.5), (2, 3, -0.2, 0.9)]), receptor_type="inhibitory")
sim.Projection(other, other, sim.AllToAllConnector(allow_self_connections=False), sim.StaticSynapse(weight=0.003),
               receptor_type="inhibitory")
sim.DCSource(amplitude=0.3, start=10.0, stop=20.0).inject_into(cells[:2])
cells[0:3].record("v", sampling_interval=0.5)
other.record(["spikes", "gsyn_exc"])
learnt.set(weight=0.03)
sim.reset()
sim.run(30.0)
noise.set(rate=30.0)
sim.run(20.0)
block = other.get_data().segments[0]
assert len(block.spiketrains) == 3 and block.filter(name="gsyn_exc")[0].shape[1] == 3
pylab.plot(learnt.get("weight", format="list", with_address=False))
pylab.savefig("picture.png")
print(block.spiketrains[0][0])
"""


@needs_pynn
def test_a_script_is_recorded(comes, messages):
    net = comes(SCRIPT)
    sizes = {"in": 4, "noise": 2, "population2": 5, "other_cells": 3, "more": 2, "DCSource": 1}
    assert {name: part.ids.size for name, part in net.populations.items()} == sizes
    assert net.resolution == 0.1
    assert [list(row) for row in net.populations["in"].model.spike_times] == [[1.0, 2.1], [3.0], [], [4.0]]
    noise = net.populations["noise"].model
    assert (noise.start, noise.stop) == (5.0, 50.0)
    assert np.array_equal(noise.rate_times, [0.1, 30.0])
    assert np.array_equal(noise.rate_values, [[10.0, 30.0], [20.0, 30.0]])
    cells, other = net.populations["population2"], net.populations["other_cells"]
    assert cells.model.C_m == 500.0
    assert np.ptp(cells.model.tau_m) > 0
    assert cells.initial == {"V_m": -65.0}
    assert (other.model.g_L, other.model.tau_minus, other.initial["V_m"]) == (50.0, 33.0, -60.0)
    wires = net.projections
    first = wires["in_population2"]
    assert (list(first.rule.pre), list(first.rule.post), first.weight) == ([0, 1, 2, 3], [1, 2, 3, 4], 500.0)
    assert wires["noise_population2"].rule == neuro.all_to_all()
    assert wires["noise_more"].delay == pytest.approx(0.7)
    assert wires["learnt"].weight == 30.0
    rule = neuro.stdp(tau_plus=17.0, lambda_=0.01, alpha=2.0, mu_plus=1.0, mu_minus=1.0, Wmax=40.0)
    assert wires["learnt"].synapse == rule
    assert list(wires["other_cells_population2"].weight) == [-100.0, -200.0]
    assert np.allclose(wires["other_cells_population2"].delay, [0.5, 0.9])
    assert wires["other_cells_other_cells"].weight == -3.0
    current = net.populations["DCSource"].model
    assert (current.amplitude, current.start, current.stop) == (300.0, 9.5, 19.5)
    assert net.probes["population2_v"].every == 0.5
    assert net.probes["other_cells_gsyn_exc"].record == "g_ex"
    messages({"heading": net.verdicts.heading} | {each.node: each.how for each in net.verdicts})
    assert len(net.verdicts) == 3
    neuro.compile(net)


@needs_pynn
def test_a_current_flows_into_several_parts_and_networks(comes):
    net = comes(
        "import pyNN.nest as sim\nsim.setup(timestep=0.1)\ncells = sim.Population(3, sim.IF_curr_exp())\n"
        "source = sim.StepCurrentSource(times=[10.0, 30.0], amplitudes=[0.1, -0.1])\n"
        "cells[0:1].inject(source)\ncells[2].inject(source)\n"
        "sim.run(5.0)\nsim.reset()\ncells.set(tau_m=10.0)\nsim.run(5.0)\n"
    )
    assert net.populations["population0"].model.tau_m == 10.0
    for name, cell in (("StepCurrentSource", 0), ("StepCurrentSource_2", 2)):
        assert list(net.populations[name].model.amplitude_values) == [100.0, -100.0]
        assert list(net.projections[f"{name}_population0"].rule.post) == [cell]


@needs_pynn
def test_what_cannot_come_is_told_by_line(comes, messages):
    script = (
        "import pyNN.spiNNaker as p\np.setup(timestep=1.0)\ncells = p.Population(3, p.HH_cond_exp())\n"
        "more = p.Population(3, p.extra_models.IFCurrExpCa2Adaptive())\nfine = p.Population(3, p.IF_curr_exp())\n"
        "p.external_devices.SpikeInjector(3)\np.Population(1, p.SpikeSourceArray(spike_times=[-1.5, 3.0]))\n"
        "p.Projection(fine, fine, p.OneToOneConnector(), p.SimpleStochasticSynapse(weight=1.0))\n"
        "p.run(10)\nfine.set(tau_m=10.0)\np.run(10)\n"
    )
    messages({"all": refused(comes, script)})


TAUGHT = {
    **{"dopamine_delay": 1.0, "tau_c": 500.0, "tau_n": 100.0, "concentration": 0.25, "Wmax": 4000.0, "c_max": 4000.0},
}
LEARNS = """
import pyNN.spiNNaker as p
p.setup(timestep=1.0)
extra = p.extra_models
source, times = p.Population(2, p.SpikeSourcePoisson(rate=30.0)), [[10.0]]
rules = {
    "pair": (p.SpikePairRule(A_plus=0.02, A_minus=0.03), p.AdditiveWeightDependence(w_max=4.0)),
    "soft": (p.SpikePairRule(A_plus=0.02, A_minus=0.03), p.MultiplicativeWeightDependence(w_max=4.0)),
    "nearest": (extra.SpikeNearestPairRule(A_plus=0.02, A_minus=0.02), p.AdditiveWeightDependence(w_max=4.0)),
    "triplet": (
        extra.PfisterSpikeTriplet(tau_plus=16.8, tau_minus=33.7, tau_x=101, tau_y=114, A_plus=0.01, A_minus=0.01),
        extra.WeightDependenceAdditiveTriplet(w_max=4.0, A3_plus=0.02, A3_minus=0.01),
    ),
    "vogels": (extra.Vogels2011Rule(alpha=0.2, A_plus=0.02, tau=20.0), p.AdditiveWeightDependence(w_max=4.0)),
    "taught": (p.SpikePairRule(A_plus=1.0, A_minus=1.0), p.AdditiveWeightDependence(w_max=4.0)),
    "taught soft": (p.SpikePairRule(A_plus=0.25, A_minus=0.125), p.MultiplicativeWeightDependence(w_max=4.0)),
    "taught vogels": (extra.Vogels2011Rule(alpha=0.25, A_plus=0.5, tau=20.0), p.AdditiveWeightDependence(w_max=4.0)),
    "nearest soft": (extra.SpikeNearestPairRule(A_minus=0.02), p.MultiplicativeWeightDependence(w_max=4.0)),
    "recurrent": (
        extra.RecurrentRule(accumulator_depression=-3, mean_pre_window=10.0, A_plus=0.25, A_minus=0.125),
        p.MultiplicativeWeightDependence(w_min=0.5, w_max=4.0),
    ),
}
for name, parts in rules.items():
    cells = p.Population(2, p.IF_curr_exp(), label=name)
    kind = "inhibitory" if name == "vogels" else "excitatory"
    learns = p.STDPMechanism(*parts, weight=2.0, delay=3.0)
    p.Projection(source, cells, p.AllToAllConnector(), learns, receptor_type=kind)
    if name.startswith("taught"):
        dopamine = p.Population(1, p.SpikeSourceArray(spike_times=times), label=name + " dopamine")
        by = extra.Neuromodulation(weight=0.25, tau_c=500.0, tau_d=100.0, w_max=4.0)
        receptor = "punishment" if name == "taught vogels" else "reward"
        p.Projection(dopamine, cells, p.AllToAllConnector(), by, receptor_type=receptor)
p.run(100)
"""


@needs_pynn
def test_what_learns_on_spinnaker_comes_with_its_amplitudes(comes, tmp_path):
    """Additive steps are weights there, those of triplets shares of the largest weight, in nA."""
    net = comes(LEARNS)
    found = {part.target: part.synapse for part in net.projections.values()}
    wanted = {
        "pair": neuro.stdp(lambda_=0.005, alpha=1.5, mu_plus=0.0, mu_minus=0.0, Wmax=4000.0),
        "soft": neuro.stdp(lambda_=0.02, alpha=1.5, Wmax=4000.0),
        "nearest": neuro.stdp_nn_symm(lambda_=0.005, mu_plus=0.0, mu_minus=0.0, Wmax=4000.0, pre_at_start=True),
        "triplet": neuro.stdp_triplet(
            **{"tau_plus_triplet": 101.0, "tau_minus_triplet": 114.0, "Wmax": 4000.0},
            **{"Aplus": 40.0, "Aminus": 40.0, "Aplus_triplet": 80.0, "Aminus_triplet": 40.0},
        ),
        "vogels": neuro.vogels_sprekeler(eta=20.0, alpha=0.2, Wmax=-4000.0),
        "taught": neuro.stdp_dopa(
            **{"dopamine": "taught_dopamine", "dopamine_delay": 1.0, "tau_c": 500.0, "tau_n": 100.0, "c_min": 0.0},
            **{"A_plus": 25000.0, "A_minus": 25000.0, "Wmax": 4000.0},
        ),
        "taught_soft": neuro.spinnaker_learning(
            **{"dopamine": "taught_soft_dopamine", "dependence": "multiplicative", "A_plus": 0.25, "A_minus": 0.125},
            **TAUGHT,
        ),
        "taught_vogels": neuro.spinnaker_learning(
            **{"dopamine": "taught_vogels_dopamine", "timing": "vogels", "alpha": 0.25, "A_plus": 0.125},
            **{"A_minus": 0.0025} | TAUGHT | {"concentration": -0.25},
        ),
        "nearest_soft": neuro.stdp_nn_symm(lambda_=0.01, alpha=2.0, Wmax=4000.0, pre_at_start=True),
        "recurrent": neuro.spinnaker_learning(
            **{"timing": "recurrent", "dependence": "multiplicative", "A_plus": 0.25, "A_minus": 0.125},
            **{"accumulator_depression": -3, "mean_pre_window": 10.0, "Wmin": 500.0, "Wmax": 4000.0},
        ),
    }
    for name, synapse in wanted.items():
        assert found[name] == synapse or found[name].parameters() == synapse.parameters(), name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, "spinnaker")
    rules = [wires.rule for wires in sim._engine.fixed.projections]
    programs = {rule.program for rule in rules if rule is not None}
    assert len(programs) == 10
    neuro.to_pynn(net, tmp_path / "again.py")
    again = neuro.from_pynn(tmp_path / "again.py", run_script=True)
    for path in tmp_path.glob("again.*"):
        path.unlink()
    assert len(again.projections) == len(net.projections)
    for part in net.projections.values():
        (back,) = [one for one in again.projections.values() if one.target == part.target]
        assert type(back.synapse) is type(part.synapse)
        for word, value in part.synapse.parameters().items():
            assert back.synapse.parameters()[word] == (value if isinstance(value, str) else pytest.approx(value)), word
        assert (back.source, back.delay) == (part.source, part.delay)
        assert np.allclose(back.weight, part.weight)


BEGIN = "import pyNN.nest as sim\nsim.setup()\np = sim.Population(3, sim.IF_curr_exp())\n"
HOSTILE = yaml.safe_load(Path(__file__).with_name("hostile_scripts.yaml").read_text("utf-8"))


@pytest.fixture
def comes(tmp_path):
    """Read a script by its text; it may not write into its folder."""

    def read(text, **words):
        path = tmp_path / "script.py"
        path.write_text(text)
        return neuro.from_pynn(path, run_script=True, **words)

    yield read
    assert os.listdir(tmp_path) == ["script.py"]


def left_over():
    """Processes that scripts of this test have started and that still run."""
    processes, test = [], os.environ["PYTEST_CURRENT_TEST"].encode()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (folder / "environ").read_bytes()
            processes += [folder.name] if b"\0NEURO_SCRIPT=" in words and test in words else []
    return processes


@needs_pynn
@pytest.mark.parametrize(
    ("code", "message"),
    [pytest.param(*row, marks=[pytest.mark.slow] if k > 1 else []) for k, row in enumerate(HOSTILE)],
)
def test_a_hostile_script_is_refused(comes, code, message):
    seconds = 1.5 if "while" in code else 60.0
    assert refused(comes, f"{BEGIN}{code}\n", seconds=seconds).startswith(f"script.py{message}")
    assert not left_over()


def test_a_script_is_run_only_if_it_may(tmp_path, monkeypatch, messages, answer):
    monkeypatch.chdir(tmp_path)
    Path("script.py").write_text("raise SystemExit(5)")
    messages({"refused": answer("convert", "script.py", "net.yaml").err})


@needs_pynn
def test_a_written_script_is_the_same_network(tmp_path):
    net = pynn_networks.network(14)
    net.save(tmp_path / "net.yaml")
    words = ["--seed", "14", "--for", "200"]
    done = CliRunner().invoke(app, ["convert", str(tmp_path / "net.yaml"), str(tmp_path / "net_pynn.py"), *words])
    assert done.exception is None
    back = neuro.from_pynn(tmp_path / "net_pynn.py", run_script=True)
    ours, theirs = neuro.compile(net, seed=14), neuro.compile(back)
    ours.run(200.0)
    theirs.run(200.0)
    for name in ("excite", "inhibit"):
        mine, its = ours.spikes(name), theirs.spikes(name)
        assert len(mine[0]) > 5 or name == "inhibit"
        assert np.allclose(mine[0], its[0])
        assert np.array_equal(mine[1], its[1])


@needs_pynn
def test_short_term_plasticity_comes_in_and_goes_out(tmp_path, messages):
    path = tmp_path / "script.py"
    path.write_text(
        "import pyNN.nest as p\np.setup()\na = p.Population(2, p.SpikeSourcePoisson(rate=20.0))\n"
        "b = p.Population(3, p.IF_curr_exp(tau_syn_E=4.0))\n"
        "t = p.TsodyksMarkramSynapse(U=0.2, tau_rec=130.0, tau_facil=50.0, weight=0.5)\n"
        "p.Projection(a, b, p.AllToAllConnector(), t, label='x')\np.run(1.0)\n"
    )
    net = neuro.from_pynn(path, run_script=True)
    assert net.projections["x"].synapse == neuro.tsodyks2(U=0.2, tau_rec=130.0, tau_fac=50.0)
    assert net.projections["x"].weight == 500.0
    (came,), (went,) = net.verdicts, neuro.to_pynn(net, tmp_path / "again.py")
    assert (came.node, went.node, came.how) == ("script.py:6", "x", went.how)
    messages({"how": came.how})
    text = (tmp_path / "again.py").read_text()
    assert "sim.TsodyksMarkramSynapse(U=0.2, tau_rec=130.0, tau_facil=50.0, weight=0.5, delay=0.1)" in text


def test_a_written_script_is_python_and_keeps_what_is_small_in_itself(tmp_path):
    net = neuro.Network("two")
    net.population("a", 2, neuro.spike_generator(spike_times=[[1.0], [2.0]]))
    net.population("b", 2, neuro.iaf_psc_exp())
    net.connect("a", "b", neuro.one_to_one(), weight=250.0, delay=1.5)
    neuro.to_pynn(net, tmp_path / "two.py")
    text = (tmp_path / "two.py").read_text()
    assert "sim.OneToOneConnector()" in text
    assert "sim.StaticSynapse(weight=0.25, delay=1.5)" in text
    assert sorted(np.load(tmp_path / "two.npz")) == ["a.ids", "a.times", "written_by_neuro"]
    compile(text, "two.py", "exec")
    neuro.to_pynn(net, tmp_path / "two.py")  # its own files are replaced
    (tmp_path / "two.py").write_text(text + "# edited\n")
    with pytest.raises(neuro.ModelError, match="exists and is not a script that neuro wrote"):
        neuro.to_pynn(net, tmp_path / "two.py")


def test_what_pynn_has_not_is_told_by_part(tmp_path, messages):
    net = neuro.Network("odd")
    net.population("a", 2, neuro.sinusoidal_poisson_generator(rate=5.0))
    net.population("b", 2, neuro.mat2_psc_exp())
    net.population("c", 2, neuro.iaf_psc_exp())
    net.connect("c", "c", neuro.all_to_all(), neuro.stdp_pl_hom(), weight=1.0)
    net.signal("reward", to="c")
    others = error_of(neuro.to_pynn, net, tmp_path / "odd.py").others
    places = [str(one).partition(": ")[2].partition("\n")[0] for one in others]
    messages({"places": "\n".join(places)})
    reset = {"reset_by_subtraction": True}
    own = [
        neuro.iaf_psc_exp(**reset),
        neuro.iaf_psc_delta(t_ref=0.0, max_spikes=3, **reset),
        neuro.iaf_psc_delta(V_min=-80.0),
    ]
    for model, word in zip(own, (*reset, *reset, "V_min"), strict=True):
        net = neuro.Network("odd")
        net.population("a", 2, model)
        assert f"'{word}' has no counterpart in PyNN's IF_curr_" in refused(neuro.to_pynn, net, tmp_path / "odd.py")
    assert list(tmp_path.iterdir()) == []


def test_learning_that_spynnaker_has_not_is_told_by_part(tmp_path, messages):
    def told(*rules, model=None):
        net = neuro.Network("odd", resolution=1.0)
        net.population("a", 2, neuro.spike_generator(spike_times=[[1.0], [2.0]]))
        net.population("b", 2, model or neuro.iaf_psc_exp())
        if getattr(rules[0], "signal", None):
            net.signal("s", to="b")
        for k, rule in enumerate(rules):
            net.connect("a", "b", neuro.all_to_all(), rule, weight=1.0, delay=1.0, name=f"learns{k}")
        return "; ".join(one.message for one in error_of(neuro.to_pynn, net, tmp_path / "odd.py").others)

    taught = {"dopamine": "a", "c_min": 0.0}
    messages(
        {
            "mixed exponents": told(neuro.stdp_nn_symm(mu_plus=0.0, pre_at_start=True)),
            "the start": told(neuro.stdp_nn_symm()),
            "baseline": told(neuro.stdp_dopa(**taught, b=0.1)),
            "two signs": told(neuro.stdp_dopa(dopamine="a")),
            "a signal": told(neuro.stdp_dopa(c_min=0.0, signal="s")),
            "two teachers": told(neuro.stdp_dopa(**taught), neuro.stdp_dopa(**taught, tau_c=500.0)),
            "one is not taught": told(neuro.stdp_dopa(**taught), neuro.stdp()),
            "mV": told(neuro.spinnaker_learning(), model=neuro.iaf_psc_delta()),
        }
    )
    assert list(tmp_path.iterdir()) == []


def test_reading_pynn_does_not_import_it():
    code = "import neuro, sys; neuro.from_pynn, neuro.to_pynn; print('pyNN' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
