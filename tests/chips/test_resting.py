"""Populations of a chip that rest until input comes: the bits of those that are updated in every step."""

import numpy as np
import pytest

import neuro
from neuro_chip import deliver

STEPS = 900

CELLS = {
    "exp": neuro.iaf_psc_exp(tau_m=10.0, tau_syn_ex=2.0, tau_syn_in=2.0, t_ref=2.0),
    "delta": neuro.iaf_psc_delta(tau_m=10.0, t_ref=2.0),
    "no leak": neuro.iaf_psc_delta(tau_m=float("inf"), t_ref=2.0),
    "held below threshold": neuro.iaf_psc_delta(tau_m=10.0, I_e=200.0),
    "driven": neuro.iaf_psc_delta(tau_m=10.0, I_e=500.0),
}


def net(cell: neuro.iaf_psc_exp | neuro.iaf_psc_delta) -> neuro.Network:
    """Two bursts of spikes into ten neurons, far apart; a chain behind them has a synapse that is late."""
    rng = np.random.default_rng(4)
    times, ids = np.concatenate([rng.integers(5, 20, 60), rng.integers(500, 520, 60)]), rng.integers(0, 8, 120)
    net = neuro.Network("resting", resolution=1.0)
    net.population("input", 8, neuro.spike_train(spikes=np.column_stack((times, ids))[np.argsort(times)]))
    net.population("cells", 10, cell)
    net.population("late", 3, cell)
    unit = 2.0 if isinstance(cell, neuro.iaf_psc_delta) else 300.0
    net.connect("input", "cells", neuro.all_to_all(), weight=rng.uniform(0.2 * unit, unit, 80), delay=1.0)
    net.connect("cells", "late", neuro.fixed_indegree(4), weight=3.0 * unit, delay=7.0)
    return net


def told(sim: neuro.Simulation) -> list[np.ndarray]:
    counts = sim.counts()
    found = [np.array([counts.populations[name].neuron_updates_active for name in ("cells", "late")])]
    found.append(np.array(sorted(counts.native.items())))
    for name in ("cells", "late"):
        found += [*sim.spikes(name), sim.get(name, "V_m")]
    return found


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
@pytest.mark.parametrize("cell", CELLS)
def test_who_rests_is_as_if_updated(backend, cell):
    """A run of one step updates everybody, since the host may have written anything before it."""
    at_once, by_step = (neuro.compile(net(CELLS[cell]), backend=backend, seed=1) for _ in range(2))
    at_once.run(float(STEPS))
    for _ in range(STEPS):
        by_step.run(1.0)
    assert all(np.array_equal(one, other) for one, other in zip(told(at_once), told(by_step), strict=True))
    rested = at_once._engine._machine.arrays["resting"]
    assert (rested[1:] == (cell != "driven")).all()
    if cell != "driven":
        assert at_once.spikes("late")[0].size > 3


SIGNS = {"both": (-60.0, 90.0), "excitatory": (5.0, 90.0), "inhibitory": (-90.0, -5.0)}


def grids(depth: int, stride: int, signs: str) -> neuro.Network:
    """Noise in two channels onto eight maps, of which a channel reaches all or half."""
    rng = np.random.default_rng(3)
    net = neuro.Network("grids", resolution=1.0)
    net.population("noise", (2, 9, 8), neuro.poisson_generator(rate=60.0))
    net.population("maps", (8, "auto", "auto"), neuro.iaf_psc_exp(tau_syn_ex=3.0, tau_syn_in=3.0, I_e=300.0))
    low, high = SIGNS[signs]
    weight = rng.uniform(low, high, (8, depth, 4, 3))
    grid = neuro.grid(kernel=(4, 3), stride=stride, depthwise=depth == 1)
    net.connect("noise", "maps", grid, weight=weight, delay=2.0, name="see")
    return net


def ran(net: neuro.Network, backend: str) -> dict[str, np.ndarray]:
    sim = neuro.compile(net, backend=backend, seed=2)
    sim.run(60.0)
    sim.set_weights("see", sim.weights("see")[::-1])
    sim.run(60.0)
    times, ids = sim.spikes("maps")
    counts = sim.counts().populations["maps"].neuron_updates_active
    return {"times": times, "ids": ids, "V_m": sim.get("maps", "V_m"), "active": np.array(counts)}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
@pytest.mark.parametrize(
    ("depth", "stride", "signs"), [(2, 1, "both"), (2, 2, "excitatory"), (1, 1, "inhibitory"), (1, 1, "both")]
)
def test_gathered_spikes_are_those_sent_one_by_one(backend, signs, depth, stride, monkeypatch):
    gathered = ran(grids(depth, stride, signs), backend)
    monkeypatch.setattr(deliver, "FEWEST", 1 << 30)
    alone = ran(grids(depth, stride, signs), backend)
    assert gathered["active"] > 0
    if signs != "inhibitory":
        assert gathered["ids"].size > 100
    assert all(np.array_equal(gathered[name], alone[name]) for name in gathered)


def learn(depth: int, stride: int, backend: str) -> list[np.ndarray]:
    """Trials that teach a grid, a weight here and there, and let maps grow."""
    net = neuro.Network("taught", resolution=1.0)
    net.population("input", (2, 9, 8), neuro.spike_generator())
    net.population("maps", (8, "auto", "auto"), neuro.iaf_psc_delta(tau_m=float("inf"), E_L=0.0, V_reset=0.0, V_th=4.0))
    grid = neuro.grid(kernel=(4, 3), stride=stride, depthwise=depth == 1)
    rule = neuro.r_stdp(epsilon=0.02)
    net.connect("input", "maps", grid, rule, weight=neuro.normal(mean=0.6, std=0.1), delay=1.0, name="see")
    net.group("choice", neuro.winner_take_all(of="maps"))
    labels = neuro.labels(of="maps", maps_per_label=2)
    net.trials(input="input", duration=20.0, labels=labels, reward=neuro.reward())
    rng, trials, spikes = np.random.default_rng(5), 40, 90
    ids = np.concatenate([rng.choice(144, spikes, replace=False) for _ in range(trials)])
    sim = neuro.compile(net, backend=backend, seed=3)
    before = sim.weights("see")
    times, offsets = rng.integers(0, 20, trials * spikes).astype(float), np.arange(trials + 1) * spikes
    found = sim.trials(times, ids, offsets, rng.integers(0, 4, trials), learn=True)
    weights = sim.weights("see")
    assert np.mean(weights != before) > 0.9
    return [found.winner, found.step, found.potential, weights]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
@pytest.mark.parametrize(("depth", "stride"), [(2, 1), (2, 3), (1, 1)])
def test_what_is_taught_is_sent_by_either_way(backend, depth, stride, monkeypatch):
    gathered = learn(depth, stride, backend)
    monkeypatch.setattr(deliver, "FEWEST", 1 << 30)
    alone = learn(depth, stride, backend)
    assert np.unique(gathered[0]).size > 3
    assert all(np.array_equal(one, other) for one, other in zip(gathered, alone, strict=True))
