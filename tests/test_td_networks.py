"""Networks that learn by temporal-difference errors: a critic on a track, an actor and a critic in a grid."""

import numpy as np
import pytest

import neuro
from neuro.testing import observe
from neuro.testing.case import differences
from neuro_models import grid_world, linear_track
from refusals import refused


def relative_rms(values):
    expected = linear_track.expected()[1]
    return float(np.sqrt(np.mean((values - expected) ** 2) / np.mean(expected**2)))


def runs(seed, n, backend="event", **words):
    sim = neuro.compile(linear_track.network(**words), backend, seed=seed)
    runner = linear_track.Runner(sim)
    return sim, np.array([runner.run() for _ in range(n)])


def test_the_value_on_a_track_becomes_the_discounted_reward():
    """10 neurons, 40 runs; benchmarks/test_learnt.py has 20 neurons, 100 runs and many seeds."""
    _, values = runs(31, 40, critics=10)
    assert relative_rms(values[0]) > 0.5
    late = values[-20:].mean(axis=0)
    assert relative_rms(late) <= 0.1
    assert np.corrcoef(late, linear_track.expected()[1])[0, 1] > 0.95


def test_what_is_expected_leaves_no_error():
    times, expected = linear_track.expected()
    assert (times[0], times[-1], expected[-1]) == (linear_track.EVERY, linear_track.DURATION, linear_track.REWARD)
    errors = neuro.td_error_rate(0.0, expected, np.gradient(expected, times), linear_track.TAU_R)
    assert errors[1:-1] == pytest.approx(0.0, abs=1e-6)


def test_moves_in_a_grid_are_those_of_the_reference():
    found = []
    for backend in ("reference", "event"):
        sim = neuro.compile(grid_world.network(side=2), backend, seed=4)
        agent = grid_world.Agent(sim, grid_world.World(side=2), seed=4)
        moves = agent.episode(limit=4)
        assert np.ptp(sim.weights("policy")[2]) > 0.0
        found.append(observe(sim) | {"moves": moves, "values": agent.values})
    assert not differences(*found, exact=False)


def test_a_random_walk_takes_as_long_as_the_world_says():
    """The mean number of moves from each place solves a linear system; the start needs 106.82."""
    world = grid_world.World()
    places = [(y, x) for y in range(world.side) for x in range(world.side)][:-1]
    chances = np.zeros((len(places), len(places)))
    for i, place in enumerate(places):
        for action in range(4):
            there, reward, ends = world.step(place, action)
            assert reward == (60.0 if ends else -5.0 if there == place else 0.0)
            if not ends:
                chances[i, places.index(there)] += 0.25
    moves = np.linalg.solve(np.eye(len(places)) - chances, np.ones(len(places)))
    assert moves[0] == pytest.approx(106.82, abs=0.005)


def test_the_way_through_a_grid_is_learnt():
    """A small one, of which a random walk needs 29 moves; benchmarks/test_learnt.py has 5 x 5 places."""
    sim = neuro.compile(grid_world.network(side=3), seed=31)
    agent = grid_world.Agent(sim, grid_world.World(side=3), seed=31)
    assert np.median([agent.episode() for _ in range(30)][-10:]) <= 5.0
    assert max(agent.values[2, 1], agent.values[1, 2]) > 30.0  # beside the goal, where 60 are expected
    assert np.isnan(agent.values[2, 2])


def test_a_grid_has_a_side():
    assert "grid_world: side = 1: expected at least 2" in refused(lambda: grid_world.network(side=1))
