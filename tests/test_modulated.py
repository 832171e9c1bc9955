"""Rules of three factors: whose weights move under a signal or under dopamine, ours and third-party ones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import neuro
from beside import evaluated
from closed_forms import expected_lesson, lessons
from neuro.extend import Modulated, State, quantity
from neuro.testing import check_part

BACKENDS = pytest.mark.parametrize("backend", ["reference", "event"])


@dataclass(frozen=True, kw_only=True, eq=False)
class hebb_by_n(Modulated):
    """At every post spike the weight grows by rate x n x K+."""

    equation: ClassVar[str] = "post: w += rate n K+"
    source: ClassVar[str] = "this test"
    states: ClassVar[tuple[State, ...]] = (State("now", "", "n at the last event"),)

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    rate: float = quantity(0.1, "", "learning rate")
    Wmax: float = quantity(400.0, "", "largest weight", above=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class fading(hebb_by_n):
    """Likewise, of a modulator that fades."""

    tau_n: float = quantity(15.0, "ms", "time constant of n", above=0)


def constants(p, h, c):
    """The parameters; that of n is the last."""
    c[:3] = p[:3]
    c[3] = h
    c[4] = h / p[3] if len(p) > 3 else 0.0


def on_post(y, e, c, pre, post):
    """Learn."""
    y[0, e] = max(0.0, min(c[2], y[0, e] + c[1] * y[1, e] * pre[0]))


def on_pre(y, e, c, pre, post):
    """Nothing is learnt."""


def advance(y, e, c, begin, end, n, grid):
    """Keep n of the end."""
    y[1, e] = n * math.exp(-(end - begin) * c[4])


@pytest.mark.parametrize("rule", evaluated(__file__, "RULES", globals()), ids=lambda rule: rule.name)
def test_a_rule_on_event_and_reference(rule):
    check_part(rule, ms=10.0)


PRE, POST, DELAY, START = 10.0, 15.0, 4.0, 1.0


def one_pair(rule, backend):
    """One synapse, a spike of its source and one of its target, which reaches the synapse DELAY later."""
    net = neuro.Network("pair")
    net.population("pre", 1, neuro.spike_generator(spike_times=[[PRE]]))
    net.population("driver", 1, neuro.spike_generator(spike_times=[[POST - 1.0]]))
    net.population("post", 1, neuro.iaf_psc_delta())
    net.signal("reward", to="post")
    net.connect("driver", "post", neuro.all_to_all(), weight=1000.0, delay=1.0)
    net.connect("pre", "post", neuro.all_to_all(), rule, weight=START, delay=DELAY, name="learnt")
    return neuro.compile(net, backend)


@BACKENDS
def test_a_pair_and_reward_move_a_weight_as_florian_says(backend):
    sim = one_pair(neuro.mstdpet(signal="reward", A_plus=2.0, gamma=0.3, b=0.5, tau_z=30.0), backend)
    sim.signal("reward", 0.5)
    sim.run(40.0)
    assert sim.spikes("post")[0].tolist() == [POST]
    z = 2.0 * math.exp(-(POST + DELAY - PRE) / 20.0) / 30.0 * math.exp(-(40.0 - POST - DELAY) / 30.0)
    assert sim.get("learnt", "z") == pytest.approx(z, rel=1e-12)
    assert sim.get("learnt", "weight") == START  # reward is at its baseline
    sim.signal("reward", 1.7)
    sim.run(10.0)
    assert sim.get("learnt", "n") == 1.7
    moved = 0.3 * (1.7 - 0.5) * z * 30.0 * (1.0 - math.exp(-10.0 / 30.0))
    assert sim.get("learnt", "weight") == pytest.approx(START + moved, rel=1e-12)


@BACKENDS
@pytest.mark.parametrize("reward", [1.7, -2.0])
def test_a_moment_of_reward_moves_a_weight_as_vasilaki_says(backend, reward):
    """alpha(w) (R - b) e with alpha = 3000 w/5 (1 - w/5) for 0.1 ms, here in 1,000 small steps."""
    sim = one_pair(neuro.mstdpet(signal="reward", gamma=3000.0, b=0.5, tau_z=30.0, Wmax=5.0, soft=True), backend)
    sim.signal("reward", 0.5)
    sim.run(40.0)
    z, w = sim.get("learnt", "z")[0] * math.exp(-0.05 / 30.0), START
    sim.signal("reward", reward)
    sim.run(0.1)
    sim.signal("reward", 0.5)
    sim.run(40.0)
    for _ in range(1000):
        w += 1e-4 * 3000.0 * (reward - 0.5) * z * w / 5.0 * (1.0 - w / 5.0)
    assert abs(w - START) > 0.3
    assert sim.get("learnt", "weight") == pytest.approx(w, rel=1e-3)


@BACKENDS
@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize(("reward", "bound"), [(1e6, 5.0), (-1e6, 0.0)])
def test_a_weight_stays_within_its_bounds(backend, reward, bound, soft):
    sim = one_pair(neuro.mstdpet(signal="reward", Wmax=5.0, soft=soft), backend)
    sim.signal("reward", reward)
    sim.run(40.0)
    assert sim.get("learnt", "weight") == bound
    sim.signal("reward", -reward)
    sim.run(40.0)
    assert sim.get("learnt", "weight") == (bound if soft else 5.0 - bound)


def test_a_modulator_that_never_falls_comes_from_a_signal(messages):
    net = neuro.Network("own")
    net.population("cells", 2, neuro.iaf_psc_exp())
    net.connect("cells", "cells", neuro.all_to_all(), hebb_by_n(signal="rewards"), name="learnt")
    messages.calls(globals() | {"net": net})


def test_reward_less_its_running_mean():
    assert neuro.reward_error(1.0, 0.25, 0.1) == (0.75, 0.325)
    errors, baselines = neuro.reward_error([1.0, -1.0], 0.5, 0.0)
    assert errors.tolist() == [0.5, -1.5]
    assert baselines.tolist() == [0.5, 0.5]
    b = 0.0
    for _ in range(200):
        error, b = neuro.reward_error(3.0, b, 0.1)
    assert error == pytest.approx(3.0 * 0.9**199, rel=1e-6)


def test_temporal_difference_errors_by_hand():
    assert neuro.td_error(1.0, 2.0, 3.0, 0.5) == 0.5
    assert neuro.td_error(5.0, 2.0, [0.0, 4.0], 1.0).tolist() == [3.0, 7.0]
    assert neuro.td_error_rate(0.25, 8.0, 0.5, 4.0) == -1.25
    t, tau_r = 300.0, 400.0  # V = R exp(-(T - t) / tau_r) expects a reward R at T: no error on the way
    value = 100.0 * math.exp(-(1000.0 - t) / tau_r)
    assert neuro.td_error_rate(0.0, value, value / tau_r, tau_r) == pytest.approx(0.0, abs=1e-15)


def test_what_is_no_error_signal_is_refused(messages):
    messages.calls(globals())


def weights_to_normalise(backend, weight):
    net = neuro.Network("sums")
    net.population("pre", 4, neuro.poisson_generator(rate=50.0))
    net.population("post", 3, neuro.iaf_psc_exp())
    wires = neuro.pairs(pre=[0, 1, 1, 3], post=[0, 0, 2, 2])
    net.connect("pre", "post", wires, neuro.stdp(), weight=weight, delay=1.0, name="w")
    return neuro.compile(net, backend)


@BACKENDS
def test_weights_onto_a_neuron_are_scaled_to_a_sum(backend):
    sim = weights_to_normalise(backend, [10.0, 30.0, 50.0, 50.0])
    neuro.normalise(sim, "w", [20.0, 1.0, 80.0])
    assert sim.weights("w")[2].tolist() == [5.0, 15.0, 40.0, 40.0]
    sim.run(50.0)
    neuro.normalise(sim, "w", 60.0)
    _, post, weight = sim.weights("w")
    assert np.bincount(post, weight) == pytest.approx([60.0, 0.0, 60.0])


def test_the_weights_of_a_map_are_scaled_to_a_sum():
    net = neuro.Network("maps")
    net.population("pre", (2, 4, 4), neuro.poisson_generator(rate=50.0))
    net.population("post", (3, "auto", "auto"), neuro.iaf_psc_exp())
    drawn = neuro.uniform(low=1.0, high=9.0)
    net.connect("pre", "post", neuro.grid(kernel=(2, 2)), weight=drawn, delay=1.0, name="w")
    sim = neuro.compile(net)
    before = sim.weights("w")
    neuro.normalise(sim, "w", [1.0, 2.0, 3.0])
    after = sim.weights("w")
    assert after.sum(axis=(1, 2, 3)) == pytest.approx([1.0, 2.0, 3.0])
    assert np.ptp(after[1] / before[1]) < 1e-15


def test_sums_that_cannot_be_had_are_refused(messages):
    sim = weights_to_normalise("reference", [10.0, 30.0, 50.0, 50.0])
    messages.calls(globals() | {"sim": sim})
    assert sim.weights("w")[2].tolist() == [10.0, 30.0, 50.0, 50.0]


def test_a_hedonistic_synapse_recovers_releases_and_fails():
    rule = neuro.hedonistic(q_0=math.log(3.0), Delta_z=-math.log(3.0), tau_r=8.0)
    on_pre, c, y = rule.arithmetic.on_pre, np.zeros(rule.width), np.zeros((6, 1))
    rule.arithmetic.constants(rule.vector(), 0.1, c)
    y[:, 0] = [7.0, *rule.first_states()[:, 0]]

    def after(u, since):
        on_pre(y, 0, c, (since,), (), u)
        return y[2:, 0].tolist(), rule.arithmetic.sent(y, 0, c)

    (eligible, z, released, refractory), sent = after(0.74, math.inf)  # p = 3/4, z before its jump
    assert (released, refractory, sent) == (1.0, 1.0, 7.0)
    assert (eligible, z) == pytest.approx((0.25, -math.log(3.0)))
    recovers = 1.0 - math.exp(-2.0 / 8.0)
    (eligible, _, released, refractory), sent = after(recovers + 1e-9, 2.0)
    assert (released, refractory, sent) == (0.0, 1.0, 0.0)
    assert eligible == pytest.approx(0.25)  # not available: no lesson
    y[3, 0] = -math.log(3.0)
    (eligible, _, released, refractory), sent = after(0.51 * recovers, 2.0)  # recovered, and p = 1/2
    assert (released, refractory, sent) == (0.0, 0.0, 0.0)
    assert eligible == pytest.approx(0.25 - 0.5)


@pytest.mark.parametrize(("n", "theta", "p"), [(10, 6, 0.5), (8, 3, 0.3)])
def test_the_expected_lesson_of_hedonistic_synapses(n, theta, p):
    """One spike of each of n synapses onto a neuron, reward 1 if at least theta release."""
    neurons = 50_000
    found, expected = lessons(n, theta, p, neurons), expected_lesson(n, theta, p)
    error = found.std() / math.sqrt(neurons)
    assert error < 0.02 * expected
    assert abs(found.mean() - expected) < 4.0 * error


@BACKENDS
def test_what_is_not_released_is_not_sent(backend):
    net = neuro.Network("sent", resolution=1.0)
    net.population("pre", 8, neuro.spike_generator(spike_times=[[1.0]] * 8))
    net.population("post", 20, neuro.iaf_psc_delta())
    net.connect("pre", "post", neuro.all_to_all(), neuro.hedonistic(), weight=0.1, delay=1.0, name="w")
    sim = neuro.compile(net, backend, seed=3)
    sim.run(2.0)
    released = sim.get("w", "released").reshape(8, 20).sum(axis=0)
    assert np.ptp(released) > 0.0
    assert sim.get("post", "V_m") + 70.0 == pytest.approx(0.1 * released)


def test_synapses_draw_alike_on_all_backends_and_each_spike_anew():
    net = neuro.Network("draws")
    net.population("pre", 3, neuro.spike_generator(spike_times=[[1.0, 1.0]] * 3))
    net.population("post", (6, 10, 10), neuro.iaf_psc_delta())
    net.population("sheet", (1, 11, 11), neuro.spike_generator())
    drawn = neuro.uniform(low=0.5, high=4.0)
    rule = neuro.hedonistic(tau_c=1e9)
    net.connect("pre", "post", neuro.pairwise_bernoulli(p=0.7), rule, weight=0.1, delay=drawn, name="w")
    net.connect("sheet", "post", neuro.grid(kernel=(2, 2)), weight=1.0, delay=1.0)  # event keeps maps in another order

    def lessons(backend, threads):
        sim = neuro.compile(net, backend, threads=threads)
        sim.run(2.0)
        return sim.get("w", "c").round(6)

    expected = lessons("reference", 1)
    for threads in (1, 2):
        assert np.array_equal(lessons("event", threads), expected)
    failed_twice, failed_once, released = ((expected == c).mean() for c in (-1.0, 0.0, 0.5))
    assert failed_twice + failed_once + released == 1.0  # who releases first cannot again in no time
    assert released == pytest.approx(0.5, abs=0.05)
    assert failed_twice == pytest.approx(0.25, abs=0.05)
