"""Rules of spike pairs with a value for each synapse."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.extend import Synapse, Trace, quantity
from refused import without_place

PRE, POST = [2, 0, 1, 0, 2], [1, 3, 0, 0, 2]
N = len(PRE)


def network(rule: Synapse, weight: object = 40.0, connect: object = None) -> neuro.Network:
    """Neurons that fire by themselves, and pairs listed in no order."""
    net = neuro.Network("n")
    net.population("drive", 3, neuro.poisson_generator(rate=150.0))
    net.population("source", 3, neuro.parrot_neuron())
    net.population("cells", 4, neuro.iaf_psc_exp(I_e=450.0))
    net.connect("drive", "source", neuro.one_to_one())
    net.connect("source", "cells", connect or neuro.pairs(pre=PRE, post=POST), rule, weight=weight, name="w")
    return net


def learnt(net: neuro.Network, backend: str) -> np.ndarray:
    sim = neuro.compile(net, backend, seed=4)
    sim.run(80.0)
    return np.concatenate((sim.weights("w")[2], sim.get("cells", "V_m")))


RULES = (
    *(neuro.stdp, neuro.stdp_nn_symm, neuro.stdp_nn_restr, neuro.stdp_nn_pre_centered),
    *(neuro.stdp_triplet, neuro.vogels_sprekeler, neuro.tsodyks2),
)

WHERE = [
    *((rule, "reference") for rule in RULES),
    *((rule, "event") for rule in (neuro.stdp, neuro.stdp_triplet, neuro.tsodyks2)),
]
"""Event compiles two kernels for each rule, in about 4 s; how it hands on the values is the same for all rules."""


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(WHERE), st.data())
def test_values_that_are_all_equal_are_the_number(where, data):
    rule, backend = where
    takes = [word for word, q in rule.quantities().items() if q.arrays and word != "Wmax"]
    numbers = {word: data.draw(st.floats(0.0, 1.0), word) for word in takes}
    sign = -1.0 if rule is neuro.vogels_sprekeler else 1.0
    if "Wmax" in rule.quantities():
        numbers["Wmax"] = sign * data.draw(st.floats(50.0, 200.0), "Wmax")
    one = learnt(network(rule.from_words(numbers), sign * 40.0), backend)
    arrays = {word: np.full(N, value) for word, value in numbers.items()}
    each = learnt(network(rule.from_words(arrays), sign * 40.0), backend)
    assert np.array_equal(one, each)


def test_each_synapse_learns_by_its_own_number():
    steps = np.array([0.0, 0.3, 0.1, 0.2, 0.05])
    weak = {"weight": 4e-7}  # moves no spike
    each = learnt(network(neuro.stdp(lambda_=steps, Wmax=1e-6), **weak), "event")
    order = np.lexsort((POST, PRE))
    for k, step in enumerate(steps[order]):
        assert each[k] == learnt(network(neuro.stdp(lambda_=step, Wmax=1e-6), **weak), "event")[k]
    assert np.unique(each[:N]).size == N


def test_drawn_values_are_those_of_the_seed_and_within_the_distribution():
    rule = neuro.stdp(lambda_=neuro.uniform(low=0.01, high=0.02), Wmax=neuro.normal(mean=100.0, std=1.0))
    sims = [neuro.compile(network(rule, connect=neuro.fixed_indegree(500)), seed=seed) for seed in (1, 1, 2)]
    one, again, other = (sim.get("w", "lambda") for sim in sims)
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    assert 0.01 <= one.min() < 0.0101
    assert 0.0199 < one.max() < 0.02
    assert abs(sims[0].get("w", "Wmax").mean() - 100.0) < 0.2
    assert np.array_equal(sims[0].get("w", "alpha"), np.ones(2000))


def test_values_of_distance():
    net = neuro.Network("n")
    rule = neuro.stdp(lambda_=neuro.of_distance(neuro.linear(c=0.1, a=0.2)))
    line = net.population("line", (4, 1), neuro.iaf_psc_exp())
    net.connect(line, line, neuro.all_to_all(), rule, weight=1.0, name="w")
    apart = np.abs(np.subtract.outer(np.arange(4), np.arange(4))).ravel()
    assert neuro.compile(net).get("w", "lambda") == pytest.approx(0.1 + 0.2 * apart)


def test_an_empty_projection_has_no_values():
    none = neuro.pairwise_bernoulli(p=0.0)
    sim = neuro.compile(network(neuro.stdp(lambda_=neuro.uniform(low=0.0, high=1.0)), connect=none))
    sim.set("w", alpha=np.zeros(0))
    sim.run(10.0)
    assert sim.get("w", "lambda").size == 0


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_values_are_set_read_saved_and_kept_by_a_network(backend, tmp_path: Path):
    net = network(neuro.stdp())
    sim = neuro.compile(net, backend, seed=1)
    sim.run(50.0)
    steps = np.linspace(0.0, 0.2, N)
    sim.set("w", lambda_=steps)
    sim.set("w", alpha=[2.0, 3.0], pre=net.populations["source"][0])
    sim.run(50.0)
    assert np.array_equal(sim.get("w", "lambda"), steps)
    assert np.array_equal(sim.get("w", "lambda_"), steps)
    assert np.array_equal(sim.get("w", "alpha"), [2.0, 3.0, 1.0, 1.0, 1.0])
    sim.save(tmp_path / "state.h5")
    again = neuro.compile(net, backend, seed=1)
    again.restore(tmp_path / "state.h5")
    for one in (sim, again):
        one.set("w", pre=net.populations["source"][2], alpha=0.5)
        one.run(50.0)
    assert np.array_equal(sim.weights("w")[2], again.weights("w")[2])
    sim.network().save(tmp_path / "learnt.yaml")
    kept = neuro.compile(neuro.load(tmp_path / "learnt.yaml"), backend)
    for word in ("lambda", "alpha", "mu_plus", "tau_plus"):
        assert np.array_equal(kept.get("w", word), sim.get("w", word))
    sim.reset(weights=True)
    sim.set("w", lambda_=0.01, alpha=1.0)
    fresh = neuro.compile(net, backend, seed=1)
    for one in (sim, fresh):
        one.run(50.0)
    assert np.array_equal(sim.weights("w")[2], fresh.weights("w")[2])


def test_a_state_is_not_that_of_other_values(tmp_path: Path):
    first, other = (neuro.compile(network(neuro.stdp(lambda_=np.full(N, k))), seed=1) for k in (0.1, 0.2))
    first.save(tmp_path / "state.h5")
    assert "a state of another network 'n'" in without_place(other.restore, tmp_path / "state.h5")


def test_values_in_yaml(tmp_path: Path):
    net = network(neuro.stdp(lambda_=[0.1, 0.2, 0.3, 0.4, 0.5], Wmax=neuro.uniform(low=90.0, high=99.0)))
    net.save(tmp_path / "net.yaml")
    assert neuro.load(tmp_path / "net.yaml") == net
    text = (tmp_path / "net.yaml").read_text().replace("0.5", "-0.5")
    (tmp_path / "net.yaml").write_text(text)
    assert "stdp.lambda[4] = -0.5: expected a number >= 0" in without_place(neuro.load, tmp_path / "net.yaml")


def test_values_that_do_not_fit_are_refused(messages):
    net = network(neuro.stdp())
    scope = globals() | {"s": neuro.compile(net, "reference"), "first": net.populations["source"][0]}
    messages.calls(scope)


def test_chips_have_one_rule_for_a_projection():
    net = neuro.Network("n", resolution=1.0)
    net.population("a", 2, neuro.poisson_generator(rate=20.0))
    net.population("b", 2, neuro.iaf_psc_exp())
    rule = neuro.stdp(lambda_=[0.1, 0.2], Wmax=[90.0, 80.0])
    net.connect("a", "b", neuro.one_to_one(), rule, weight=40.0, name="w")
    why = "projection 'w': stdp: lambda, Wmax of each synapse: expected one number, because a rule is for a projection"
    for chip in ("loihi", "spinnaker"):
        message = without_place(neuro.compile, net, chip)
        assert why in message
        assert "hint: give all synapses one number, split the projection, or run on event" in message


@dataclass(frozen=True, kw_only=True, eq=False)
class slow(Synapse):
    """A rule that would have a trace of its own at each synapse."""

    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau"),)

    tau: float = quantity(20.0, "ms", "time constant", above=0, arrays=True)


def test_a_trace_has_one_time_constant():
    from neuro.model.synapses import complete

    with pytest.raises(TypeError) as error:
        complete(slow)
    message = "'tau' has a value per synapse: expected one for all synapses, because synapses share their traces"
    assert str(error.value) == f"synapse model 'slow': {message}"


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_a_state_with_weights_that_were_set_changes_no_described_weight(backend: str, tmp_path: Path):
    net = neuro.Network("described")
    net.population("cells", 40, neuro.iaf_psc_exp(I_e=450.0))
    net.connect("cells", "cells", neuro.all_to_all(), weight=neuro.normal(mean=30.0, std=9.0), name="wires")
    sim = neuro.compile(net, backend, seed=1)
    described = sim.get("wires", "weight")
    sim.run(5.0)
    sim.set("wires", weight=0.5 * described)
    sim.save(tmp_path / "state.h5")
    other = neuro.compile(net, backend, seed=1)
    other.restore(tmp_path / "state.h5")
    assert np.array_equal(other.get("wires", "weight"), 0.5 * described)
    other.reset(weights=True)
    assert np.array_equal(other.get("wires", "weight"), described)
    assert np.array_equal(other.program.projections[0].weight, described)
