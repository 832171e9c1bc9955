"""Learning of networks over many seeds.

Networks learn the value of places on a track and the way through a grid, by temporal-difference errors of a program or
of neurons. Synapses with random release learn answers. Delays learn to make arrivals coincide, and to distinguish
orders of spikes.
"""

import time

import numpy as np

import neuro
import neuro_models
from neuro_models import hedonists, orders
from neuro_models.delays import BETWEEN, drawn_onsets, gathering, spread
from neuro_models.worlds import Track, values

TRACK_SEEDS = range(100, 120)  # no setting was chosen with these seeds
RUNS, EPISODES, LAST = 100, 150, 50


def test_the_value_on_a_track(figure):
    expected, net = Track.expected(), neuro.load(neuro_models.path("linear_track"))
    found, took = [], []
    for seed in TRACK_SEEDS:
        loop = neuro.closed_loop(net, seed=seed, record=True)
        began = time.perf_counter()
        loop.run(episodes=RUNS)
        value = values(loop)[-20:].mean(axis=0)
        took.append(time.perf_counter() - began)
        rms = np.sqrt(np.mean((value - expected) ** 2) / np.mean(expected**2))
        found.append((rms, np.corrcoef(value, expected)[0, 1]))
    rms, correlation = np.array(found).T
    figure("critic: relative rms, median", float(np.median(rms)), "", "at most 0.1")
    figure("critic: relative rms, largest", float(rms.max()), "", "at most 0.1")
    figure("critic: correlation, median", float(np.median(correlation)), "", "about 0.986")
    figure(f"critic: {RUNS} runs", min(took), "s", "reported")


def late_moves(seed, critic):
    """Return the median number of moves in the last episodes."""
    net = neuro.load(neuro_models.path("grid_world"), {} if critic else {"gain": 1e12})  # every value then counts as 0
    return float(np.median(neuro.closed_loop(net, seed=seed).run(episodes=EPISODES).lengths[-LAST:]))


def test_the_way_through_a_grid(figure):
    for critic, told, aim in ((True, "with a critic", "at most 10"), (False, "without", "at least 14")):
        took, found = [], []
        for seed in TRACK_SEEDS:
            began = time.perf_counter()
            found.append(late_moves(seed, critic))
            took.append(time.perf_counter() - began)
        for what, value in zip(("least", "median", "most"), np.quantile(found, (0.0, 0.5, 1.0)), strict=True):
            figure(f"grid {told}: moves, {what} of {len(TRACK_SEEDS)} seeds", float(value), "", aim)
        figure(f"grid {told}: {EPISODES} episodes", min(took), "s", "reported")


DOPAMINE_SEEDS = range(11, 21)
"""Seeds of the test. The parameters of the network were chosen with seed 1."""


def moves_by_dopamine(seed, parameters):
    """Return the most moves in 5 episodes without babbling after learning, and the late median with babbling."""
    loop = neuro.closed_loop(neuro.load(neuro_models.path("grid_loop"), parameters), seed=seed)
    babbling = loop.run(episodes=250, steps=6000).lengths[-LAST:]
    learnt = neuro.closed_loop(loop.network(frozen=True), learns=False, seed=seed)
    learnt.sim.set_weights("babblers_actors", np.zeros(4))
    return learnt.test(5, most=60).lengths.max(), np.median(babbling)


def test_dopaminergic_neurons_teach_the_way_through_a_grid(figure):
    for parameters, seeds, told, aim in (
        ({}, DOPAMINE_SEEDS, "whole", "at least 9"),
        ({"value_drive": 0.0, "expectation": 0.0}, DOPAMINE_SEEDS[:3], "without a critic", "reported"),
        ({"reward_drive": 0.0}, DOPAMINE_SEEDS[:3], "without food", "0"),
    ):
        moves, babbling = np.array([moves_by_dopamine(seed, parameters) for seed in seeds]).T
        figure(f"grid by dopamine, {told}: shortest way, seeds of {len(seeds)}", int(np.sum(moves == 8)), "", aim)
        figure(f"grid by dopamine, {told}: moves while babbling, median", float(np.median(babbling)), "", "reported")


CHANCE_SEEDS = range(11, 21)
"""Seeds of the test. Weights and learning rate were chosen with seeds 1 to 4."""


def answers(seed, reward):
    """Return the mean rates of the output for A and B in the last 200 of 1000 trials, Hz."""
    labels = np.random.default_rng(seed).permutation(np.arange(1000) % 2)
    sim = neuro.compile(hedonists.network(), seed=seed)
    rates = hedonists.present(sim, hedonists.PATTERNS[labels], reward * np.where(labels == 0, 1.0, -1.0))
    return [rates[800:][labels[800:] == pattern].mean() for pattern in (0, 1)]


def test_the_rewarded_pattern_is_answered(figure):
    for reward, aim in ((1.0, "10"), (0.0, "about 3")):
        a, b = np.array([answers(seed, reward) for seed in CHANCE_SEEDS]).T
        told = "A rewarded, B punished" if reward else "no reward"
        figure(f"{told}: seeds with rate(A) > 2 rate(B)", float((a > 2.0 * b).sum()), "of 10", aim)
        for name, rates in (("A", a), ("B", b)):
            figure(f"{told}: rate({name}), least", float(rates.min()), "Hz")
            figure(f"{told}: rate({name}), largest", float(rates.max()), "Hz")


BITS = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])


def bits_learnt(seed, epochs):
    """Return the mean rates of the output for each pattern in the first and the last tenth, Hz, shape (2, 4)."""
    rng = np.random.default_rng(seed)
    shown = np.concatenate([rng.permutation(4) for _ in range(epochs)])
    sim = neuro.compile(hedonists.network(eta=0.2, weight=200.0), seed=seed)
    pre, _, drawn = sim.weights("onto_hidden")
    sim.set_weights("onto_hidden", np.where(pre % 2 == 0, drawn, -drawn))
    rewards = np.where(BITS.sum(axis=1) == 1, 1.0, -1.0)
    rates = hedonists.present(sim, (BITS @ hedonists.PATTERNS)[shown], rewards[shown], duration=500.0)
    tenth = 4 * max(1, epochs // 10)
    ends = (slice(tenth), slice(-tenth, None))
    return np.array([[rates[end][shown[end] == pattern].mean() for pattern in range(4)] for end in ends])


def test_exclusive_or_is_not_learnt(figure):
    """Test Seung's task as in Florian: 30 inputs per bit at 0 or 40 Hz, half of them inhibitory, and 60 hidden neurons.

    A pattern lasts 500 ms. The reward of each output spike is +1 if exactly one bit is set, and -1 otherwise. The task
    is learnt if the margin is above 0.

    Source: H. S. Seung, Neuron 40:1063, 2003; R. V. Florian, Neural Comput. 19:1468, 2007.
    """
    for seed in range(1, 4):
        for when, rates in zip(("first", "last"), bits_learnt(seed, 150), strict=True):
            told = ", ".join(f"{rate:.1f}" for rate in rates)
            margin = float(min(rates[1], rates[2]) - rates[3])
            figure(
                f"exclusive or, seed {seed}, {when} tenth: 00, 01, 10, 11 at {told} Hz: min(01, 10) - 11", margin, "Hz"
            )


CELLS = 500
ORDER_SEEDS = range(50)


def test_arrivals_come_together(figure):
    """Train neurons with separate inputs, so that each neuron is a repetition."""
    for by_step, presentations in ((True, 50), (False, 80)):
        onsets = drawn_onsets(seed=1, cells=CELLS)
        sim = neuro.compile(gathering(onsets, presentations, by_step), seed=1)
        found = [spread(onsets, sim.get("gathered", "delay"))]
        for _ in range(presentations):
            sim.run(BETWEEN)
            found.append(spread(onsets, sim.get("gathered", "delay")))
        told = "by one step" if by_step else "by A dt exp(-|dt|/tau)"
        needed = np.count_nonzero(np.array(found), axis=0)
        figure(f"stddp {told}: spread at the start", float(found[0].mean()), "ms", "about 8.7")
        figure(f"stddp {told}: neurons with spread 0", float((found[-1] == 0.0).sum()), f"of {CELLS}", f"{CELLS}")
        figure(f"stddp {told}: median of presentations", float(np.median(needed)), "", "about 17 and 48")


def right(seed, rule, trials, swapped):
    """Return a mask of the trials that are decided rightly. The labels are swapped from trial `swapped` on."""
    times, inputs, begins, labels = orders.batch(1, trials, orders=seed)
    labels = np.where(np.arange(trials) < swapped, labels, 1 - labels)
    sim = neuro.compile(orders.network(rule), seed=seed)
    return sim.trials(times, inputs, begins, labels, learn=True).label == labels


def test_orders_are_told_apart(figure):
    found = np.array([right(seed, neuro.r_stddp(), 600, 600) for seed in ORDER_SEEDS])
    figure("r_stddp: right in trials 51 to 100", float(found[:, 50:100].mean()), "", "at least 0.99")
    figure("r_stddp: right in the last 50 of 600", float(found[:, -50:].mean()), "", "at least 0.99")
    for most in (16.0, 20.0, 30.0):
        rule = neuro.r_stddp(d_max=most)
        found = np.array([right(seed, rule, 900, 300) for seed in ORDER_SEEDS])
        recovered = (found[:, -50:].mean(axis=1) >= 0.95).mean()
        told = f"r_stddp: labels swapped at 300 of 900, d_max {most:g} ms, seeds at 0.95 or more"
        figure(told, float(recovered), "", "reported")


def test_bars_of_a_spiking_grid(figure):
    """Learn bars by delays and by weights, with 5 seeds that were not used to choose settings.

    The labels are shifted by one class at trial 600 of 1500.
    """
    for name, rule in {
        "r_stddp": neuro.r_stddp(),
        "r_stdp": neuro.r_stdp(),
        "rescue": neuro.r_stdp(rescue=True),
    }.items():
        rightly = []
        for seed in range(5):
            times, inputs, begins, labels = orders.bars(seed, 1500)
            labels = np.where(np.arange(1500) < 600, labels, (labels + 1) % 4)
            sim = neuro.compile(orders.network(rule, 4, 1.5), seed=seed)
            rightly.append(sim.trials(times, inputs, begins, labels, learn=True).label == labels)
        for told, part in {
            "51 to 100": slice(50, 100),
            "551 to 600": slice(550, 600),
            "1451 to 1500": slice(1450, 1500),
        }.items():
            each = np.array(rightly)[:, part].mean(axis=1)
            figure(f"bars, {name}: right in trials {told}, mean", float(each.mean()), "", "reported")
            figure(f"bars, {name}: right in trials {told}, least", float(each.min()), "", "reported")
