"""Every resolution that NEST's clock has: all times reach the step that they mean, as in the reference."""

from typing import Any

import numpy as np
import pytest

import neuro

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
