"""Neurons that are no part of the compiled loop: NEST's traces, closed forms, and event beside the reference."""

from pathlib import Path

import pytest

import neuro
from neuro.testing import check_part
from neuro.verify.verify import Result, verify

NEURONS = [
    neuro.iaf_cond_exp(E_L=-65.0, tau_syn_ex=5.0, I_e=100.0, V_th=neuro.uniform(low=-56.0, high=-50.0)),
    neuro.iaf_cond_exp(E_L=-65.0, tau_syn_ex=5.0, I_e=100.0, t_ref=0.0, rk4_substeps=3),
]


@pytest.mark.parametrize("model", NEURONS, ids=lambda model: f"{model.name}-{getattr(model, 'rk4_substeps', '')}")
def test_event_does_what_the_reference_does(model: neuro.iaf_cond_exp):
    check_part(model, ms=10.0)


@pytest.fixture(scope="session")
def traces(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """NEST's traces of neurons."""
    folder = tmp_path_factory.mktemp("neurons")
    for file in (shared / "reference" / "nest-models").glob("f2_*"):
        (folder / file.name).symlink_to(file)
    return folder


def told(results: list[Result]) -> list[str]:
    return [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok]


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_every_trace_of_nest_comes_out(traces: Path, backend: str):
    results = verify(traces, backend)
    assert told(results) == []
    assert {r.quantity for r in results} >= {"spikes", "V_m", "g_ex", "g_in"}


def test_nest_verifies_its_own_traces(traces: Path, nest):
    assert told(verify(traces, "nest")) == []


def decaying(**words: float) -> neuro.Network:
    """A neuron whose conductances only decay, far below threshold."""
    net = neuro.Network("decaying")
    net.population("cell", 1, neuro.iaf_cond_exp(**words), initial={"g_ex": 3.0, "g_in": 5.0})
    net.probe("V", "cell", "V_m")
    return net


def test_rk4_and_rkf45_agree():
    found = []
    for substeps in (0, 1, 4):
        sim = neuro.compile(decaying(tau_syn_ex=5.0, rk4_substeps=substeps), "event")
        sim.run(30.0)
        found.append(sim.trace("V")[1][:, 0])
    assert found[0] == pytest.approx(found[2], abs=1e-7)
    assert found[1] == pytest.approx(found[2], abs=1e-7)
    assert abs(found[0] - found[1]).max() > 0.0


def test_a_neuron_at_rest_sleeps_and_wakes():
    net = neuro.Network("rest")
    net.population("source", 1, neuro.spike_generator(spike_times=[[900.0]]))
    net.population("cell", 1, neuro.iaf_cond_exp(tau_syn_ex=1.0))
    net.connect("source", "cell", neuro.one_to_one(), weight=100.0, delay=1.0)
    found = {}
    for backend in ("reference", "event"):
        sim = neuro.compile(net, backend)
        sim.run(1000.0)
        found[backend] = sim.spikes("cell")[0].tolist()
    assert found["event"] == found["reference"] != []
