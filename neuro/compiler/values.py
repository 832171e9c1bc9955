"""Numbers, arrays, files and distributions as flat arrays."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Apart
from neuro.compiler.connections import Connections
from neuro.compiler.pairs import BLOCK, blocks
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, words_of
from neuro.core.keyed_random import generator
from neuro.core.values import plain, shown
from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.space import Profile, of_distance
from neuro.program.program import Floats

LONGEST_DELAY = 2**16
"""Steps that a delay may have."""

Steps: TypeAlias = NDArray[np.integer[Any]]
Room: TypeAlias = NDArray[np.floating[Any]]


def per_neuron(value: Any, shape: tuple[int, ...], what: str, key: tuple[int, str, str]) -> Floats:
    """One value for each neuron of a population, or one for all (shape (1,)).

    Args:
        value: a number, an array of the population's shape or flat, or a distribution.
        shape: the population's.
        what: its name in messages.
        key: of a distribution's draws, see `keyed_random.generator`.
    """
    size = int(np.prod(shape))
    value = plain(value)
    if isinstance(value, Distribution):
        return value.drawn(generator(*key), size)
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return array.reshape(1) + 0.0
    if array.shape not in (shape, (size,)):
        message = f"{what}: an array of shape {list(array.shape)}: expected {_one_of({shape, (size,)})}"
        raise ModelError(message, hint="one value for each neuron, or one number for all", path=words_of(what))
    return array.reshape(-1) + 0.0


def per_synapse(
    value: Any, found: Connections, what: str, rng: np.random.Generator, apart: Apart, room: Room | None = None
) -> Floats:
    """One value for each synapse in the program's order, or one for all (shape (1,)).

    Args:
        value: a number, an array in the order of the rule, a distribution or a function of distance.
        found: the synapses.
        what: its name in messages.
        rng: draws from a distribution.
        apart: gives what lies between neurons, for a function of distance.
        room: memory for the values of all synapses, which may be used; that of 32 bits only if all fit.
    """
    if what in found.factors:
        own = replace(found, factors={})
        factor = found.factors[what]
        scaled = per_synapse(value, own, what, rng, apart) * factor if found.size else factor
        if not np.isfinite(scaled).all():
            raise ModelError(f"{what}: {shown(value)} x the file's values is too large: expected finite numbers")
        return scaled + 0.0
    value = plain(value)
    if isinstance(value, Distribution):
        drawn: Floats = _drawn(value, found, rng, room)
        return drawn
    if isinstance(value, of_distance):
        return _by_distance(value.profile, found, what, apart) + 0.0
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return array.reshape(1) + 0.0
    if not found.listed:
        text = (
            f"{what}: an array of shape {list(array.shape)} for synapses that are drawn at random: "
            "expected a number or a distribution"
        )
        raise ModelError(text, hint="neuro.pairs lists synapses that can have a value each", path=words_of(what))
    if array.shape not in found.listed:
        message = f"{what}: an array of shape {list(array.shape)}: expected {_one_of(set(found.listed))}"
        raise ModelError(message, path=words_of(what))
    flat = array.reshape(-1)
    return (flat if found.order is None else flat[found.order]) + 0.0


def _drawn(value: Distribution, found: Connections, rng: np.random.Generator, room: Room | None) -> Any:
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


def _pieces(
    value: Distribution | of_distance, found: Connections, what: str, rng: np.random.Generator, apart: Apart
) -> Iterator[Floats]:
    """The values of all synapses, some at a time."""
    if isinstance(value, Distribution) and found.shared is None:
        yield from value.pieces(rng, found.size)
    else:
        yield per_synapse(value, found, what, rng, apart)


def _by_distance(profile: Profile, found: Connections, what: str, apart: Apart) -> Floats:
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


def delay_steps(
    value: Any,
    found: Connections,
    clock: Clock,
    what: str,
    rng: np.random.Generator,
    apart: Apart,
    small: bool = False,
) -> Steps:
    """Delays in steps. Those drawn, of distance and of a file are rounded, to at least one step; given ones lie on it.

    With `small` drawn ones take a byte each where none is longer than 255 steps.
    """
    if what in found.factors:
        whole = np.maximum(np.rint(per_synapse(value, found, what, rng, apart) / clock.resolution), 1.0)
        if whole.max(initial=1.0) > LONGEST_DELAY:
            raise too_late(f"the longest {what}", int(whole.max()), clock)
        return whole.astype(np.int32)
    value = plain(value)
    if isinstance(value, (Distribution, of_distance)):
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
    if np.ndim(value):
        steps = clock.steps(per_synapse(value, found, what, rng, apart), what)
    else:
        steps = one_delay(value, clock, what)
    far = np.flatnonzero(steps > LONGEST_DELAY)
    if far.size:
        raise too_late(f"{what}[{far[0]}]" if steps.size > 1 else what, int(steps.ravel()[far[0]]), clock)
    early = np.flatnonzero(steps < 1)
    if early.size:
        message = f"{what}[{early[0]}] = 0 ms: expected at least the resolution, {clock.resolution:g} ms"
        raise ModelError(message, path=words_of(what), kind="resolution")
    return steps.astype(np.int32)


def too_late(what: str, step: int, clock: Clock) -> ModelError:
    """The error for a delay that would need too much memory for what is under way."""
    longest = clock.ms(LONGEST_DELAY)
    return ModelError(
        f"{what} = {clock.ms(step):g} ms: expected at most {longest:g} ms, 2^16 steps", path=words_of(what)
    )


def one_delay(value: Any, clock: Clock, what: str) -> NDArray[np.int64]:
    """One delay in steps, shape (1,)."""
    step = clock.step(value, what)
    if step < 1:
        message = f"{what} = {value:g} ms: expected at least the resolution, {clock.resolution:g} ms"
        raise ModelError(message, hint=f"the smallest is {clock.ms(1):g} ms", path=words_of(what), kind="resolution")
    if step > LONGEST_DELAY:
        raise too_late(what, step, clock)
    return np.array([step], dtype=np.int64)


def _one_of(shapes: set[tuple[int, ...]]) -> str:
    return " or ".join(str(list(s)) for s in sorted(shapes, key=len, reverse=True))


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
