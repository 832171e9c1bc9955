"""Rules that learn by moves: by hand, and the event backend beside the reference, bit for bit."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.extend import MoveRule, State, Trace, quantity
from refused import refused

BACKENDS = pytest.mark.parametrize("backend", ["reference", "event"])


def network(connected=None, gate=None, **of_rules):
    """Six places, a circuit of three that chooses and four neurons that judge."""
    net = neuro.Network("agent", resolution=1.0)
    places = net.population("places", 6, neuro.spike_generator())
    ask = net.population("ask", 1, neuro.spike_generator())
    actor = net.population("actor", 3, neuro.soft_wta(tau_m=5.0))
    critic = net.population("critic", 4, neuro.pp_psc_delta(with_reset=False, c_1=100.0, c_2=200.0, c_3=0.0))
    for name, target in (("act", actor), ("judge", critic), ("open", critic)):
        net.signal(name, to=target)
    rule = connected or neuro.all_to_all()
    acts = neuro.reinforce(signal="act", receptor="ex", tau=5.0, eta=0.5, **of_rules)
    judges = neuro.td_lambda(signal="judge", gate=gate, tau=8.0, eta=0.1, **of_rules)
    net.connect(places, actor, rule, acts, weight=neuro.uniform(low=-0.5, high=0.5), delay=1.0, name="policy")
    net.connect(places, critic, rule, judges, weight=0.1, delay=1.0, name="value")
    net.connect(ask, actor, neuro.all_to_all(), neuro.static(receptor="ask"), weight=1.0, delay=1.0, name="asked")
    return net


def played(sim, moves, rng, gated=False):
    """All that can be read after some moves, with spikes and errors at random, and an end of an episode on the way."""
    seen = []
    for move in range(moves):
        times = sim.time + np.sort(rng.integers(1, 19, 12)).astype(float)
        sim.inject("places", times, rng.integers(6, size=12))
        sim.inject("ask", [sim.time + 9.0, sim.time + 19.0], [0, 0])
        if gated:
            sim.signal("open", rng.random(4))
        sim.run(20.0)
        sim.signal("act", rng.normal(size=3))
        sim.signal("judge", rng.normal(size=4))
        if move % 3 == 2:
            sim.set("policy", e=0.0, z=0.0)
        seen += [sim.get(part, state) for part in ("policy", "value") for state in ("e", "z", "weight")]
        seen += [sim.get("actor", "p"), sim.get("critic", "V_m"), *sim.spikes("actor")]
    return seen


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("gate", [None, "open"])
@pytest.mark.parametrize("connected", [None, neuro.pairwise_bernoulli(0.5)], ids=["all_to_all", "pairwise_bernoulli"])
def test_event_is_the_reference(connected, gate, threads):
    net = network(connected, gate)
    rows = [
        played(neuro.compile(net, backend, seed=3, **options), 7, np.random.default_rng(1), gate is not None)
        for backend, options in (("reference", {}), ("event", {"threads": threads}))
    ]
    for one, other in zip(*rows, strict=True):
        np.testing.assert_array_equal(one, other)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32), x_min=st.sampled_from([1e-6, 1e-3, 0.3]), pairs=st.integers(1, 24))
def test_random_moves_on_event_are_those_of_the_reference(seed, x_min, pairs):
    net = network(neuro.fixed_total_number(pairs), x_min=x_min)
    one, other = (
        played(neuro.compile(net, b, seed=seed), 4, np.random.default_rng(seed)) for b in ("reference", "event")
    )
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@BACKENDS
def test_the_error_teaches_the_moves_before_and_then_takes_over_the_last(backend):
    sim = neuro.compile(network(), backend, seed=2)
    sim.set("value", weight=0.0)
    sim.inject("places", [1.0, 4.0], [0, 0])
    sim.run(20.0)
    gathered = sim.get("value", "e")
    times, critics = sim.spikes("critic")
    x = sum(np.exp(-(times - pre - 1.0) / 8.0) * (times >= pre + 1.0) for pre in (1.0, 4.0))
    expected = np.bincount(critics, x * (x >= 1e-3), minlength=4)
    np.testing.assert_allclose(gathered[:4], expected, rtol=1e-12)
    assert not gathered[4:].any()
    sim.signal("judge", 2.0)
    assert not sim.get("value", "weight").any()  # nothing was done before this move
    np.testing.assert_array_equal(sim.get("value", "z"), gathered)
    sim.signal("judge", 2.0)
    np.testing.assert_allclose(sim.get("value", "weight"), 0.1 * 2.0 * gathered)
    np.testing.assert_allclose(sim.get("value", "z"), 0.9 * gathered)


@BACKENDS
def test_a_choice_counts_less_what_was_expected(backend):
    sim = neuro.compile(network(), backend, seed=2)
    sim.inject("places", [1.0], [2])
    sim.inject("ask", [3.0], [0])
    sim.run(4.0)
    p, chosen = sim.get("actor", "p"), sim.spikes("actor")[1]
    assert p.sum() == pytest.approx(1.0)
    spiked = np.bincount(chosen, minlength=3)
    assert spiked.sum() == 1
    np.testing.assert_allclose(sim.get("policy", "e")[6:9], (spiked - p) * np.exp(-2.0 / 5.0), rtol=1e-12)


@BACKENDS
def test_a_state_goes_on_after_a_save(backend, tmp_path):
    net, rng = network(gate="open"), np.random.default_rng(5)
    sim = neuro.compile(net, backend, seed=1)
    played(sim, 4, rng, True)
    sim.save(tmp_path / "state.h5")
    again = neuro.compile(net, backend, seed=1)
    again.restore(tmp_path / "state.h5")
    one, other = (played(each, 3, np.random.default_rng(6), True) for each in (sim, again))
    assert all(np.array_equal(a, b) for a, b in zip(one[:6], other[:6], strict=True))


@BACKENDS
def test_a_reset_keeps_weights_and_forgets_eligibility(backend):
    sim = neuro.compile(network(), backend, seed=1)
    played(sim, 4, np.random.default_rng(1))
    learnt = sim.get("value", "weight")
    sim.reset()
    np.testing.assert_array_equal(sim.get("value", "weight"), learnt)
    assert not sim.get("value", "z").any()
    sim.reset(weights=True)
    assert (sim.get("value", "weight") == 0.1).all()


@BACKENDS
def test_weights_stay_within_their_bounds(backend):
    sim = neuro.compile(network(Wmin=-1.0, Wmax=1.0), backend, seed=1)
    sim.set("value", z=np.linspace(-1.0, 1.0, 24))
    sim.signal("judge", 1e6)
    weight = sim.get("value", "weight")
    assert (weight.min(), weight.max()) == (-1.0, 1.0)
    sim.set("value", eta=0.0)
    sim.signal("judge", -1e6)
    np.testing.assert_array_equal(sim.get("value", "weight"), weight)
    assert "weight[0] = 3: expected -1 to 1, the bounds of td_lambda" in refused(sim.set, "value", weight=3.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class hebb(MoveRule):
    """A third-party rule that sees the potential: e' = x V_m where the neuron spikes or not."""

    sees: ClassVar[str] = "V_m"
    states: ClassVar = (State("e", "", "eligibility"),)
    pre: ClassVar = (Trace("tau"),)
    tau: float = quantity(5.0, "ms", "of the pre trace", above=0)


def constants(p, h, c):
    """None."""


def gather(y, e, c, pre, spikes, state, gate):
    """The potential counts, whether the neuron spikes or not."""
    y[1, e] += pre[0] * state


def teach(y, e, c, n):
    """At once."""
    y[0, e] += n * y[1, e]
    y[1, e] = 0.0


def test_a_third_party_rule_sees_the_potential():
    found = []
    for backend in ("reference", "event"):
        net = neuro.Network("seen", resolution=1.0)
        pre = net.population("pre", 3, neuro.spike_generator(spike_times=[[1.0, 5.0], [2.0], []]))
        post = net.population("post", 2, neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=100.0))
        net.signal("reward", to=post)
        weight = neuro.uniform(low=0.5, high=1.0)
        net.connect(pre, post, neuro.all_to_all(), hebb(signal="reward"), weight=weight, delay=1.0, name="learnt")
        sim = neuro.compile(net, backend, seed=1)
        sim.run(8.0)
        eligible = sim.get("learnt", "e")
        sim.signal("reward", 0.1)
        found.append((eligible, sim.get("learnt", "weight")))
    assert found[0][0].astype(bool).tolist() == [True] * 4 + [False] * 2
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def learning(rule, weight=1.0, delay=1.0):
    net = neuro.Network("refused", resolution=1.0)
    net.population("pre", 2, neuro.spike_generator())
    for name in ("post", "other"):
        net.population(name, 2, neuro.iaf_psc_exp())
    net.signal("judge", to="post")
    net.signal("elsewhere", to="other")
    net.connect("pre", "post", neuro.all_to_all(), rule, weight=weight, delay=delay)
    neuro.compile(net, "reference")


def without_receptor():
    net = neuro.Network("which", resolution=1.0)
    net.population("pre", 2, neuro.spike_generator())
    net.population("choice", 2, neuro.soft_wta())
    net.connect("pre", "choice", neuro.all_to_all(), weight=1.0, delay=1.0)
    neuro.compile(net, "reference")


def circuit(size):
    net = neuro.Network("large", resolution=1.0)
    net.population("choice", size, neuro.soft_wta())
    neuro.compile(net, "reference")


def test_what_cannot_learn_so_is_refused(messages):
    messages.calls(globals())


@pytest.mark.parametrize("backend", ["loihi", "spinnaker", "nest", "torch"])
def test_other_backends_refuse_to_learn_by_moves(backend):
    if backend in ("nest", "torch"):
        pytest.importorskip(backend, reason=f"{backend} is not installed")
    assert "cannot run this network" in refused(neuro.compile, network(), backend)


@BACKENDS
def test_a_circuit_chooses_by_softmax(backend):
    n = 400 if backend == "reference" else 4000
    net = neuro.Network("soft", resolution=1.0)
    net.population("ask", 1, neuro.spike_generator(spike_times=[list(np.arange(1.0, n + 1.0))]))
    net.population("drive", 3, neuro.spike_generator(spike_times=[[1.0]] * 3))
    net.population("choice", 3, neuro.soft_wta(tau_m=1e9, Delta_V=2.0))
    net.connect("ask", "choice", neuro.all_to_all(), neuro.static(receptor="ask"), weight=1.0, delay=1.0)
    weights = np.array([0.0, 1.0, 3.0])
    net.connect("drive", "choice", neuro.one_to_one(), neuro.static(receptor="ex"), weight=weights, delay=1.0)
    sim = neuro.compile(net, backend, seed=4)
    sim.run(n + 1.0)
    times, chosen = sim.spikes("choice")
    assert len(times) == len(set(times)) == n
    p = np.exp(weights / 2.0) / np.exp(weights / 2.0).sum()
    np.testing.assert_allclose(np.bincount(chosen, minlength=3) / n, p, atol=4 * np.sqrt(0.25 / n))
