"""Rules of spike pairs and triplets: equal on the backends, to NEST's traces, and to what is known in closed form."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import neuro
from neuro.model.synapses import Synapse
from neuro.testing import check_part, observe
from neuro.testing.case import differences
from neuro.verify.verify import verify

RULES: dict[str, Synapse] = {
    "stdp_triplet": neuro.stdp_triplet(Aplus=0.1, Aplus_triplet=0.03, Aminus=0.2, Aminus_triplet=0.01),
    "inhibitory stdp_triplet": neuro.stdp_triplet(Aplus_triplet=0.03, Aminus=0.2, Wmax=-50.0),
}
GOLDEN = ("g4_stdp_triplet",)


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_a_rule_is_the_same_on_both_backends(rule: Synapse):
    check_part(rule)


def onto_parrots(rule: Synapse, backend: str) -> neuro.Simulation:
    """Spikes of multiplicity above one on both sides, some at equal times."""
    net = neuro.Network("parrots", resolution=1.0)
    net.population("noise", 6, neuro.poisson_generator(rate=600.0))
    net.population("pre", 6, neuro.parrot_neuron())
    net.population("post", 4, neuro.parrot_neuron())
    net.population("end", 4, neuro.parrot_neuron())
    net.connect("noise", "pre", neuro.one_to_one(), delay=1.0)
    net.connect("noise", "post", neuro.pairs(pre=[0, 1, 2, 3], post=[0, 1, 2, 3]), delay=3.0)
    low, high = sorted((0.4 * rule.Wmax, 0.6 * rule.Wmax)) if hasattr(rule, "Wmax") else (40.0, 60.0)
    drawn = neuro.uniform(low=low, high=high)
    net.connect("pre", "post", neuro.all_to_all(), rule, weight=drawn, delay=4.0, name="learnt")
    sim = neuro.compile(net, backend, seed=3)
    sim.run(40.0)
    return sim


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_spikes_of_a_step_act_one_after_the_other(rule: Synapse):
    expected, found = (observe(onto_parrots(rule, backend)) for backend in ("reference", "event"))
    assert np.ptp(expected["weight of learnt"]) > 0.0
    assert differences(expected, found, exact=False) == []


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_traces_of_nest_come_out(shared: Path, tmp_path: Path, backend: str):
    for case in GOLDEN:
        for kind in ("json", "npz"):
            shutil.copy(shared / "reference" / "nest-models" / f"{case}.{kind}", tmp_path)
    results = verify(tmp_path, backend)
    assert {result.case for result in results} == {*GOLDEN}
    assert [f"{r.case} {r.quantity}: {r.message}" for r in results if not r.ok] == []
