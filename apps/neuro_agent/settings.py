"""What may be chosen of an agent: numbers with their bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from neuro import ModelError
from neuro.apps import Quantity, check_fields, unknown

__all__ = ["SEED", "Settings", "settings_of"]

SEED = Quantity(kind="integer", at_least=0, at_most=2**63 - 1)
"""What a seed may be, as of `neuro.compile`."""


def _number(default: float, **bounds: Any) -> Any:
    return field(default=default, metadata={"quantity": Quantity(**bounds)})


def _word(default: str, *words: str) -> Any:
    return field(default=default, metadata={"quantity": Quantity(kind="word", words=words)})


def _whole(default: int, least: int = 1, **bounds: Any) -> Any:
    return field(default=default, metadata={"quantity": Quantity(kind="integer", at_least=least, **bounds)})


USUAL = 24
"""Active places to which rates refer."""
LEARNING = ("event", "reference")
"""Backends that have neurons that draw, and rules that learn from move to move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
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

    encoder: str = _word("places", "places", "tiles", "one_hot", "population")
    spikes: str = _word("regular", "regular", "poisson")
    group: int = _whole(2)
    fields: int = _whole(6, 2)
    active: int = _whole(USUAL)
    critics: int = _whole(100, at_most=10_000)
    levels: int = _whole(7, 2)
    circuits: int = _whole(1, at_most=64)
    reward_scale: float = _number(1.0, above=0.0)
    discount: float = _number(0.99, at_least=0.0, below=1.0)
    decay: float = _number(0.9, at_least=0.0, at_most=1.0)
    actor_rate: float = _number(2.4, at_least=0.0)
    critic_rate: float = _number(0.06, at_least=0.0)
    errors: str = _word("plain", "plain", "normalised")
    novelty: float = _number(0.0, at_least=0.0)
    sharpness: float = _number(4.0, above=0.0)
    explore: int = _whole(400, 0)
    backend: str = _word("event", *LEARNING)

    def __post_init__(self) -> None:
        check_fields(self, "agent")

    def plain(self) -> dict[str, Any]:
        """The values by name."""
        return asdict(self)


def settings_of(named: Mapping[str, Any]) -> Settings:
    """Settings by name.

    Raises:
        ModelError: a name is unknown, or a value out of bounds.
    """
    known = {one.name for one in fields(Settings)}
    for name in named:
        if name not in known:
            raise unknown("setting of an agent", name, known)
    if named.get("backend", "event") not in LEARNING:
        message = f"agent: backend = {named['backend']!r}: it learns on {' or '.join(LEARNING)}"
        raise ModelError(message, hint="train on event, then agent.test(env, backend='loihi')")
    try:
        return Settings(**named)
    except TypeError as error:
        raise ModelError(f"settings of an agent: {error}") from None
