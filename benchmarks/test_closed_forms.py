"""Figures of models, rules and codes beside known results: the experiments of the tests at full length."""

import numpy as np
from scipy.stats import skellam

import neuro
from closed_forms import (
    NOISY,
    drift_of_inhibition,
    drifted,
    escapes,
    expected_lesson,
    expected_triplets,
    held_rate,
    lessons,
    settled,
    triplets,
)
from neuro.coding import first_to_fire, highest_rate, poisson
from neuro_models import motion


def test_adaptive_thresholds(figure):
    for current in (20.0, 30.0, 60.0):
        expected = 1000.0 * settled(current) / (0.05 * 1e4)
        figure(f"adaptive threshold at {current:g} pA: rate", held_rate(current, 600.0), "Hz", f"{expected:.3f}")


def test_escape(figure):
    n, ms, h = 2000, 5000.0, 0.1
    p = 1.0 - np.exp(-h * 1e-3 * NOISY.lambda_0 * np.exp(-1.0))
    counts = escapes(n, ms, h)
    error = np.sqrt(p * n * ms / h) / (n * ms)
    figure("escape 2 mV below threshold: rate", counts.sum() / (n * ms), "per ms", f"{p / h:.5f} +- {error:.5f}")
    figure("escape: Fano factor", counts.var() / counts.mean(), "", f"{1.0 - p:.3f} +- {np.sqrt(2.0 / n):.3f}")


def test_fixed_points(figure):
    """Compare the fixed points at small steps. On a grid of 0.2 ms few pairs have equal times, which change nothing."""
    slow = {"lambda_": 0.002}
    points = {
        "soft": (neuro.stdp(**slow), 50.0),
        "van_Rossum": (neuro.stdp(**slow, mu_plus=0.0, alpha=1.5), 100.0 / 1.5),
        "Guetig": (neuro.stdp(**slow, mu_plus=0.4, mu_minus=0.4, alpha=1.2), 100.0 / (1.0 + 1.2**2.5)),
        "power_law": (neuro.stdp_pl_hom(lambda_=0.05, alpha=0.11), (1.0 / 0.11) ** (1.0 / 0.6)),
    }
    for name, found in drifted(points, settle=200.0, reads=200, h=0.2).items():
        figure(f"fixed point, {name}", found, "", f"{points[name][1]:.2f}")
    long = {"soft": (neuro.stdp(**slow, alpha=1.1), 100.0 / 3.2)}
    found = drifted(long, settle=200.0, reads=200, h=0.2, tau_minus=40.0)["soft"]
    figure("fixed point, soft, alpha 1.1, tau_minus 40 ms", found, "", f"{long['soft'][1]:.2f}")


def test_inhibition_holds_the_rate(figure):
    for rate in (2.0, 3.0, 5.0):
        expected = 20.0 * 1e-3 * (2.0 * 0.02 * rate - 0.12)
        found = drift_of_inhibition(rate, seconds=1000.0, h=0.2)
        figure(f"vogels_sprekeler, post spikes at {rate:g} Hz: drift of |w|", found, "per s", f"{expected:.2g}")


def test_triplets(figure):
    rates = np.array([0.1, 10.0, 20.0, 40.0, 50.0])
    for rate, found, aims in zip(rates, triplets(rates), expected_triplets(rates), strict=True):
        for late, change, aim in zip(("after", "before"), found, aims, strict=True):
            figure(f"stdp_triplet, {rate:g} Hz, post 10 ms {late} pre", float(change), "", f"{aim:.4f}")


def test_lessons(figure):
    for n, theta, p in ((10, 6, 0.5), (8, 3, 0.3)):
        found, expected = lessons(n, theta, p, 200_000), expected_lesson(n, theta, p)
        told = f"{expected:.6f} +- {found.std() / np.sqrt(found.size):.2g}"
        figure(f"hedonistic: E[R c], {theta} of {n} at p = {p:g}", float(found.mean()), "", told)


def test_motion(figure):
    n = 4000
    speed, direction, times, ids = motion.drawn_edges(30, n)
    for longest, aims in ((np.inf, ("1", "0.996")), (62.0, ("1", "0.995")), (16.0, ("", ""))):
        sim = neuro.compile(motion.network(n, longest=longest))
        found = motion.shares(motion.peaks(sim, times, ids), speed, direction)
        for what, share, aim in zip(("direction", "direction and speed"), found, aims, strict=True):
            figure(f"edges, delays up to {longest:g} ms: {what}", share, "", aim)


def test_codes(figure):
    races = poisson(np.tile([60.0, 40.0], (50_000, 1)), 200.0, seed=7)
    counts = np.isfinite(races).sum(axis=2)
    right = np.mean([np.mean(highest_rate(pair) == 0) for pair in counts])
    expected = skellam.sf(0, 12, 8) + skellam.pmf(0, 12, 8) / 2
    figure("highest rate of 60 and 40 Hz in 200 ms: right", float(right), "", f"{expected:.4f}")
    first = [first_to_fire(race).tolist() == [0] for race in races]
    figure("first spike of 60 and 40 Hz: right", float(np.mean(first)), "", "0.6")
    counts = np.isfinite(poisson(np.full(50_000, 50.0), 1000.0, seed=7)).sum(axis=1)
    figure("poisson code at 50 Hz: Fano factor", counts.var() / counts.mean(), "", "1 +- 0.006")
