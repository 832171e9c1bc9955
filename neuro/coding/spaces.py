"""Spaces of an environment: observations as dimensions, vectors and spikes; actions as circuits of neurons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from neuro.coding.fields import Dimension
from neuro.core.errors import ModelError

Floats = npt.NDArray[np.float64]
BOUNDLESS = 1e6
"""A bound beyond this number counts as infinite, because spaces without a bound have the largest float."""
EXPECTED = "Box, Discrete, MultiDiscrete, MultiBinary, or a Dict or Tuple of these"


def dimensions_of(space: gymnasium.Space[Any], name: str = "observation") -> list[Dimension]:
    """Return the dimensions of a space of observations, in the order of `flat`.

    Raises:
        ModelError: a part of the space has another type.
    """
    match space:
        case spaces.Discrete():
            return [Dimension(name, int(space.n), int(space.start))]
        case spaces.MultiDiscrete():
            starts = np.ravel(space.start)
            return [Dimension(f"{name}[{k}]", int(n), int(starts[k])) for k, n in enumerate(np.ravel(space.nvec))]
        case spaces.MultiBinary():
            return [Dimension(f"{name}[{k}]", 2) for k in range(int(np.prod(space.shape)))]
        case spaces.Box():
            ends = zip(np.ravel(space.low).astype(float), np.ravel(space.high).astype(float), strict=True)
            whole = np.issubdtype(space.dtype, np.integer)
            return [
                Dimension(f"{name}[{k}]", low=_bound(low), high=_bound(high), whole=whole)
                for k, (low, high) in enumerate(ends)
            ]
        case spaces.Dict():
            return [d for key, part in _parts_by_key(space, name) for d in dimensions_of(part, f"{name}[{key!r}]")]
        case spaces.Tuple():
            return [d for k, part in enumerate(space.spaces) for d in dimensions_of(part, f"{name}[{k}]")]
    raise ModelError(f"{name} space: found {type(space).__name__}: expected {EXPECTED}")


def _parts_by_key(space: spaces.Dict, name: str = "observation") -> list[tuple[str, gymnasium.Space[Any]]]:
    """Return the parts of a Dict sorted by key, because equal spaces may have their keys in different orders."""
    for key in space.spaces:
        if not isinstance(key, str):
            raise ModelError(f"{name} space: the key {key!r} is of type {type(key).__name__}: expected a text")
    return sorted(space.spaces.items())


def _bound(value: float) -> float:
    return value if abs(value) < BOUNDLESS else float(np.copysign(np.inf, value))


def flat(space: gymnasium.Space[Any], observation: Any, n: int = 0) -> Floats:
    """Return observations as vectors, (observations, dimensions).

    The vectors are copies, because many environments reuse the arrays of their observations.

    Args:
        space: space of one observation.
        observation: one observation, or with `n` the observations of a vector of environments.
        n: number of environments; 0 for a single observation.

    Raises:
        ModelError: an observation does not fit the space, or contains NaN.
    """
    leading = (n,) if n else ()
    try:
        if type(space) is not spaces.Box and isinstance(space, (spaces.Dict, spaces.Tuple)):
            vectors = np.concatenate([part.reshape(n or 1, -1) for part in _parts(space, observation, leading)], axis=1)
        else:
            vectors = _array(space, observation, leading).reshape(n or 1, -1)
        is_integer, vectors = vectors.dtype.kind in "biu", vectors.astype(np.float64)
    except (TypeError, ValueError, KeyError, IndexError, OverflowError):
        form_expected = f"{n} of {space}, one for each environment" if n else f"one of {space}"
        shape = getattr(observation, "shape", None)
        form = type(observation).__name__ if shape is None else f"an array of shape {list(shape)}"
        raise ModelError(f"observation: found {form}: expected {form_expected}") from None
    if is_integer:
        return vectors
    is_finite = np.isfinite(vectors)
    if np.count_nonzero(is_finite) < is_finite.size:
        bad = int(np.argmin(is_finite))
        environment, d = divmod(bad, vectors.shape[1])
        number = dimensions_of(space)[d].name + (f" of environment {environment}" if n else "")
        raise ModelError(f"{number} is {vectors.flat[bad]:g}: expected a finite number")
    return vectors


class States:
    """Dimensions with states in an observation, and their values.

    Args:
        space: space of one observation.
    """

    def __init__(self, space: gymnasium.Space[Any]) -> None:
        with_states = [(d, dimension) for d, dimension in enumerate(dimensions_of(space)) if dimension.states]
        self._space, self._columns = space, [d for d, _ in with_states]
        self._first = np.array([dimension.first for _, dimension in with_states])
        self._count = np.array([dimension.states for _, dimension in with_states])

    def check(self, vectors: Floats) -> Floats:
        """Return the vectors, (observations, dimensions), unchanged.

        Raises:
            ModelError: a number is not a state of its dimension.
        """
        if self._columns:
            values = vectors[:, self._columns]
            bad = (values < self._first) | (values >= self._first + self._count) | (values != np.floor(values))
            if bad.any():
                raise ModelError(f"observation: found {values[bad][0]:g}: expected one of {self._space}")
        return vectors


def _parts(space: gymnasium.Space[Any], value: Any, leading: tuple[int, ...]) -> Any:
    """Yield the array of each part of an observation. Its shape is `leading` and the shape of the part's space."""
    if isinstance(space, spaces.Dict):
        for key, part in _parts_by_key(space):
            yield from _parts(part, value[key], leading)
    elif isinstance(space, spaces.Tuple):
        for part, part_value in zip(space.spaces, value, strict=True):
            yield from _parts(part, part_value, leading)
    else:
        yield _array(space, value, leading)


def _array(space: gymnasium.Space[Any], value: Any, leading: tuple[int, ...]) -> npt.NDArray[Any]:
    array = np.asarray(value)
    if array.shape != (*leading, *(space.shape or ())):
        raise ValueError
    return array


ACTIONS = "Discrete, MultiDiscrete, MultiBinary, or a Box with finite bounds"
MOST = 64
"""Largest number of neurons of a circuit, see `neuro.soft_wta`."""


@dataclass(frozen=True)
class Actions:
    """Actions from the spikes of circuits.

    Attributes:
        sizes: number of neurons of each circuit.
        space: space of the actions.
        values: for each circuit of a Box, the number that each neuron stands for, (neurons,); empty for other spaces.
    """

    sizes: tuple[int, ...]
    space: gymnasium.Space[Any]
    values: tuple[npt.NDArray[np.float64], ...] = ()

    def of(self, winners: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
        """Return the actions of all copies, copies first, from the winners of each circuit, (copies, circuits)."""
        if isinstance(self.space, spaces.Box):
            chosen_values = np.stack([values[winners[:, k]] for k, values in enumerate(self.values)], axis=1)
            mean_values = chosen_values.reshape(len(chosen_values), *self.space.shape, -1).mean(axis=-1)
            # The mean of numbers at a bound may lie beyond the bound by rounding.
            winners = np.clip(mean_values, self.space.low, self.space.high)
            if np.issubdtype(self.space.dtype, np.integer):
                winners = np.rint(winners)
        elif isinstance(self.space, spaces.Discrete):
            winners = winners + int(self.space.start)
        elif isinstance(self.space, spaces.MultiDiscrete):
            winners = winners + np.ravel(self.space.start)
        return winners.reshape(-1, *(self.space.shape or ())).astype(self.space.dtype, copy=False)


def actions_of(space: gymnasium.Space[Any], levels: int, circuits: int = 1) -> Actions:
    """Return the circuits for a space of actions.

    Args:
        space: space of the actions.
        levels: number of neurons of each circuit of a Box, for values between the bounds.
        circuits: number of circuits for each number of a Box. The number is the mean of their choices.

    Raises:
        ModelError: the space has another type or no bounds, or needs more neurons than a circuit has.
    """
    actions = _actions(space, levels, circuits)
    if max(actions.sizes, default=0) > MOST:
        raise ModelError(f"action space {space}: {max(actions.sizes)} actions: expected at most {MOST}")
    if not actions.sizes:
        raise ModelError(f"action space {space} is empty: expected {ACTIONS}")
    return actions


def _actions(space: gymnasium.Space[Any], levels: int, circuits: int) -> Actions:
    match space:
        case spaces.Discrete():
            return Actions((int(space.n),), space)
        case spaces.MultiDiscrete():
            return Actions(tuple(int(n) for n in np.ravel(space.nvec)), space)
        case spaces.MultiBinary():
            return Actions((2,) * int(np.prod(space.shape)), space)
        case spaces.Box():
            ends = [np.ravel(bound).astype(np.float64) for bound in (space.low, space.high)]
            if np.abs(ends).max(initial=0.0) >= BOUNDLESS:
                raise ModelError(
                    f"action space {space}: no bounds, or a bound beyond {BOUNDLESS:,.0f}: expected {ACTIONS}",
                    hint="set bounds with a wrapper, gymnasium.wrappers.TransformAction",
                )
            values = tuple(
                np.linspace(low, high, levels) for low, high in zip(*ends, strict=True) for _ in range(circuits)
            )
            return Actions((levels,) * len(values), space, values)
    raise ModelError(f"action space: found {type(space).__name__}: expected {ACTIONS}")
