"""Dopamine in trials: each trial beside a simulation of its own that begins with the weights of the one before.

`NEURO_DOPAMINE_TRIALS` sets how many random networks are tried.
"""

import os

import numpy as np
import pytest

import neuro

NETWORKS = int(os.environ.get("NEURO_DOPAMINE_TRIALS", "6"))
REWARDS = {"correct": 0.05, "wrong": -0.03}
LABELS = {"of": "out", "maps_per_label": 2}
INPUTS, TICKS = 12, 40


def rules(rng):
    """A rule, and whether the reward sets its dopamine: extremes of rates and bounds among them."""
    dopa = {
        "A_plus": rng.choice([0.5, 2.0]), "A_minus": rng.choice([0.0, 0.7]), "tau_c": rng.choice([5.0, 80.0]),
        "tau_n": rng.choice([4.0, 60.0]), "b": rng.choice([0.0, 0.01, -0.02]), "Wmin": -100.0,
        "Wmax": rng.choice([700.0, 5000.0]), "deliver_interval": int(rng.integers(1, 4)),
    }  # fmt: skip
    return [
        neuro.stdp_dopa(signal="reward", **dopa),
        neuro.stdp_dopa(dopamine="hidden", dopamine_delay=3.0, c_min=0.0, **dopa),
        neuro.stdp_dopa(dopamine="out", **dopa),
        neuro.mstdpet(signal="reward", gamma=20.0, Wmax=5000.0),
    ]


def network(seed, trials):
    """Inputs onto a hidden population and an output of which one neuron decides; without draws but connections."""
    rng = np.random.default_rng(seed)
    net = neuro.Network("lessons", resolution=float(rng.choice([0.5, 1.0])))
    h = net.resolution
    spikes = {} if trials else {"spike_times": [[] for _ in range(INPUTS)]}
    net.population("input", INPUTS, neuro.spike_generator(**spikes))
    net.population("hidden", 6, neuro.iaf_psc_exp(tau_m=8.0, t_ref=2.0, tau_syn_ex=2.0, tau_minus=15.0))
    net.population("out", (4, 2), neuro.iaf_psc_delta(tau_m=15.0, t_ref=1.0, tau_minus=10.0, V_th=-62.0))
    net.signal("reward", to="out")
    rule, other = (rules(rng)[k] for k in rng.integers(0, 4, 2))
    delay = float(rng.integers(1, 5))
    weight = neuro.uniform(low=300.0, high=600.0)
    net.connect("input", "hidden", neuro.all_to_all(), weight=400.0, delay=delay, name="up")
    scale = {"weight": weight, "delay": neuro.uniform(low=1.0, high=4.0)}
    net.connect("input", "out", neuro.fixed_indegree(n=6), rule, name="w", **scale)
    net.connect("hidden", "out", neuro.all_to_all(), other, weight=2.0, delay=2.0, name="v")
    net.group("choice", neuro.winner_take_all(of="out"))
    if trials:
        stop = ("full", "at_decision")[seed % 2]
        net.trials(input="input", duration=TICKS * h, after=30 * h, stop=stop, labels=LABELS, reward=REWARDS)
    return net


def batch(seed, n=6):
    """Ticks, inputs and labels of some trials; one is silent, in one the inputs spike in each tick."""
    rng = np.random.default_rng([seed, 1])
    shown = [(rng.integers(0, TICKS, m), rng.integers(0, INPUTS, m)) for m in rng.integers(5, 60, n)]
    shown[1] = (np.zeros(0, int), np.zeros(0, int))
    shown[3] = (np.repeat(np.arange(TICKS), INPUTS), np.tile(np.arange(INPUTS), TICKS))
    return shown, rng.integers(0, 2, n)


def learnt(sim):
    return {name: sim.get(name, "weight").copy() for name in ("w", "v")}


def alone(seed, backend, weights, shown, ticks, reward):
    """The weights after a simulation of its own: the trial's input up to its end, the reward, and the time after."""
    sim = neuro.compile(network(seed, trials=False), backend, seed=1)
    h = sim.program.resolution
    for name, each in weights.items():
        sim.set(name, weight=each)
    ran = shown[0] < ticks
    sim.inject("input", (shown[0][ran] + 1) * h, shown[1][ran])
    sim.run(ticks * h)
    sim.signal("reward", np.full(8, reward))
    sim.run(30 * h)
    return learnt(sim)


@pytest.mark.parametrize("backend", ["event", "reference"])
def test_a_trial_is_a_simulation_of_its_own(backend):
    moved = 0
    for seed in range(NETWORKS):
        sim = neuro.compile(network(seed, trials=True), backend, seed=1)
        shown, labels = batch(seed)
        for (ticks, ids), label in zip(shown, labels, strict=True):
            before = learnt(sim)
            r = sim.trials(ticks * sim.program.resolution, ids, [0, len(ids)], [label], learn=True)
            reward = 0.0 if r.winner[0] < 0 else REWARDS["correct" if r.label[0] == label else "wrong"]
            own = alone(seed, backend, before, (ticks, ids), int(r.ticks[0]), reward)
            for name, each in learnt(sim).items():
                assert np.array_equal(each, own[name]), (seed, name)
                moved += not np.array_equal(each, before[name])
    assert moved > NETWORKS


def test_event_learns_as_the_reference_does():
    """Batches cut anywhere, and trials that do not teach between them."""
    for seed in range(NETWORKS):
        event, reference = (neuro.compile(network(seed, trials=True), b, seed=1) for b in ("event", "reference"))
        shown, labels = batch(seed)
        h, ends = event.program.resolution, np.cumsum([0, *(len(ids) for _, ids in shown)])
        times, ids = (np.concatenate(parts) for parts in zip(*shown, strict=True))
        found = [sim.trials(times * h, ids, ends, labels, learn=True) for sim in (event, reference)]
        assert np.array_equal(found[0].winner, found[1].winner)
        assert np.array_equal(found[0].ticks, found[1].ticks)
        for name, each in learnt(reference).items():
            assert np.allclose(each, event.get(name, "weight"), rtol=1e-9, atol=1e-12), (seed, name)
        before = learnt(event)
        event.trials(times * h, ids, ends)
        assert all(np.array_equal(each, before[name]) for name, each in learnt(event).items())
        cut = neuro.compile(network(seed, trials=True), "event", seed=1)
        cut.trials(times[: ends[2]] * h, ids[: ends[2]], ends[:3], labels[:2], learn=True)
        cut.trials(times[: ends[2]] * h, ids[: ends[2]], ends[:3])
        cut.trials(times[ends[2] :] * h, ids[ends[2] :], ends[2:] - ends[2], labels[2:], learn=True)
        assert all(np.array_equal(each, before[name]) for name, each in learnt(cut).items())


def small(rule, on=None, **words):
    """One input onto two neurons that decide."""
    net = neuro.Network("small", resolution=1.0)
    net.population("input", (1, 2, 2), neuro.spike_generator())
    net.population("out", (2, 2, 2), neuro.iaf_psc_delta(tau_m=15.0))
    net.signal("reward", to="out", **words.pop("signal", {}))
    net.connect("input", "out", on or neuro.all_to_all(), rule, weight=5.0, name="w")
    net.group("choice", neuro.winner_take_all(of="out"))
    backend = words.pop("backend", "event")
    net.trials(**{"input": "input", "duration": 10.0, "labels": {"of": "out"}} | words)
    return neuro.compile(net, backend)


DOPA = neuro.stdp_dopa(signal="reward")


def test_mistakes(messages):
    messages.calls(globals())


def test_without_labels_dopamine_of_the_network_teaches():
    sim = small(neuro.stdp_dopa(dopamine="out", A_plus=3.0), labels=None, after=20.0)
    sim.trials([0.0, 1.0, 1.0, 1.0], [0, 0, 1, 2], [0, 4], learn=True)
    assert (sim.get("w", "weight") > 5.0).any()
