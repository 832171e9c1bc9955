"""Methods for regression: a Wiener filter, a perceptron on the same counts, and a spiking network with leaky readout.

All methods are causal: the value at a step depends only on the spikes up to this step.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

import neuro
from neuro.chips import HostWork
from neuro.coding import on_numbers
from neuro_bench.artificial import Network, train_module
from neuro_bench.costs import Costs, product_costs, spiking_costs
from neuro_bench.spiking import CHIP, INPUT, OUTPUT
from neuro_bench.task import Floats, Method, Recording, check_installed
from neuro_train.data import probe

AT_ONCE = 10_000
"""Number of steps processed together."""
PRICED_STEPS = 1_000
"""Number of steps over which costs are averaged."""
SILENT = 100.0
"""Threshold of the readout neurons in standard deviations of the target, so high that they never fire."""
FORGOTTEN = 5.0
"""Time after which the initial state has no effect, in time constants."""


class Windows:
    """Spike counts in consecutive windows, the last of which ends with each step.

    Example: with width 5 and 10 lags, step 99 has the counts of the steps 95 to 99, 90 to 94, and so on to 50 to 54.

    Args:
        recording: the spikes.
        width: length of a window in steps.
        lags: number of windows.
    """

    def __init__(self, recording: Recording, width: int, lags: int) -> None:
        channels = recording.spikes.shape[1]
        sums = np.cumsum(recording.spikes, axis=0, dtype=np.int32)
        self._sums, self.size = np.concatenate((np.zeros((1, channels), np.int32), sums)), lags * channels
        self._steps_back = width * np.arange(lags + 1)  # to the borders of the windows

    def __len__(self) -> int:
        return len(self._sums) - 1

    def at(self, steps: Any) -> Floats:
        """Return the counts at the given steps, shape (steps, lags x channels)."""
        ends = np.maximum(steps[:, None] + 1 - self._steps_back, 0)
        return np.asarray(-np.diff(self._sums[ends], axis=1).reshape(len(steps), self.size), np.float32)

    def parts(self) -> Any:
        """Yield blocks of at most `AT_ONCE` steps with their counts, until all steps are done."""
        for first in range(0, len(self), AT_ONCE):
            steps = np.arange(first, min(first + AT_ONCE, len(self)))
            yield steps, self.at(steps)


class Wiener(Method):
    """Weighted sum of the counts, by ridge regression: a weight for each channel, window and value."""

    kind = "regression"
    called_by = "wiener"
    title = "Wiener filter: ridge regression on counts of the last windows"
    settings = {"width": 5, "lags": 10, "ridge": 1e-3}
    space = {"width": (5, 10, 20), "lags": (5, 10, 15), "ridge": (1e-4, 1e-3, 1e-2, 1e-1)}

    def fit(self, train: Recording, settings: Mapping[str, Any], seed: int) -> _Linear:
        """Solve the normal equations; see `Method`."""
        windows = Windows(train, settings["width"], settings["lags"])
        gram, moments = np.zeros((windows.size + 1, windows.size + 1)), 0.0
        for steps, counts in windows.parts():
            x = np.concatenate((counts, np.ones((len(counts), 1), np.float32)), axis=1)
            gram += x.T @ x
            moments = moments + x.T @ train.targets[steps]
        strength = settings["ridge"] * np.trace(gram[:-1, :-1]) / windows.size
        gram[np.diag_indices(windows.size)] += max(float(strength), 1e-12)  # the offset is not penalised
        return _Linear(np.linalg.solve(gram, moments), settings)


class _Linear:
    def __init__(self, weights: Any, settings: Mapping[str, Any]) -> None:
        self._weights, self._settings = weights, settings

    def _parts(self, data: Recording) -> Any:
        return (counts for _, counts in Windows(data, self._settings["width"], self._settings["lags"]).parts())

    def predict(self, data: Recording) -> Any:
        """Return the values of each step."""
        return np.concatenate([counts @ self._weights[:-1] + self._weights[-1] for counts in self._parts(data)])

    def costs(self, data: Recording) -> Costs:
        """Count the products of counts other than 0. As in NeuroBench, counting the spikes costs nothing."""
        products, size = (self._weights[:-1] != 0).sum(axis=1), self._weights[:-1].size  # products of each count
        macs = sum(float(((counts != 0) * products).sum()) for counts in self._parts(data)) / len(data)
        return product_costs(self._weights.size, 4 * self._weights.size, macs, float(size))


class Perceptron(Method):
    """Perceptron on counts of the last 0.2 s, with two hidden layers of the sizes in NeuroBench's network."""

    kind = "regression"
    called_by = "mlp"
    title = "perceptron with two hidden layers on counts of the last windows, float32 (torch)"
    settings = {
        "width": 7, "lags": 7, "first": 32, "second": 48, "epochs": 10, "rate": 0.005, "decay": 0.01, "dropout": 0.3,
        "batch": 256,
    }  # fmt: skip
    space: ClassVar[Mapping[str, Any]] = {
        "width": (5, 7, 10),
        "lags": (5, 7, 10),
        "epochs": (5, 10),
        "rate": (0.002, 0.005, 0.01),
        "dropout": (0.1, 0.3, 0.5),
    }

    def fit(self, train: Recording, settings: Mapping[str, Any], seed: int) -> _Decoder:
        """Train by gradients; see `Method`."""
        check_installed(self, "torch")
        import torch
        from torch import nn

        windows = Windows(train, settings["width"], settings["lags"])
        mean, std = _mean_and_std(train)
        targets = (train.targets - mean) / std

        def make() -> Any:
            first, second = settings["first"], settings["second"]
            layers = (nn.Linear(windows.size, first), nn.ReLU(), nn.Linear(first, second), nn.ReLU())
            return nn.Sequential(*layers, nn.Dropout(settings["dropout"]), nn.Linear(second, targets.shape[1]))

        def loss(module: Any, chosen: Any, epoch: int, rng: Any) -> Any:
            outputs = module(torch.from_numpy(windows.at(chosen)))
            return nn.functional.mse_loss(outputs, torch.from_numpy(targets[chosen]))

        module = train_module(make, loss, len(train), settings["batch"], settings, seed)
        return _Decoder(module, settings, mean, std)


class _Decoder(Network):
    """A module that maps the counts of windows to standardised values of a step."""

    def __init__(self, module: Any, settings: Mapping[str, Any], mean: Floats, std: Floats) -> None:
        super().__init__(module, "float32")
        self._settings, self._mean, self._std = settings, mean, std

    def predict(self, data: Recording) -> Any:
        """Return the values of each step."""
        import torch

        windows = Windows(data, self._settings["width"], self._settings["lags"])
        with torch.no_grad():
            outputs = torch.cat([self.module(torch.from_numpy(counts)) for _, counts in windows.parts()])
        return self._mean + self._std * outputs.numpy()


def _mean_and_std(train: Recording) -> tuple[Floats, Floats]:
    """Return the mean and the standard deviation of each target."""
    return train.targets.mean(axis=0), np.maximum(train.targets.std(axis=0), 1e-12)


class LIFReadout(Method):
    """Spiking network with a hidden layer of LIF neurons. The outputs are potentials of neurons that never fire."""

    kind = "regression"
    called_by = "lif-readout"
    title = "spiking network with a leaky readout, by surrogate gradients"
    spiking = True
    settings = {
        "hidden": 64, "tau": 20.0, "tau_out": 50.0, "epochs": 20, "rate": 0.01, "decay": 0.01, "slope": 2.0,
        "batch": 10, "steps": 250,
    }  # fmt: skip
    space: ClassVar[Mapping[str, Any]] = {
        "hidden": (32, 64, 128),
        "tau": (20.0, 40.0, 80.0),
        "tau_out": (30.0, 50.0, 100.0),
        "epochs": (20, 40),
        "rate": (0.005, 0.01, 0.02),
        "slope": (1.0, 2.0, 4.0),
    }

    def network(self, train: Recording, settings: Mapping[str, Any]) -> neuro.Network:
        """Build the untrained network. The initial weights let the hidden potentials vary by about a threshold."""
        h, channels = train.step, train.spikes.shape[1]
        net = neuro.Network(self.called_by, resolution=h)
        cell: Any = {"t_ref": 0.0, "E_L": 0.0, "V_reset": 0.0}
        net.population(INPUT, channels, neuro.spike_generator())
        net.population("hidden", settings["hidden"], neuro.iaf_psc_delta(tau_m=settings["tau"], V_th=1.0, **cell))
        leaky = neuro.iaf_psc_delta(tau_m=settings["tau_out"], V_th=SILENT, **cell)
        net.population(OUTPUT, train.targets.shape[1], leaky)
        spikes_per_step = max(0.1, float(train.spikes.sum()) / len(train))
        for name, source, target, std in (
            ("in_hidden", INPUT, "hidden", (spikes_per_step * settings["tau"] / (2.0 * h)) ** -0.5),
            ("hidden_out", "hidden", OUTPUT, 0.1),
        ):
            weight = neuro.normal(mean=0.0, std=std)
            net.connect(source, target, neuro.all_to_all(), weight=weight, delay=h, name=name)
        return net

    def fit(self, train: Recording, settings: Mapping[str, Any], seed: int) -> _Readout:
        """Train by surrogate gradients; see `Method`."""
        check_installed(self, "torch")
        from neuro_train.plan import TrainingPlan
        from neuro_train.trainer import learn

        warm_up = int(FORGOTTEN * max(settings["tau"], settings["tau_out"]) / train.step)
        mean, std = _mean_and_std(train)
        standardised = Recording(train.spikes, (train.targets - mean) / std, train.step)
        options: Any = {name: settings[name] for name in ("epochs", "rate", "decay", "slope", "batch")}
        duration = (warm_up + settings["steps"]) * train.step
        plan = TrainingPlan(input=INPUT, output=OUTPUT, loss="mse", duration=duration, seed=seed, **options)
        trained = learn(self.network(train, settings), stretches(standardised, settings["steps"], warm_up), plan)
        return _Readout(trained.net, seed, mean, std)


def stretches(recording: Recording, steps: int, before: int) -> Any:
    """Cut a recording into training examples.

    Args:
        recording: spikes and targets.
        steps: number of steps with targets in an example.
        before: number of earlier steps at the beginning of an example, in which the network forgets its initial state.
            Their targets are NaN.
    """
    from neuro_torch import Events
    from neuro_train.data import BatchData

    count = -(-len(recording) // steps)
    padding = count * steps - len(recording)
    rows = steps * np.arange(count)[:, None] + np.arange(before + steps)
    spikes = np.pad(recording.spikes, ((before, padding), (0, 0)))[rows]
    targets = np.pad(recording.targets, ((before, padding), (0, 0)), constant_values=np.nan)[rows]
    targets[:, :before] = np.nan
    events = Events(count, before + steps, {INPUT: spikes.nonzero()})
    return BatchData(events, targets, (), recording.spikes.shape[1:], "")


class _Readout:
    def __init__(self, net: neuro.Network, seed: int, mean: Floats, std: Floats) -> None:
        self.net, self._seed, self._mean, self._std = net, seed, mean, std

    def _run(self, backend: str, data: Recording) -> Any:
        """Run the network with the whole recording as input."""
        sim = neuro.compile(self.net, backend=backend, seed=self._seed)
        step, channel = data.spikes.nonzero()
        sim.inject(INPUT, (step + 1.0) * data.step, channel)
        sim.run(len(data) * data.step)
        return sim

    def predict(self, data: Recording) -> Any:
        """Return the values of each step."""
        return self._mean + self._std * self._run("event", data).trace(probe(OUTPUT))[1]

    def costs(self, data: Recording) -> Costs:
        """Return NeuroBench's counts and the bills of chips, averaged over the first steps."""
        n = min(PRICED_STEPS, len(data))
        sim = self._run(CHIP, data.take(slice(n)))
        scaling = on_numbers(len(self._mean), 3 * len(self._mean))  # a product with a sum for each value
        return spiking_costs(sim, sim.taken(), n, host=[HostWork("scale of the potentials", scaling, "step", times=n)])
