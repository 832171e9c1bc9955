"""A critic on a linear track: spiking neurons learn how much the reward at its end is worth from each place.

An animal runs along the track in 4 s, over places whose cells fire regularly, and gets a reward at the end. The value
V is read from the rate of the critic, smoothed by the kernel kappa of the rule; its temporal-difference error teaches
the weights. What comes after the end is worth nothing, so V should be R exp(-(T - t) / tau_r) on the way.

Source: Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013. The neurons are those of its
table 1; the cells of places, the scale of V, the smallest weight and the learning rate are measured choices.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

import neuro

__all__ = ["DURATION", "EVERY", "REWARD", "TAU_R", "Runner", "expected", "network"]

Floats = NDArray[np.float64]

DURATION = 4000.0
"""ms from the start of the track to the reward, T."""
REWARD = 100.0
"""R, in the unit of V."""
TAU_R = 4000.0
"""ms over which rewards are discounted."""
EVERY = 20.0
"""ms between two readings of V."""

_RUN_UP = 600.0  # ms before the start, without learning: V, which is smoothed, begins at nothing
_WIDTH, _APART, _PEAK = 400.0, 200.0, 120.0  # of the places: ms, ms, Hz
_PER_HZ, _V_0 = 2.0, -40.0  # V of a rate: 20 Hz are worth nothing, 70 Hz the reward
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def _spikes() -> tuple[Floats, NDArray[np.int64]]:
    """Times in ms and cells of one run: each fires where the integral of its rate passes a whole number."""
    centres = np.arange(-2.0 * _WIDTH, _RUN_UP + DURATION + 2.0 * _WIDTH + 1.0, _APART)
    times = np.arange(1.0, _RUN_UP + DURATION + 1.0)
    rates = 1e-3 * _PEAK * np.exp(-((times[:, None] - centres) ** 2) / (2.0 * _WIDTH**2))
    whole = np.floor(np.cumsum(rates, axis=0) + np.arange(centres.size) * _GOLDEN % 1.0)
    step, cell = np.nonzero(np.diff(whole, axis=0, prepend=0.0))
    return times[step], cell


def expected() -> tuple[Floats, Floats]:
    """When V is read on a run, in ms from the start, and what it should be."""
    times = np.arange(EVERY, DURATION + 0.5 * EVERY, EVERY)
    return times, REWARD * np.exp(-(DURATION - times) / TAU_R)


def network(critics: int = 20, eta: float = 1.0) -> neuro.Network:
    """Cells of `places`, all to all neurons of the `critic`, which the signal `error` teaches.

    Args:
        critics: how many neurons.
        eta: learning rate, pA.
    """
    cells = neuro.srm0(tau_m=20.0, tau_syn_ex=5.0, E_L=0.0, V_th=16.0, eta_0=5.0, t_ref=0.0, lambda_0=60.0, Delta_V=2.0)
    rule = neuro.td_ltp(signal="error", tau_m=20.0, tau_s=5.0, eta=eta, Wmin=30.0, Wmax=300.0)
    net = neuro.Network("linear_track", resolution=1.0)
    net.population("places", int(_spikes()[1].max()) + 1, neuro.spike_generator())
    net.population("critic", critics, cells)
    net.signal("error", to="critic")
    net.connect("places", "critic", neuro.all_to_all(), rule, weight=65.0, delay=1.0, name="value")
    return net


class Runner:
    """Runs along the track again and again; the critic learns on the way.

    Args:
        sim: of `network`.
    """

    def __init__(self, sim: neuro.Simulation) -> None:
        self._sim = sim
        self._times, self._cells = _spikes()
        self._kappa = np.array([200.0, 50.0])  # ms, the defaults of td_ltp
        self._parts = np.zeros(2)
        self._critics = sim.get("critic", "V_m").size

    def run(self) -> Floats:
        """V at the times of `expected`."""
        sim = self._sim
        sim.inject("places", sim.time + self._times, self._cells)
        self._parts[:] = 0.0
        before = [self._read() for _ in range(round(_RUN_UP / EVERY))]
        values = [before[-1]]
        for _ in range(round(DURATION / EVERY)):
            values.append(self._read())
            slope = (values[-1] - values[-2]) / EVERY
            sim.signal("error", neuro.td_error_rate(0.0, values[-1], slope, TAU_R))
        # The reward comes and V falls to 0: of V' and r only the integrals count, REWARD and -V.
        sim.signal("error", (REWARD - values[-1]) / EVERY)
        sim.run(EVERY)
        sim.signal("error", 0.0)
        sim.forget(before=sim.time)
        return np.array(values[1:])

    def _read(self) -> float:
        """V, a while later."""
        sim = self._sim
        begin = sim.time
        sim.run(EVERY)
        late = sim.time - sim.spikes("critic", since=begin)[0]
        self._parts *= np.exp(-EVERY / self._kappa)
        self._parts += np.exp(-late / self._kappa[:, None]).sum(axis=1)
        rate = 1000.0 * (self._parts[0] - self._parts[1]) / (self._kappa[0] - self._kappa[1]) / self._critics
        return float(_PER_HZ * rate + _V_0)
