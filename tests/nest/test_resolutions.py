"""Every resolution that NEST's clock has: all times reach the step that they mean, as in the reference."""

from typing import Any

import numpy as np
import pytest

import neuro
from neuro.model.neurons import Neuron

pytestmark = pytest.mark.usefixtures("nest")

FEW = (1, 9, 350, 700, 1_400, 33_300)

TICKS = (*range(1, 120), *range(125, 1000, 15), 350, 410, 700, 820, 1_100, 2_100, 3_300, 7_300, 33_300, 64_000, 100_000)

"""Lengths of a step in 0.001 ms. At 9, 350, 410, 700 and 820 among others ticks x 0.001 is above the decimal number."""


def network(h: float) -> neuro.Network:
    """One of each thing that is told a time, all in steps."""
    net = neuro.Network("steps", resolution=h)
    net.population("s", 2, neuro.spike_generator(spike_times=[[h, 7 * h, 30 * h, 71 * h], [2 * h, 3 * h, 60 * h]]))
    steps = {"amplitude_times": [3 * h, 30 * h, 63 * h], "amplitude_values": [1.0, 0.0, 2.0]}
    net.population("steps", 1, neuro.step_current_generator(**steps, start=2 * h, stop=70 * h))
    net.population("constant", 1, neuro.dc_generator(amplitude=1.0, start=5 * h, stop=47 * h))
    net.population("noise", 1, neuro.noise_generator(mean=0.5, std=0.2, dt=3 * h))
    slow = {"tau_m": 20 * h, "C_m": 25.0 * h, "tau_syn_ex": 3 * h, "tau_syn_in": 4 * h}
    net.population("c", 2, neuro.iaf_psc_exp(**slow, t_ref=3 * h, I_e=20.0))
    net.connect("s", "c", neuro.one_to_one(), weight=30.0, delay=2 * h)
    net.connect("steps", "c", neuro.all_to_all(), weight=20.0, delay=h)
    net.connect("constant", "c", neuro.all_to_all(), weight=15.0, delay=13 * h)
    net.connect("noise", "c", neuro.all_to_all(), weight=5.0, delay=4 * h)
    net.connect("c", "c", neuro.all_to_all(), neuro.stdp(Wmax=60.0, tau_plus=10 * h), weight=10.0, delay=7 * h)
    rule = neuro.stdp_dopa(
        **{"tau_n": 50 * h, "tau_c": 100 * h, "tau_plus": 10 * h, "b": 0.0, "A_plus": 0.3, "A_minus": 0.2},
        **{"Wmax": 60.0, "dopamine": "c", "dopamine_delay": 3 * h},
    )
    net.connect("s", "c", neuro.all_to_all(), rule, weight=10.0, delay=9 * h, name="rewarded")
    net.probe("V", "c", "V_m", every=5 * h)
    return net


def outcome(h: float, backend: str) -> tuple[list[Any], list[np.ndarray]]:
    """The steps and neurons that spike, and numbers that may differ by rounding."""
    sim = neuro.compile(network(h), backend)
    sim.run(27 * h)
    sim.run(53 * h)
    times, ids = sim.spikes("c")
    numbers = [sim.get("c", "V_m"), sim.trace("V")[1], sim.weights("c_c")[2], sim.weights("rewarded")[2]]
    return [np.rint(times / h).astype(int).tolist(), ids.tolist()], numbers


def check(lengths: tuple[int, ...]) -> None:
    for ticks in lengths:
        h = ticks / 1000
        spikes, numbers = outcome(h, "reference")
        assert len(spikes[0]) > 8
        found, others = outcome(h, "nest")
        assert found == spikes, f"resolution {h}"
        for ours, expected in zip(others, numbers, strict=True):
            assert ours == pytest.approx(expected, rel=1e-9), f"resolution {h}"


def test_times_reach_their_steps():
    check(FEW)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_all_times_reach_their_steps(part: int):
    check(TICKS[part::10])


def test_a_resolution_that_ended_in_a_delay_of_0():
    net = neuro.Network("slow", resolution=0.7)
    net.population("c", 1, neuro.iaf_psc_exp(I_e=500.0, t_ref=2.1))
    sim = neuro.compile(net, "nest")
    sim.run(70.0)
    assert sim.spikes("c")[0] == pytest.approx([14.0, 30.1, 46.2, 62.3])


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
