"""Rules of spike pairs and triplets: equal on the backends, to NEST's traces, and to what is known in closed form."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import neuro
from alike import alike
from beside import evaluated
from closed_forms import FIXED_POINTS, drifted, expected_triplets, triplets
from neuro.model.synapses import Synapse
from neuro.testing import check_part
from neuro.testing.verify import verify
from refused import refused

RULES: dict[str, Synapse] = evaluated(__file__, "RULES", globals())
GOLDEN = (
    *("g1_stdp_nn_symm", "g2_stdp_nn_restr", "g3_stdp_nn_pre_centered", "g4_stdp_triplet"),
    *("g5_vogels_sprekeler", "g6_stdp_pl_hom", "g7_stdp_van_rossum"),
)


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_a_rule_is_the_same_on_both_backends(rule: Synapse):
    check_part(rule, ms=10.0)


def onto_parrots(rule: Synapse, delay: object) -> neuro.Network:
    """Spikes of multiplicity above one on both sides, some at equal times."""
    net = neuro.Network("parrots", resolution=1.0)
    net.population("noise", 6, neuro.poisson_generator(rate=250.0))
    net.population("pre", 6, neuro.parrot_neuron())
    net.population("post", 4, neuro.parrot_neuron())
    net.population("end", 4, neuro.parrot_neuron())
    net.connect("noise", "pre", neuro.one_to_one(), delay=1.0)
    net.connect("noise", "post", neuro.pairs(pre=[0, 1, 2, 3] * 2, post=[0, 1, 2, 3] * 2), delay=3.0)
    low, high = sorted((0.4 * rule.Wmax, 0.6 * rule.Wmax)) if hasattr(rule, "Wmax") else (40.0, 60.0)
    drawn = neuro.uniform(low=low, high=high)
    net.connect("pre", "post", neuro.all_to_all(), rule, weight=drawn, delay=delay, name="learnt")
    return net


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_spikes_of_a_step_act_one_after_the_other(rule: Synapse):
    for delay in (4.0, neuro.uniform(low=1.0, high=4.0)):
        expected, _ = alike(onto_parrots(rule, delay), 30.0, seed=3)
        assert np.ptp(expected.get("learnt", "weight")) > 0.0


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_traces_of_nest_come_out(golden: Path, tmp_path: Path, backend: str):
    for case in GOLDEN:
        for kind in ("json", "npz"):
            shutil.copy(golden / "nest-models" / f"{case}.{kind}", tmp_path)
    results = verify(tmp_path, backend)
    assert {result.case for result in results} == {*GOLDEN}
    assert [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok] == []


@pytest.mark.parametrize("rule", [neuro.tsodyks2(U=0.0), neuro.hedonistic(), neuro.stdp(Wmax=-5.0, lambda_=0.0)])
@pytest.mark.parametrize("delay", [1.0, [1.0, 2.0]], ids=["one delay", "two delays"])
def test_a_spike_that_brings_nothing_has_arrived(rule: Synapse, delay: float | list[float]):
    """A synapse that inhibits and releases nothing sends -0.0: its target counts as active all the same."""
    found = []
    for backend in ("reference", "event"):
        net = neuro.Network("nothing", resolution=1.0)
        net.population("source", 2, neuro.spike_generator(spike_times=[[5.0, 7.0, 9.0], [20.0]]))
        net.population("cells", 2, neuro.iaf_psc_exp())
        net.connect("source", "cells", neuro.one_to_one(), rule, weight=-5.0, delay=delay)
        sim = neuro.compile(net, backend)
        sim.run(30.0)
        found.append(sim.counts().populations["cells"].neuron_updates_active)
    assert found == [4, 4]


def test_weights_drift_to_where_independent_spikes_hold_them():
    """Poisson spikes of 20 Hz on both sides; steps of finite size end 1 % below the fixed point."""
    found = drifted(FIXED_POINTS, settle=60.0, reads=20)
    for name, (_, point) in FIXED_POINTS.items():
        assert found[name] == pytest.approx(point, rel=0.02), name


def test_triplets_of_visual_cortex():
    """60 pairs, post 10 ms after pre and before it: late pairs turn from depression to potentiation above 20 Hz."""
    rates = np.array([10.0, 20.0, 40.0, 50.0])
    change = triplets(rates)
    assert change == pytest.approx(expected_triplets(rates), abs=1e-13)
    assert change == pytest.approx(np.array([[0.13, -0.33], [0.25, -0.35], [0.53, 0.16], [0.74, 0.73]]), abs=6e-3)


def test_loihi_says_which_rules_it_has(messages):
    net = neuro.Network("net", resolution=1.0)
    net.population("source", 2, neuro.spike_generator(spike_times=[[1.0], [2.0]]))
    net.population("cells", 2, neuro.iaf_psc_exp())
    net.connect("source", "cells", neuro.all_to_all(), neuro.stdp_triplet(), weight=10.0, delay=2.0, name="learnt")
    messages({"told": refused(neuro.compile, net, "loihi").partition("projection ")[2]})


def test_depression_by_triplets_ends_at_no_weight():
    net = neuro.Network("depressed")
    net.population("pre", 1, neuro.spike_generator(spike_times=[np.arange(10.0, 200.0, 10.0).tolist()]))
    net.population("post", 1, neuro.spike_generator(spike_times=[np.arange(8.0, 200.0, 10.0).tolist()]))
    net.population("out", 1, neuro.parrot_neuron())
    rule = neuro.stdp_triplet(Aplus=0.0, Aplus_triplet=0.0, Aminus=5.0, Aminus_triplet=0.0)
    net.connect("pre", "out", neuro.one_to_one(), rule, weight=3.0, delay=1.0, name="w")
    net.connect("post", "out", neuro.one_to_one(), weight=1.0, delay=1.0)
    for backend in ("reference", "event"):
        sim = neuro.compile(net, backend)
        sim.run(200.0)
        assert sim.get("w", "weight").tolist() == [0.0]
