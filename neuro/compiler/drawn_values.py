"""Weights and delays from distributions or from the distance between neurons."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import GetGeometry
from neuro.compiler.connections import Connections
from neuro.compiler.pairs import BLOCK, blocks
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, words_of
from neuro.model.distributions import Distribution, lognormal, normal, uniform
from neuro.model.space import Profile, of_distance
from neuro.program.program import Floats

LONGEST_DELAY = 2**16
"""Largest delay in steps."""

Steps: TypeAlias = NDArray[np.integer[Any]]
Buffer: TypeAlias = NDArray[np.floating[Any]]


def drawn_values(value: Distribution, connections: Connections, rng: np.random.Generator, buffer: Buffer | None) -> Any:
    """Return the drawn value of each synapse."""
    if connections.shared is not None:
        # Both directions of a symmetric pair share a draw.
        return value.checked_sample(rng, int(connections.shared.max(initial=-1)) + 1)[connections.shared]
    last = 0
    # In pieces: a second array of all values would double the peak memory of a large network.
    for piece in value.pieces(rng, connections.size):
        if piece.size == connections.size:
            return piece
        if buffer is None or buffer.size != connections.size:
            buffer = np.empty(connections.size)
        first, last = last, last + piece.size
        buffer[first:last] = piece
    assert buffer is not None
    return buffer


def values_of_distance(profile: Profile, connections: Connections, label: str, get_geometry: GetGeometry) -> Floats:
    """Return the value of each synapse as a function of distance."""
    if connections.layout == "grid":
        message = f"{label} of distance: a shared kernel has none: expected numbers or a distribution"
        raise ModelError(message, path=words_of(label))
    space, values = get_geometry(), np.empty(connections.size)
    last = 0
    for pre, post in connections.pairs(len(space.target.places)):
        first, last = last, last + len(pre)
        values[first:last] = profile.values(space.distance(pre, post))
    return values


def drawn_delays(
    value: Distribution | of_distance,
    connections: Connections,
    clock: Clock,
    label: str,
    rng: np.random.Generator,
    get_geometry: GetGeometry,
    small: bool,
) -> Steps:
    """Return delays in steps, rounded, at least one step; arguments as for `delay_steps`."""
    check_distribution(value, clock, label)
    # One byte per synapse for drawn, static delays saves 0.9 GB for 300 M synapses. A single delay above 255
    # steps widens the array.
    delays: Steps = np.empty(connections.size, dtype=np.uint8 if small else np.int32)
    longest, n_done = 0.0, 0
    for piece in _pieces(value, connections, label, rng, get_geometry):
        check_values(value, piece, connections, clock, label)
        for begin, end in blocks(0, piece.size, BLOCK):
            in_steps = piece[begin:end] / clock.resolution
            np.rint(in_steps, out=in_steps)
            longest = max(longest, float(in_steps.max()))
            if longest > np.iinfo(delays.dtype).max:
                delays = delays.astype(np.int32)
            if longest <= LONGEST_DELAY:
                delays[n_done + begin : n_done + end] = np.maximum(in_steps, 1.0, out=in_steps)
        n_done += piece.size
    if longest > LONGEST_DELAY:
        raise too_long_delay(f"the longest {'drawn ' * isinstance(value, Distribution)}{label}", int(longest), clock)
    return delays


def _pieces(
    value: Distribution | of_distance,
    connections: Connections,
    label: str,
    rng: np.random.Generator,
    get_geometry: GetGeometry,
) -> Iterator[Floats]:
    """Yield the values of all synapses in pieces."""
    if isinstance(value, Distribution) and connections.shared is None:
        yield from value.pieces(rng, connections.size)
    elif isinstance(value, Distribution):
        yield drawn_values(value, connections, rng, None)
    else:
        yield values_of_distance(value.profile, connections, label, get_geometry) + 0.0


def too_long_delay(label: str, step: int, clock: Clock) -> ModelError:
    """Return the error for a delay that is too long: its spikes in flight would need too much memory."""
    longest = clock.ms(LONGEST_DELAY)
    return ModelError(
        f"{label} = {clock.ms(step):g} ms: expected at most {longest:g} ms, 2^16 steps", path=words_of(label)
    )


_TOLERANCE = 1e-9
"""Tolerance in steps for values below 0 of a function of distance, because of rounding."""


def check_distribution(value: Distribution | of_distance, clock: Clock, label: str) -> None:
    """Refuse a distribution with delays that are clearly too small, before values are drawn.

    Delays are rounded to whole steps, at least one. A tail below one step is allowed. A distribution with most delays
    below one step, or with negative bounds, is a mistake.

    Raises:
        ModelError: the bounds are below 0, or the middle is below one step.
    """
    match value:
        case uniform():
            if value.low < 0.0:
                hint = f"set low to {clock.resolution:g}, one step"
                raise ModelError(
                    f"{label}: uniform.low = {value.low:g} ms: expected at least 0 ms", hint=hint, path=words_of(label)
                )
            if _rounds_to_zero(value.high, clock):
                hint = "use a finer resolution, which has shorter steps"
                message = f"{label}: uniform.high = {value.high:g} ms: {_expected_one_step(clock)}"
                raise ModelError(message, hint=hint, path=words_of(label))
        case normal() | lognormal():
            centre = value.mean if isinstance(value, normal) else math.exp(min(value.mean, 700.0))
            middle = min(max(centre, value.low), value.high)
            if _rounds_to_zero(middle, clock):
                hint = f"only a tail may be below; raise {value.name}.mean, or set {value.name}.low"
                message = f"{label}: the middle of the {value.name} is {middle:.3g} ms: {_expected_one_step(clock)}"
                raise ModelError(message, hint=hint, path=words_of(label))


def check_values(
    value: Distribution | of_distance, delays: Floats, connections: Connections, clock: Clock, label: str
) -> None:
    """Check drawn or computed delays. Distributions with a tail are left to `check_distribution`.

    Args:
        value: the distribution or function of distance.
        delays: delay of each synapse, in ms.
        connections: the synapses.
        clock: clock of the network.
        label: name of the value in messages.

    Raises:
        ModelError: a delay is below 0, or all are below one step.
    """
    # `check_distribution` has checked `value`. A tail below one step is rounded up to one step.
    if isinstance(value, (uniform, normal, lognormal)) or not delays.size:
        return
    function = isinstance(value, of_distance)
    first = int(delays.argmin())
    if delays[first] < -_TOLERANCE * clock.resolution:
        first = int((delays < -_TOLERANCE * clock.resolution).argmax())
        pre, post = connections.ends(first)
        hint = "the function of distance is below 0 there: raise c" if function else "'sample' must give at least 0"
        message = f"{label} of synapse {pre} -> {post} = {delays[first]:.4g} ms: expected at least 0 ms"
        raise ModelError(message, hint=hint, path=words_of(label))
    if _rounds_to_zero(float(delays.max()), clock):
        hint = "the function of distance is too small: raise c" if function else ""
        message = f"{label}: the largest of {delays.size} is {delays.max():.3g} ms"
        raise ModelError(f"{message}: {_expected_one_step(clock)}", hint=hint, path=words_of(label))


def _rounds_to_zero(delay: float, clock: Clock) -> bool:
    """Return whether a delay rounds to 0 steps."""
    return bool(np.rint(delay / clock.resolution) < 1)


def _expected_one_step(clock: Clock) -> str:
    return f"expected at least one step, {clock.resolution:g} ms"
