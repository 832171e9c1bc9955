"""The drift of weights under `r_stdp`: the rule itself, its bounds, what is counted, and ReMuS' epsilons."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

import neuro
from neuro import r_stdp
from neuro.compiler import compile_network
from neuro_doctor.drift import Drift, Shares, drift_of, findings as drift_findings, shares_of
from neuro_doctor.wiring import Wiring
from refused import refused

REMUS = Path(__file__).parents[2] / "models" / "neuro_models" / "remus.yaml"
RATE = st.floats(-0.3, 0.3)
WEIGHT = st.floats(0.001, 0.999)
SINCE = np.array([2.0, 0.0, -1.0])
"""ms from the arrival of an input to the decision, in the order of `Shares`."""


@st.composite
def rules(draw: Any) -> r_stdp:
    """Rules with rates of any sign."""
    rates = {word: draw(RATE) for word in ("Ar_plus", "Ar_minus", "Ap_plus", "Ap_minus")}
    return r_stdp(**rates, epsilon=draw(st.floats(0.0, 0.001)), ties_after=draw(st.booleans()))


@st.composite
def shares(draw: Any) -> Shares:
    """Shares that leave some trials in which nothing is taught."""
    parts = np.array(draw(st.lists(st.floats(0.001, 1.0), min_size=8, max_size=8)))
    parts /= parts.sum()
    return Shares(parts[:3], parts[3:6], parts[6])


def changes(rule: r_stdp, weight: Any) -> list[float]:
    """What each outcome of `Shares` changes, by the functions of the rule."""
    c = np.zeros(rule.width)
    rule.arithmetic.constants(rule.vector(), 1.0, c)
    taught = [rule.arithmetic.teach(weight, since, lesson, c) for lesson in (1.0, -1.0) for since in SINCE]
    return [new - weight for new in (*taught, rule.arithmetic.encourage(weight, c))]


@given(rules(), shares(), st.floats(0.01, 0.99))
def test_the_expected_change_is_that_of_the_rule(rule, taught, weight):
    probability = [*taught.rewarded, *taught.punished, taught.grown]
    expected = float(np.dot(probability, changes(rule, weight)))
    assert float(drift_of(rule, taught).change(weight)) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("epsilon", [0.0, 0.0005, 0.003, 0.02])
@pytest.mark.parametrize("ties_after", [False, True])
def test_a_course_is_the_mean_of_many_random_ones(epsilon, ties_after):
    rule = r_stdp(Ar_plus=0.02, Ar_minus=-0.01, Ap_plus=0.005, Ap_minus=-0.03, epsilon=epsilon, ties_after=ties_after)
    taught = Shares(np.array([0.1, 0.05, 0.05]), np.array([0.25, 0.1, 0.05]), np.array(0.3))
    probability = np.array([*taught.rewarded, *taught.punished, taught.grown])
    rng, weight = np.random.default_rng(1), np.full(200, 0.8)
    c = np.zeros(rule.width)
    rule.arithmetic.constants(rule.vector(), 1.0, c)
    outcomes = np.array([(lesson, since) for lesson in (1.0, -1.0) for since in SINCE])
    for _ in range(300):
        drawn = rng.choice(8, size=weight.size, p=[*probability, 1.0 - probability.sum()])
        for k, outcome in enumerate(drawn.tolist()):
            if outcome < 6:
                lesson, since = outcomes[outcome]
                weight[k] = rule.arithmetic.teach(weight[k], since, lesson, c)
            elif outcome == 6:
                weight[k] = rule.arithmetic.encourage(weight[k], c)
    # Four deviations of the mean of the courses, and what the second order of rates up to 0.03 leaves out.
    assert float(drift_of(rule, taught).after(0.8, 300)) == pytest.approx(weight.mean(), abs=0.3 * weight.std() + 0.005)


PUSH, LIFT = st.floats(-0.1, 0.1), st.floats(0.0, 0.02)


@given(PUSH, LIFT, st.just(0.0) | st.floats(1e-6, 1.0), st.integers(0, 5000), st.integers(0, 5000))
def test_courses_stay_within_the_bounds_in_order_and_go_on(push, lift, weight, first, second):
    drift = Drift(np.array(push), np.array(lift))
    there = drift.after(weight, first)
    assert 0.0 <= there <= 1.0
    assert drift.after(weight, 0) == pytest.approx(weight, abs=1e-12)
    assert drift.after(there, second) == pytest.approx(float(drift.after(weight, first + second)), abs=1e-6)
    assert drift.after(min(1.0, weight + 0.01), first) >= there - 1e-9
    assert drift.after(1.0, first) == pytest.approx(1.0, abs=1e-9)
    assert lift or drift.after(0.0, first) == 0.0


@given(st.floats(-0.1, -1e-4), st.floats(0.0, 0.02), WEIGHT)
def test_weights_end_at_the_fixed_points(push, lift, weight):
    drift = Drift(np.array(push), np.array(lift))
    low, high = drift.fixed_points()
    if low < high:
        assert drift.change(low) == pytest.approx(0.0, abs=1e-12)
        assert drift.change(high) == pytest.approx(0.0, abs=1e-12)
    if abs(weight - high) > 0.01 and abs(4.0 * lift + push) > 0.01 * abs(push):
        assert drift.after(weight, 1e9) == pytest.approx(1.0 if weight > high else float(low), abs=1e-4)


@given(st.floats(-0.1, -1e-4), WEIGHT, st.floats(0.01, 0.5))
def test_the_saturating_epsilon_separates_weights_that_fall(push, weight, grown):
    epsilon = float(Drift(np.array(push), np.array(0.0)).saturating_epsilon(weight, grown))
    assert Drift(np.array(push), np.array(1.02 * epsilon * grown)).after(weight, 1e9) == 1.0
    assert Drift(np.array(push), np.array(0.98 * epsilon * grown)).after(weight, 1e9) < 1.0


def test_without_a_push_down_every_epsilon_saturates_and_nothing_drifts_without_both():
    up, still = Drift(np.array(0.01), np.array(0.0)), Drift(np.array(0.0), np.array(0.0))
    assert up.saturating_epsilon(0.5, 0.1) == 0.0
    assert up.fixed_points() == (1.0, 0.0)
    assert np.isnan(still.fixed_points()).all()
    assert still.after(0.3, 1e6) == 0.3


def small(rule: r_stdp, backend: str = "event", **words: Any) -> neuro.Simulation:
    """Two labels of two maps each over a small sheet."""
    net = neuro.Network("small", resolution=0.5)
    net.population("sheet", (2, 5, 6), neuro.spike_generator())
    cells = neuro.iaf_psc_delta(tau_m=float("inf"), E_L=0.0, V_reset=0.0, V_th=3.0, t_ref=0.0)
    net.population("maps", (4, "auto", "auto"), cells)
    weight = neuro.normal(mean=0.6, std=0.1, low=0.1, high=0.9)
    net.connect("sheet", "maps", neuro.grid(**{"kernel": (3, 3)} | words), rule, weight=weight, delay=1.0, name="s2")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="sheet", duration=10.0, stop="full", labels={"of": "maps", "maps_per_label": 2}, reset=["V_m"])
    return neuro.compile(net, backend, seed=3)


@pytest.mark.parametrize("ties_after", [False, True])
def test_counted_shares_predict_each_trial_exactly(ties_after):
    rule = r_stdp(Ar_plus=0.1, Ar_minus=-0.05, Ap_plus=0.02, Ap_minus=-0.08, epsilon=0.004, ties_after=ties_after)
    sim, rng, outcomes = small(rule), np.random.default_rng(2), set()
    for _ in range(40):
        ids = rng.permutation(60)[: rng.integers(5, 50)]
        trial = rng.integers(0, 6, ids.size) * 0.5, ids, [0, ids.size], [int(rng.integers(2))]
        before = sim.weights("s2").copy()
        results = sim.trials(*trial, learn=True)
        taught = shares_of(sim, "s2", *trial, results)
        drift = drift_of(rule, taught)
        assert sim.weights("s2") == pytest.approx(before + drift.change(before), abs=1e-12)
        outcomes.add((int(results.label[0]) < 0, bool(taught.grown.any())))
        outcomes |= {str(k) for k in range(3) if taught.rewarded[k].any()}
    assert outcomes == {(True, True), (False, True), (False, False), "0", "1", "2"}


def test_a_map_loses_what_brings_it_to_decisions_that_are_mostly_wrong():
    rule = r_stdp(epsilon=0.0)
    alive = rule.Ap_minus / (rule.Ap_minus - rule.Ar_plus)
    for right, grows in ((alive + 0.01, True), (alive - 0.01, False)):
        taught = Shares(np.array([right, 0.0, 0.0]), np.array([1.0 - right, 0.0, 0.0]), np.array(0.0))
        assert (drift_of(rule, taught).push > 0.0) == grows


def test_shares_of_what_has_none_are_refused():
    batch: Any = ([], [], [0], [])
    expected = "expected a grid that learns by r_stdp in trials, without rescue"
    assert refused(shares_of, small(r_stdp(rescue=True)), "s2", *batch, None).endswith(expected)
    assert refused(shares_of, small(r_stdp()), "s3", *batch, None) == f"shares_of: 's3': {expected}"
    assert refused(shares_of, small(r_stdp(), padding=1), "s2", *batch, None).endswith("trials, without padding")


@pytest.mark.parametrize(
    ("theta", "lowest", "some", "highest"),
    [(60.0, 0.0005, (0.0007, 0.001), 0.002), (30.0, 0.0002, (0.0007, 0.001), 0.004)],
)
def test_the_epsilon_is_named_at_which_remus_no_longer_saturates(theta, lowest, some, highest):
    """Measured on N-MNIST, `lowest` learns, `some` do with some recordings, `highest` ends at chance."""

    def warned(epsilon: float) -> list[tuple[str, str]]:
        net = neuro.load(REMUS, params={"theta": theta, "epsilon": epsilon})
        return [(each.evidence, each.remedy) for each in drift_findings(Wiring(compile_network(net, 1)))]

    assert warned(0.0002) == warned(lowest) == []
    for epsilon in (*some, highest):
        ((evidence, remedy),) = warned(epsilon)
        least, most = (float(remedy.split(word)[1].split()[0].strip(",")) for word in ("about ", "at most "))
        assert lowest <= least < min(some)
        assert ("may saturate" in evidence) == (epsilon <= most) == (epsilon in some)
