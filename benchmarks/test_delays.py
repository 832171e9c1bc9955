"""Delays that learn, over many seeds: arrivals that come together, and orders of spikes that are told apart."""

import numpy as np

import neuro
from neuro_models import orders
from neuro_models.delays import BETWEEN, drawn_onsets, gathering, spread

CELLS = 500
SEEDS = 50


def test_arrivals_come_together(figure):
    """Each neuron has inputs of its own, so they are as many repetitions."""
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
    """Which trials are decided rightly, whose labels are swapped from one on."""
    times, inputs, begins, labels = orders.batch(1, trials, orders=seed)
    labels = np.where(np.arange(trials) < swapped, labels, 1 - labels)
    sim = neuro.compile(orders.network(rule), seed=seed)
    return sim.trials(times, inputs, begins, labels, learn=True).label == labels


def test_orders_are_told_apart(figure):
    found = np.array([right(seed, neuro.r_stddp(), 600, 600) for seed in range(SEEDS)])
    figure("r_stddp: right in trials 51 to 100", float(found[:, 50:100].mean()), "", "at least 0.99")
    figure("r_stddp: right in the last 50 of 600", float(found[:, -50:].mean()), "", "at least 0.99")
    for most in (16.0, 20.0, 30.0):
        rule = neuro.r_stddp(d_max=most)
        found = np.array([right(seed, rule, 900, 300) for seed in range(SEEDS)])
        recovered = (found[:, -50:].mean(axis=1) >= 0.95).mean()
        told = f"r_stddp: labels swapped at 300 of 900, d_max {most:g} ms, seeds at 0.95 or more"
        figure(told, float(recovered), "", "reported")
