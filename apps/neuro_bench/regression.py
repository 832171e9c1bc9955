"""Methods for regression: a linear filter, a perceptron on the same counts, and a spiking network with a leaky readout.

All are causal: what they say of a step follows from the spikes until it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

import neuro
from neuro_bench.artificial import Network, optimised
from neuro_bench.costs import Costs, product_costs, spiking_costs
from neuro_bench.spiking import CHIP, INPUT, OUTPUT
from neuro_bench.task import Floats, Method, Recording, check_installed
from neuro_train.data import probe

AT_ONCE = 10_000
"""Steps."""
PRICED_STEPS = 1_000
"""Steps that the bill is the mean of."""
SILENT = 100.0
"""Threshold of the readout in standard deviations of its target, which nothing reaches."""
FORGOTTEN = 5.0
"""Time constants until a network does not know how it began."""


class Windows:
    """Counts of spikes in the last windows before each step, one behind the other.

    Args:
        recording: the spikes.
        width: steps of a window.
        lags: windows.
    """

    def __init__(self, recording: Recording, width: int, lags: int) -> None:
        channels = recording.spikes.shape[1]
        sums = np.cumsum(recording.spikes, axis=0, dtype=np.int32)
        self._sums, self.size = np.concatenate((np.zeros((1, channels), np.int32), sums)), lags * channels
        self._back = width * np.arange(lags + 1)

    def __len__(self) -> int:
        return len(self._sums) - 1

    def at(self, steps: Any) -> Floats:
        """Those of some steps, (steps, lags x channels)."""
        ends = np.maximum(steps[:, None] + 1 - self._back, 0)
        return np.asarray(-np.diff(self._sums[ends], axis=1).reshape(len(steps), self.size), np.float32)

    def parts(self) -> Any:
        """All, so many steps at once: the steps, and their counts."""
        for first in range(0, len(self), AT_ONCE):
            steps = np.arange(first, min(first + AT_ONCE, len(self)))
            yield steps, self.at(steps)


class Wiener(Method):
    """The sum of the counts with a weight for each channel, window and value, by ridge regression."""

    kind = "regression"
    called_by = "wiener"
    title = "Wiener filter: ridge regression on counts of the last windows"
    settings = {"width": 5, "lags": 10, "ridge": 1e-3}
    space = {"width": (5, 10, 20), "lags": (5, 10, 15), "ridge": (1e-4, 1e-3, 1e-2, 1e-1)}

    def fit(self, train: Recording, settings: Mapping[str, Any], seed: int) -> _Linear:
        """Learn by the normal equations; see `Method`."""
        windows = Windows(train, settings["width"], settings["lags"])
        gram, wanted = np.zeros((windows.size + 1, windows.size + 1)), 0.0
        for steps, counts in windows.parts():
            x = np.concatenate((counts, np.ones((len(counts), 1), np.float32)), axis=1)
            gram += x.T @ x
            wanted = wanted + x.T @ train.targets[steps]
        strength = settings["ridge"] * np.trace(gram[:-1, :-1]) / windows.size
        gram[np.diag_indices(windows.size)] += max(float(strength), 1e-12)  # the offset is free
        return _Linear(np.linalg.solve(gram, wanted), settings)


class _Linear:
    def __init__(self, weights: Any, settings: Mapping[str, Any]) -> None:
        self._weights, self._settings = weights, settings

    def _parts(self, shown: Recording) -> Any:
        return (counts for _, counts in Windows(shown, self._settings["width"], self._settings["lags"]).parts())

    def predict(self, shown: Recording) -> Any:
        """The values of each step."""
        return np.concatenate([counts @ self._weights[:-1] + self._weights[-1] for counts in self._parts(shown)])

    def costs(self, shown: Recording) -> Costs:
        """Products of counts that are not 0; what it takes to count is not counted, as by NeuroBench."""
        used, size = (self._weights[:-1] != 0).sum(axis=1), self._weights[:-1].size
        macs = sum(float(((counts != 0) * used).sum()) for counts in self._parts(shown)) / len(shown)
        return product_costs(self._weights.size, 4 * self._weights.size, macs, float(size))


class Perceptron(Method):
    """Two hidden layers of the sizes of NeuroBench's artificial network for this task, on counts of the last 0.2 s."""

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
        """Learn by gradients; see `Method`."""
        check_installed(self, "torch")
        import torch
        from torch import nn

        windows = Windows(train, settings["width"], settings["lags"])
        middle, size = _scale(train)
        wanted = (train.targets - middle) / size

        def make() -> Any:
            first, second = settings["first"], settings["second"]
            hidden = (nn.Linear(windows.size, first), nn.ReLU(), nn.Linear(first, second), nn.ReLU())
            return nn.Sequential(*hidden, nn.Dropout(settings["dropout"]), nn.Linear(second, wanted.shape[1]))

        def loss(module: Any, chosen: Any, epoch: int, rng: Any) -> Any:
            said = module(torch.from_numpy(windows.at(chosen)))
            return nn.functional.mse_loss(said, torch.from_numpy(wanted[chosen]))

        module = optimised(make, loss, len(train), settings["batch"], settings, seed)
        return _Decoder(module, settings, middle, size)


class _Decoder(Network):
    """A module that says values of a step by counts of windows, in standard deviations."""

    def __init__(self, module: Any, settings: Mapping[str, Any], middle: Floats, size: Floats) -> None:
        super().__init__(module, "float32")
        self._settings, self._middle, self._size = settings, middle, size

    def predict(self, shown: Recording) -> Any:
        """The values of each step."""
        import torch

        windows = Windows(shown, self._settings["width"], self._settings["lags"])
        with torch.no_grad():
            said = torch.cat([self.module(torch.from_numpy(counts)) for _, counts in windows.parts()])
        return self._middle + self._size * said.numpy()


def _scale(train: Recording) -> tuple[Floats, Floats]:
    """Mean and standard deviation of each target."""
    return train.targets.mean(axis=0), np.maximum(train.targets.std(axis=0), 1e-12)


class LIFReadout(Method):
    """A hidden layer of LIF neurons, and leaky neurons that never fire, whose potentials are the values."""

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
        """The network before it learns; the first weights are drawn so that potentials vary as far as a threshold."""
        h, channels = train.step, train.spikes.shape[1]
        net = neuro.Network(self.called_by, resolution=h)
        cell: Any = {"t_ref": 0.0, "E_L": 0.0, "V_reset": 0.0}
        net.population(INPUT, channels, neuro.spike_generator())
        net.population("hidden", settings["hidden"], neuro.iaf_psc_delta(tau_m=settings["tau"], V_th=1.0, **cell))
        leaky = neuro.iaf_psc_delta(tau_m=settings["tau_out"], V_th=SILENT, **cell)
        net.population(OUTPUT, train.targets.shape[1], leaky)
        a_step = max(0.1, float(train.spikes.sum()) / len(train))
        for name, source, target, std in (
            ("in_hidden", INPUT, "hidden", (a_step * settings["tau"] / (2.0 * h)) ** -0.5),
            ("hidden_out", "hidden", OUTPUT, 0.1),
        ):
            weight = neuro.normal(mean=0.0, std=std)
            net.connect(source, target, neuro.all_to_all(), weight=weight, delay=h, name=name)
        return net

    def fit(self, train: Recording, settings: Mapping[str, Any], seed: int) -> _Readout:
        """Learn by surrogate gradients; see `Method`."""
        check_installed(self, "torch")
        from neuro_train.plan import TrainingPlan
        from neuro_train.trainer import learn

        before = int(FORGOTTEN * max(settings["tau"], settings["tau_out"]) / train.step)
        middle, size = _scale(train)
        scaled = Recording(train.spikes, (train.targets - middle) / size, train.step)
        words: Any = {name: settings[name] for name in ("epochs", "rate", "decay", "slope", "batch")}
        duration = (before + settings["steps"]) * train.step
        plan = TrainingPlan(input=INPUT, output=OUTPUT, loss="mse", duration=duration, seed=seed, **words)
        trained = learn(self.network(train, settings), stretches(scaled, settings["steps"], before), plan)
        return _Readout(trained.net, seed, middle, size)


def stretches(recording: Recording, steps: int, before: int) -> Any:
    """A recording as recordings of so many steps for `neuro train`, each after so many for which nothing is asked."""
    from neuro_torch import Events
    from neuro_train.data import BatchData

    count = -(-len(recording) // steps)
    behind = count * steps - len(recording)
    rows = steps * np.arange(count)[:, None] + np.arange(before + steps)
    spikes = np.pad(recording.spikes, ((before, behind), (0, 0)))[rows]
    targets = np.pad(recording.targets, ((before, behind), (0, 0)), constant_values=np.nan)[rows]
    targets[:, :before] = np.nan
    events = Events(count, before + steps, {INPUT: spikes.nonzero()})
    return BatchData(events, targets, (), recording.spikes.shape[1:], "")


class _Readout:
    def __init__(self, net: neuro.Network, seed: int, middle: Floats, size: Floats) -> None:
        self.net, self._seed, self._middle, self._size = net, seed, middle, size

    def _run(self, backend: str, shown: Recording) -> Any:
        """Show a recording from its beginning to its end."""
        sim = neuro.compile(self.net, backend=backend, seed=self._seed)
        step, channel = shown.spikes.nonzero()
        sim.inject(INPUT, (step + 1.0) * shown.step, channel)
        sim.run(len(shown) * shown.step)
        return sim

    def predict(self, shown: Recording) -> Any:
        """The values of each step."""
        return self._middle + self._size * self._run("event", shown).trace(probe(OUTPUT))[1]

    def costs(self, shown: Recording) -> Costs:
        """By NeuroBench's counts, and the bills of chips, of the first steps."""
        n = min(PRICED_STEPS, len(shown))
        sim = self._run(CHIP, shown.take(slice(n)))
        return spiking_costs(sim, sim.taken(), n)
