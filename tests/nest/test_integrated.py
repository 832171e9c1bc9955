"""Neurons with integrators where a step holds much: adaptive steps and several spikes in one are those of NEST."""

import numpy as np
import pytest

import neuro
from neuro.model.neurons import Neuron


def found(net: neuro.Network, backend: str) -> tuple[list[tuple[float, int]], np.ndarray]:
    sim = neuro.compile(net, backend)
    sim.run(100.0)
    times, ids = sim.spikes("cells")
    return list(zip(times.tolist(), ids.tolist(), strict=True)), sim.trace("V_m")[1]


@pytest.mark.parametrize("model", [neuro.aeif_cond_exp, neuro.aeif_psc_exp])
@pytest.mark.parametrize(("delta_t", "resolution"), [(2.0, 0.1), (2.0, 1.0), (0.0, 0.5)])
def test_adaptive_steps_are_those_of_nest(model: type[Neuron], resolution: float, delta_t: float, nest):
    """A fast membrane on a coarse grid: a step is cut wherever NEST cuts it, by an error that counts by the slope."""
    net = neuro.Network("coarse", resolution=resolution)
    net.population("cells", 1, model(I_e=900.0, C_m=100.0, Delta_T=delta_t))
    net.probe("V_m", "cells", "V_m")
    expected, ours = found(net, "nest"), found(net, "event")
    assert ours[0] == expected[0] != []
    assert np.abs(ours[1] - expected[1]).max() <= 1e-4  # rounding grows in each upswing


@pytest.mark.parametrize(("backend", "resolution"), [("event", 0.5), ("event", 1.0), ("reference", 1.0)])
def test_all_spikes_of_a_step_are_sent(resolution: float, backend: str, nest):
    """Reset above where the upswing begins, it fires again at once; plastic synapses on both ends see each spike."""

    def weights_of(backend: str) -> list[float]:
        net = neuro.Network("bursts", resolution=resolution)
        net.population("cells", 1, neuro.aeif_cond_exp(I_e=3000.0, V_reset=-47.0, b=20.0))
        net.population("relay", 1, neuro.parrot_neuron())
        net.population("out", 1, neuro.iaf_psc_exp(tau_minus=10.0))
        net.connect("cells", "relay", neuro.one_to_one(), weight=1.0)
        net.connect("cells", "out", neuro.one_to_one(), weight=200.0)
        net.connect("relay", "out", neuro.one_to_one(), neuro.stdp(Wmax=500.0), weight=200.0, name="to")
        net.connect("out", "cells", neuro.one_to_one(), neuro.stdp(Wmax=500.0), weight=1.0, name="back")
        net.probe("V_m", "out", "V_m")
        sim = neuro.compile(net, backend)
        sim.run(100.0)
        times = sim.spikes("cells")[0].tolist()
        assert len(times) > len(set(times)) > 50
        return [*times, *sim.spikes("out")[0], *sim.weights("to")[2], *sim.weights("back")[2], *sim.trace("V_m")[1][0]]

    assert weights_of(backend) == pytest.approx(weights_of("nest"), rel=1e-9)


def test_rk4_is_refused(nest):
    net = neuro.Network("even")
    net.population("cells", 2, neuro.iaf_cond_exp(rk4_substeps=2))
    with pytest.raises(neuro.ModelError) as error:
        neuro.compile(net, "nest")
    assert "population 'cells': rk4_substeps: NEST integrates by RKF45" in str(error.value)
    assert "leave it out, or backend 'event' runs it" in str(error.value)
