"""Numbers, arrays, files and distributions as flat arrays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Apart
from neuro.compiler.connections import Connections
from neuro.compiler.drawn_values import (
    LONGEST_DELAY as LONGEST_DELAY,
    Room as Room,
    Steps as Steps,
    drawn_delays,
    drawn_values,
    too_late as too_late,
    values_of_distance,
)
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, words_of
from neuro.core.keyed_random import generator
from neuro.core.values import plain, shown
from neuro.model.distributions import Distribution
from neuro.model.space import of_distance
from neuro.program.program import Floats


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
        drawn: Floats = drawn_values(value, found, rng, room)
        return drawn
    if isinstance(value, of_distance):
        return values_of_distance(value.profile, found, what, apart) + 0.0
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
        return drawn_delays(value, found, clock, what, rng, apart, small)
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
