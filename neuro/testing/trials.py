"""Cases of trials: decisions, rewards, dropout, reset. Values of `exact_...` are exact in floats and in integers."""

from __future__ import annotations

from typing import Any

import numpy as np

from neuro.model.distributions import normal, uniform
from neuro.model.network import Network
from neuro.model.neurons import iaf_psc_delta, iaf_psc_exp, poisson_generator, spike_generator
from neuro.model.parts import local_winners, winner_take_all
from neuro.model.rules import Rule, all_to_all, fixed_indegree, grid, one_to_one
from neuro.model.synapses import Synapse, first_spike_stdp, r_stdp, static, tempotron
from neuro.run.simulation import Simulation
from neuro.run.trials import TrialResults
from neuro.testing.case import Found, Start, case, integers_too, network, observe
from neuro.testing.exact import cell, whole

INF = float("inf")


DRAWN = normal(mean=0.5, std=0.1, low=0.0, high=1.0)
"""Initial weights of cases that learn."""


def recogniser(
    synapse: Synapse | None = None,
    rule: Rule | None = None,
    *,
    weight: object = DRAWN,
    threshold: float = 5.0,
    **settings: Any,
) -> Network:
    """Return a network of six maps, two for each label, over a small sheet; the first map to fire decides.

    Args:
        synapse: synapse model, `r_stdp()` by default.
        rule: connection rule, a grid by default; with other rules a map has two neurons.
        weight: initial weights, mV.
        threshold: threshold of the maps, mV.
        settings: settings of the trials, see `Network.trials`, which replace the defaults here.
    """
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    shape = (6, "auto", "auto") if rule is None else (6, 2)
    net.population("maps", shape, cell(V_th=threshold))
    net.connect("sheet", "maps", rule or grid(kernel=(4, 4)), synapse or r_stdp(), weight=weight, delay=2.0, name="s2")
    net.group("choice", winner_take_all(of="maps"))
    defaults: dict[str, Any] = {"labels": {"of": "maps", "maps_per_label": 2}, "reset": ["V_m"], "duration": 20.0}
    net.trials(input="sheet", **(defaults | settings))
    return net


def batch(n: int, spikes: int = 24) -> tuple[Any, Any, Any, Any]:
    """Return random spikes for n trials, at most one for each neuron and trial: times, ids, offsets and labels."""
    rng = np.random.default_rng(5)
    ids = np.concatenate([rng.permutation(72)[:spikes] for _ in range(n)])
    times = rng.integers(0, 15, n * spikes).astype(np.float64)
    return times, ids, np.arange(n + 1) * spikes, rng.integers(0, 3, n)


def trial_results(results: TrialResults, name: str = "trials") -> Found:
    """Return the results of a batch by name."""
    counts = results.counts
    return {
        f"{name}: winner": results.winner,
        f"{name}: label": results.label,
        f"{name}: step": results.step,
        f"{name}: ticks": results.ticks,
        f"{name}: potential": results.potential,
        f"{name}: wins": np.concatenate([results.wins.neurons, results.wins.steps, results.wins.offsets]),
        f"{name}: counts": np.array([counts.steps, counts.spikes, counts.synaptic_ops, counts.learning_updates]),
    }


def taught(start: Start, net: Network, epochs: int = 2) -> Found:
    """Run epochs of learning and then a test; return all results and everything that can be read."""
    sim = start(net)
    times, ids, offsets, labels = batch(24)
    outcome: Found = {}
    for epoch in range(epochs):
        results = sim.trials(times, ids, offsets, labels, learn=True, samples=np.arange(24) // 3, epoch=epoch)
        outcome |= trial_results(results, f"epoch {epoch}")
    return outcome | trial_results(sim.trials(times, ids, offsets), "test") | observe(sim)


@case
def silent_trials(start: Start) -> Found:
    """Trials without enough spikes, one of them without any."""
    sim = start(recogniser())
    results = sim.trials([3.0, 3.0, 4.0], [0, 40, 7], [0, 2, 2, 3], labels=[0, 1, 2], learn=True)
    return trial_results(results) | observe(sim)


@case
def rewarded_learning(start: Start) -> Found:
    """r_stdp on shared kernels: reward, punishment and the growth of the right label's maps."""
    return taught(start, recogniser(r_stdp(epsilon=0.002)))


@case
def rescued_learning(start: Start) -> Found:
    """r_stdp with rescue, and dropout that is drawn for each sample and decays."""
    return taught(start, recogniser(r_stdp(rescue=True), dropout={"of": "maps", "p": 0.4, "decay": 0.5}))


@case
def dropout_of_each_trial(start: Start) -> Found:
    """Dropout drawn for each trial; rates set between epochs."""
    net = recogniser(dropout={"of": "maps", "p": 0.5, "every": "trial"}, reward={"correct": 1, "wrong": 0})
    sim = start(net)
    times, ids, offsets, labels = batch(12)
    first = trial_results(sim.trials(times, ids, offsets, labels, learn=True), "first")
    sim.set("s2", Ar_plus=0.3, Ar_minus=-0.1, epsilon=0.01)
    return first | trial_results(sim.trials(times, ids, offsets, labels, learn=True, epoch=1), "second") | observe(sim)


@case
def rewarded_learning_with_padding(start: Start) -> Found:
    """r_stdp on a padded grid with a stride: inputs beyond the border do not learn."""
    net = recogniser(r_stdp(epsilon=0.002), grid(kernel=(3, 3), stride=2, padding=1))
    net.populations.pop("maps")
    net.population("maps", (6, 3, 3), iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=3.0))
    return taught(start, net)


@case
def rewarded_learning_by_channel(start: Start) -> Found:
    """r_stdp on depthwise kernels, each of which gets the spikes of one map of a layer in between."""
    net = network(1.0)
    cells = iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=2.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("between", (3, "auto", "auto"), cells)
    net.population("maps", (6, "auto", "auto"), cells)
    net.connect("sheet", "between", grid(kernel=(3, 3)), weight=uniform(low=0.3, high=0.8))
    weight = uniform(low=0.4, high=0.9)
    rule = grid(kernel=(2, 2), padding="same", depthwise=True)
    net.connect("between", "maps", rule, r_stdp(epsilon=0.002), weight=weight, name="s2")
    net.group("choice", winner_take_all(of="maps"))
    net.trials(input="sheet", labels={"of": "maps", "maps_per_label": 2}, reset=["V_m"], duration=20.0)
    return taught(start, net)


@case
def rewarded_learning_of_all_pairs(start: Start) -> Found:
    """r_stdp with a weight for every pair, and other bounds."""
    return taught(start, recogniser(r_stdp(Wmin=-0.2, Wmax=1.4, rescue=True), all_to_all()))


@case
def rewarded_learning_with_delays(start: Start) -> Found:
    """r_stdp over random synapses with drawn delays: the time of arrival counts."""
    net = recogniser(r_stdp(epsilon=0.003), fixed_indegree(n=30, multapses=False))
    part = net.projections.pop("s2")
    net.connect("sheet", "maps", part.rule, part.synapse, weight=part.weight, delay=uniform(low=1, high=6), name="s2")
    return taught(start, net)


@case
def rewarded_learning_from_a_layer(start: Start) -> Found:
    """r_stdp from neurons between the input and the output, which may spike more than once."""
    net = network(1.0)
    net.population("sheet", 12, spike_generator())
    net.population("layer", 12, iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=1.0, t_ref=0.0))
    net.population("out", (4, 3), iaf_psc_delta(tau_m=20.0, E_L=0.0, V_reset=0.0, V_th=2.0))
    net.connect("sheet", "layer", one_to_one(), weight=2.0, name="into")
    net.connect("layer", "layer", one_to_one(), weight=0.6, delay=3.0, name="again")
    net.connect("layer", "out", all_to_all(), r_stdp(epsilon=0.01), weight=uniform(low=0.2, high=0.8), name="s2")
    net.group("choice", winner_take_all(of="out"))
    net.trials(input="sheet", duration=20.0, labels={"of": "out", "maps_per_label": 2})
    sim = start(net)
    times, ids, offsets, labels = batch(10, 8)
    results = sim.trials(times, ids % 12, offsets, labels % 2)
    some = np.concatenate([np.random.default_rng(k).permutation(12)[:8] for k in range(10)])
    return (
        trial_results(results)
        | trial_results(sim.trials(times, some, offsets, labels % 2, learn=True), "learn")
        | observe(sim)
    )


@case
def learning_without_labels(start: Start) -> Found:
    """An unsupervised rule changes the synapses of the neuron that decided, regardless of labels."""
    sim = start(recogniser(first_spike_stdp(A_plus=0.1, A_minus=-0.05), labels=None))
    times, ids, offsets, _ = batch(24)
    return trial_results(sim.trials(times, ids, offsets, learn=True)) | observe(sim)


@case
def learning_at_the_peak(start: Start) -> Found:
    """A rule that uses the largest V_m of each neuron before the decision, in trials that continue after it."""
    return taught(start, recogniser(tempotron(lambda_=0.1, tau_s=0.0, tau_m=20.0), stop="full"))


@case
def states_that_go_on(start: Start) -> Found:
    """Only the states named in `reset` are reset between trials; here the currents of iaf_psc_exp continue."""
    net = network(1.0)
    net.population("source", 4, spike_generator())
    net.population("cells", (2, 2), iaf_psc_exp(tau_syn_ex=15.0))
    net.connect("source", "cells", one_to_one(), weight=250.0)
    net.group("choice", winner_take_all(of="cells"))
    net.trials(input="source", duration=12.0, labels={"of": "cells"}, reset=["V_m"])
    sim = start(net)
    outcome = trial_results(sim.trials([0.0, 1.0, 2.0, 0.0, 5.0], [0, 0, 1, 3, 3], [0, 3, 5]))
    sim.run(10.0)
    return outcome | observe(sim)


def simulation_after_trials(sim: Simulation) -> Found:
    """Run a batch with learning; return its results and everything that can be read."""
    times, ids, offsets, labels = batch(12)
    return trial_results(sim.trials(times, ids, offsets, labels, learn=True, samples=np.arange(12) // 2)) | observe(sim)


def sheets(group: dict[str, Any], synapse: Synapse | None = None, rule: Rule | None = None, **settings: Any) -> Network:
    """Return a network of six maps of 3 x 3 neurons over a small sheet."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (6, 3, 3), iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=4.0))
    net.connect("sheet", "maps", rule or grid(kernel=(4, 4)), synapse or static(), weight=DRAWN, name="s2")
    net.group("choice", local_winners(of="maps", **group))
    net.trials(input="sheet", duration=20.0, **({"stop": "full"} | settings))
    return net


@integers_too
@case
def exact_local_winners(start: Start) -> Found:
    """Each map wins once and silences its neighbourhood, also in a run after the trials; ties are drawn."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (6, "auto", "auto"), cell(V_th=9.0))
    net.connect("sheet", "maps", grid(kernel=(4, 4)), weight=whole(-1, 3, (6, 2, 4, 4)), delay=2.0, name="s2")
    net.group("choice", local_winners(of="maps", radius=1, per_map=1))
    net.trials(input="sheet", duration=20.0, stop="full")
    sim = start(net)
    times, ids, offsets, _ = batch(12, 40)
    outcome = trial_results(sim.trials(times, ids, offsets), "first")
    sim.run(7.0)
    return outcome | trial_results(sim.trials(times, ids, offsets), "second") | observe(sim)


@integers_too
@case
def exact_local_winners_to_the_last(start: Start) -> Found:
    """Any number of wins for each map; a trial ends when no neuron can win any more."""
    net = network(1.0)
    net.population("sheet", (2, 6, 6), spike_generator())
    net.population("maps", (2, 3, 4), cell(V_th=15.0))
    net.connect("sheet", "maps", all_to_all(), weight=whole(-1, 3, (72, 24)), name="s2")
    net.group("choice", local_winners(of="maps", radius=1))
    net.trials(input="sheet", duration=20.0)
    times, ids, offsets, _ = batch(10)
    sim = start(net)
    return trial_results(sim.trials(times, ids, offsets)) | observe(sim)


@case
def local_winners_learn(start: Start) -> Found:
    """Each winner learns; several winners of one map learn one after another."""
    sim = start(sheets({"radius": 0, "per_map": 3}, first_spike_stdp(A_plus=0.1, A_minus=-0.05)))
    times, ids, offsets, _ = batch(24, 40)
    return (
        trial_results(sim.trials(times, ids, offsets, learn=True))
        | trial_results(sim.trials(times, ids, offsets))
        | observe(sim)
    )


@case
def local_winners_are_rewarded(start: Start) -> Found:
    """Each winner is rewarded according to its own label, with dropout of maps; a trial ends with the last decision."""
    labels, dropout = {"of": "maps", "maps_per_label": 2}, {"of": "maps", "p": 0.4}
    words: dict[str, Any] = {"labels": labels, "dropout": dropout, "stop": "at_decision"}
    return taught(start, sheets({"radius": 1, "per_map": 1}, r_stdp(epsilon=0.002), all_to_all(), **words))


@case
def local_winners_without_trials(start: Start) -> Found:
    """Winners also silence their neighbourhood outside of trials, until a reset."""
    net = network(1.0)
    net.population("noise", 144, poisson_generator(rate=100.0))
    net.population("cells", (3, 6, 8), iaf_psc_delta(tau_m=30.0, E_L=0.0, V_reset=0.0, V_th=2.0))
    net.connect("noise", "cells", one_to_one(), weight=uniform(low=0.6, high=1.4), name="drive")
    net.group("choice", local_winners(of="cells", radius=1, per_map=3))
    sim = start(net)
    sim.run(50.0)
    before_reset = observe(sim)
    sim.reset()
    sim.run(80.0)
    return {f"first: {name}": np.asarray(values) for name, values in before_reset.items()} | observe(sim)


def chooser(synapse: Synapse | None = None, weight: object = None, threshold: float = 9.0, **settings: Any) -> Network:
    """Return the network of `recogniser` with whole numbers as weights."""
    kernels = whole(-1, 3, (6, 2, 4, 4)) if weight is None else weight
    return recogniser(synapse or static(), weight=kernels, threshold=threshold, **settings)


@integers_too
@case
def exact_decisions(start: Start) -> Found:
    """Decisions, ties and potentials; a trial ends at its decision."""
    sim = start(chooser())
    times, ids, offsets, _ = batch(20)
    return trial_results(sim.trials(times, ids, offsets)) | observe(sim)


@integers_too
@case
def exact_full_trials(start: Start) -> Found:
    """Trials with `stop: full`, some of them silent, and a run between two batches."""
    sim = start(chooser(stop="full", threshold=14.0))
    times, ids, offsets, _ = batch(12)
    outcome = trial_results(sim.trials(times, ids, offsets), "first")
    sim.run(7.0)
    few = sim.trials([3.0, 3.0, 4.0], [0, 40, 7], [0, 2, 2, 3])
    return (
        outcome | trial_results(few, "silent") | trial_results(sim.trials(times, ids, offsets), "second") | observe(sim)
    )


@integers_too
@case
def exact_run_after_a_decision(start: Start) -> Found:
    """Input spikes after a trial's decision are discarded and do not occur in the next run."""
    sim = start(chooser(threshold=2.0))
    times, ids, offsets, _ = batch(4)
    outcome = trial_results(sim.trials(times, ids, offsets))
    sim.run(25.0)
    return outcome | observe(sim)


@integers_too
@case
def exact_rewards(start: Start) -> Found:
    """r_stdp at its bounds, where a reward changes no weight: dropout, labels and learning_updates."""
    weight = whole(0, 1, (6, 2, 4, 4))
    net = chooser(r_stdp(epsilon=0.0), weight, 5.0, dropout={"of": "maps", "p": 0.4, "decay": 0.5})
    return taught(start, net)


@integers_too
@case
def exact_rescue(start: Start) -> Found:
    """r_stdp with rescue, at its bounds, with dropout of each trial."""
    weight = whole(0, 1, (6, 2, 4, 4))
    return taught(start, chooser(r_stdp(rescue=True), weight, 7.0, dropout={"of": "maps", "p": 0.5, "every": "trial"}))


@integers_too
@case
def exact_growth(start: Start) -> Found:
    """r_stdp with all weights at Wmax, so growth is counted but changes no weight; many decisions tie."""
    return taught(start, recogniser(r_stdp(Wmax=2.0), all_to_all(), weight=2.0, threshold=8.0))
