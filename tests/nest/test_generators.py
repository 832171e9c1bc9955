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
