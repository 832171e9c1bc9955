"""Weights and delays that are drawn, or that follow from the distance between neurons."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Apart
from neuro.compiler.connections import Connections
from neuro.compiler.pairs import BLOCK, blocks
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, words_of
from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.space import Profile, of_distance
from neuro.program.program import Floats

LONGEST_DELAY = 2**16
"""Steps that a delay may have."""

Steps: TypeAlias = NDArray[np.integer[Any]]
Room: TypeAlias = NDArray[np.floating[Any]]


def drawn_values(value: Distribution, found: Connections, rng: np.random.Generator, room: Room | None) -> Any:
    """The draw that each synapse takes."""
    if found.shared is not None:
        # Both directions of a symmetric pair take one draw.
        return value.drawn(rng, int(found.shared.max(initial=-1)) + 1)[found.shared]
    last = 0
    # Piece by piece into the room: a second array of all values would double what a large network needs at its peak.
    for piece in value.pieces(rng, found.size):
        if piece.size == found.size:
            return piece
        if room is None or room.size != found.size:
            room = np.empty(found.size)
        first, last = last, last + piece.size
        room[first:last] = piece
    assert room is not None
    return room


def values_of_distance(profile: Profile, found: Connections, what: str, apart: Apart) -> Floats:
    """The value of each synapse."""
    if found.layout == "grid":
        message = f"{what} of distance: a shared kernel has none: expected numbers or a distribution"
        raise ModelError(message, path=words_of(what))
    space, values = apart(), np.empty(found.size)
    last = 0
    for pre, post in found.pairs(len(space.target.places)):
        first, last = last, last + len(pre)
        values[first:last] = profile.values(space.distance(pre, post))
    return values


def drawn_delays(
    value: Distribution | of_distance,
    found: Connections,
    clock: Clock,
    what: str,
    rng: np.random.Generator,
    apart: Apart,
    small: bool,
) -> Steps:
    """Delays in steps, rounded, to at least one step; arguments as of `delay_steps`."""
    check_distribution(value, clock, what)
    # A byte a synapse where delays are drawn and static: 300 M synapses save 0.9 GB. A draw above 255 steps widens
    # all.
    late: Steps = np.empty(found.size, dtype=np.uint8 if small else np.int32)
    longest, done = 0.0, 0
    for piece in _pieces(value, found, what, rng, apart):
        check_values(value, piece, found, clock, what)
        for begin, end in blocks(0, piece.size, BLOCK):
            whole = piece[begin:end] / clock.resolution
            np.rint(whole, out=whole)
            longest = max(longest, float(whole.max()))
            if longest > np.iinfo(late.dtype).max:
                late = late.astype(np.int32)
            if longest <= LONGEST_DELAY:
                late[done + begin : done + end] = np.maximum(whole, 1.0, out=whole)
        done += piece.size
    if longest > LONGEST_DELAY:
        raise too_late(f"the longest {'drawn ' * isinstance(value, Distribution)}{what}", int(longest), clock)
    return late


def _pieces(
    value: Distribution | of_distance, found: Connections, what: str, rng: np.random.Generator, apart: Apart
) -> Iterator[Floats]:
    """The values of all synapses, some at a time."""
    if isinstance(value, Distribution) and found.shared is None:
        yield from value.pieces(rng, found.size)
    elif isinstance(value, Distribution):
        yield drawn_values(value, found, rng, None)
    else:
        yield values_of_distance(value.profile, found, what, apart) + 0.0


def too_late(what: str, step: int, clock: Clock) -> ModelError:
    """The error for a delay that would need too much memory for what is under way."""
    longest = clock.ms(LONGEST_DELAY)
    return ModelError(
        f"{what} = {clock.ms(step):g} ms: expected at most {longest:g} ms, 2^16 steps", path=words_of(what)
    )


_SLACK = 1e-9
"""Steps below 0 that a function of distance may be by rounding."""


def check_distribution(value: Distribution | of_distance, clock: Clock, what: str) -> None:
    """Refuse delays whose bounds show before they are drawn that they are too early for a spike.

    Delays are rounded to steps, and what rounds to none is one step. That goes for tails and for neurons at one place;
    where all are too early, or one lies before its spike, the description is mistaken.

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
