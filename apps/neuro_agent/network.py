"""The settings and the network of an agent: places excite a critic and, for each number of an action, a circuit.

Its world says how the network sees, acts and is taught; `neuro.closed_loop` runs it as well as `ActorCritic`.
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
"""What a seed may be, as of `neuro.compile`."""
USUAL = 24
"""Active places to which rates refer."""
LEARNING = ("event", "reference")
"""Backends that have neurons that draw, and rules that learn from move to move."""


@dataclass(frozen=True, kw_only=True)
class Settings(apps.Settings):
    """Of the network and of its learning; the defaults are one set for all tasks.

    Attributes:
        encoder: what stands for an observation, of `neuro.coding`: "places", "tiles", "one_hot" or "population".
        spikes: "regular", or "poisson" for spikes at random times.
        group: dimensions of an observation that one group of places sees together.
        fields: places of a grid, or bells, along a continuous dimension.
        active: places that are to be active at a time: so many grids a group has, each shifted by a share of a field,
            that this is about their number; at least one.
        critics: neurons of the critic.
        levels: actions along a dimension of a continuous action space, between which a circuit chooses.
        circuits: that choose along a dimension of a continuous action space; the action is the mean of their choices.
        reward_scale: what a typical reward of random moves in each step, for ever, is worth to the critic.
        discount: of the reward of the next control step, gamma.
        decay: of eligibility from one control step to the next beside `discount`, lambda.
        actor_rate: by how much an error of 1 changes the preference for an action in the same state, mV.
        critic_rate: which share of an error the value in the same state takes over. Both rates are those of USUAL
            active places; of fewer they are less, see `rates_of`.
        errors: "plain", or "normalised": scaled for the actor by their own running size.
        novelty: reward for a state that has not been seen, in typical rewards; it falls as 1 / sqrt(times seen).
        sharpness: how many times as sharply as while learning a frozen agent tells preferences apart: it need not try.
        explore: control steps at random before learning: the bounds of dimensions that have none are learnt from them,
            and the scale of rewards.
        backend: on which it learns, "event" or "reference"; chips have no neurons that draw.
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
            message = f"agent: backend = {self.backend!r}: it learns on {' or '.join(LEARNING)}"
            raise ModelError(message, hint="train on event, then agent.test(env, backend='loihi')")
        super().__post_init__()

    def place(self) -> str:
        """Return what messages call it."""
        return "an agent"

    def plain(self) -> dict[str, Any]:
        """Return the values by name."""
        return self.as_words()


Floats: TypeAlias = npt.NDArray[np.float64]
Weights: TypeAlias = Mapping[str, Floats]

STEP = 20
"""Ticks of 1 ms of a control step."""
TAU = 5.0
"""Time constant of membranes and traces in ms: what one control step has left is gone in the next."""
CRITIC = "critic"
TYPICAL = 0.05
"""Root mean square of an error to which errors are normalised."""
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


def encoder_of(settings: Settings) -> Any:
    """Return the encoder that stands for observations."""
    encoder = ENCODERS[settings.encoder]
    return encoder(**{word: getattr(settings, word) for word in encoder.quantities() if hasattr(settings, word)})


def network(
    settings: Settings,
    places: Any,
    actions: Actions,
    environment: Mapping[str, Any],
    learnt: Weights | None = None,
) -> neuro.Network:
    """The network that learns, or with `learnt` one whose synapses are static and that has no critic.

    Args:
        settings: of the network, its learning and its world.
        places: the neurons that stand for observations, with their fields.
        actions: what the neurons of the circuits stand for.
        environment: words of the world's environment.
        learnt: weights by projection, mV, (places, neurons).
    """
    net = neuro.Network("actor_critic", resolution=1.0)
    etas = _etas(rates_of(settings, places.active), places.active)
    circuits = [circuit(k) for k in range(len(actions.sizes))]
    here = net.population("places", places.size, neuro.spike_generator())
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
    for k, size in enumerate(actions.sizes):
        width = 1.0 if learnt is None else 1.0 / settings.sharpness
        actor = net.population(circuits[k], size, neuro.soft_wta(tau_m=TAU, Delta_V=width))
        rule: Synapse = neuro.static(receptor="ex")
        if learnt is None:
            net.signal(f"error{k}", to=actor)
            rule = neuro.reinforce(signal=f"error{k}", eta=etas[0], receptor="ex", **common)
        connect(actor, f"policy{k}", rule)
        asked = neuro.static(receptor="ask")
        net.connect(ask, actor, neuro.all_to_all(), asked, weight=1.0, delay=1.0, name=f"ask{k}")
    novelty: dict[str, Any] = {"novelty": settings.novelty, "places": "places"} if settings.novelty else {}
    td: dict[str, Any] = {
        "critic": CRITIC,
        "discount": settings.discount,
        "rest": REST,
        "gain": GAIN,
        "worth": settings.reward_scale,
    }
    same = TEACHERS["same"](as_="error", size=TYPICAL if settings.errors == "normalised" else None)
    errors = {"error": TEACHERS["td"](**td, **novelty), **{f"error{k}": same for k in range(len(circuits))}}
    net.world(
        environment=environment,
        step=float(STEP),
        observe={"places": encoder_of(settings), "ask": ENCODERS["pulse"]()},
        act=DECODERS["winner"](of=circuits),
        reward=errors if learnt is None else None,
        explore=settings.explore,
    )
    return net


def rates_of(settings: Settings, active: int) -> tuple[float, float]:
    """By how much an error of 1 changes the preference for an action, and the value, in the state of `active` places.

    The settings are those of USUAL places. One place that stands for a state alone takes all of an error's noise, which
    many share; the exponent is that with which both FrozenLake (one place) and MountainCar (24) are learnt.
    """
    share = (active / USUAL) ** (2.0 / 3.0)
    return settings.actor_rate * share, settings.critic_rate * share


def _etas(rates: tuple[float, float], active: int) -> tuple[float, float]:
    """The learning rates of the rules in mV, for the actor and the critic.

    An active place brings x, which is 1 / (1 - exp(-PERIOD / tau)) at a spike and decays; the means are over a period.
    """
    actor, critic = rates
    x = np.exp(-np.arange(PERIOD) / TAU) / (1.0 - math.exp(-PERIOD / TAU))
    return actor / (active * float(np.mean(x**2))), critic / (active * REST * float(np.mean(x)) ** 2)
