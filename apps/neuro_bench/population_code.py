"""A spiking network for series: populations of LIF neurons that say each value in spikes, and a readout of the last.

The value is a current into all neurons of a population, whose gains and offsets differ, so each fires from another
value on, up or down, once. It stays for some steps, after the value halfway from the one before; a clock's spikes
empty the neurons in between, so which neurons fire depends on the current alone. A smooth function of the current is
the sum of its changes where neurons begin or cease to fire, and ridge regression says the next value from such
functions of the last so many values (as in Eliasmith and Anderson, Neural Engineering, MIT Press 2003). Both are
linear, so the readout is one weight for each neuron and delay, added at each spike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

import neuro
from neuro.chips import neurobench
from neuro_bench.costs import PICOJOULES, Costs, on_chips
from neuro_bench.method import Method
from neuro_bench.reservoir import REACH
from neuro_bench.task import Series

SHOWN, EMPTYING = 3, 2
"""Steps that a current is shown, and steps before until the neurons are empty and the current has come."""
STEPS = SHOWN + EMPTYING
TAU = 4.0
"""ms, of the membrane; a step is 1 ms."""
LEAST = 1.0 / -math.expm1(-SHOWN / TAU)
"""Of a threshold: the least current with which a neuron fires in the steps that it is shown."""
Floats = npt.NDArray[np.float64]


class PopulationCode(Method):
    """Populations of LIF neurons with a readout by least squares, which then hear their own predictions."""

    kind = "series"
    called_by = "population-code"
    title = "spiking populations with delays and a readout by least squares"
    spiking = True
    settings = {"cells": 2000, "functions": 30, "steep": 1.0, "delays": 20, "ridge": 1e-9, "members": 3}
    space = {
        "functions": (20, 30, 45),
        "steep": (0.8, 1.0, 1.3),
        "delays": (9, 12, 16, 20),
        "ridge": (1e-10, 3e-10, 1e-9, 3e-9),
    }

    def fit(self, train: Series, settings: Mapping[str, Any], seed: int) -> _Coded:
        """Learn to say the next value; see `Method`."""
        return _Coded(train, settings, seed)


class _Cells:
    """Populations of a seed, one for each member; the same for all series."""

    def __init__(self, count: int, members: int, seed: int) -> None:
        words: Any = {
            "tau_m": TAU,
            "C_m": TAU,
            "t_ref": SHOWN - 1.0,
            "E_L": 0.0,
            "V_reset": 0.0,
            "V_th": 1.0,
            "V_min": 0.0,
        }
        net = neuro.Network("population-code", resolution=1.0)
        value = net.population("value", members, neuro.dc_generator(amplitude=0.0))
        net.population("clock", 1, neuro.spike_generator())
        self._ways: list[tuple[Floats, Floats]] = []
        names = [f"cells_{k}" for k in range(members)]
        for k, name in enumerate(names):
            rng = np.random.default_rng((seed, k, 5))
            at = REACH * (2.0 * (np.arange(count) + rng.random(count)) / count - 1.0)
            gain = rng.uniform(1.0, 3.0, count) * rng.choice((-1.0, 1.0), count)
            self._ways.append((at, np.sign(gain)))
            net.population(name, count, neuro.iaf_psc_delta(I_e=LEAST - gain * at, **words))
            net.connect(value[k], name, neuro.all_to_all(), weight=gain[None, :], delay=1.0)
            net.connect("clock", name, neuro.all_to_all(), weight=-100.0, delay=1.0)
        self.sim, self.members, self._seed = neuro.compile(net), members, seed
        self._amplitude = self.sim.port("value", "amplitude")
        self._stepper = self.sim.stepper(float(STEPS), ["clock"], names)
        self._ticks = np.array([1, STEPS]), np.zeros(2, dtype=np.int64)
        self.begin()

    def begin(self) -> None:
        """Go back to time 0; what the first steps say, before any spike of the clock, is dropped."""
        self.sim.reset()
        self.count(np.zeros(self.members))

    def count(self, values: Floats) -> Floats:
        """How often each neuron fires at a value for each member, in standard deviations, (members, neurons)."""
        self._amplitude.set(np.clip(values, -REACH, REACH))
        return np.stack([each[0] for each in self._stepper.step(self._ticks)]).astype(np.float64)

    def counts(self, values: Floats) -> Floats:
        """The same of many, (members, values), as (members, values, neurons)."""
        return np.stack([self.count(each) for each in values.T], axis=1)

    def decoders(self, functions: int, steep: float) -> list[Floats]:
        """For each member weights of the counts that make hyperbolic tangents of the value, (neurons, functions).

        They make them but for a constant: the weight of a neuron is the change of the function from the middle
        between it and the neuron before to that between it and the next, the sign is that of its gain.
        """
        found = []
        for k, (at, sign) in enumerate(self._ways):
            rng = np.random.default_rng((self._seed, k, 6))
            centre, slope = rng.uniform(-REACH, REACH, functions), steep * rng.uniform(0.5, 1.4, functions)
            middles = np.concatenate(([-REACH], (at[1:] + at[:-1]) / 2.0, [REACH]))
            found.append(sign[:, None] * np.diff(np.tanh((middles[:, None] - centre) * slope), axis=0))
        return found


_cells = lru_cache(maxsize=4)(_Cells)


class _Coded:
    """The populations and their readouts of a series; the mean of what they say goes on."""

    def __init__(self, train: Series, settings: Mapping[str, Any], seed: int) -> None:
        cells = self._cells = _cells(settings["cells"], settings["members"], seed)
        self._mean, self._std = float(train.mean()), float(train.std())
        seen = (train - self._mean) / self._std
        halfway = (seen + np.concatenate((seen[:1], seen[:-1]))) / 2.0
        both = np.stack((halfway, seen), axis=1).ravel()
        counts = cells.counts(np.tile(both, (cells.members, 1)))
        delays, self._last = settings["delays"], both[-1]
        self._weights = np.empty((2, cells.members, delays, settings["cells"]))
        self._offsets = np.empty((cells.members, 1))
        for k, decoders in enumerate(cells.decoders(settings["functions"], settings["steep"])):
            weights, self._offsets[k] = _ridge(counts[k] @ decoders, seen, delays, settings["ridge"])
            self._weights[:, k] = weights @ decoders.T
        self._coming = np.tile(self._offsets, delays)
        for k in range(len(both) - 2 * delays, len(both)):
            self._coming = self._heard(self._coming, counts[:, k], k % 2)

    def _heard(self, coming: Floats, counts: Floats, which: int) -> Floats:
        """The sums of the next predictions, (members, delays), after each spike has added its weight to all of them.

        With the first current of a value the first of them is over.
        """
        if which == 0:
            coming = np.concatenate((coming[:, 1:], self._offsets), axis=1)
        added: Floats = (self._weights[which] @ counts[:, :, None])[:, :, 0]
        return coming + added

    def predict(self, shown: int) -> Series:
        """The next values, each of a member from its spikes that say those before it."""
        coming, last = self._coming, np.full(len(self._offsets), self._last)
        said = np.empty((shown, len(self._offsets)))
        for k in range(shown):
            said[k] = value = np.clip(coming[:, 0], -REACH, REACH)
            for which, current in enumerate(((last + value) / 2.0, value)):
                coming = self._heard(coming, self._cells.count(current), which)
            last = value
        mean: Series = self._mean + self._std * said.mean(axis=1)
        return mean

    def costs(self, shown: int) -> Costs:
        """The bill of Loihi for the neurons, and the sums of the readout, by the values that are said."""
        sim = self._cells.sim
        self._cells.begin()
        self.predict(shown)
        taken: Any = sim.taken()
        found = neurobench(sim.program, taken.raw_counts, samples=shown, steps=2 * STEPS)
        _, members, delays, cells = self._weights.shape
        readout = delays * found["spikes"]["out"]
        sums, bills = PICOJOULES["float32 sum"] * 1e-12 * readout, on_chips(sim, taken, shown, clock=False)
        bills = {
            word: {f"{k}, and the readout's sums": v + sums for k, v in each.items()} for word, each in bills.items()
        }
        ops = found["synaptic_operations"]
        return Costs(
            parameters=self._weights.size,
            footprint_bytes=found["footprint_bytes"] + self._weights.nbytes,
            connection_sparsity=found["connection_sparsity"],
            activation_sparsity=found["activation_sparsity"],
            effective_macs=2.0 * members * cells,  # both currents into each neuron
            effective_acs=ops["effective_acs"] + readout,
            dense=ops["dense"] + 2.0 * members * cells + self._weights.size,
            **bills,
        )


def _ridge(features: Floats, seen: Series, delays: int, strength: float) -> tuple[Floats, float]:
    """Weights of the features of the last values that say the next, (currents, delays, features), and an offset."""
    rows = np.arange(delays - 1, len(seen) - 1)
    x = np.stack([features[2 * (rows - j) + h] for h in range(2) for j in range(delays)], axis=1).reshape(len(rows), -1)
    middle, size = x.mean(axis=0), x.std(axis=0) + 1e-9
    z, y = (x - middle) / size, seen[rows + 1]
    wide = z.shape[1] > len(rows)
    gram = z @ z.T if wide else z.T @ z
    gram += strength * z.size * np.eye(len(gram))
    weights = (z.T @ np.linalg.solve(gram, y) if wide else np.linalg.solve(gram, z.T @ y)) / size
    return weights.reshape(2, delays, -1), -float(middle @ weights)
