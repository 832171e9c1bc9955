"""Methods for series: spiking populations, the same functions without spikes, an echo state network, and the mean.

The spiking populations encode a value as a current into all neurons of a population. The neurons have different
offsets, so each neuron has a threshold value of its own. A neuron fires if the value is above the threshold value, and
fires earlier if the value is further above. The spikes and their times distinguish as many values as there are neurons
times steps (time to first spike: Thorpe, Delorme and Van Rullen, Neural Networks 14:715, 2001). A neuron that has fired
stays silent until spikes of a clock reset all neurons before the next value. The spikes therefore depend on the present
value only.

A spike is weighted by the number of steps after it, like a synaptic current that flows until the reset. The output of a
neuron is thus a staircase function of the value. Sums of such staircases approximate smooth functions. Ridge regression
predicts the next value from the smooth functions of the last values (as in Eliasmith and Anderson, Neural Engineering,
MIT Press 2003). The sums and the regression are linear, so the readout has one weight for each neuron and delay, which
is added at each spike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro.chips import HostWork
from neuro.coding import on_numbers
from neuro_bench.costs import Costs, product_costs, spiking_costs
from neuro_bench.task import Method, Series

EMPTYING, SHOWN = 2, 16
"""Number of steps for the reset and the arrival of the current, and number of steps in which neurons may fire."""
STEPS = EMPTYING + SHOWN
TAU = 4.0
"""Membrane time constant in ms; a step is 1 ms."""
DEEP = 1e4
"""Depth of a neuron's reset below 0, in thresholds, so that it cannot fire again before the clock resets it to 0."""
MARGIN = 1.15
"""Range of predicted values relative to the range of the training values."""
PRICED_VALUES = 75
"""Largest number of values over which costs are averaged."""
Floats = npt.NDArray[np.float64]
LEAST: Floats = -1.0 / np.expm1(-np.arange(1.0, SHOWN + 1.0) / TAU)
"""Smallest current, in thresholds, for a spike in the first step, in the second step, and so on."""
NONE = np.zeros(0, dtype=np.int64)


class PopulationCode(Method):
    """Populations of LIF neurons with a least-squares readout, which predict with their own predictions as input."""

    kind = "series"
    called_by = "population-code"
    title = "spiking populations with delays and a readout by least squares"
    spiking = True
    settings = {"cells": 2000, "functions": 45, "steep": 4.5, "delays": 20, "ridge": 1e-12, "members": 3}
    space = {
        "functions": (30, 45, 60),
        "steep": (3.0, 4.5, 6.0),
        "delays": (16, 20, 24),
        "ridge": (1e-13, 1e-12, 1e-11),
    }

    def fit(self, train: Series, settings: Mapping[str, Any], seed: int) -> _Coded:
        """Fit the prediction of the next value; see `Method`."""
        return _Coded(train, settings, seed)


class _Cells:
    """Populations that encode values from -1 to 1, one for each member. The series does not change them.

    Args:
        count: number of neurons of a population.
        members: number of populations.
        seed: seed of the threshold values.

    Attributes:
        at: threshold values, shape (members, neurons).
        sim: the simulation of all populations.
    """

    def __init__(self, count: int, members: int, seed: int) -> None:
        cell: Any = {"tau_m": TAU, "C_m": TAU, "t_ref": 0.0, "E_L": 0.0, "V_th": 1.0, "V_reset": -DEEP, "V_min": -DEEP}
        shifts = [np.random.default_rng((seed, k, 5)).random() for k in range(members)]
        self.at = 2.0 * (np.arange(count) + np.array(shifts)[:, None]) / count - 1.0
        self._seed, gain, size = seed, _gain(count), members * count
        emptying = np.array([[-2.0 * DEEP], [DEEP * math.exp(-1.0 / TAU)]])  # first all to V_min, then all to 0
        net = neuro.Network("population-code", resolution=1.0)
        value = net.population("value", size, neuro.dc_generator(amplitude=0.0))
        clock = net.population("clock", EMPTYING, neuro.spike_generator())
        cells = net.population("cells", size, neuro.iaf_psc_delta(I_e=LEAST[-1] - gain * self.at.ravel(), **cell))
        net.connect(value, cells, neuro.one_to_one(), weight=gain, delay=1.0)
        net.connect(clock, cells, neuro.all_to_all(), weight=np.tile(emptying, size), delay=1.0)
        self.sim = neuro.compile(net)
        self._amplitude = self.sim.port("value", "amplitude")
        self._stepper = self.sim.stepper(1.0, ["clock"], ["cells"])

    def remaining_shares(self, values: Floats) -> Floats:
        """Return the share of the steps that remain at each neuron's spike, shape (members, neurons).

        A spike in the first of 16 steps gives 1, in the last step 1/16. A neuron without a spike has 0.

        Args:
            values: value of each member, shape (members,).
        """
        self._amplitude.set(np.repeat(values, self.at.shape[1]))
        for step in range(EMPTYING):
            self._stepper.step((np.array([1]), np.array([step])))
        spike_counts, steps_since_spike = np.zeros(self.at.size), np.zeros(self.at.shape)
        for _ in range(SHOWN):
            spike_counts += self._stepper.step((NONE, NONE))[0][0]
            steps_since_spike += spike_counts.reshape(steps_since_spike.shape)
        return steps_since_spike / SHOWN

    def decoders(self, functions: int, steep: float) -> list[Floats]:
        """Return for each member the weights (neurons, functions) that turn remaining shares into smooth functions.

        The functions are those of `tangents`, up to a constant and blurred by the width of a staircase. The weight of a
        neuron is the change of the function between the midpoints to the next smaller and larger threshold value.
        """
        weights = []
        for k, thresholds in enumerate(self.at):
            middles = np.concatenate(([-1.0], (thresholds[1:] + thresholds[:-1]) / 2.0, [1.0]))
            weights.append(np.diff(tangents(functions, steep, (self._seed, k))(middles), axis=0))
        return weights


def tangents(functions: int, steep: float, stream: tuple[int, int]) -> Callable[[Floats], Floats]:
    """Return random hyperbolic tangents: a function from values in [-1, 1] to an array (values, functions).

    Args:
        functions: number of functions.
        steep: mean slope of the functions.
        stream: seed and member, which determine centres and slopes.
    """
    rng = np.random.default_rng((*stream, 6))
    centre, slope = rng.uniform(-1.0, 1.0, functions), steep * rng.uniform(0.5, 1.4, functions)
    return lambda values: np.tanh((values[:, None] - centre) * slope)


def _gain(count: int) -> float:
    """Return the current per value for which the edges of all neurons' staircases are spaced most evenly.

    A neuron fires in or before step k if the value exceeds its threshold value by (LEAST[k] - LEAST[-1]) / gain. The
    spikes change at these edges. Modulo the distance of two threshold values, all neurons have the same edges, which
    are LEAST / gain up to a common shift. The error grows with the sum of the cubes of the gaps between the edges.

    Args:
        count: number of neurons.
    """
    gains, distance = np.linspace(5.0, 20.0, 4001), 2.0 / count
    edges = np.sort(np.mod(LEAST / gains[:, None], distance), axis=1)
    gaps = np.diff(edges, append=edges[:, :1] + distance)
    return float(gains[np.argmin((gaps**3).sum(axis=1))])


_cells = lru_cache(maxsize=4)(_Cells)


@lru_cache(maxsize=4)
def _shares_of_values(cells: _Cells, values: bytes) -> Floats:
    """Return the remaining shares for each value of a series, shape (members, values, neurons).

    Args:
        cells: the populations.
        values: bytes of the values in float64, which the cache can compare.
    """
    return np.stack([cells.remaining_shares(np.full(len(cells.at), value)) for value in np.frombuffer(values)], axis=1)


class _Coded:
    """The populations with readouts fitted to a series; the prediction is the mean of the members' predictions."""

    def __init__(self, train: Series, settings: Mapping[str, Any], seed: int) -> None:
        cells = self._cells = _cells(settings["cells"], settings["members"], seed)
        series, self._middle, self._scale = scaled(train)
        shares, delays = _shares_of_values(cells, series.tobytes()), settings["delays"]
        self._weights = np.empty((len(shares), delays, settings["cells"]))
        self._offsets = np.empty((len(shares), 1))
        for k, decoders in enumerate(cells.decoders(settings["functions"], settings["steep"])):
            weights, self._offsets[k] = ridge(shares[k] @ decoders, series, delays, settings["ridge"])
            self._weights[k] = weights @ decoders.T
        self._sums = np.tile(self._offsets, delays)
        for k in range(len(series) - delays, len(series)):
            self._sums = self._add_value(self._sums, shares[:, k])

    def _add_value(self, sums: Floats, shares: Floats) -> Floats:
        """Drop the sum of the present prediction, and add a value's spikes to the sums of the next predictions.

        Args:
            sums: sums of the next predictions, shape (members, delays).
            shares: remaining shares of the value's spikes, shape (members, neurons).
        """
        contributions: Floats = (self._weights @ shares[:, :, None])[:, :, 0]
        return np.concatenate((sums[:, 1:], self._offsets), axis=1) + contributions

    def predict(self, data: int) -> Series:
        """Return the next values. Each member encodes its own predictions as spikes to predict the following values."""
        sums, predictions = self._sums, np.empty((data, len(self._offsets)))
        for k in range(data):
            predictions[k] = np.clip(sums[:, 0], -1.0, 1.0)
            sums = self._add_value(sums, self._cells.remaining_shares(predictions[k]))
        return np.asarray(self._middle + self._scale * predictions.mean(axis=1))

    def costs(self, data: int) -> Costs:
        """Return the costs of the neurons and of the readout's sums, averaged over the first predictions."""
        sim, n = self._cells.sim, min(data, PRICED_VALUES)
        sim.reset()
        self.predict(n)
        counts: Any = sim.taken()
        members, delays, cells = self._weights.shape
        spikes = counts.counts.populations["cells"].spikes / n
        readout = delays * (spikes + members * SHOWN)  # sums of the spikes' weights, and of the currents in each step
        # Each member's prediction has two limits and a sum. Their mean has a product with a sum, for the scale.
        work = on_numbers(readout + 3 * members + 1, 2 * readout + 2 * members + 3)
        host = [HostWork("readout", work, "value", times=n)]
        costs: Any = spiking_costs(sim, counts, n, steps=STEPS, clock=False, host=host)
        with_readout: Costs = replace(
            costs,
            parameters=self._weights.size,
            footprint_bytes=costs.footprint_bytes + self._weights.nbytes,
            effective_macs=float(members * cells),  # the current into each neuron
            effective_acs=costs.effective_acs + readout,
            dense=costs.dense + members * cells + self._weights.size,
        )
        return with_readout


def scaled(train: Series) -> tuple[Series, float, float]:
    """Scale a series to [-1, 1] with a margin.

    Returns:
        the scaled series x, the middle and the scale, with series = middle + scale x.
    """
    low, high = float(train.min()), float(train.max())
    middle, scale = (low + high) / 2.0, MARGIN * (high - low) / 2.0
    return (train - middle) / scale, middle, scale


def ridge(features: Floats, series: Series, delays: int, strength: float) -> tuple[Floats, float]:
    """Fit the next value by ridge regression on the features of the last values.

    Args:
        features: features of each value, shape (values, features).
        series: the values.
        delays: number of last values.
        strength: penalty, divided by the number of observations and by the number of weights.

    Returns:
        weights, shape (delays, features), with the weights of the last value first, and the offset.
    """
    rows = np.arange(delays - 1, len(series) - 1)
    x = np.stack([features[rows - j] for j in range(delays)], axis=1).reshape(len(rows), -1)
    x_mean, x_std = x.mean(axis=0), x.std(axis=0) + 1e-9
    y_mean = float(series[rows + 1].mean())
    z, y = (x - x_mean) / x_std, series[rows + 1] - y_mean
    is_wide = z.shape[1] > len(rows)  # then the dual form solves the smaller system
    gram = z @ z.T if is_wide else z.T @ z
    gram += strength * z.size * np.eye(len(gram))
    weights = (z.T @ np.linalg.solve(gram, y) if is_wide else np.linalg.solve(gram, z.T @ y)) / x_std
    return weights.reshape(delays, -1), y_mean - float(x_mean @ weights)


WARM_UP = 45
"""Number of values before the fit of the readout: 0.6 Lyapunov times, as in NeuroBench."""
REACH = 3.0
"""Largest distance of a prediction from the mean of the series, in standard deviations."""


class Members:
    """Models of one series that predict independently. The common prediction is the mean of their predictions.

    Args:
        models: one or more models.
    """

    def __init__(self, models: Sequence[Any]) -> None:
        self._models = models

    def predict(self, data: int) -> Series:
        """Return the mean of the members' next values."""
        return np.asarray(np.mean([model.predict(data) for model in self._models], axis=0))

    def costs(self, data: int) -> Costs:
        """Return the costs of the first member times the number of members."""
        costs: Costs = self._models[0].costs(data)
        n = len(self._models)
        fields = ("parameters", "footprint_bytes", "effective_macs", "effective_acs", "dense")
        joules = {name: n * value for name, value in costs.joules.items()}
        counts: Any = {field: n * getattr(costs, field) for field in fields}
        return replace(costs, joules=joules, **counts)


class EchoState(Method):
    """Random recurrent network with a readout from ridge regression, which predicts with its predictions as input."""

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
        """Fit the prediction of the next value; see `Method`."""
        units, members = settings["units"], []
        for k in range(settings["members"]):
            rng = np.random.default_rng((seed, k, 4))
            recurrent = rng.uniform(-1.0, 1.0, (units, units)) * (rng.random((units, units)) < settings["connected"])
            recurrent *= settings["radius"] / max(float(np.abs(np.linalg.eigvals(recurrent)).max()), 1e-12)
            input_weights = rng.uniform(-1.0, 1.0, (units, 2)) * [1.0, settings["scale"]]
            members.append(_Reservoir(recurrent, input_weights, settings, train))
        return Members(members)


class _Reservoir:
    def __init__(self, recurrent: Any, input_weights: Any, settings: Mapping[str, Any], train: Series) -> None:
        self._recurrent, self._input, self._leak = recurrent, input_weights, settings["leak"]
        self._mean, self._std = float(train.mean()), float(train.std())
        series = (train - self._mean) / self._std
        state, states = np.zeros(len(recurrent)), np.empty((len(train), len(recurrent) + 2))
        for k, value in enumerate(series):
            state = self._next(state, value)
            states[k] = np.append(state, (value, 1.0))
        x, y = states[WARM_UP:-1], series[WARM_UP + 1 :]
        gram = x.T @ x + settings["ridge"] * np.eye(x.shape[1])
        self._out = np.linalg.solve(gram, x.T @ y)
        self._state, self._value = state, float(series[-1])

    def _next(self, state: Any, value: float) -> Any:
        activation = np.tanh(self._recurrent @ state + self._input[:, 0] + self._input[:, 1] * value)
        return (1.0 - self._leak) * state + self._leak * activation

    def predict(self, data: int) -> Series:
        """Return the next values, each computed from the previous prediction."""
        state, value, predictions = self._state, self._value, np.empty(data)
        for k in range(data):
            value = float(np.append(state, (value, 1.0)) @ self._out)
            predictions[k] = value = float(np.clip(value, -REACH, REACH))
            state = self._next(state, value)
        return self._mean + self._std * predictions

    def costs(self, data: int) -> Costs:
        """Count the products of the recurrent connections and of the readout for a value."""
        weights = (self._recurrent, self._input, self._out)
        size = sum(array.size for array in weights)
        macs = float(sum(np.count_nonzero(array) for array in weights))
        return product_costs(self._out.size, 8 * size, macs, float(size), connection_sparsity=1.0 - macs / size)


class TanhRidge(Method):
    """The functions, delays, members and settings of `PopulationCode`, computed exactly instead of by spikes."""

    kind = "series"
    called_by = "tanh-ridge"
    title = "the same functions of the last values without spikes, and ridge regression"
    settings = {name: value for name, value in PopulationCode.settings.items() if name != "cells"}
    space = PopulationCode.space

    def fit(self, train: Series, settings: Mapping[str, Any], seed: int) -> Members:
        """Fit the prediction of the next value; see `Method`."""
        return Members([_Tangents(train, settings, (seed, k)) for k in range(settings["members"])])


class _Tangents:
    def __init__(self, train: Series, settings: Mapping[str, Any], stream: tuple[int, int]) -> None:
        self._functions = tangents(settings["functions"], settings["steep"], stream)
        series, self._middle, self._scale = scaled(train)
        delays, features = settings["delays"], self._functions(series)
        self._weights, self._offset = ridge(features, series, delays, settings["ridge"])
        self._features = features[: -delays - 1 : -1]  # the last value first, as in the weights

    def predict(self, data: int) -> Series:
        """Return the next values, each computed from the previous predictions."""
        features, predictions = self._features, np.empty(data)
        for k in range(data):
            predictions[k] = np.clip(self._offset + np.sum(self._weights * features), -1.0, 1.0)
            features = np.concatenate((self._functions(predictions[k : k + 1]), features[:-1]))
        return self._middle + self._scale * predictions

    def costs(self, data: int) -> Costs:
        """Count the products for a value: those of the readout and of the functions' slopes, without tanh itself."""
        macs = float(self._weights.size + self._weights.shape[1])
        size = self._weights.size
        return product_costs(size, 8 * (size + 2 * self._weights.shape[1] + 1), macs, macs)


class SeriesMean(Method):
    """The mean of the training series, the baseline that a method must beat."""

    kind = "series"
    called_by = "mean"
    title = "the mean of the training series"

    def fit(self, train: Series, settings: Mapping[str, Any], seed: int) -> _Mean:
        """Compute the mean."""
        return _Mean(float(np.mean(train)))


class _Mean:
    def __init__(self, value: float) -> None:
        self._value = value

    def predict(self, data: int) -> Series:
        """Return the mean for each value."""
        return np.full(data, self._value)

    def costs(self, data: int) -> Costs:
        """Return the size of one number; no operations."""
        return Costs(parameters=1, footprint_bytes=8)
