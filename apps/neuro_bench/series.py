"""Methods for series: spiking populations and the same functions without spikes, an echo state network, the mean.

The spiking populations have a readout of the last values. A value is a current into all neurons of a population, whose
offsets differ, so each fires from another value on, and the further the value is above that, the sooner. Which neurons
fire, and when, distinguishes as many values as there are neurons times steps (time to first spike: Thorpe, Delorme and
Van Rullen, Neural Networks 14:715, 2001). A neuron that has fired is silent until a clock's spikes empty all neurons
for the next value, so the spikes follow from the value alone.

A spike counts for the steps that are left, as by a synaptic current that flows until then, so each neuron adds a
staircase of the value. A smooth function is a sum of these, and ridge regression says the next value from such
functions of the last so many values (as in Eliasmith and Anderson, Neural Engineering, MIT Press 2003). Both are
linear, so the readout is one weight for each neuron and delay, added at each spike.
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
from neuro_bench.costs import PICOJOULES, Costs, product_costs, spiking_costs
from neuro_bench.task import Method, Series

EMPTYING, SHOWN = 2, 16
"""Steps until the neurons are empty and the current has come, and steps that neurons may fire in."""
STEPS = EMPTYING + SHOWN
TAU = 4.0
"""ms, of the membrane; a step is 1 ms."""
DEEP = 1e4
"""Thresholds below 0 that a neuron is left at by its spike, from where no current brings it back in time."""
MARGIN = 1.15
"""What can be said reaches this much further from the middle of the values that were seen than these."""
PRICED_VALUES = 75
"""Values that costs are the mean of, at most."""
Floats = npt.NDArray[np.float64]
LEAST: Floats = -1.0 / np.expm1(-np.arange(1.0, SHOWN + 1.0) / TAU)
"""Of a threshold: the least current for a spike in the first step, in the second, and so on."""
NONE = np.zeros(0, dtype=np.int64)


class PopulationCode(Method):
    """Populations of LIF neurons with a readout by least squares, which then hear their own predictions."""

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
        """Learn to say the next value; see `Method`."""
        return _Coded(train, settings, seed)


class _Cells:
    """Populations of a seed, one for each member, for values from -1 to 1; the same for all series."""

    def __init__(self, count: int, members: int, seed: int) -> None:
        words: Any = {"tau_m": TAU, "C_m": TAU, "t_ref": 0.0, "E_L": 0.0, "V_th": 1.0, "V_reset": -DEEP, "V_min": -DEEP}
        first = [np.random.default_rng((seed, k, 5)).random() for k in range(members)]
        self.at = 2.0 * (np.arange(count) + np.array(first)[:, None]) / count - 1.0
        self._seed, gain, size = seed, _gain(count), members * count
        emptying = np.array([[-2.0 * DEEP], [DEEP * math.exp(-1.0 / TAU)]])  # first all to V_min, then all to 0
        net = neuro.Network("population-code", resolution=1.0)
        value = net.population("value", size, neuro.dc_generator(amplitude=0.0))
        clock = net.population("clock", EMPTYING, neuro.spike_generator())
        cells = net.population("cells", size, neuro.iaf_psc_delta(I_e=LEAST[-1] - gain * self.at.ravel(), **words))
        net.connect(value, cells, neuro.one_to_one(), weight=gain, delay=1.0)
        net.connect(clock, cells, neuro.all_to_all(), weight=np.tile(emptying, size), delay=1.0)
        self.sim = neuro.compile(net)
        self._amplitude = self.sim.port("value", "amplitude")
        self._stepper = self.sim.stepper(1.0, ["clock"], ["cells"])

    def left(self, values: Floats) -> Floats:
        """The share of the steps that are left from each neuron's spike on, or 0, (members, neurons), at its value."""
        self._amplitude.set(np.repeat(values, self.at.shape[1]))
        for step in range(EMPTYING):
            self._stepper.step((np.array([1]), np.array([step])))
        fired, said = np.zeros(self.at.size), np.zeros(self.at.shape)
        for _ in range(SHOWN):
            fired += self._stepper.step((NONE, NONE))[0][0]
            said += fired.reshape(said.shape)
        return said / SHOWN

    def decoders(self, functions: int, steep: float) -> list[Floats]:
        """For each member weights that make smooth functions of the value from what is left, (neurons, functions).

        They make hyperbolic tangents but for a constant, blurred by the little that a staircase extends over: the
        weight of a neuron is the change of the function from the middle between it and the neuron before to that
        between it and the next.
        """
        found = []
        for k, at in enumerate(self.at):
            middles = np.concatenate(([-1.0], (at[1:] + at[:-1]) / 2.0, [1.0]))
            found.append(np.diff(tangents(functions, steep, (self._seed, k))(middles), axis=0))
        return found


def tangents(functions: int, steep: float, drawn: tuple[int, int]) -> Callable[[Floats], Floats]:
    """Hyperbolic tangents of values from -1 to 1, (values, functions), which a seed and a member draw."""
    rng = np.random.default_rng((*drawn, 6))
    centre, slope = rng.uniform(-1.0, 1.0, functions), steep * rng.uniform(0.5, 1.4, functions)
    return lambda values: np.tanh((values[:, None] - centre) * slope)


def _gain(count: int) -> float:
    """Current of a value, for which the steps of all neurons' staircases divide the values most evenly.

    A neuron fires in a step from its own value on and LEAST / gain further. Taken modulo the distance of two neurons
    these are the steps at which the spikes change; the error grows with the sum of the cubes of their distances.
    """
    gains, apart = np.linspace(5.0, 20.0, 4001), 2.0 / count
    steps = np.sort(np.mod(LEAST / gains[:, None], apart), axis=1)
    gaps = np.diff(steps, append=steps[:, :1] + apart)
    return float(gains[np.argmin((gaps**3).sum(axis=1))])


_cells = lru_cache(maxsize=4)(_Cells)


@lru_cache(maxsize=4)
def _left(cells: _Cells, values: bytes) -> Floats:
    """What is left at each of many values, which all members are shown, (members, values, neurons)."""
    return np.stack([cells.left(np.full(len(cells.at), each)) for each in np.frombuffer(values)], axis=1)


class _Coded:
    """The populations and their readouts of a series; the mean of what they say goes on."""

    def __init__(self, train: Series, settings: Mapping[str, Any], seed: int) -> None:
        cells = self._cells = _cells(settings["cells"], settings["members"], seed)
        seen, self._middle, self._reach = scaled(train)
        left, delays = _left(cells, seen.tobytes()), settings["delays"]
        self._weights = np.empty((len(left), delays, settings["cells"]))
        self._offsets = np.empty((len(left), 1))
        for k, decoders in enumerate(cells.decoders(settings["functions"], settings["steep"])):
            weights, self._offsets[k] = ridge(left[k] @ decoders, seen, delays, settings["ridge"])
            self._weights[k] = weights @ decoders.T
        self._coming = np.tile(self._offsets, delays)
        for k in range(len(seen) - delays, len(seen)):
            self._coming = self._heard(self._coming, left[:, k])

    def _heard(self, coming: Floats, left: Floats) -> Floats:
        """The sums of the next predictions, (members, delays), after a value; the first of them is over.

        Each spike adds its weight, for the steps that are left, to all of them.
        """
        added: Floats = (self._weights @ left[:, :, None])[:, :, 0]
        return np.concatenate((coming[:, 1:], self._offsets), axis=1) + added

    def predict(self, shown: int) -> Series:
        """The next values, each of a member from its spikes that say those before it."""
        coming, said = self._coming, np.empty((shown, len(self._offsets)))
        for k in range(shown):
            said[k] = np.clip(coming[:, 0], -1.0, 1.0)
            coming = self._heard(coming, self._cells.left(said[k]))
        return np.asarray(self._middle + self._reach * said.mean(axis=1))

    def costs(self, shown: int) -> Costs:
        """The bills of chips for the neurons, and the sums of the readout, by the first values that are said."""
        sim, shown = self._cells.sim, min(shown, PRICED_VALUES)
        sim.reset()
        self.predict(shown)
        taken: Any = sim.taken()
        costs: Any = spiking_costs(sim, taken, shown, steps=STEPS, clock=False)
        members, delays, cells = self._weights.shape
        fired = taken.counts.populations["cells"].spikes / shown
        readout = delays * (fired + members * SHOWN)  # a spike's weights, and the currents' flow
        sums, named = PICOJOULES["float32 sum"] * 1e-12 * readout, "{}, and the readout's sums".format
        made: Costs = replace(
            costs,
            parameters=self._weights.size,
            footprint_bytes=costs.footprint_bytes + self._weights.nbytes,
            effective_macs=float(members * cells),  # the current into each neuron
            effective_acs=costs.effective_acs + readout,
            dense=costs.dense + members * cells + self._weights.size,
            joules={named(k): v + sums for k, v in costs.joules.items()},
            joules_of_spikes={named(k): v + sums for k, v in costs.joules_of_spikes.items()},
            unpriced={named(k): v for k, v in costs.unpriced.items()},
        )
        return made


def scaled(train: Series) -> tuple[Series, float, float]:
    """A series from -1 to 1 with a margin, and the value that is 0 and how far 1 is from it."""
    low, high = float(train.min()), float(train.max())
    middle, reach = (low + high) / 2.0, MARGIN * (high - low) / 2.0
    return (train - middle) / reach, middle, reach


def ridge(features: Floats, seen: Series, delays: int, strength: float) -> tuple[Floats, float]:
    """Weights of the features of the last values that say the next, (delays, features), and an offset."""
    rows = np.arange(delays - 1, len(seen) - 1)
    x = np.stack([features[rows - j] for j in range(delays)], axis=1).reshape(len(rows), -1)
    middle, size = x.mean(axis=0), x.std(axis=0) + 1e-9
    mean = float(seen[rows + 1].mean())
    z, y = (x - middle) / size, seen[rows + 1] - mean
    wide = z.shape[1] > len(rows)
    gram = z @ z.T if wide else z.T @ z
    gram += strength * z.size * np.eye(len(gram))
    weights = (z.T @ np.linalg.solve(gram, y) if wide else np.linalg.solve(gram, z.T @ y)) / size
    return weights.reshape(delays, -1), mean - float(middle @ weights)


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
        return np.asarray(np.mean([model.predict(shown) for model in self._models], axis=0))

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
        units, members = settings["units"], []
        for k in range(settings["members"]):
            rng = np.random.default_rng((seed, k, 4))
            inside = rng.uniform(-1.0, 1.0, (units, units)) * (rng.random((units, units)) < settings["connected"])
            inside *= settings["radius"] / max(float(np.abs(np.linalg.eigvals(inside)).max()), 1e-12)
            inward = rng.uniform(-1.0, 1.0, (units, 2)) * [1.0, settings["scale"]]
            members.append(_Reservoir(inside, inward, settings, train))
        return Members(members)


class _Reservoir:
    def __init__(self, inside: Any, inward: Any, settings: Mapping[str, Any], train: Series) -> None:
        self._inside, self._inward, self._leak = inside, inward, settings["leak"]
        self._mean, self._std = float(train.mean()), float(train.std())
        seen = (train - self._mean) / self._std
        state, states = np.zeros(len(inside)), np.empty((len(train), len(inside) + 2))
        for k, value in enumerate(seen):
            state = self._next(state, value)
            states[k] = np.append(state, (value, 1.0))
        x, y = states[WARM_UP:-1], seen[WARM_UP + 1 :]
        gram = x.T @ x + settings["ridge"] * np.eye(x.shape[1])
        self._out = np.linalg.solve(gram, x.T @ y)
        self._state, self._value = state, float(seen[-1])

    def _next(self, state: Any, value: float) -> Any:
        driven = np.tanh(self._inside @ state + self._inward[:, 0] + self._inward[:, 1] * value)
        return (1.0 - self._leak) * state + self._leak * driven

    def predict(self, shown: int) -> Series:
        """The next values, each from the one that it said before."""
        state, value, said = self._state, self._value, np.empty(shown)
        for k in range(shown):
            value = float(np.append(state, (value, 1.0)) @ self._out)
            said[k] = value = float(np.clip(value, -REACH, REACH))
            state = self._next(state, value)
        return self._mean + self._std * said

    def costs(self, shown: int) -> Costs:
        """Products of the drawn connections and of the readout, for a value."""
        weights = (self._inside, self._inward, self._out)
        size = sum(each.size for each in weights)
        macs = float(sum(np.count_nonzero(each) for each in weights))
        return product_costs(self._out.size, 8 * size, macs, float(size), connection_sparsity=1.0 - macs / size)


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
        size = self._weights.size
        return product_costs(size, 8 * (size + 2 * self._weights.shape[1] + 1), macs, macs)


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
