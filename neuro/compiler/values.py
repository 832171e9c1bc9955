"""Conversion of numbers, arrays, files and distributions to flat arrays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import GetGeometry
from neuro.compiler.connections import Connections
from neuro.compiler.drawn_values import (
    LONGEST_DELAY as LONGEST_DELAY,
    Buffer as Buffer,
    Steps as Steps,
    drawn_delays,
    drawn_values,
    too_long_delay as too_long_delay,
    values_of_distance,
)
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, words_of
from neuro.core.keyed_random import generator
from neuro.core.values import plain, shown
from neuro.model.distributions import Distribution
from neuro.model.space import of_distance
from neuro.program.program import Floats


def per_neuron(value: Any, shape: tuple[int, ...], label: str, key: tuple[int, str, str]) -> Floats:
    """Return one value per neuron of a population, or a single shared value, shape (1,).

    The array is a copy, in which -0.0 is 0.0.

    Args:
        value: a number, an array of the population's shape or flat, or a distribution.
        shape: shape of the population.
        label: name of the value in messages.
        key: key of a distribution's draws, see `keyed_random.generator`.
    """
    size = int(np.prod(shape))
    value = plain(value)
    if isinstance(value, Distribution):
        return value.checked_sample(generator(*key), size)
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return array.reshape(1) + 0.0
    if array.shape not in (shape, (size,)):
        message = f"{label}: an array of shape {list(array.shape)}: expected {_one_of({shape, (size,)})}"
        raise ModelError(message, hint="one value for each neuron, or one number for all", path=words_of(label))
    return array.reshape(-1) + 0.0


def per_synapse(
    value: Any,
    connections: Connections,
    label: str,
    rng: np.random.Generator,
    get_geometry: GetGeometry,
    buffer: Buffer | None = None,
) -> Floats:
    """Return one value per synapse in the program's order, or a single shared value, shape (1,).

    Args:
        value: a number, an array in the order of the rule, a distribution or a function of distance.
        connections: the synapses.
        label: name of the value in messages.
        rng: generator for the draws of a distribution.
        get_geometry: function that returns positions and distances of neurons, for a function of distance.
        buffer: memory that may be used for the values. The caller passes 32 bits only if all values fit.
    """
    if label in connections.factors:  # a file of synapses has a factor for each
        unscaled = replace(connections, factors={})
        factor = connections.factors[label]
        scaled = per_synapse(value, unscaled, label, rng, get_geometry) * factor if connections.size else factor
        if not np.isfinite(scaled).all():
            raise ModelError(f"{label}: {shown(value)} times the file's values is too large: expected finite numbers")
        return scaled + 0.0
    value = plain(value)
    if isinstance(value, Distribution):
        values: Floats = drawn_values(value, connections, rng, buffer)
        return values
    if isinstance(value, of_distance):
        return values_of_distance(value.profile, connections, label, get_geometry) + 0.0
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return array.reshape(1) + 0.0
    if not connections.weight_shapes:
        text = (
            f"{label}: an array of shape {list(array.shape)} for synapses that are drawn at random: "
            "expected a number or a distribution"
        )
        raise ModelError(text, hint="list synapses with neuro.pairs to give each a value", path=words_of(label))
    if array.shape not in connections.weight_shapes:
        message = f"{label}: an array of shape {list(array.shape)}: expected {_one_of(set(connections.weight_shapes))}"
        raise ModelError(message, path=words_of(label))
    flat = array.reshape(-1)
    return (flat if connections.order is None else flat[connections.order]) + 0.0


def delay_steps(
    value: Any,
    connections: Connections,
    clock: Clock,
    what: str,
    rng: np.random.Generator,
    get_geometry: GetGeometry,
    small: bool = False,
) -> Steps:
    """Return delays in steps. Delays from a distribution, a distance or a file are rounded to at least one step.

    Other delays must be multiples of the resolution. With `small`, drawn delays up to 255 steps are stored in a byte
    each.
    """
    if what in connections.factors:
        in_steps = np.maximum(np.rint(per_synapse(value, connections, what, rng, get_geometry) / clock.resolution), 1.0)
        if in_steps.max(initial=1.0) > LONGEST_DELAY:
            raise too_long_delay(f"the longest {what}", int(in_steps.max()), clock)
        return in_steps.astype(np.int32)
    value = plain(value)
    if isinstance(value, (Distribution, of_distance)):
        return drawn_delays(value, connections, clock, what, rng, get_geometry, small)
    if np.ndim(value):
        steps = clock.steps(per_synapse(value, connections, what, rng, get_geometry), what)
    else:
        steps = one_delay(value, clock, what)
    too_long = np.flatnonzero(steps > LONGEST_DELAY)
    if too_long.size:
        raise too_long_delay(
            f"{what}[{too_long[0]}]" if steps.size > 1 else what, int(steps.ravel()[too_long[0]]), clock
        )
    too_short = np.flatnonzero(steps < 1)
    if too_short.size:
        message = f"{what}[{too_short[0]}] = 0 ms: expected at least the resolution, {clock.resolution:g} ms"
        raise ModelError(message, path=words_of(what), kind="resolution")
    return steps.astype(np.int32)


def one_delay(value: Any, clock: Clock, what: str) -> NDArray[np.int64]:
    """Return one delay in steps, shape (1,)."""
    step = clock.step(value, what)
    if step < 1:
        message = f"{what} = {value:g} ms: expected at least the resolution, {clock.resolution:g} ms"
        raise ModelError(message, hint=f"the smallest is {clock.ms(1):g} ms", path=words_of(what), kind="resolution")
    if step > LONGEST_DELAY:
        raise too_long_delay(what, step, clock)
    return np.array([step], dtype=np.int64)


def _one_of(shapes: set[tuple[int, ...]]) -> str:
    return " or ".join(str(list(s)) for s in sorted(shapes, key=len, reverse=True))
