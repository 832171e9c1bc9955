"""Groups with several winners: a plain prototype of Masquelier and Thorpe's competition, random networks, messages."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from neuro import Network, all_to_all, grid, iaf_psc_delta, local_winners, mozafari, r_stdp, spike_generator
from neuro.run.simulation import Simulation
from neuro.testing import observe
from neuro.testing.case import differences
from neuro.testing.trials import sheets, trial_results

BACKENDS = ("reference", "event", "loihi", "spinnaker")
INF = float("inf")
MAPS, SIDE, FIELD, THRESHOLD, TICKS = 5, 8, 4, 6.0, 20
PLACES = SIDE - FIELD + 1


def sheet(group: Any, rule: Any = None, threshold: float = THRESHOLD, **words: Any) -> Network:
    net = Network("sheet", resolution=1.0)
    net.population("c1", (2, SIDE, SIDE), spike_generator())
    net.population(
        "s2", (MAPS, "auto", "auto"), iaf_psc_delta(tau_m=INF, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=threshold)
    )
    weight = neuro.normal(mean=0.6, std=0.1, low=0.0, high=1.0)
    net.connect("c1", "s2", grid(kernel=(FIELD, FIELD)), rule, weight=weight, delay=1.0, name="w")
    net.group("choice", group)
    net.trials(input="c1", duration=float(TICKS), **({"stop": "full"} | words))
    return net


def frames(n: int, seed: int, spikes: int = 50) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    ids = np.concatenate([rng.permutation(2 * SIDE * SIDE)[:spikes] for _ in range(n)])
    return rng.integers(0, TICKS, n * spikes).astype(float), ids, np.arange(n + 1) * spikes


def prototype(w: Any, times: Any, ids: Any, radius: int, per_map: int) -> tuple[list[tuple[int, int]], Any, Any]:
    """One frame: who won and when, V_m of each map at its own decision or the end, and which inputs came before."""
    arrival = np.full((2, SIDE, SIDE), INF)
    arrival.ravel()[ids] = times + 1.0
    under = np.lib.stride_tricks.sliding_window_view(arrival, (FIELD, FIELD), axis=(1, 2))
    wins: list[tuple[int, int]] = []
    silent, count, decided = np.zeros((MAPS, PLACES, PLACES), bool), np.zeros(MAPS, int), np.zeros(MAPS)
    v = np.zeros((MAPS, PLACES, PLACES))
    for tick in range(TICKS):
        v = v + np.einsum("mcij,crsij->mrs", w, under == tick)
        at_tick = v.copy()
        while True:
            able = np.where(silent | (at_tick < THRESHOLD), -INF, at_tick)
            m, r, c = np.unravel_index(able.argmax(), v.shape)
            if able[m, r, c] == -INF:
                break
            wins.append((int(np.ravel_multi_index((m, r, c), v.shape)), tick))
            decided[m] = at_tick[m].max() if count[m] == 0 else decided[m]
            count[m] += 1
            v[m, r, c] = 0.0
            silent[:, max(0, r - radius) : r + radius + 1, max(0, c - radius) : c + radius + 1] = True
            silent[m] |= count[m] == per_map
    return wins, np.where(count > 0, decided, v.max(axis=(1, 2))), under


@pytest.mark.parametrize("backend", BACKENDS[:2])
@pytest.mark.parametrize(("radius", "per_map"), [(2, 1), (1, 2), (0, 0)])
def test_a_plain_prototype_wins_and_learns_the_same(backend: str, radius: int, per_map: int):
    """30 frames of Masquelier and Thorpe's rule, whose rates are doubled after 10 and after 20."""
    rule = neuro.first_spike_stdp(A_plus=2**-6, A_minus=-0.75 * 2**-6)
    sim = neuro.compile(sheet(local_winners(of="s2", radius=radius, per_map=per_map or None), rule), backend, seed=2)
    w, rate, several = sim.weights("w").copy(), 2**-6, 0
    for epoch in range(3):
        times, ids, offsets = frames(10, seed=epoch)
        results = sim.trials(times, ids, offsets, learn=True)
        for i in range(10):
            here = slice(offsets[i], offsets[i + 1])
            wins, potential, under = prototype(w, times[here], ids[here], radius, per_map)
            found = slice(results.wins.offsets[i], results.wins.offsets[i + 1])
            assert list(zip(results.wins.neurons[found], results.wins.steps[found], strict=True)) == wins
            assert results.potential[i] == pytest.approx(potential, abs=1e-12)
            assert (results.winner[i], results.step[i]) == wins[0]
            for neuron, tick in wins:
                m, r, c = np.unravel_index(neuron, (MAPS, PLACES, PLACES))
                a = np.where(under[:, r, c] <= tick, rate, -0.75 * rate)
                w[m] += a * w[m] * (1.0 - w[m])
            several += len(wins) > 1
        rate *= 2.0
        sim.set("w", A_plus=rate, A_minus=-0.75 * rate)
    assert sim.weights("w") == pytest.approx(w, abs=1e-12)
    assert several > 25


def test_with_a_threshold_out_of_reach_the_potential_is_that_of_the_end():
    """How C2 is read: nobody wins, and without leak V_m at the end is the largest of the trial."""
    sim = neuro.compile(sheet(local_winners(of="s2", radius=2, per_map=1)), "event", seed=2)
    times, ids, offsets = frames(4, seed=1)
    sim.set("s2", V_th=1e6)
    results = sim.trials(times, ids, offsets)
    for i in range(4):
        came = np.zeros((2, SIDE, SIDE))
        here = slice(offsets[i], offsets[i + 1])
        came.ravel()[ids[here][times[here] < TICKS - 1]] = 1.0
        under = np.lib.stride_tricks.sliding_window_view(came, (FIELD, FIELD), axis=(1, 2))
        total = np.einsum("mcij,crsij->mrs", sim.weights("w"), under)
        assert results.potential[i] == pytest.approx(total.max(axis=(1, 2)), abs=1e-12)
    assert len(results.wins.neurons) == 0


@settings(max_examples=14, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    radius=st.integers(0, 4),
    per_map=st.sampled_from([None, 1, 2, 5]),
    stop=st.sampled_from(["full", "at_decision"]),
    rule=st.sampled_from([all_to_all(), grid(kernel=(4, 4)), grid(kernel=(2, 2), stride=2)]),
    synapse=st.sampled_from([r_stdp(epsilon=0.01), r_stdp(rescue=True), mozafari(Ar_plus=0.1)]),
    dropped=st.sampled_from([0.0, 0.4]),
    seed=st.integers(0, 5),
)
def test_event_equals_reference(radius, per_map, stop, rule, synapse, dropped, seed):
    words = {"labels": {"of": "maps", "maps_per_label": 2}, "dropout": {"of": "maps", "p": dropped}, "stop": stop}
    net = sheets({"radius": radius, "per_map": per_map}, synapse, rule, **words)
    rng = np.random.default_rng(seed)
    ids, times = np.concatenate([rng.permutation(72)[:40] for _ in range(6)]), rng.integers(0, 12, 240).astype(float)
    found = []
    for backend in ("reference", "event"):
        sim = neuro.compile(net, backend, seed=seed)
        learnt = trial_results(sim.trials(times, ids, np.arange(7) * 40, np.arange(6) % 3, learn=True))
        sim.run(5.0 if stop == "full" else 0.0)
        found.append(learnt | observe(sim))
    assert differences(*found, exact=False) == []


def row(rule: Any, weights: Any, backend: str = "reference", **group: Any) -> Simulation:
    """Three inputs onto two maps of one row and three places, which stand for two labels; threshold 0.8."""
    net = Network("row", resolution=1.0)
    net.population("input", 3, spike_generator())
    net.population("maps", (2, 1, 3), iaf_psc_delta(tau_m=INF, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=0.8))
    net.connect("input", "maps", all_to_all(), rule, weight=np.array(weights, float), delay=1.0, name="w")
    net.group("choice", local_winners(of="maps", **group))
    net.trials(input="input", duration=10.0, labels={"of": "maps"})
    return neuro.compile(net, backend)


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_each_winner_is_rewarded_by_its_own_label(backend: str):
    """Place 0 of map 0 wins first, place 2 of map 1 later; place 1 of map 1 is silenced by the first."""
    weights = [[0.9, 0, 0, 0.5, 0.88, 0], [0.5, 0, 0, 0, 0, 0.85], [0, 0, 0.7, 0, 0, 0]]
    rule = mozafari(Ar_plus=0.1, Ar_minus=-0.05, Ap_plus=0.02, Ap_minus=-0.04)
    sim = row(rule, weights, backend, radius=1)
    told = sim.trials([0.0, 3.0], [0, 1], [0, 2], labels=[0], learn=True)
    assert (told.wins.neurons.tolist(), told.wins.steps.tolist(), told.wins.offsets.tolist()) == (
        [0, 5],
        [1, 4],
        [0, 2],
    )
    assert (told.winner.tolist(), told.label.tolist(), told.step.tolist(), told.ticks.tolist()) == ([0], [0], [1], [5])
    assert told.potential.tolist() == [[0.9, 0.88]]
    w = np.array(weights)
    w[0, 0] += 0.1 * 0.9 * (1 - 0.9)
    w[1, 0] += -0.05 * 0.5 * (1 - 0.5)
    w[1, 5] += -0.04 * 0.85 * (1 - 0.85)
    assert sim.weights("w")[2].reshape(3, 6) == pytest.approx(w, abs=1e-15)
    assert told.counts.learning_updates == 6


def test_of_one_step_the_larger_margin_wins_first():
    sim = row(neuro.static(), [[0.81, 0.9, 0.82, 0, 0, 0]] + [[0.0] * 6] * 2, radius=1)
    assert sim.trials([0.0], [0], [0, 1]).wins.neurons.tolist() == [1]


def test_wins_of_a_group_with_one_winner_are_its_decisions():
    net = sheet(neuro.winner_take_all(of="s2"))
    results = neuro.compile(net, "event", seed=2).trials(*frames(8, seed=1, spikes=27))
    decided = results.winner >= 0
    assert 0 < decided.sum() < 8
    assert results.wins.neurons.tolist() == results.winner[decided].tolist()
    assert results.wins.steps.tolist() == results.step[decided].tolist()
    assert np.diff(results.wins.offsets).tolist() == decided.astype(int).tolist()


def test_an_empty_batch():
    results = neuro.compile(sheet(local_winners(of="s2", radius=1)), "reference").trials([], [], [0])
    assert (results.wins.neurons.tolist(), results.wins.offsets.tolist()) == ([], [0])


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.program.backend.OverflowWarning")
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_saved_state_keeps_who_is_silenced(backend: str, tmp_path):
    net = Network("noisy", resolution=1.0)
    net.population("noise", 60, neuro.poisson_generator(rate=60.0))
    net.population("cells", (3, 4, 5), iaf_psc_delta(tau_m=INF, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=3.0))
    net.connect("noise", "cells", neuro.one_to_one(), weight=1.0)
    net.group("choice", local_winners(of="cells", radius=1, per_map=2))
    whole, again = (neuro.compile(net, backend, seed=4) for _ in range(2))
    whole.run(20.0)
    before = len(whole.spikes("cells")[0])
    whole.save(tmp_path / "state.h5")
    whole.run(100.0)
    again.restore(tmp_path / "state.h5")
    again.run(100.0)
    assert 0 < before < len(whole.spikes("cells")[0])
    assert differences(observe(whole), observe(again), exact=True) == []


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_who_was_left_out_of_a_trial_may_fire_after_it(backend: str):
    """All maps are dropped in a trial without input; its inputs then drive them from outside."""
    net = sheet(neuro.winner_take_all(of="s2"), neuro.first_spike_stdp(), dropout={"of": "s2", "p": 0.999})
    sim = neuro.compile(net, backend, seed=1)
    assert sim.trials([], [], [0, 0], learn=True).winner.tolist() == [-1]
    sim.inject("c1", times=np.full(128, sim.time + 1.0), ids=np.arange(128))
    sim.run(5.0)
    assert len(sim.spikes("s2")[0]) == 1


@pytest.mark.parametrize("backend", BACKENDS[:2])
def test_a_trial_opens_all_groups(backend: str):
    net = sheet(local_winners(of="s2", radius=1, per_map=1))
    net.population("more", (1, 2, 2), iaf_psc_delta(tau_m=INF, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0))
    net.population("one", 2, iaf_psc_delta(tau_m=INF, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0))
    net.connect("c1", "more", all_to_all(), weight=0.2)
    net.connect("c1", "one", all_to_all(), weight=0.2)
    net.group("others", local_winners(of="more", radius=0, per_map=1))
    net.group("single", neuro.winner_take_all(of="one"))
    net.trials_section = neuro.Trials(input="c1", duration=20.0, stop="full", labels=neuro.labels(of="s2"))
    sim = neuro.compile(net, backend, seed=1)
    sim.trials(*frames(3, seed=1))
    assert [len(sim.spikes(name)[0]) for name in ("more", "one")] == [3, 3]


def test_it_is_written_and_read(tmp_path):
    net = sheet(local_winners(of="s2", radius=3, per_map=1))
    net.save(tmp_path / "net.yaml")
    assert neuro.load(tmp_path / "net.yaml") == net
    assert "choice: {local_winners: {of: s2, radius: 3, per_map: 1}}" in (tmp_path / "net.yaml").read_text()


def _flat(group: local_winners) -> Network:
    net = Network("flat", resolution=1.0)
    net.population("maps", (2, 4), iaf_psc_delta())
    net.group("choice", group)
    return net


def test_mistakes(messages):
    messages.calls(globals())
