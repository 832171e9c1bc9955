"""Settings and network of an agent: places excite a critic and, for each number of an action, a circuit.

The network's world defines observations, actions and rewards; `neuro.closed_loop` runs it as well as `ActorCritic`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

import neuro
from neuro import ModelError, apps
from neuro.apps import DECODERS, ENCODERS, TEACHERS, Actions, Quantity, setting
from neuro.coding import PERIOD
from neuro.extend import Synapse

SEED = Quantity(kind="integer", at_least=0, at_most=2**63 - 1)
"""Range of a seed, as for `neuro.compile`."""
USUAL = 24
"""Number of active places to which the learning rates refer."""
LEARNING = ("event", "reference")
"""Backends with neurons that fire at random and rules whose eligibility lasts over moves."""


@dataclass(frozen=True, kw_only=True)
class Settings(apps.Settings):
    """Settings of the network and its learning; one set of defaults for all tasks.

    Attributes:
        encoder: encoder of observations, of `neuro.coding`: "places", "tiles", "one_hot" or "population".
        spikes: "regular", or "poisson" for spikes at random times.
        group: number of dimensions of an observation that one group of places encodes together.
        fields: number of places of a grid, or of bells, along a continuous dimension.
        active: target number of places that are active at a time. Each group has one grid of places or more, shifted
            by shares of a field; the number of grids brings the total nearest to `active`.
        critics: number of neurons of the critic.
        levels: number of actions along a dimension of a continuous action space, between which a circuit chooses.
        circuits: number of circuits along a dimension of a continuous action space; the action is their mean choice.
        reward_scale: value of a state in which every future step brings the typical reward of random moves.
        discount: discount of the next control step, gamma.
        decay: decay of eligibility per control step besides `discount`, lambda.
        actor_rate: change of the preference for an action in the same state by an error of 1, mV.
        critic_rate: share of an error by which the value in the same state changes. Both rates hold for USUAL active
            places and are smaller with fewer places, see `rates_of`.
        errors: "plain", or "normalised": divided, for the actor, by their running size.
        novelty: reward for a new state, in typical rewards; it falls as 1 / sqrt(number of visits).
        sharpness: factor of the preferences of a frozen agent; above 1 it explores less.
        explore: number of random control steps before learning, which measure the bounds of unbounded dimensions and
            the scale of rewards.
        backend: backend for learning, "event" or "reference"; chips have no neurons that fire at random.
    """

    encoder: str = setting("places", words=("places", "tiles", "one_hot", "population"))
    spikes: str = setting("regular", words=("regular", "poisson"))
    group: int = setting(2, at_least=1)
    fields: int = setting(6, at_least=2)
    active: int = setting(USUAL, at_least=1)
    critics: int = setting(100, at_least=1, at_most=10_000)
    levels: int = setting(7, at_least=2)
    circuits: int = setting(1, at_least=1, at_most=64)
    reward_scale: float = setting(1.0, above=0)
    discount: float = setting(0.99, at_least=0, below=1)
    decay: float = setting(0.9, at_least=0, at_most=1)
    actor_rate: float = setting(2.4, "mV", at_least=0)
    critic_rate: float = setting(0.06, at_least=0)
    errors: str = setting("plain", words=("plain", "normalised"))
    novelty: float = setting(0.0, at_least=0)
    sharpness: float = setting(4.0, above=0)
    explore: int = setting(400, at_least=0)
    backend: str = setting("event", words=LEARNING)

    def __post_init__(self) -> None:
        if self.backend not in LEARNING:
            message = f"agent: backend = {self.backend!r}: agents learn on {' or '.join(LEARNING)}"
            raise ModelError(message, hint="train on event, then agent.test(env, backend='loihi')")
        super().__post_init__()

    def place(self) -> str:
        """Return the name of the owner of these settings, for messages."""
        return "an agent"

    def plain(self) -> dict[str, Any]:
        """Return the values by name."""
        return self.as_words()


Floats: TypeAlias = npt.NDArray[np.float64]
Weights: TypeAlias = Mapping[str, Floats]

STEP = 20
"""Length of a control step in ticks of 1 ms."""
TAU = 5.0
"""Time constant of membranes and traces, ms: they decay within a control step."""
CRITIC = "critic"
TYPICAL = 0.05
"""Root mean square of normalised errors."""
BASE, SLOPE, FEEDBACK = 240.0, 180.0, 20.0
"""Rate of a critic's neuron at rest in Hz, its slope in Hz/mV, and the strength of its adaptation.

A spike raises the threshold, which delays the next spike, so the counts vary less than those of a Poisson process. With
this FEEDBACK (1 Hz more rate lowers the drive by FEEDBACK Hz) the counts of a control step vary by 0.14 mV; those of a
Poisson process of the same rate and slope vary by 0.66 mV (sqrt(REST) / GAIN). Noise of the value is noise of the
error, which the actor would learn.
"""
REST, GAIN = 5.98, 3.69
"""Spikes of a critic's neuron per control step without input, and their change per mV of input.

Measured with 400 neurons in 1,500 control steps; from -1 to 1 mV the slope is 3.82 to 2.84.
"""


def circuit(k: int) -> str:
    """Return the name of the population that chooses number k of an action."""
    return f"actor{k}"


def encoder_of(settings: Settings) -> Any:
    """Return the encoder of observations."""
    encoder = ENCODERS[settings.encoder]
    return encoder(**{word: getattr(settings, word) for word in encoder.quantities() if hasattr(settings, word)})


def network(
    settings: Settings,
    places: Any,
    actions: Actions,
    environment: Mapping[str, Any],
    weights: Weights | None = None,
) -> neuro.Network:
    """Return the network that learns, or with `weights` the frozen network with static synapses and no critic.

    Args:
        settings: settings of the network, its learning and its world.
        places: neurons that encode observations, with their fields.
        actions: conversion of the neurons that spiked in the circuits to an action of the environment.
        environment: words of the world's environment.
        weights: weights by projection, mV, (places, neurons).
    """
    net = neuro.Network("actor_critic", resolution=1.0)
    etas = _etas(rates_of(settings, places.active), places.active)
    circuits = [circuit(k) for k in range(len(actions.sizes))]
    place_population = net.population("places", places.size, neuro.spike_generator())
    ask = net.population("ask", 1, neuro.spike_generator())
    common: dict[str, Any] = {"tau": TAU, "decay": settings.discount * settings.decay, "Wmin": -100.0, "Wmax": 100.0}

    def connect(target: Any, name: str, rule: Synapse) -> None:
        weight = 0.0 if weights is None else weights[name].ravel()
        net.connect(place_population, target, neuro.all_to_all(), rule, weight=weight, delay=1.0, name=name)

    if weights is None:
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
    for k, size in enumerate(actions.sizes):
        width = 1.0 if weights is None else 1.0 / settings.sharpness
        actor = net.population(circuits[k], size, neuro.soft_wta(tau_m=TAU, Delta_V=width))
        rule: Synapse = neuro.static(receptor="ex")
        if weights is None:
            net.signal(f"error{k}", to=actor)
            rule = neuro.reinforce(signal=f"error{k}", eta=etas[0], receptor="ex", **common)
        connect(actor, f"policy{k}", rule)
        ask_synapse = neuro.static(receptor="ask")
        net.connect(ask, actor, neuro.all_to_all(), ask_synapse, weight=1.0, delay=1.0, name=f"ask{k}")
    novelty: dict[str, Any] = {"novelty": settings.novelty, "places": "places"} if settings.novelty else {}
    td: dict[str, Any] = {
        "critic": CRITIC,
        "discount": settings.discount,
        "rest": REST,
        "gain": GAIN,
        "worth": settings.reward_scale,
    }
    teacher = TEACHERS["same"](as_="error", size=TYPICAL if settings.errors == "normalised" else None)
    errors = {"error": TEACHERS["td"](**td, **novelty), **{f"error{k}": teacher for k in range(len(circuits))}}
    net.world(
        environment=environment,
        step=float(STEP),
        observe={"places": encoder_of(settings), "ask": ENCODERS["pulse"]()},
        act=DECODERS["winner"](of=circuits),
        reward=errors if weights is None else None,
        explore=settings.explore,
    )
    return net


def rates_of(settings: Settings, active: int) -> tuple[float, float]:
    """Return the change of the preference for an action (mV) and of the value by an error of 1, with `active` places.

    The settings hold for USUAL places. With fewer places each one receives more of the error's noise, so the rates are
    smaller. With the exponent 2/3 the agent learns both FrozenLake (one place) and MountainCar (24).
    """
    share = (active / USUAL) ** (2.0 / 3.0)
    return settings.actor_rate * share, settings.critic_rate * share


def _etas(rates: tuple[float, float], active: int) -> tuple[float, float]:
    """Return the learning rates of the rules in mV, for the actor and the critic.

    The trace of an active place is x = 1 / (1 - exp(-PERIOD / tau)) at a spike, and decays until the next. The
    rates use the means of x and x^2 over a period.
    """
    actor, critic = rates
    x = np.exp(-np.arange(PERIOD) / TAU) / (1.0 - math.exp(-PERIOD / TAU))
    return actor / (active * float(np.mean(x**2))), critic / (active * REST * float(np.mean(x)) ** 2)
