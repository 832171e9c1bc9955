"""Weights at pre spikes are those of NEST's weight_recorder."""

import numpy as np
import pytest

import neuro

pytestmark = pytest.mark.usefixtures("nest")

STDP = {"tau_plus": 18.0, "lambda": 0.05, "alpha": 1.1, "mu_plus": 0.4, "mu_minus": 0.6, "Wmax": 400.0}
INTO = np.sort(np.random.default_rng(4).choice(np.arange(10, 2000), (4, 60), replace=False)) / 10.0
WEIGHTS = np.array([[90.0, 150.0, 60.0], [120.0, 80.0, 40.0], [200.0, 30.0, 70.0], [55.0, 45.0, 310.0]])
DELAY, MS = 1.3, 210.0


def of_nest():
    """What its weight_recorder shows: times, senders, targets and weights, by time, sender and target."""
    import nest

    nest.ResetKernel()
    nest.set(resolution=0.1, print_time=False)
    sources = nest.Create("spike_generator", 4, [{"spike_times": times} for times in INTO])
    parrots, cells = nest.Create("parrot_neuron", 4), nest.Create("iaf_psc_exp", 3, {"I_e": 380.0, "tau_minus": 22.0})
    recorder = nest.Create("weight_recorder")
    nest.CopyModel("stdp_synapse", "recorded", {"weight_recorder": recorder})
    nest.Connect(sources, parrots, "one_to_one", {"delay": 1.0})
    weights = {"synapse_model": "recorded", "weight": WEIGHTS.T, "delay": DELAY, **STDP}
    nest.Connect(parrots, cells, "all_to_all", weights)
    nest.Simulate(MS)
    events = recorder.events
    senders, targets = events["senders"] - parrots[0].global_id, events["targets"] - cells[0].global_id
    steps = np.rint(events["times"] * 10.0).astype(int)
    order = np.lexsort((targets, senders, steps))
    nest.ResetKernel()
    return steps[order], senders[order], targets[order], events["weights"][order]


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_weights_at_pre_spikes(backend):
    net = neuro.Network("recorded")
    net.population("sources", 4, neuro.spike_generator(spike_times=[list(times) for times in INTO]))
    net.population("parrots", 4, neuro.parrot_neuron())
    net.population("cells", 3, neuro.iaf_psc_exp(I_e=380.0, tau_minus=22.0))
    net.connect("sources", "parrots", neuro.one_to_one(), delay=1.0)
    words = {word if word != "lambda" else "lambda_": value for word, value in STDP.items()}
    learning = net.connect(
        "parrots", "cells", neuro.all_to_all(), neuro.stdp(**words), weight=WEIGHTS, delay=DELAY, name="learning"
    )
    net.probe("sent", learning, "weight", at="pre_spikes")
    sim = neuro.compile(net, backend)
    for _ in range(3):
        sim.run(MS / 3)
    times, sent = sim.trace("sent")
    steps, senders, targets, weights = of_nest()
    arrived = np.rint(times * 10.0).astype(int)
    kept = arrived < steps.max() + 1
    assert np.array_equal(arrived[kept], steps)
    assert np.array_equal(sent["pre"][kept], senders)
    assert np.array_equal(sent["post"][kept], targets)
    assert np.abs(sent["weight"][kept] - weights).max() < 1e-9
    assert np.ptp(weights) > 100.0
    assert steps.size > 600
