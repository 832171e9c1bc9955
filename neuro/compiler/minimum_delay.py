"""Delays that are drawn or follow from distance: what is too early for a spike.

They are rounded to steps, and what rounds to none is one step. That goes for tails and for neurons at one place; where
all are too early, or one lies before its spike, the description is mistaken.
"""

from __future__ import annotations

import math

import numpy as np

from neuro.compiler.connect import Connections
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, words_of
from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.space import of_distance
from neuro.program.program import Floats

_SLACK = 1e-9
"""Steps below 0 that a function of distance may be by rounding."""


def check_distribution(value: Distribution | of_distance, clock: Clock, what: str) -> None:
    """What the bounds of a distribution tell before it is drawn.

    Raises:
        ModelError: its values lie below 0, or its middle below one step.
    """
    match value:
        case uniform():
            if value.low < 0.0:
                hint = f"low: {clock.resolution:g} is one step"
                raise ModelError(
                    f"{what}: uniform.low = {value.low:g} ms: expected at least 0 ms", hint=hint, path=words_of(what)
                )
            if _none(value.high, clock):
                hint = "a finer resolution has shorter steps"
                message = f"{what}: uniform.high = {value.high:g} ms: {_expected(clock)}"
                raise ModelError(message, hint=hint, path=words_of(what))
        case normal() | lognormal():
            centre = value.mean if isinstance(value, normal) else math.exp(min(value.mean, 700.0))
            middle = min(max(centre, value.low), value.high)
            if _none(middle, clock):
                hint = f"only its tail is cut; raise {value.name}.mean, or set {value.name}.low"
                message = f"{what}: the middle of the {value.name} is {middle:.3g} ms: {_expected(clock)}"
                raise ModelError(message, hint=hint, path=words_of(what))


def check_values(
    value: Distribution | of_distance, delays: Floats, found: Connections, clock: Clock, what: str
) -> None:
    """What the values tell, of those that have no tail.

    Args:
        value: what they follow from.
        delays: of each synapse, in ms.
        found: the synapses.
        clock: of the network.
        what: their name in messages.

    Raises:
        ModelError: one lies below 0, or all below one step.
    """
    # Judged before they were drawn: a tail below one step is rounded up to it.
    if isinstance(value, (uniform, normal, lognormal)) or not delays.size:
        return
    function = isinstance(value, of_distance)
    first = int(delays.argmin())
    if delays[first] < -_SLACK * clock.resolution:
        first = int((delays < -_SLACK * clock.resolution).argmax())
        pre, post = found.ends(first)
        hint = "the function of distance is below 0 there: raise c" if function else "'sample' must give at least 0"
        message = f"{what} of synapse {pre} -> {post} = {delays[first]:.4g} ms: expected at least 0 ms"
        raise ModelError(message, hint=hint, path=words_of(what))
    if _none(float(delays.max()), clock):
        hint = "the function of distance is too small: raise c" if function else ""
        message = f"{what}: the largest of {delays.size} is {delays.max():.3g} ms"
        raise ModelError(f"{message}: {_expected(clock)}", hint=hint, path=words_of(what))


def _none(delay: float, clock: Clock) -> bool:
    """Whether a delay rounds to no step."""
    return bool(np.rint(delay / clock.resolution) < 1)


def _expected(clock: Clock) -> str:
    return f"expected at least one step, {clock.resolution:g} ms"
