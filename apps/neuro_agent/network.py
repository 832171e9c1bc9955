"""The network of an agent: places that excite a critic and, for each number of an action, a circuit that chooses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

import neuro
from neuro.extend import Synapse
from neuro_agent.settings import Settings

__all__ = ["CRITIC", "STEP", "TAU", "circuit", "network"]

Weights: TypeAlias = Mapping[str, npt.NDArray[np.float64]]

STEP = 20
"""Ticks of 1 ms of a control step."""
TAU = 5.0
"""Time constant of membranes and traces in ms: what one control step has left is gone in the next."""
CRITIC = "critic"
BASE, SLOPE, FEEDBACK = 240.0, 180.0, 20.0
"""Rate of a critic's neuron at rest in Hz, by how much 1 mV changes it, and how strongly it adapts.

A spike raises the threshold, which holds the next one back: where a rate of 1 Hz more lowers the drive by FEEDBACK Hz,
the counts of a control step vary by 0.14 mV, those of a Poisson process of the same rate and slope by 0.66 mV
(sqrt(REST) / GAIN). What varies in the value is an error that was not made, and the actor follows it.
"""
REST, GAIN = 5.98, 3.69
"""Spikes of a critic's neuron in a control step in which nothing excites it, and by how many 1 mV changes that.

Measured with 400 neurons in 1,500 control steps; from -1 to 1 mV the slope is 3.82 to 2.84.
"""


def circuit(k: int) -> str:
    """The population that chooses the number k of an action."""
    return f"actor{k}"


def network(
    places: int, actions: Sequence[int], settings: Settings, etas: tuple[float, float], learnt: Weights | None = None
) -> neuro.Network:
    """The network that learns, or with `learnt` one whose synapses are static and that has no critic.

    Args:
        places: neurons that stand for observations.
        actions: neurons of each circuit.
        settings: how many neurons the critic has, the decay of eligibility, and how sharply a frozen agent chooses.
        etas: learning rates of actor and critic, mV.
        learnt: weights by projection, mV, (places, neurons).
    """
    net = neuro.Network("actor_critic", resolution=1.0)
    here = net.population("places", places, neuro.spike_generator())
    ask = net.population("ask", 1, neuro.spike_generator())
    common: dict[str, Any] = {"tau": TAU, "decay": settings.discount * settings.decay, "Wmin": -100.0, "Wmax": 100.0}

    def connect(target: Any, name: str, rule: Synapse) -> None:
        weight = 0.0 if learnt is None else learnt[name].ravel()
        net.connect(here, target, neuro.all_to_all(), rule, weight=weight, delay=1.0, name=name)

    if learnt is None:
        point = neuro.pp_psc_delta(
            tau_m=TAU,
            with_reset=False,
            c_1=SLOPE * (1.0 + FEEDBACK),
            c_2=BASE * (1.0 + FEEDBACK),
            c_3=0.0,
            tau_sfa=TAU,
            q_sfa=1000.0 * FEEDBACK / (1.0 + FEEDBACK) / SLOPE * (1.0 - math.exp(-1.0 / TAU)),
        )
        critic = net.population(CRITIC, settings.critics, point)
        net.signal("error", to=critic)
        connect(critic, "value", neuro.td_lambda(signal="error", eta=etas[1], **common))
    for k, size in enumerate(actions):
        width = 1.0 if learnt is None else 1.0 / settings.sharpness
        actor = net.population(circuit(k), size, neuro.soft_wta(tau_m=TAU, Delta_V=width))
        rule: Synapse = neuro.static(receptor="ex")
        if learnt is None:
            net.signal(f"error{k}", to=actor)
            rule = neuro.reinforce(signal=f"error{k}", eta=etas[0], receptor="ex", **common)
        connect(actor, f"policy{k}", rule)
        asked = neuro.static(receptor="ask")
        net.connect(ask, actor, neuro.all_to_all(), asked, weight=1.0, delay=1.0, name=f"ask{k}")
    return net
