"""Models that are not linear, by the integrators."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from neuro.testing import check_part

MODELS = yaml.safe_load(Path(__file__).with_name("models.yaml").read_text())["models"]
AEIF = MODELS["own_aeif_cond_exp"]
GOLDEN = Path(__file__).parents[2].parent / "shared" / "reference" / "nest-models" / "f3_aeif_cond_exp"
RELAXING = {
    "equations": {"V_m": "(E_L - V_m)/tau_m + (g*(E - V_m) + I)/C_m"},
    "receptors": {"g": {"kernel": "exp", "tau": "tau_syn"}},
    "parameters": {"E_L": "-70 mV", "E": "0 mV", "tau_m": "10 ms", "tau_syn": "2 ms", "C_m": "250 pF"},
}


def like_nest(integrator, backend):
    """A neuron with the parameters and inputs of a golden trace, and what NEST has of it."""
    facts = json.loads(GOLDEN.with_suffix(".json").read_text())
    model = neuro.equations("aeif", **{**AEIF, "integrator": integrator})
    net = neuro.Network("golden")
    net.population("cells", 1, model(**facts["neuron"]["params"]))
    for name, given in facts["inputs"].items():
        net.population(name, 1, neuro.spike_generator(spike_times=[given["spike_times_ms"]]))
        net.connect(name, "cells", neuro.one_to_one(), weight=given["weight"], delay=given["delay_ms"])
    for state in ("V_m", "w", "g_ex", "g_in"):
        net.probe(state, "cells", state)
    sim = neuro.compile(net, backend)
    sim.run(facts["t_sim_ms"])
    golden = np.load(GOLDEN.with_suffix(".npz"))
    rows = np.rint(golden["times_ms"] / 0.1).astype(int) - 1
    steps = np.rint(sim.spikes("cells")[0] / 0.1)
    errors = {state: np.abs(sim.trace(state)[1][rows, 0] - golden[state]).max() for state in ("V_m", "w", "g_ex")}
    return steps, np.rint(golden["spikes_ms"] / 0.1), errors


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_an_adaptive_exponential_neuron_has_nests_spikes(backend):
    steps, expected, errors = like_nest({"rkf45": {"tolerance": 1e-6}}, backend)
    assert np.array_equal(steps, expected)
    assert errors["V_m"] < 1e-3
    assert errors["w"] < 1e-3
    assert errors["g_ex"] < 1e-6


def test_with_many_substeps_rk4_has_them_too():
    steps, expected, errors = like_nest({"rk4": {"substeps": 100}}, "event")
    assert np.array_equal(steps, expected)
    assert errors["V_m"] < 1.0


def test_they_run_alike_on_both_backends():
    words = {"threshold": "V_m >= V_th", "reset": {"V_m": "E_L"}, "refractory": {"time": "t_ref", "hold": ["V_m"]}}
    parameters = {**RELAXING["parameters"], "V_th": "-55 mV", "t_ref": "0.5 ms"}
    more = {"parameters": parameters, "integrator": "exponential_euler"}
    check_part(neuro.equations("firing", **{**RELAXING, **words, **more})())


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
