"""Populations of a chip that rest until input comes: the bits of those that are updated in every step."""

import numpy as np
import pytest

import neuro

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
