"""Learning by temporal-difference errors, over many seeds: the value on a track, and the way through a grid."""

import time

import numpy as np

import neuro
from neuro_models import grid_world, linear_track

SEEDS = range(100, 120)  # none of them served to choose a number
RUNS, EPISODES, LAST = 100, 150, 50


def test_the_value_on_a_track(figure):
    expected = linear_track.expected()[1]
    found, took = [], []
    for seed in SEEDS:
        runner = linear_track.Runner(neuro.compile(linear_track.network(), seed=seed))
        began = time.perf_counter()
        value = np.mean([runner.run() for _ in range(RUNS)][-20:], axis=0)
        took.append(time.perf_counter() - began)
        rms = np.sqrt(np.mean((value - expected) ** 2) / np.mean(expected**2))
        found.append((rms, np.corrcoef(value, expected)[0, 1]))
    rms, correlation = np.array(found).T
    figure("critic: relative rms, median", float(np.median(rms)), "", "at most 0.1")
    figure("critic: relative rms, largest", float(rms.max()), "", "at most 0.1")
    figure("critic: correlation, median", float(np.median(correlation)), "", "about 0.986")
    figure(f"critic: {RUNS} runs", min(took), "s", "reported")


def late_moves(seed, critic):
    """The median of moves in the last episodes."""
    agent = grid_world.Agent(neuro.compile(grid_world.network(), seed=seed), grid_world.World(), seed, critic=critic)
    return float(np.median([agent.episode() for _ in range(EPISODES)][-LAST:]))


def test_the_way_through_a_grid(figure):
    for critic, told, aim in ((True, "with a critic", "at most 10"), (False, "without", "at least 14")):
        took, found = [], []
        for seed in SEEDS:
            began = time.perf_counter()
            found.append(late_moves(seed, critic))
            took.append(time.perf_counter() - began)
        for what, value in zip(("least", "median", "most"), np.quantile(found, (0.0, 0.5, 1.0)), strict=True):
            figure(f"grid {told}: moves, {what} of {len(SEEDS)} seeds", float(value), "", aim)
        figure(f"grid {told}: {EPISODES} episodes", min(took), "s", "reported")
