"""Models that are not linear, by the integrators."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from beside import beside
from neuro.testing import check_part
from refused import refused

MODELS = yaml.safe_load(Path(__file__).with_name("models.yaml").read_text())["models"]
(RELAXING,) = beside(__file__, "RELAXING")


def like_nest(golden, case, integrator, backend):
    """A neuron with the parameters and inputs of a golden trace, NEST's spikes, and its states' errors."""
    path = golden / "nest-models" / case
    facts = json.loads(path.with_suffix(".json").read_text())
    own = MODELS[f"own_{facts['neuron']['model']}"]
    model = neuro.equations("own", **{**own, "integrator": integrator})
    net = neuro.Network("golden")
    net.population("cells", 1, model(**facts["neuron"]["params"]))
    for name, given in facts["inputs"].items():
        net.population(name, 1, neuro.spike_generator(spike_times=[given["spike_times_ms"]]))
        net.connect(name, "cells", neuro.one_to_one(), weight=given["weight"], delay=given["delay_ms"])
    states = facts["recorded"]["rec"]
    for state in states:
        net.probe(state, "cells", state)
    sim = neuro.compile(net, backend)
    sim.run(facts["t_sim_ms"])
    expected = np.load(path.with_suffix(".npz"))
    rows = np.rint(expected["times_ms"] / 0.1).astype(int) - 1
    steps = np.rint(sim.spikes("cells")[0] / 0.1)
    errors = {state: np.abs(sim.trace(state)[1][rows, 0] - expected[state]).max() for state in states}
    return steps, np.rint(expected["spikes_ms"] / 0.1), errors


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_an_adaptive_exponential_neuron_has_nests_spikes(golden, backend):
    integrator = {"rkf45": {"tolerance": 1e-6, "slope_tolerance": 1e-6}}
    steps, expected, errors = like_nest(golden, "f3_aeif_cond_exp", integrator, backend)
    assert np.array_equal(steps, expected)
    assert errors["V_m"] < 1e-6
    assert errors["w"] < 1e-6
    assert errors["g_ex"] < 1e-9


def test_an_adaptive_exponential_neuron_is_its_built_in_twin():
    own = neuro.equations("own", **{**MODELS["own_aeif_cond_exp"], "integrator": {"rkf45": {"slope_tolerance": 1e-6}}})
    found = []
    for model in (own(I_e=1000.0), neuro.aeif_cond_exp(I_e=1000.0)):
        net = neuro.Network("twins")
        net.population("cells", 1, model)
        net.probe("V_m", "cells", "V_m")
        sim = neuro.compile(net)
        sim.run(200.0)
        found.append((sim.spikes("cells")[0].tolist(), sim.trace("V_m")[1]))
    assert len(found[0][0]) > 5
    assert found[0][0] == found[1][0]
    assert np.abs(found[0][1] - found[1][1]).max() < 1e-6


def test_a_group_cannot_have_what_resets_itself():
    net = neuro.Network()
    net.population("cells", 2, neuro.equations("own", **MODELS["own_aeif_cond_exp"])())
    net.group("choice", neuro.winner_take_all(of="cells"))
    why = "an own, whose neurons reset themselves before a group can choose: expected neurons that a group resets"
    assert refused(neuro.compile, net).endswith(f"group 'choice': winner_take_all of 'cells', {why}")


def test_with_many_substeps_rk4_has_them_too(golden):
    steps, expected, errors = like_nest(golden, "f3_aeif_cond_exp", {"rk4": {"substeps": 100}}, "event")
    assert np.array_equal(steps, expected)
    assert errors["V_m"] < 1.0


@pytest.mark.parametrize(
    ("integrator", "error"), [({"rkf45": {"tolerance": 1e-3}}, 1e-9), ("rk4", 2e-5)], ids=["rkf45", "rk4"]
)
def test_a_neuron_with_conductances_has_nests_spikes(golden, integrator, error):
    """On the reference; its twin runs on event."""
    steps, expected, errors = like_nest(golden, "f2_iaf_cond_exp", integrator, "reference")
    assert np.array_equal(steps, expected)
    assert max(errors.values()) < error


@pytest.mark.parametrize(
    ("integrator", "substeps"), [({"rkf45": {"tolerance": 1e-3}}, 0), ("rk4", 1)], ids=["rkf45", "rk4"]
)
def test_a_neuron_with_conductances_is_its_built_in_twin(integrator, substeps):
    own = neuro.equations("own", **{**MODELS["own_iaf_cond_exp"], "integrator": integrator})
    found = []
    for model in (own(g_L=16.6667), neuro.iaf_cond_exp(g_L=16.6667, rk4_substeps=substeps)):
        net = neuro.Network("twins")
        net.population("noise", 80, neuro.poisson_generator(rate=40.0))
        net.population("cells", 20, model, initial={"V_m": neuro.uniform(low=-70.0, high=-56.0)})
        net.connect("noise", "cells", neuro.pairwise_bernoulli(p=0.5), weight=25.0, delay=1.0)
        net.connect("cells", "cells", neuro.pairwise_bernoulli(p=0.2), weight=-30.0, delay=0.7)
        net.probe("V_m", "cells", "V_m")
        sim = neuro.compile(net, "event", seed=3)
        sim.run(300.0)
        found.append((np.stack(sim.spikes("cells")), sim.trace("V_m")[1]))
    (spikes, potentials), (expected, of_twin) = found
    assert np.array_equal(spikes, expected)
    assert spikes.shape[1] > 100
    # The twins round differently, and a last digit can change the size of an adaptive step.
    assert np.abs(potentials - of_twin).max() < 1e-7


def test_they_run_alike_on_both_backends():
    words = {"threshold": "V_m >= V_th", "reset": {"V_m": "E_L"}, "refractory": {"time": "t_ref", "hold": ["V_m"]}}
    parameters = {**RELAXING["parameters"], "V_th": "-55 mV", "t_ref": "0.5 ms"}
    more = {"parameters": parameters, "integrator": "exponential_euler"}
    check_part(neuro.equations("firing", **{**RELAXING, **words, **more})(), ms=15.0)


@pytest.mark.parametrize(
    ("integrator", "order"),
    [("exponential_euler", 1), ("euler", 1), ("rk4", 4)],
    ids=["exponential_euler", "euler", "rk4"],
)
def test_a_finer_step_is_nearer_by_its_order(integrator, order):
    found = []
    for h in (0.4, 0.2, 0.0125):
        net = neuro.Network("order", resolution=h)
        net.population("source", 1, neuro.spike_generator(spike_times=[[0.4]]))
        net.population("cells", 1, neuro.equations("relaxing", **{**RELAXING, "integrator": integrator})())
        net.connect("source", "cells", neuro.one_to_one(), weight=20.0, delay=0.4)
        net.probe("v", "cells", "V_m")
        sim = neuro.compile(net, "reference")
        sim.run(6.4)
        found.append(sim.trace("v")[1][-1, 0])
    coarse, fine = abs(found[0] - found[2]), abs(found[1] - found[2])
    assert coarse / fine == pytest.approx(2**order, rel=0.15)
