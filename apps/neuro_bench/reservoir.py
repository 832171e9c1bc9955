"""Opponents for series: an echo state network, the spiking populations without spikes, and the mean of the series.

Also the mean of several models of a series.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from neuro_bench.costs import Costs, arithmetic
from neuro_bench.method import Method
from neuro_bench.population_code import PopulationCode, ridge, scaled, tangents
from neuro_bench.task import Series

WARM_UP = 45
"""Values before the readout learns: 0.6 Lyapunov times, as NeuroBench's."""
REACH = 3.0
"""Standard deviations of the series on both sides of its mean, beyond which nothing is predicted."""


class Members:
    """Models of one series that go on each by itself; said is their mean, which tends to that of the series.

    Args:
        models: one or more.
    """

    def __init__(self, models: Sequence[Any]) -> None:
        self._models = models

    def predict(self, shown: int) -> Series:
        """The next values, the mean of what the members say."""
        said: Series = np.mean([model.predict(shown) for model in self._models], axis=0)
        return said

    def costs(self, shown: int) -> Costs:
        """Those of the first, as often as there are members."""
        one: Costs = self._models[0].costs(shown)
        n = len(self._models)
        words = ("parameters", "footprint_bytes", "effective_macs", "effective_acs", "dense")
        joules = {name: n * value for name, value in one.joules.items()}
        counts: Any = {word: n * getattr(one, word) for word in words}
        return replace(one, joules=joules, **counts)


class EchoState(Method):
    """A drawn recurrent network with a readout by ridge regression, which then hears its own predictions."""

    kind = "series"
    called_by = "echo-state"
    title = "echo state network (Jaeger, GMD Report 148, 2001)"
    settings = {
        "units": 400, "radius": 0.9, "leak": 0.5, "scale": 0.3, "ridge": 1e-7, "connected": 0.1, "members": 3,
    }  # fmt: skip
    space = {
        "radius": (0.4, 0.6, 0.8, 0.9, 1.0, 1.2),
        "leak": (0.3, 0.5, 0.7, 1.0),
        "scale": (0.1, 0.2, 0.3, 0.5, 0.8),
        "ridge": (1e-10, 1e-9, 1e-8, 1e-7, 1e-6),
    }

    def fit(self, train: Series, settings: Mapping[str, Any], seed: int) -> Members:
        """Learn to say the next value; see `Method`."""
        return Members(
            [self._one(train, settings, np.random.default_rng((seed, k, 4))) for k in range(settings["members"])]
        )

    def _one(self, train: Series, settings: Mapping[str, Any], rng: np.random.Generator) -> _Reservoir:
        units = settings["units"]
        inside = rng.uniform(-1.0, 1.0, (units, units)) * (rng.random((units, units)) < settings["connected"])
        inside *= settings["radius"] / max(float(np.abs(np.linalg.eigvals(inside)).max()), 1e-12)
        return _Reservoir(inside, rng.uniform(-1.0, 1.0, (units, 2)) * [1.0, settings["scale"]], settings, train)


class _Reservoir:
    def __init__(self, inside: Any, inward: Any, settings: Mapping[str, Any], train: Series) -> None:
        self._inside, self._inward, self._leak = inside, inward, settings["leak"]
        self._mean, self._std = float(train.mean()), float(train.std())
        seen = (train - self._mean) / self._std
        state, states = np.zeros(len(inside)), np.empty((len(train), len(inside) + 2))
        for k, value in enumerate(seen):
            state = self._next(state, value)
            states[k] = self._seen(state, value)
        x, y = states[WARM_UP:-1], seen[WARM_UP + 1 :]
        gram = x.T @ x + settings["ridge"] * np.eye(x.shape[1])
        self._out = np.linalg.solve(gram, x.T @ y)
        self._state, self._value = state, float(seen[-1])

    def _next(self, state: Any, value: float) -> Any:
        driven = np.tanh(self._inside @ state + self._inward[:, 0] + self._inward[:, 1] * value)
        return (1.0 - self._leak) * state + self._leak * driven

    def _seen(self, state: Any, value: float) -> Any:
        return np.concatenate((state, [value, 1.0]))

    def predict(self, shown: int) -> Series:
        """The next values, each from the one that it said before."""
        state, value, said = self._state, self._value, np.empty(shown)
        for k in range(shown):
            value = float(self._seen(state, value) @ self._out)
            said[k] = value = float(np.clip(value, -REACH, REACH))
            state = self._next(state, value)
        return self._mean + self._std * said

    def costs(self, shown: int) -> Costs:
        """Products of the drawn connections and of the readout, for a value."""
        weights = (self._inside, self._inward, self._out)
        size = sum(each.size for each in weights)
        macs = float(sum(np.count_nonzero(each) for each in weights))
        words: Any = {"connection_sparsity": 1.0 - macs / size, "joules": arithmetic("float32", macs, float(size))}
        sizes: Any = {"parameters": self._out.size, "footprint_bytes": 8 * size}
        return Costs(effective_macs=macs, dense=float(size), **sizes, **words)


class TanhRidge(Method):
    """The functions, delays, members and settings of `PopulationCode`, computed exactly in place of by spikes."""

    kind = "series"
    called_by = "tanh-ridge"
    title = "the same functions of the last values without spikes, and ridge regression"
    settings = {name: value for name, value in PopulationCode.settings.items() if name != "cells"}
    space = PopulationCode.space

    def fit(self, train: Series, settings: Mapping[str, Any], seed: int) -> Members:
        """Learn to say the next value; see `Method`."""
        return Members([_Tangents(train, settings, (seed, k)) for k in range(settings["members"])])


class _Tangents:
    def __init__(self, train: Series, settings: Mapping[str, Any], drawn: tuple[int, int]) -> None:
        self._functions = tangents(settings["functions"], settings["steep"], drawn)
        seen, self._middle, self._reach = scaled(train)
        delays, made = settings["delays"], self._functions(seen)
        self._weights, self._offset = ridge(made, seen, delays, settings["ridge"])
        self._made = made[: -delays - 1 : -1]  # the last value first, as the weights

    def predict(self, shown: int) -> Series:
        """The next values, each from those that it said before."""
        made, said = self._made, np.empty(shown)
        for k in range(shown):
            said[k] = np.clip(self._offset + np.sum(self._weights * made), -1.0, 1.0)
            made = np.concatenate((self._functions(said[k : k + 1]), made[:-1]))
        return self._middle + self._reach * said

    def costs(self, shown: int) -> Costs:
        """Products of the readout and of the functions' slopes, for a value; tangents are not counted."""
        macs = float(self._weights.size + self._weights.shape[1])
        words: Any = {"effective_macs": macs, "dense": macs, "joules": arithmetic("float32", macs, macs)}
        size = self._weights.size
        return Costs(parameters=size, footprint_bytes=8 * (size + 2 * self._weights.shape[1] + 1), **words)


class SeriesMean(Method):
    """The mean of the series: what a method has to beat."""

    kind = "series"
    called_by = "mean"
    title = "the mean of what was seen"

    def fit(self, train: Series, settings: Mapping[str, Any], seed: int) -> _Mean:
        """Keep the mean."""
        return _Mean(float(np.mean(train)))


class _Mean:
    def __init__(self, value: float) -> None:
        self._value = value

    def predict(self, shown: int) -> Series:
        """The same value for ever."""
        return np.full(shown, self._value)

    def costs(self, shown: int) -> Costs:
        """One number."""
        return Costs(parameters=1, footprint_bytes=8)
