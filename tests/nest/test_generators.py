"""Generators of currents against NEST itself: scripts of its own, not our backend, and backend event beside them."""

from typing import Any

import numpy as np
import pytest

import neuro

pytestmark = pytest.mark.usefixtures("nest")

CELL = {"tau_syn_ex": 3.0, "tau_syn_in": 5.0, "I_e": 250.0}

STEPS = {"amplitude_times": [0.1, 7.3, 20.0], "amplitude_values": [300.0, -200.0, 450.0]}

WAVES = {"amplitude": 300.0, "offset": 120.0, "frequency": 37.0, "phase": 70.0}


def of_nest(model: str, words: dict[str, Any], then: dict[str, Any], synapse: dict[str, Any]) -> tuple[Any, Any]:
    """V_m after each step, and the times of spikes, of one neuron under one generator; `then` is set at 20 ms."""
    import nest

    nest.ResetKernel()
    nest.set(resolution=0.1)
    source, cell = nest.Create(model, params=words), nest.Create("iaf_psc_exp", params=CELL)
    meter = nest.Create("multimeter", params={"record_from": ["V_m"], "interval": 0.1})
    spikes = nest.Create("spike_recorder")
    nest.Connect(source, cell, syn_spec=synapse)
    nest.Connect(meter, cell)
    nest.Connect(cell, spikes)
    nest.Simulate(20.0)
    if then:
        source.set(then)
    nest.Simulate(40.1)
    found = meter.events["V_m"][:600].copy(), spikes.events["times"].copy()
    nest.ResetKernel()
    return found


def of_ours(model: Any, then: dict[str, Any], weight: float, delay: float, receptor: str | None) -> tuple[Any, Any]:
    net = neuro.Network("one", resolution=0.1)
    net.population("source", 1, model)
    net.population("cell", 1, neuro.iaf_psc_exp(**CELL))
    net.connect("source", "cell", neuro.one_to_one(), neuro.static(receptor=receptor), weight=weight, delay=delay)
    net.probe("V", "cell", "V_m", every=0.1)
    sim = neuro.compile(net, "event")
    sim.run(20.0)
    if then:
        sim.set("source", **then)
    sim.run(40.0)
    return sim.trace("V")[1].ravel(), sim.spikes("cell")[0]


@pytest.mark.parametrize(
    ("model", "words", "then"),
    [
        ("step_current_generator", STEPS, {}),
        ("ac_generator", WAVES, {}),
        ("ac_generator", WAVES, {"frequency": 90.0, "phase": 10.0, "amplitude": 200.0}),
        ("dc_generator", {"amplitude": 250.0}, {"amplitude": -100.0}),
        ("noise_generator", {"mean": 200.0}, {"mean": -50.0}),
    ],
)
@pytest.mark.parametrize(
    ("weight", "delay", "window", "receptor"),
    [(1.2, 0.1, {}, None), (-0.7, 2.3, {"start": 4.2, "stop": 43.0}, "ex"), (-0.7, 0.1, {}, "ex")],
)
def test_v_is_that_of_nest(model, words, then, window, weight, delay, receptor):
    synapse = {"weight": weight, "delay": delay, "receptor_type": 0 if receptor is None else 1}
    expected, spiked = of_nest(model, words | window, then, synapse)
    v, spikes = of_ours(getattr(neuro, model)(**words, **window), then, weight, delay, receptor)
    assert np.abs(v - expected).max() < 1e-9
    assert np.allclose(spikes, spiked, rtol=0.0, atol=1e-9)


def nest_variance(words: dict[str, float]) -> float:
    """The variance of what NEST's noise sends in 4 s, seen by a multimeter on each of some generators."""
    import nest

    nest.ResetKernel()
    nest.set(resolution=0.1, rng_seed=7)
    source = nest.Create("noise_generator", 20, params=words)
    cells = nest.Create("iaf_psc_delta", 20)
    meter = nest.Create("multimeter", params={"record_from": ["I"], "interval": 1.0})
    nest.Connect(source, cells, "one_to_one")
    nest.Connect(meter, source)
    nest.Simulate(4000.0)
    found = float(np.var(meter.events["I"]))
    nest.ResetKernel()
    return found


def test_the_variance_of_noise_is_nests():
    from neuro.program.currents import Emission

    words = {"mean": 30.0, "std": 200.0, "std_mod": 150.0, "frequency": 0.03, "phase": 40.0}
    net = neuro.Network("noise", resolution=0.1)
    net.population("source", 20, neuro.noise_generator(**words))
    net.population("cells", 20, neuro.iaf_psc_delta())
    net.connect("source", "cells", neuro.one_to_one())
    program = neuro.compile(net, "reference").program
    parameters = {word: np.array([value]) for word, value in words.items()}
    drawn = Emission(program, 0).at(np.arange(1, 40000, 10), parameters)
    assert np.var(drawn) == pytest.approx(nest_variance(words), rel=0.03)


STDP = {"tau_plus": 18.0, "lambda": 0.05, "alpha": 1.1, "mu_plus": 0.4, "mu_minus": 0.6, "Wmax": 400.0}

INTO = np.sort(np.random.default_rng(4).choice(np.arange(10, 2000), (4, 60), replace=False)) / 10.0

WEIGHTS = np.array([[90.0, 150.0, 60.0], [120.0, 80.0, 40.0], [200.0, 30.0, 70.0], [55.0, 45.0, 310.0]])

DELAY, MS = 1.3, 210.0


def recorded_by_nest():
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
    steps, senders, targets, weights = recorded_by_nest()
    arrived = np.rint(times * 10.0).astype(int)
    kept = arrived < steps.max() + 1
    assert np.array_equal(arrived[kept], steps)
    assert np.array_equal(sent["pre"][kept], senders)
    assert np.array_equal(sent["post"][kept], targets)
    assert np.abs(sent["weight"][kept] - weights).max() < 1e-9
    assert np.ptp(weights) > 100.0
    assert steps.size > 600


PARAMETERS = {"tau_m": 8.0, "C_m": 100.0, "dead_time": 2.0, "I_e": 20.0}

TIMES, WEIGHT = [3.0, 5.5, 5.6, 9.0], 4.0


def ours(n, ms, **parameters):
    net = neuro.Network("point", resolution=0.1)
    net.population("in", 1, neuro.spike_generator(spike_times=[TIMES]))
    net.population("cells", n, neuro.pp_psc_delta(**PARAMETERS, **parameters))
    net.connect("in", "cells", neuro.all_to_all(), weight=WEIGHT, delay=1.0)
    net.probe("v", "cells", record="V_m", every=0.1)
    sim = neuro.compile(net, seed=3)
    sim.run(ms)
    return sim


def theirs(nest, n, ms, **parameters):
    nest.resolution, nest.rng_seed = 0.1, 3
    lists = {name: [value] for name, value in parameters.items() if name in ("tau_sfa", "q_sfa")}
    cells = nest.Create("pp_psc_delta", n, params=PARAMETERS | parameters | lists)
    source = nest.Create("spike_generator", params={"spike_times": TIMES})
    nest.Connect(source, cells, syn_spec={"weight": WEIGHT, "delay": 1.0})
    meter = nest.Create("multimeter", params={"record_from": ["V_m"], "interval": 0.1})
    recorder = nest.Create("spike_recorder")
    nest.Connect(meter, cells[0])
    nest.Connect(cells, recorder)
    nest.Simulate(ms)
    return meter.get("events", "V_m"), recorder.n_events


def test_the_potential_is_that_of_nest(own_nest):
    rates = {"c_1": 0.0, "c_2": 0.0, "c_3": 0.0}
    v, spikes = theirs(own_nest, 1, 30.0, **rates)
    sim = ours(1, 30.0, **rates)
    assert spikes == len(sim.spikes("cells")[0]) == 0
    np.testing.assert_allclose(sim.trace("v")[1][: len(v), 0], v, rtol=1e-12)


@pytest.mark.parametrize(
    "rates",
    [
        {"c_1": 30.0, "c_2": 40.0, "c_3": 0.0, "with_reset": False},
        {"c_1": 0.0, "c_2": 20.0, "c_3": 0.8, "with_reset": True},
        {"c_1": -50.0, "c_2": 10.0, "c_3": 0.0, "with_reset": False},
        {"c_1": 300.0, "c_2": 400.0, "c_3": 0.0, "with_reset": False, "tau_sfa": 12.0, "q_sfa": 0.8},
    ],
)
def test_rates_are_those_of_nest(own_nest, rates):
    n, ms = 400, 200.0
    _, spikes = theirs(own_nest, n, ms, **rates)
    found = len(ours(n, ms, **rates).spikes("cells")[0])
    # Counts of a process with a dead time vary less than those of a Poisson process.
    assert found == pytest.approx(spikes, abs=4.0 * np.sqrt(found + spikes) + 4.0)


def test_the_threshold_adapts_as_in_nest(own_nest):
    """Spikes that are sure, so that both have the same: the threshold after each, and its decay."""
    rates = {"c_1": 1e6, "c_2": 0.0, "c_3": 0.0, "with_reset": False, "tau_sfa": 5.0, "q_sfa": 6.0}
    v, spikes = theirs(own_nest, 1, 30.0, **rates)
    sim = ours(1, 30.0, **rates)
    assert len(sim.spikes("cells")[0]) == spikes > 3
    np.testing.assert_allclose(sim.trace("v")[1][: len(v), 0], v, rtol=1e-12)
