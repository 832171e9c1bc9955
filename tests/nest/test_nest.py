"""NEST runs our networks: golden traces, laws that hold on it, and equality with the event backend."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import neuro
from neuro.testing import observe
from neuro.testing.case import Found, differences
from neuro.testing.verify import verify
from neuro_nest.kernel import CRASH

pytestmark = pytest.mark.usefixtures("nest")

QUICK = (
    *("a5_iaf_psc_delta_refractory_input", "a6_iaf_psc_exp_dc_generator"),
    *("b1_stdp_multiplicative", "b2_stdp_additive", "b3_stdp_guetig_delay5"),
)
"""Traces that take NEST seconds; of others it is read at each of thousands of steps."""


def rich() -> neuro.Network:
    """All that NEST has: models, currents, noise, delays, autapses, multapses, both rules, signal and dopamine."""
    net = neuro.Network("rich")
    net.population("noise", 8, neuro.poisson_generator(rate=np.linspace(300.0, 1500.0, 8), start=2.0, stop=55.0))
    net.population("listed", 3, neuro.spike_generator(spike_times=[[1.0, 1.0, 7.0], [], [3.0, 3.1]]))
    net.population("current", 1, neuro.dc_generator(amplitude=200.0, start=5.0, stop=50.0))
    net.population("relay", 8, neuro.parrot_neuron())
    net.population("exp", 8, neuro.iaf_psc_exp(tau_m=neuro.uniform(low=8.0, high=15.0)), initial={"V_m": -60.0})
    net.population("delta", 5, neuro.iaf_psc_delta(V_th=-60.0, refractory_input=True))
    net.population("alpha", 4, neuro.iaf_psc_alpha(I_e=350.0, t_ref=0.0))
    net.population("izhi", 4, neuro.izhikevich(I_e=6.0))
    net.signal("reward", to="delta")
    net.connect("noise", "relay", neuro.one_to_one(), delay=0.1)
    net.connect("listed", "exp", neuro.all_to_all(), weight=500.0, delay=0.7)
    net.connect("current", "exp", neuro.all_to_all(), weight=np.linspace(-1.0, 1.0, 8)[None], delay=0.3)
    net.connect("relay", "exp", neuro.one_to_one(), weight=350.0, delay=0.4)
    delay = neuro.uniform(low=0.1, high=4.0)
    net.connect("exp", "exp", neuro.fixed_indegree(n=6), weight=neuro.normal(mean=50.0, std=90.0), delay=delay)
    net.connect("relay", "delta", neuro.fixed_indegree(n=9), neuro.stdp(Wmax=6.0, lambda_=0.1), weight=2.0, delay=delay)
    rule = neuro.stdp_dopa(signal="reward", Wmax=9.0, A_plus=0.1, A_minus=0.08, tau_n=30.0)
    net.connect("exp", "delta", neuro.fixed_indegree(n=7), rule, weight=2.0, delay=delay)
    dopamine = neuro.stdp_dopa(dopamine="izhi", Wmax=400.0, A_plus=2.0, b=0.01, tau_n=20.0, deliver_interval=5)
    net.connect("delta", "alpha", neuro.all_to_all(), dopamine, weight=200.0, delay=0.8)
    own = neuro.stdp_dopa(dopamine="alpha", dopamine_rule="one_to_one", Wmax=9.0, dopamine_delay=1.3)
    net.connect("relay", "izhi", neuro.fixed_indegree(n=3), own, weight=5.0, delay=2.0)
    net.probe("V_m", "alpha", "V_m", every=0.7)
    return net


def steered(backend: str) -> Found:
    """Run in three thirds with changes between them."""
    sim = neuro.compile(rich(), backend)
    for third in range(3):
        sim.set("noise", rate=(900.0, np.linspace(0.0, 2000.0, 8), 400.0)[third])
        sim.set("exp", V_th=-55.0 - third, I_e=np.linspace(0.0, 300.0, 8), V_m=-62.0)
        sim.set("delta", tau_m=9.0 + third, E_L=-70.0 + third)
        sim.set("delta_alpha", A_plus=2.0 - 0.5 * third)
        sim.set_weights("relay_exp", np.linspace(300.0, 500.0, 8) + third)
        sim.set_weights("exp_delta", 2.0 + third)
        sim.signal("reward", 0.02 - 0.03 * third)
        sim.inject("listed", sim.time + np.array([0.1, 0.1, 4.0]), [1, 1, 0])
        sim.run(20.0)
    return {what: values for what, values in observe(sim).items() if "I_syn" not in what}


def test_nest_equals_event_when_steered():
    assert differences(steered("event"), steered("nest"), exact=False) == []


def test_threads_set_each_weight_where_it_belongs():
    import nest

    net = neuro.Network("many")
    net.population("pre", 40, neuro.parrot_neuron())
    net.population("post", 50, neuro.iaf_psc_exp())
    net.connect("pre", "post", neuro.all_to_all(), weight=1.0, name="wires")
    sim = neuro.compile(net, "nest", threads=2)
    sim.run(1.0)
    for base in range(30):
        sim.set_weights("wires", base + np.arange(2000.0))
        ends = nest.GetConnections(synapse_model="static_synapse_lbl").get(["source", "target", "weight"])
        pre, post = (np.array(ends[word]) - min(ends[word]) for word in ("source", "target"))
        assert np.array_equal(ends["weight"], base + pre * 50 + post)


def test_a_closed_loop_with_a_signal_equals_event():
    def loop(backend: str) -> Found:
        net = neuro.Network("loop")
        net.population("eye", 6, neuro.poisson_generator(rate=80.0))
        net.population("cells", 3, neuro.iaf_psc_exp())
        net.signal("reward", to="cells")
        rule = neuro.stdp_dopa(signal="reward", Wmax=2000.0, tau_c=100.0, tau_n=50.0, A_plus=5.0, A_minus=4.0)
        net.connect("eye", "cells", neuro.all_to_all(), rule, weight=800.0, delay=1.0, name="learning")
        sim, reached = neuro.compile(net, backend), []
        for _ in range(40):
            before = sim.time
            sim.run(20.0)
            times, ids = sim.spikes("cells", since=before)
            sim.signal("reward", 0.02 * (np.bincount(ids, minlength=3) - 1.0))
            sim.set("eye", rate=40.0 + 20.0 * len(times))
            sim.forget(sim.time)
            reached.append(sim.get("learning", "weight"))
        return {"weights": np.array(reached), "spikes": np.array(sim.counts().spikes)}

    expected, found = loop("event"), loop("nest")
    assert expected["spikes"] > 200
    assert np.ptp(expected["weights"]) > 100.0
    assert differences(expected, found, exact=False) == []


@pytest.fixture
def traces(golden: Path, tmp_path: Path) -> Path:
    for case in (*QUICK, "c4_stdp_dopamine"):
        for kind in ("json", "npz"):
            shutil.copy(golden / "nest" / f"{case}.{kind}", tmp_path)
    return tmp_path


def test_golden_traces(traces: Path):
    found = {result.case: result for result in verify(traces, "nest")}
    refused = found.pop("c4_stdp_dopamine")
    assert found.keys() == {*QUICK}
    assert all(result.ok for result in found.values())
    assert refused.message.startswith("'weight' of 'pre_post' at 21.7 ms: NEST updates synapses with dopamine")


def test_memory_and_forgetting():
    sim = neuro.compile(rich(), "nest")
    sim.run(30.0)
    before = sim.memory()
    sim.forget(30.0)
    assert before["spikes"] > 0
    assert before["process of NEST"] > 1e7
    assert sim.memory()["spikes"] == 0
    assert sim.spikes("exp")[0].size == 0


CRASHING = """
import ctypes
import neuro
net = neuro.Network("net")
net.population("cells", 2, neuro.iaf_psc_exp())
sim = neuro.compile(net, "nest")
{end}
"""


def script(end: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", CRASHING.format(end=end)]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=100, env={**os.environ, **environment}
    )


def test_a_crash_is_told():
    told = script("ctypes.string_at(0)")
    assert told.returncode == -signal.SIGSEGV
    assert told.stdout == ""
    own = [line for line in told.stderr.splitlines() if not line.startswith("[")]  # Open MPI tells crashes, too
    assert own == CRASH.splitlines()


def test_nothing_is_said_of_its_own():
    told = script("sim.run(10.0); print('done')")
    assert (told.returncode, told.stdout, told.stderr) == (0, "done\n", "")


def test_several_processes_need_a_nest_with_mpi():
    import nest

    if nest.build_info["have_mpi"]:
        pytest.skip("this NEST was built with MPI")
    told = script("", OMPI_COMM_WORLD_SIZE="4")
    assert "ModelError: mpirun started 4 processes, but this NEST was built without MPI\n" in told.stderr
    assert "cmake.define.with-mpi=ON" in told.stderr


def test_listing_backends_imports_no_nest_and_a_missing_one_is_told_with_what_installs_it():
    lists = "from neuro.program.backend import installed; assert 'nest' in installed()"
    code = f"{lists}; import sys; assert 'nest' not in sys.modules; sys.modules['nest'] = None\n"
    code += CRASHING.format(end="")
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=100)
    assert told.stderr.splitlines()[-2:] == [
        "neuro.core.errors.ModelError: backend 'nest' needs NEST, which is not installed",
        "  hint: pip install nest-simulator",
    ]


def test_a_conductance_by_name(nest):
    """Its weights are positive here and negative in NEST, whichever are read and set."""
    traces = []
    for backend in ("nest", "event"):
        net = neuro.Network("by_name")
        net.population("noise", 20, neuro.poisson_generator(rate=200.0))
        net.population("cells", 5, neuro.iaf_cond_exp(tau_syn_in=4.0))
        for receptor, weight in (("ex", 3.0), ("in", 2.0)):
            synapse = neuro.static(receptor=receptor)
            net.connect("noise", "cells", neuro.all_to_all(), synapse, weight=weight, delay=1.0, name=receptor)
        net.probe("V_m", "cells", "V_m")
        sim = neuro.compile(net, backend)
        sim.run(30.0)
        assert set(sim.get("in", "weight")) == {2.0}
        sim.set_weights("in", 5.0)
        sim.run(30.0)
        assert set(sim.get("in", "weight")) == {5.0}
        traces.append(sim.trace("V_m")[1])
        del sim
    assert np.abs(traces[0] - traces[1]).max() < 1e-9
    assert np.ptp(traces[0]) > 3.0


def test_thousands_of_projections_have_labels_of_their_own():
    net = neuro.Network("many")
    net.population("a", 40, neuro.iaf_psc_exp(), initial={"V_m": -40.0})
    net.population("b", 40, neuro.iaf_psc_exp())
    for k in range(2100):
        one = neuro.pairs(pre=[k % 40], post=[(7 * k) % 40])
        net.connect("a", "b", one, weight=float(k), delay=1.0, name=f"p{k}")
    sim = neuro.compile(net, "nest")
    sim.run(3.0)
    assert sim.get("p2099", "weight").tolist() == [2099.0]
    sim.set("p2099", weight=-1.0)
    assert [sim.get(f"p{k}", "weight").item() for k in (51, 2098, 2099)] == [51.0, 2098.0, -1.0]


def test_too_many_synapses_of_two_neurons_are_refused():
    net = neuro.Network("deep")
    net.population("a", 1, neuro.iaf_psc_exp())
    net.connect("a", "a", neuro.fixed_total_number(n=20_000), name="deep")
    with pytest.raises(neuro.ModelError) as caught:
        neuro.compile(net, "nest").run(1.0)
    expected = "projection 'deep': 20,000 synapses between two neurons: backend 'nest' expects at most 16,384"
    assert str(caught.value) == expected
