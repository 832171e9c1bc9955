"""A convolutional network that learns on counts of spikes and then runs on integrate-and-fire neurons.

A layer adds up all its input before it says how much that was. A clock's spike holds its neurons far below the
threshold from the beginning on; another lets go when the layer before has said all. Then each neuron fires as often
as its potential contains the threshold, or not at all, which is the rectified sum in whole numbers. Without the clock
a neuron fires while what inhibits it is still to come, and no spike can be taken back: that is what converted
networks lose (Rueckauer et al., Front. Neurosci. 11:682, 2017). Weights are scaled so that nearly all activations lie
within the spikes that a layer may fire (Diehl et al., IJCNN 2015). Batch normalisation becomes weights and biases; the
clock says the bias as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import Showing
from neuro_bench.artificial import members
from neuro_bench.costs import Costs, spiking_costs
from neuro_bench.method import Method, check_installed
from neuro_bench.spiking import INPUT, OUTPUT, PRICED
from neuro_bench.task import Examples, Floats, Spikes

HELD = 8.0
"""Times the levels, the thresholds by which a layer is held: more would leave a chip's weights fewer bits."""
Layer = tuple[Floats, Floats]
"""Weights, (to, from, ...), and a bias for each map, (to,)."""
COMMON = 0.99
"""Share of the positive activations of a layer that lie within its levels."""


class Converted(Method):
    """Three convolutions of strides, with batch normalisation, and a layer of classes, converted to spikes."""

    called_by = "converted-cnn"
    title = "convolutional network on integrate-and-fire neurons, converted"
    spiking = True
    settings = {
        "maps": 16, "epochs": 40, "rate": 0.004, "decay": 0.01, "dropout": 0.5, "shift": 2, "warp": 0.15, "levels": 16,
        "members": 1, "backend": "event",
    }  # fmt: skip
    space = {
        "maps": (12, 16, 24),
        "epochs": (30, 40, 60),
        "rate": (0.002, 0.004, 0.008),
        "dropout": (0.3, 0.5),
        "shift": (1, 2, 3),
        "warp": (0.1, 0.15, 0.2),
    }

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _Converted:
        """Learn on the counts by gradients, then convert; see `Method`."""
        check_installed(self, "torch")
        from torch import nn

        counts = replace(train, frames=counted(train.spikes, len(train)))
        maps, (channels, *sides) = settings["maps"], counts.frames.shape[1:]
        for _ in range(3):
            sides = [-(-side // 2) for side in sides]

        def make() -> Any:
            layers: list[Any] = []
            for source, target, size in ((channels, maps, 5), (maps, 2 * maps, 5), (2 * maps, 4 * maps, 3)):
                layers += [nn.Conv2d(source, target, size, 2, size // 2), nn.BatchNorm2d(target), nn.ReLU()]
            last = nn.Linear(4 * maps * sides[0] * sides[1], len(train.classes), bias=False)
            return nn.Sequential(*layers, nn.Flatten(), nn.Dropout(settings["dropout"]), last)

        modules = members(make, counts, settings, seed)
        each = [scaled(module, counts.frames, settings["levels"]) for module in modules]
        return _Converted(each, train.spikes, settings["levels"], settings["backend"])


def counted(spikes: Spikes, examples: int) -> Floats:
    """How often each neuron fires in each example, (examples, sheets, rows, columns)."""
    size = int(np.prod(spikes.shape))
    counts = np.bincount(spikes.example * size + spikes.neuron, minlength=examples * size)
    return counts.reshape(examples, *spikes.shape).astype(np.float32)


def scaled(module: Any, frames: Floats, levels: int) -> list[Layer]:
    """Weights and biases, by which nearly all activations of a layer are 0 to `levels` if those before are.

    Potentials of the classes are those of the module.
    """
    import torch

    found, before, x = [], 1.0, torch.from_numpy(frames)
    with torch.no_grad():
        for layer in module:
            x = layer(x)
            if hasattr(layer, "weight"):
                positive = np.asarray(x[x > 0])
                last = layer is module[-1]
                now = levels / float(np.quantile(positive, COMMON)) if len(positive) and not last else 1.0
                bias = np.zeros(len(layer.weight), np.float32) if layer.bias is None else layer.bias.numpy() * now
                found.append((layer.weight.numpy() * (now / before), bias))
                before = now
    return found


class _Converted:
    """Its members lie side by side between the input and the classes, whose potentials are the sums of theirs."""

    def __init__(self, members: list[list[Layer]], like: Spikes, levels: int, backend: str = "event") -> None:
        if like.step < 1.0:
            raise ModelError(f"method 'converted-cnn': steps of {like.step} ms: expected 1 ms or more")
        words: Any = {"tau_m": float("inf"), "t_ref": 0.0, "E_L": 0.0, "V_reset": 0.0}
        cell = neuro.iaf_psc_delta(V_th=1.0, reset_by_subtraction=True, **words)
        layers, first = len(members[0]) - 1, math.ceil(like.steps * like.step) + 3
        opened = [float(first + k * (levels + 2)) for k in range(layers)]
        net = neuro.Network("converted-cnn", resolution=1.0)
        net.population(INPUT, like.shape, neuro.spike_generator())
        times = [[1.0], [2.0], *([each - 1.0, each] for each in opened)]
        clock = net.population("clock", layers + 2, neuro.spike_generator(spike_times=times))
        of_classes = np.concatenate([each[-1][0] for each in members], axis=1)
        # Out of reach even if all that speaks for a class fires at the highest level.
        never = max(1.0, levels * float(of_classes.clip(min=0.0).sum(axis=1).max()))
        net.population(OUTPUT, len(of_classes), neuro.iaf_psc_delta(V_th=never, **words))
        for m, (*maps, (weight_of_classes, _)) in enumerate(members):
            before, (_, rows, columns) = INPUT, like.shape
            for k, (weight, bias) in enumerate(maps):
                name, size, rows, columns = f"maps_{m}_{k}", weight.shape[2], -(-rows // 2), -(-columns // 2)
                net.population(name, (len(weight), rows, columns), cell)
                rule = neuro.grid(kernel=(size, size), stride=2, padding=size // 2)
                net.connect(before, name, rule, weight=weight.astype(np.float64), delay=1.0)
                # Half a threshold more than was held rounds to the nearest whole number of spikes. The largest weight
                # of a chip nearly fills the register of a step's input: it comes alone, and goes in two halves.
                rest = np.repeat(0.5 + bias.astype(np.float64), rows * columns)[None]
                told = ("held", 0, -HELD * levels), ("bias", 1, rest), ("open", k + 2, HELD * levels / 2.0)
                for word, at, each in told:
                    net.connect(clock[at], name, neuro.all_to_all(), weight=each, delay=1.0, name=f"{name}_{word}")
                before = name
            net.connect(before, OUTPUT, neuro.all_to_all(), weight=weight_of_classes.T.astype(np.float64), delay=1.0)
        self.net, self._steps, self._backend = net, int(opened[-1]) + levels + 4, backend

    def _show(self, sim: Any, shown: Examples) -> tuple[Any, Any]:
        """The class of each, that of the highest potential, and what that took."""
        showing, spikes = Showing(sim, INPUT, OUTPUT), shown.spikes
        ends, said = np.searchsorted(spikes.example, np.arange(len(shown) + 1)), []
        for k in range(len(shown)):
            own = slice(ends[k], ends[k + 1])
            showing.show(1 + (spikes.at[own] * spikes.step).astype(np.int64), spikes.neuron[own], self._steps)
            said.append(int(np.argmax(sim.get(OUTPUT, "V_m"))))
        return np.array(said), showing.taken

    def predict(self, shown: Examples) -> Any:
        """The class of each."""
        return self._show(neuro.compile(self.net, backend=self._backend), shown)[0]

    def costs(self, shown: Examples) -> Costs:
        """By NeuroBench's counts, and the bills of chips, of the first examples."""
        n = min(PRICED, len(shown))
        sim = neuro.compile(self.net, backend=self._backend)
        _, taken = self._show(sim, shown.take(np.arange(n)))
        return spiking_costs(sim, taken, n)
