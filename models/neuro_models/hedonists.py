"""Neurons whose synapses release at random. The output learns for which inputs its spikes are rewarded.

All synapses, from inputs to hidden neurons and from hidden neurons to the output, receive the same reward without any
information about their contribution. Source: Seung, Neuron 40:1063, 2003 (the rule, 60 inputs, 60 hidden neurons, one
output, 0 or 40 Hz, +1 or -1 for each spike of the output). Weights, neurons and learning rates are measured choices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

import neuro

__all__ = ["PATTERNS", "network", "present"]

Floats = NDArray[np.float64]

INPUTS, HIDDEN = 60, 60
PATTERNS: Floats = 40.0 * np.repeat(np.eye(2), INPUTS // 2, axis=1)
"""Rates of the inputs in Hz, shape (2, inputs): pattern A drives the first half of the inputs, B the second."""

_SLICE = 10.0
"""Length of a slice, ms. Spikes of a slice are rewarded during the next one, while eligibility lasts."""


def network(eta: float = 0.2, weight: float = 85.0, spread: float = 1.5) -> neuro.Network:
    """Return inputs whose rates can be set, hidden neurons and an output.

    Args:
        eta: change of q by a reward of 1 at a synapse with eligibility 1; 0 disables learning.
        weight: mean of the weights, pA; 1200 pA in one step make a neuron fire.
        spread: standard deviation of the logarithms of the weights. With equal weights nothing is learnt, because no
            single synapse has an effect above the noise.
    """
    net = neuro.Network("hedonists", resolution=1.0)
    cell = neuro.iaf_psc_exp(tau_m=20.0, E_L=0.0, V_reset=0.0, V_th=15.0, tau_syn_ex=5.0, tau_syn_in=5.0)
    net.population("inputs", INPUTS, neuro.poisson_generator())
    net.population("hidden", HIDDEN, cell)
    net.population("output", 1, cell)
    weights = neuro.lognormal(mean=float(np.log(weight)) - 0.5 * spread**2, std=spread)
    for pre, post in (("inputs", "hidden"), ("hidden", "output")):
        net.signal(f"reward_{post}", to=post)
        rule = neuro.hedonistic(signal=f"reward_{post}", eta=eta)
        net.connect(pre, post, neuro.all_to_all(), rule, weight=weights, delay=1.0, name=f"onto_{post}")
    return net


def present(sim: neuro.Simulation, rates: ArrayLike, rewards: ArrayLike, duration: float = 200.0) -> Floats:
    """Present trials one after the other, and reward each spike of the output.

    Args:
        sim: simulation of `network`.
        rates: rates of the inputs in each trial, Hz, shape (trials, inputs).
        rewards: reward of a spike of the output, shape (trials,).
        duration: duration of a trial, ms; a multiple of 10.

    Returns:
        the rate of the output in each trial, Hz.
    """
    rates, rewards = np.asarray(rates, dtype=np.float64), np.asarray(rewards, dtype=np.float64)
    spikes, reward_now = np.zeros(len(rates)), 0.0
    for trial, (rate, reward) in enumerate(zip(rates, rewards, strict=True)):
        sim.set("inputs", rate=rate)
        for _ in range(round(duration / _SLICE)):
            begin = sim.time
            sim.run(_SLICE)
            fired = len(sim.spikes("output", since=begin)[0])
            spikes[trial] += fired
            if reward_now != (reward_now := reward * fired / _SLICE):
                for post in ("hidden", "output"):
                    sim.signal(f"reward_{post}", reward_now)
        sim.forget(before=sim.time)
    return 1000.0 * spikes / duration
