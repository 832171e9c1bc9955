"""Rules with states of their own, which a signal turns into changes of the weight, as equations."""

import numpy as np
import pytest

import neuro
from beside import beside, evaluated
from neuro.testing import check_part

TRACES, MSTDPET, DOPAMINE = beside(__file__, "TRACES", "MSTDPET", "DOPAMINE")


def network(rule):
    net = neuro.Network("rewarded")
    net.population("source", 4, neuro.poisson_generator(rate=300.0))
    net.population("cells", 3, neuro.iaf_psc_exp(I_e=700.0))
    net.signal("reward", to="cells")
    net.connect("source", "cells", neuro.all_to_all(), rule, weight=60.0, delay=1.5, name="learnt")
    return net


def found(rule, backend, rewards=(2.0, -1.0, 0.3)):
    sim = neuro.compile(network(rule), backend, seed=1)
    for reward in rewards:
        sim.run(25.0)
        sim.signal("reward", np.array([reward, 0.0, -reward]))
    sim.run(25.0)
    state = rule.states[0].name
    return sim.weights("learnt")[2], sim.get("learnt", state), sim.spikes("cells")[0]


@pytest.mark.parametrize(
    ("built_in", "words", "numbers", "backend"),
    evaluated(__file__, "TWINS", globals()),
    ids=["mstdpet", "mstdpet at its bounds", "stdp_dopa", "stdp_dopa on event"],
)
def test_a_rule_written_as_equations_gives_its_twins_weights(built_in, words, numbers, backend):
    twin = found(built_in(signal="reward", **numbers), backend)
    own = found(neuro.equations("own", **words)(signal="reward", **numbers), backend)
    assert np.array_equal(twin[2], own[2])
    assert twin[0].std() > 1.0
    assert np.abs(twin[0] - own[0]).max() < 1e-12
    assert np.abs(twin[1] - own[1]).max() < 1e-12


def test_products_of_states_are_integrated_exactly():
    """Two states and a signal that decay, beside the integral in closed form and small steps of it."""
    words = {
        "traces": {},
        "states": {"a": {"tau": "tau_a"}, "b": {"tau": "tau_b"}, "k": {}},
        "on_pre": {"a": "a + 1", "b": "b + 2", "k": "k + 0.5"},
        "on_signal": {"w": "(k + n*a*b^2 - 2*a)/(1 ms)"},
        "initial": {"a": "start", "k": 0.25},
        "parameters": {"tau_a": "20 ms", "tau_b": "50 ms", "tau_n": "30 ms", "start": 0.5},
    }
    net = neuro.Network("exact")
    net.population("source", 1, neuro.spike_generator(spike_times=[[10.0]]))
    net.population("cell", 1, neuro.iaf_psc_exp())
    net.signal("reward", to="cell")
    rule = neuro.equations("product", **words)(signal="reward")
    net.connect("source", "cell", neuro.one_to_one(), rule, weight=3.0, delay=1.0, name="learnt")
    sim = neuro.compile(net, "reference")
    sim.run(10.0)
    sim.signal("reward", 0.7)
    weight = float(sim.weights("learnt")[2][0])
    assert weight == pytest.approx(3.0 + 0.25 * 10.0 - 2 * 0.5 * 20.0 * -np.expm1(-0.5), rel=1e-14)
    sim.run(40.0)
    t = (np.arange(400_000) + 0.5) * 1e-4
    a, b, n = (0.5 * np.exp(-0.5) + 1.0) * np.exp(-t / 20.0), 2.0 * np.exp(-t / 50.0), 0.7 * np.exp(-t / 30.0)
    expected = weight + float(np.sum(0.75 + n * a * b**2 - 2.0 * a)) * 1e-4
    assert float(sim.weights("learnt")[2][0]) == pytest.approx(expected, rel=1e-9)
    assert float(sim.get("learnt", "k")[0]) == 0.75


def test_a_state_may_last_no_time():
    words = {**MSTDPET, "on_post": {"z": "z + A_plus*K_plus/tau_plus"}, "on_pre": {"z": "z - A_minus*K_minus/tau_plus"}}
    words["parameters"] = {**MSTDPET["parameters"], "tau_z": {"default": "25 ms", "at_least": 0}}
    sim = neuro.compile(network(neuro.equations("own", **words)(signal="reward", tau_z=0.0)), "reference", seed=1)
    sim.signal("reward", 1.0)
    sim.run(25.0)
    assert np.array_equal(sim.weights("learnt")[2], np.full(12, 60.0))


def test_it_runs_as_any_part_does():
    check_part(neuro.equations("own", **MSTDPET)(), ms=15.0)


def test_a_state_decays_without_a_signal():
    words = {**MSTDPET, "on_pre": {"z": "z + 1/tau_z", "w": "w + z*tau_z"}}
    del words["on_signal"]
    weights = [
        neuro.compile(network(neuro.equations("own", **words)()), backend, seed=1) for backend in ("reference", "event")
    ]
    for sim in weights:
        sim.run(60.0)
    reference, event = (sim.weights("learnt")[2] for sim in weights)
    assert reference.std() > 1.0
    assert np.abs(reference - event).max() < 1e-9


def test_a_saved_network_has_its_rules(tmp_path):
    net = network(neuro.equations("own", **MSTDPET)(signal="reward", b=0.5))
    net.save(tmp_path / "net.yaml")
    assert neuro.load(tmp_path / "net.yaml") == net


def rule(**words):
    neuro.equations("m", **{**MSTDPET, **words})


def test_mistakes(messages):
    messages.calls(globals())
