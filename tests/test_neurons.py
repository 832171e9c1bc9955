"""Neurons that are no part of the compiled loop: NEST's traces, closed forms, and event beside the reference."""

import math
from pathlib import Path

import pytest

import neuro
from beside import evaluated
from closed_forms import held_rate, settled
from neuro.model.neurons import Neuron
from neuro.testing import check_part
from neuro.testing.golden import Result
from neuro.testing.verify import verify
from refused import refused, without_place

NEURONS = evaluated(__file__, "NEURONS", globals())


@pytest.mark.parametrize("model", NEURONS, ids=lambda model: f"{model.name}-{getattr(model, 'rk4_substeps', '')}")
def test_event_does_what_the_reference_does(model: Neuron):
    check_part(model, ms=5.0 if "rk4_substeps" in model.parameters() else 15.0)


@pytest.fixture(scope="session")
def traces(golden: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """NEST's traces of neurons."""
    folder = tmp_path_factory.mktemp("neurons")
    for file in (golden / "nest-models").glob("f[1234]_*"):
        (folder / file.name).symlink_to(file)
    return folder


def told(results: list[Result]) -> list[str]:
    return [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok]


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_every_trace_of_nest_comes_out(traces: Path, backend: str):
    results = verify(traces, backend)
    assert told(results) == []
    assert {r.quantity for r in results} >= {"spikes", "V_m", "g_ex", "g_in", "w", "Act_m", "I_syn_ex", "V_th"}


@pytest.mark.slow
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


def test_a_group_cannot_have_neurons_that_reset_themselves(messages):
    net = neuro.Network("group")
    net.population("cells", 2, neuro.aeif_cond_exp())
    net.group("choice", neuro.winner_take_all(of="cells"))
    messages({"told": without_place(neuro.compile, net)})


def test_v_reset_may_be_above_v_th_where_there_is_a_peak():
    net = neuro.Network("bursting")
    net.population("cells", 1, neuro.aeif_cond_exp(V_reset=-46.0, I_e=800.0))
    sim = neuro.compile(net)
    sim.run(100.0)
    assert len(sim.spikes("cells")[0]) > 5
    assert "aeif_cond_exp.V_reset = 1 mV: expected less than V_peak = 0 mV" in refused(sim.set, "cells", V_reset=1.0)


def test_rk4_with_steps_of_0_025_ms_spikes_as_rkf45():
    net = neuro.Network("axon")
    net.population("adaptive", 1, neuro.hh_psc_alpha(I_e=650.0))
    net.population("even", 1, neuro.hh_psc_alpha(I_e=650.0, rk4_substeps=4))
    sim = neuro.compile(net)
    sim.run(300.0)
    assert sim.spikes("even")[0].tolist() == sim.spikes("adaptive")[0].tolist() != []


@pytest.mark.parametrize(("current", "rate"), [(20.0, 4.789), (30.0, 9.066), (60.0, 17.883)])
def test_an_adaptive_threshold_settles_at_the_rate_that_keeps_it(current: float, rate: float):
    assert 1000.0 * settled(current) / (0.05 * 1e4) == pytest.approx(rate, abs=5e-4)
    assert held_rate(current, 120.0) == pytest.approx(rate, rel=5e-3)


def test_what_follows_from_other_states_is_not_set(messages):
    net = neuro.Network("mat")
    net.population("cell", 1, neuro.mat2_psc_exp())
    sim = neuro.compile(net)
    messages({"told": refused(sim.set, "cell", V_th=-40.0)})
    sim.set("cell", V_th_alpha_1=5.0)
    sim.run(0.1)
    assert sim.get("cell", "V_th")[0] == pytest.approx(-51.0 + 5.0 * math.exp(-0.01), abs=1e-12)


def on(backend: str, model: Neuron) -> None:
    net = neuro.Network("alone", resolution=1.0)
    net.population("cell", 1, model)
    neuro.compile(net, backend)


def test_others_refuse_it(messages):
    messages.calls(globals())
