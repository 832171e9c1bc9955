"""Rules under a temporal-difference error, `td_ltp` beside its integrals and `td_moves` by hand, and their networks."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import neuro
import neuro_models
from neuro.coding import world_teachers as teachers
from neuro.testing import check_part, observe
from neuro.testing.case import differences
from neuro_models.worlds import Grid, Track, values

BACKENDS = pytest.mark.parametrize("backend", ["reference", "event"])
PRE, POST = (5.0, 12.0, 16.0, 30.0), (14.0, 20.0, 40.0)  # ms
START = 50.0


@pytest.mark.parametrize(
    "rule",
    [neuro.td_ltp(eta=20.0, Wmax=300.0), neuro.td_moves(move=4.0, eta=5.0, Wmin=-20.0, Wmax=300.0)],
    ids=lambda rule: rule.name,
)
def test_a_rule_on_event_and_reference(rule):
    check_part(rule, ms=10.0)


def one_synapse(rule, backend):
    """Spikes of a source at PRE, of its target at POST; they reach the synapse 1 ms later."""
    net = neuro.Network("one", resolution=0.5)
    net.population("pre", 1, neuro.spike_generator(spike_times=[list(PRE)]))
    net.population("driver", 1, neuro.spike_generator(spike_times=[[t - 1.0 for t in POST]]))
    net.population("post", 1, neuro.iaf_psc_delta(V_th=500.0, t_ref=0.5))
    net.signal("error", to="post")
    net.connect("driver", "post", neuro.all_to_all(), weight=1000.0, delay=1.0)
    net.connect("pre", "post", neuro.all_to_all(), rule, weight=START, delay=1.0, name="learnt")
    return neuro.compile(net, backend)


def psp(passed, tau_m, tau_s):
    """The potential that a pre spike has made after some ms."""
    return (math.exp(-passed / tau_m) - math.exp(-passed / tau_s)) * (passed > 0.0)


@BACKENDS
def test_a_weight_moves_along_the_smoothed_potential_since_the_last_spike(backend):
    sim = one_synapse(neuro.td_ltp(signal="error", eta=3.0), backend)
    sim.run(25.0)
    assert sim.get("learnt", "weight") == START  # no error yet
    sim.signal("error", 0.4)
    sim.run(60.0)
    times = np.arange(0.0, 85.0, 1e-3) + 0.5e-3
    z, since = np.zeros_like(times), -math.inf
    for post in POST:
        heard = post + 1.0
        eps = sum(psp(heard - pre, 20.0, 5.0) for pre in PRE if since <= pre < heard)
        late = np.maximum(times - heard, 0.0)
        z += eps * (np.exp(-late / 200.0) - np.exp(-late / 50.0)) / 150.0
        since = heard
    assert sim.get("learnt", "z") == pytest.approx(z[-1], rel=1e-5)
    moved = 3.0 * 0.4 * z[times > 25.0].sum() * 1e-3
    assert sim.get("learnt", "weight") == pytest.approx(START + moved, rel=1e-9)


@BACKENDS
def test_a_move_is_taught_in_the_second_after_it(backend):
    sim = one_synapse(neuro.td_moves(signal="error", move=20.0, eta=0.5), backend)
    first = sum(psp(15.0 - pre, 10.0, 2.0) for pre in PRE)
    second = sum(psp(21.0 - pre, 10.0, 2.0) for pre in PRE)
    sim.run(20.0)
    assert sim.get("learnt", "e") == pytest.approx(first)
    sim.signal("error", 1e9)  # nobody hears it: the move before the last was none
    sim.run(20.0)
    assert [sim.get("learnt", name)[0] for name in ("e", "e_last")] == pytest.approx([second, first])
    assert sim.get("learnt", "weight") == START
    sim.signal("error", 0.7)
    sim.run(10.0)
    assert sim.get("learnt", "weight") == pytest.approx(START + 0.5 * 0.7 * first / 2.0)
    sim.run(10.0)
    sim.signal("error", -0.2)
    sim.run(20.0)
    assert sim.get("learnt", "weight") == pytest.approx(START + 0.5 * (0.7 * first - 0.2 * second))


@BACKENDS
@pytest.mark.parametrize(
    "rule", [neuro.td_ltp(signal="error", Wmin=30.0), neuro.td_moves(signal="error", move=20.0, Wmin=30.0)]
)
def test_a_weight_stays_within_its_bounds(backend, rule):
    sim = one_synapse(rule, backend)
    for error, bound in ((1e6, 100.0), (-1e6, 30.0)):
        sim.signal("error", error)
        sim.run(60.0)
        assert sim.get("learnt", "weight") == bound
        sim.reset()


def test_numbers_that_contradict_each_other(messages):
    messages.calls(globals())


# networks: a critic on a track, an actor and a critic in a grid


def relative_rms(value):
    expected = Track.expected()
    return float(np.sqrt(np.mean((value - expected) ** 2) / np.mean(expected**2)))


def test_the_value_on_a_track_becomes_the_discounted_reward():
    """10 neurons, 70 runs; benchmarks/test_learnt.py has 20 neurons, 100 runs and many seeds."""
    net = neuro.load(neuro_models.path("linear_track"), {"critics": 10})
    loop = neuro.closed_loop(net, seed=31, record=True)
    loop.run(episodes=70)
    runs = values(loop)
    assert relative_rms(runs[0]) > 0.5
    late = runs[-20:].mean(axis=0)
    assert relative_rms(late) <= 0.15
    assert np.corrcoef(late, Track.expected())[0, 1] > 0.95


def test_what_is_expected_leaves_no_error():
    expected, discount = Track.expected(), 0.995
    assert expected[-1] == 100.0
    assert discount * expected[1:] == pytest.approx(expected[:-1], rel=1e-4)


def test_moves_in_a_grid_are_those_of_the_reference():
    net, found = neuro.load(neuro_models.path("grid_world"), {"side": 2}), []
    for backend in ("reference", "event"):
        loop = neuro.closed_loop(net, backend=backend, seed=4, record=True)
        loop.run(steps=5)
        assert np.ptp(loop.sim.weights("policy")[2]) > 0.0
        found.append(observe(loop.sim) | loop.recorded())
    assert not differences(*found, exact=False)


def test_a_random_walk_takes_as_long_as_the_world_says():
    """The mean number of moves from each place solves a linear system; the start needs 106.82."""
    world = Grid()
    last = world.side**2 - 1
    chances = np.zeros((last, last))
    for place in range(last):
        for action in range(4):
            world.place = place
            there, reward, ends, _, _ = world.step(action)
            assert reward == (1.0 if ends else -0.1 if there == place else 0.0)
            if not ends:
                chances[place, there] += 0.25
    moves = np.linalg.solve(np.eye(last) - chances, np.ones(last))
    assert moves[0] == pytest.approx(106.82, abs=0.005)


def test_the_way_through_a_grid_is_learnt():
    """A small one, of which a random walk needs 29 moves; benchmarks/test_learnt.py has 5 x 5 places."""
    loop = neuro.closed_loop(neuro.load(neuro_models.path("grid_world"), {"side": 3}), seed=31)
    assert np.median(loop.run(episodes=30).lengths[-10:]) <= 5.0
    worth = loop.sim.weights("value")[2].reshape(9, -1).mean(axis=1)
    assert max(worth[5], worth[7]) > worth[0]  # beside the goal, and at the start


@pytest.mark.parametrize(("food", "beside"), [(10.0, True), (0.0, False)])
def test_dopaminergic_neurons_teach_the_value_of_the_places_beside_the_goal(food, beside):
    """Without food no place gets a value, so the weights come from the network's own dopamine."""
    net = neuro.load(neuro_models.path("grid_loop"), {"reward_drive": food})
    loop = neuro.closed_loop(net, seed=31)
    loop.run(steps=300)
    assert net.world_section.reward is None
    assert np.ptp(loop.sim.weights("policy")[2]) > 0.0
    worth = loop.sim.weights("value")[2].reshape(24, -1).mean(axis=1)
    assert (max(worth[19], worth[23]) > 40.0 > worth[0]) == beside


@pytest.mark.parametrize(
    ("teacher", "late"), [(teachers.same(as_="critic_error", others=-0.5), 1), (teachers.reward(others=-0.5), 0)]
)
def test_neurons_that_voted_otherwise_hear_a_share(teacher, late):
    """The error tells of the action before the last one, the reward of the last one."""
    net = neuro.load(neuro_models.path("grid_world"))
    world = net.world_section
    net.world_section = replace(world, reward={**world.reward, "actor_error": teacher})
    loop = neuro.closed_loop(net, seed=1, record=True)
    heard, copies = [], loop.pilot.copies
    port_of = copies.port

    def port(name, *what):
        """The port of a signal, which also keeps what is set."""
        made = port_of(name, *what)
        return SimpleNamespace(set=lambda values: (heard.append((name, values)), made.set(values)), get=made.get)

    copies.port = port
    loop.run(steps=20)
    actions = np.array(loop.actions).ravel()
    values = [each[0] for name, each in heard if name == "actor_error"]
    assert np.count_nonzero(values)
    for k, value in enumerate(values[1:], start=1):
        taken = np.repeat(np.arange(4) == actions[k - late], 5)
        assert value == pytest.approx(value[taken][0] * np.where(taken, 1.0, -0.5))
