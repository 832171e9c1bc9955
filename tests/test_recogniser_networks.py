"""The networks of Masquelier and Thorpe, Mozafari and MuST, over made-up spikes of a front end."""

from typing import Any

import numpy as np
import pytest

import neuro
import neuro_models
from neuro.run.simulation import Simulation

SHEET = (4, 17, 17)


def started(name: str, **params: Any) -> Simulation:
    return neuro.compile(neuro.load(neuro_models.path(name), params), seed=1)


def bars(n: int, seed: int, most: int | None = None) -> tuple[Any, Any, Any, Any]:
    """Frames of two classes: what is lit early is a vertical or a horizontal bar, the rest comes late."""
    rng = np.random.default_rng(seed)
    times, ids, labels = [], [], np.arange(n) % 2
    for label in labels:
        early = np.zeros(SHEET, bool)
        early[2 * label, *((slice(None), slice(6, 11)) if label == 0 else (slice(6, 11), slice(None)))] = True
        some = rng.permutation(early.size)[:300]
        when = np.where(early.ravel()[some], rng.integers(0, 12, 300), rng.integers(20, 60, 300))
        more = np.setdiff1d(np.flatnonzero(early), some)
        some, when = np.append(some, more), np.append(when, rng.integers(0, 12, len(more)))
        order = np.argsort(when, kind="stable")[:most]
        times.append(when[order].astype(float))
        ids.append(some[order])
    return np.concatenate(times), np.concatenate(ids), np.cumsum([0, *map(len, ids)]), labels


def test_masquelier_and_thorpe_tell_bars_apart_by_v_at_the_end():
    sim, rate = started("masquelier_thorpe", maps=8, theta=40.0), 2**-6
    for epoch in range(5):
        told = sim.trials(*bars(40, seed=epoch)[:3], learn=True)
        assert told.wins.offsets[-1] >= 40
        sim.set("c1_s2", A_plus=rate, A_minus=-0.75 * rate)
        rate = min(2 * rate, 0.25)
    for i in range(40):
        maps, places = np.divmod(told.wins.neurons[told.wins.offsets[i] : told.wins.offsets[i + 1]], 49)
        rows, columns = np.divmod(places, 7)
        assert len(set(maps.tolist())) == len(maps)
        apart = np.maximum(abs(rows[:, None] - rows), abs(columns[:, None] - columns))
        assert np.all(apart[~np.eye(len(maps), dtype=bool)] > 5)
    sim.set("s2", V_th=1e6)
    c2, labels = [sim.trials(*bars(40, seed=seed)[:3]).potential for seed in (10, 11)], np.arange(40) % 2
    means = np.stack([c2[0][labels == label].mean(axis=0) for label in (0, 1)])
    assert np.mean(((c2[1][:, None] - means) ** 2).sum(axis=2).argmin(axis=1) == labels) == 1.0


def test_must_keeps_thresholds_from_trial_to_trial_and_the_sum_of_weights():
    sim, wins, n = started("must", neurons=20), np.zeros(20), 30
    theta = np.zeros(20)
    for i in range(n):
        *batch, _ = bars(1, seed=i, most=150)
        told = sim.trials(*batch, learn=True)
        assert told.winner[0] >= 0
        wins[told.winner[0]] += 1
        theta *= np.exp(-64.0 / 63968.0)
        theta[told.winner[0]] += 5.0 * np.exp(-(63.0 - told.step[0]) / 63968.0)
    assert sim.get("excited", "theta") == pytest.approx(theta, abs=1e-9)
    assert wins.max() < n / 4  # without homeostasis the first two take nearly all
    assert sim.weights("c1_excited")[2].reshape(-1, 20).sum(axis=0)[wins > 0] == pytest.approx(300.0, abs=1e-9)
    sim.set("excited", theta_plus=0.0, tau_theta=1e18)
    before = sim.get("excited", "theta").copy()
    sim.trials(*bars(4, seed=50, most=150)[:3])
    assert np.array_equal(sim.get("excited", "theta"), before)
