"""What may be chosen of an agent: numbers with their bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from neuro import ModelError, apps
from neuro.apps import Quantity, setting

__all__ = ["SEED", "Settings"]

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
            active places; of fewer they are less, see `learner.rates_of`.
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
