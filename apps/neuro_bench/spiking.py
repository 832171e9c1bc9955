"""Spiking classifiers: trained by surrogate gradients, converted from a convolutional network, or by a local rule.

The convolutional network is trained on spike counts, and its conversion runs on integrate-and-fire neurons. A layer
integrates the whole input before the first neuron fires: a spike of a clock pulls the layer's neurons far below the
threshold, and another spike releases them when the previous layer has finished. Each neuron then fires until the
potential is below the threshold, so the number of spikes is the rectified sum, rounded to a whole number. Without the
clock, a neuron may fire before an inhibition arrives, and this spike cannot be undone, which lowers the accuracy of
converted networks (Rueckauer et al., Front. Neurosci. 11:682, 2017). Weights are scaled so that nearly all activations
are at most the number of spikes that a layer may fire (Diehl et al., IJCNN 2015). Batch normalisation becomes weights
and biases, and spikes of the clock add the biases.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import Showing
from neuro.chips import HostWork
from neuro.coding import on_numbers
from neuro_bench.artificial import members
from neuro_bench.costs import Costs, spiking_costs
from neuro_bench.features import recordings
from neuro_bench.task import Examples, Floats, Method, Spikes, check_installed

if TYPE_CHECKING:
    from neuro_recognise.recogniser import Recogniser


PRICED = 50
"""Number of examples over which costs are averaged."""
INPUT, OUTPUT, CHIP = "input", "out", "loihi"


class Spiking(Method):
    """Base class of networks with a hidden layer and an output neuron for each class; most output spikes decide.

    With several versions of the recordings, the number of epochs is divided by the number of versions, so that each
    recording is used equally often.

    Class attributes:
        back: True connects the hidden layer to itself.
        delayed: True trains the delays from the input to the hidden layer.
    """

    spiking = True
    back: ClassVar[bool] = False
    delayed: ClassVar[bool] = False
    settings = {
        "hidden": 128, "tau": 20.0, "epochs": 40, "rate": 0.01, "decay": 0.05, "temperature": 2.0, "slope": 1.0,
        "batch": 20, "shift": 1, "backend": "torch",
    }  # fmt: skip
    space: ClassVar[Mapping[str, Any]] = {
        "hidden": (128, 256),
        "tau": (20.0, 40.0, 80.0),
        "epochs": (40, 60),
        "rate": (0.005, 0.01, 0.02),
        "decay": (0.02, 0.05, 0.1),
        "temperature": (1.5, 2.0, 3.0),
        "slope": (1.0, 2.0, 4.0),
        "shift": (1, 2),
    }

    def network(self, train: Examples, settings: Mapping[str, Any], seed: int) -> neuro.Network:
        """Build the untrained network. The more input spikes a step has, the smaller are the initial weights."""
        spikes, h = train.spikes, train.spikes.step
        cell = neuro.iaf_psc_delta(tau_m=settings["tau"], t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0)
        net = neuro.Network(self.called_by, resolution=h)
        net.population(INPUT, spikes.shape, neuro.spike_generator())
        net.population("hidden", settings["hidden"], cell)
        net.population(OUTPUT, len(train.classes), cell)
        spikes_per_step = max(1.0, len(spikes.at) / (len(train) * spikes.steps))

        def connect(name: str, source: str, target: str, std: float, delay: Any = h) -> None:
            weight = neuro.normal(mean=0.0, std=std)
            net.connect(source, target, neuro.all_to_all(), weight=weight, delay=delay, name=name)

        input_delay = neuro.uniform(low=h, high=10.0 * h) if self.delayed else h
        connect("in_hidden", INPUT, "hidden", 0.8 / spikes_per_step**0.5, input_delay)
        if self.back:
            connect("hidden_hidden", "hidden", "hidden", settings["back"] / settings["hidden"] ** 0.5)
        connect("hidden_out", "hidden", OUTPUT, 0.1)
        return net

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
        """Train by surrogate gradients; see `Method`."""
        check_installed(self, "torch")
        from neuro_train.trainer import learn

        plan = self.plan(train, settings, seed)
        trained = learn(self.network(train, settings, seed), batch_data(train), plan)
        return _Trained(trained, plan, settings["backend"])

    def plan(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
        """Convert the settings to those of `neuro train`."""
        from neuro_train.plan import TrainingPlan

        options: Any = {name: settings[name] for name in ("rate", "decay", "temperature", "slope", "batch", "shift")}
        options["epochs"] = -(-settings["epochs"] // train.versions)
        trainable = ("in_hidden=weight,delay", "hidden_out=weight") if self.delayed else ()
        duration = train.spikes.steps * train.spikes.step
        return TrainingPlan(input=INPUT, output=OUTPUT, trainable=trainable, duration=duration, seed=seed, **options)


def batch_data(data: Examples) -> Any:
    """Convert examples to the recordings of `neuro train`."""
    from neuro_torch import Events
    from neuro_train.data import BatchData

    spikes = data.spikes
    events = Events(len(data), spikes.steps, {INPUT: (spikes.example, spikes.at, spikes.neuron)})
    return BatchData(events, data.labels, data.classes, spikes.shape, "")


class _Trained:
    """A trained network, which predicts by the torch module (backend "torch") or by a simulation on another backend."""

    def __init__(self, trained: Any, plan: Any, backend: str) -> None:
        self.net, self._module, self._plan, self._backend = trained.net, trained.module, plan, backend

    def predict(self, data: Examples) -> Any:
        """Return the class of each example; -1 if no output neuron spikes."""
        from neuro_train.tested import by_module, on_backend

        batch = batch_data(data)
        if self._backend == "torch":
            return by_module(self._module, batch, self._plan).decided
        return on_backend(self.net, self._backend, batch, self._plan).decided

    def costs(self, data: Examples) -> Costs:
        """Return NeuroBench's counts and the bills of chips, averaged over the first examples."""
        n = min(PRICED, len(data))
        events = batch_data(data.take(np.arange(n))).events
        sim = neuro.compile(self.net, backend=CHIP, seed=self._plan.seed)
        showing = Showing(sim, INPUT, OUTPUT)
        for k in range(n):
            train = events.trains[INPUT].of([k])
            showing.show(train.step, train.neuron, events.steps, len(train.step))
        return spiking_costs(sim, showing.taken, n, host=showing.host("counts"))


class Recurrent(Spiking):
    """Network with a recurrent hidden layer.

    The surrogate derivative is narrow (a large `slope`). A wide derivative is far from 0 even for neurons that are far
    from a spike, and recurrent synapses multiply this error in each step until the gradient is useless.
    """

    called_by = "recurrent"
    title = "recurrent spiking network, by surrogate gradients"
    back = True
    settings = {**Spiking.settings, "slope": 4.0, "back": 0.5, "batch": 50, "rate": 0.02}
    space = {**Spiking.space, "slope": (4.0, 8.0), "back": (0.25, 0.5, 1.0), "rate": (0.01, 0.02, 0.04)}


class Dense(Spiking):
    """Feed-forward network with one hidden layer."""

    called_by = "dense"
    title = "spiking network with one hidden layer, by surrogate gradients"


class Delays(Spiking):
    """Feed-forward network whose synapses to the hidden layer have learnt delays."""

    called_by = "delays"
    title = "spiking network with learnt delays, by surrogate gradients"
    delayed = True
    settings = {**Spiking.settings, "hidden": 256, "tau": 50.0}


HELD = 8.0
"""Inhibition that holds a layer, in multiples of its levels. With a larger value, the other weights
would have fewer bits on a chip."""
Layer = tuple[Floats, Floats]
"""Weights, shape (to, from, ...), and a bias for each map, shape (to,)."""
COMMON = 0.99
"""The scale of a layer maps this quantile of its positive activations to the largest number of spikes."""


class Converted(Method):
    """Three strided convolutions with batch normalisation and a dense layer of classes, converted to spikes."""

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
        """Train on spike counts by gradients, then convert; see `Method`."""
        check_installed(self, "torch")
        from torch import nn

        counts = replace(train, frames=spike_counts(train.spikes, len(train)))
        maps, (channels, *sides) = settings["maps"], counts.frames.shape[1:]
        for _ in range(3):
            sides = [-(-side // 2) for side in sides]

        def make() -> Any:
            layers: list[Any] = []
            for source, target, size in ((channels, maps, 5), (maps, 2 * maps, 5), (2 * maps, 4 * maps, 3)):
                layers += [nn.Conv2d(source, target, size, 2, size // 2), nn.BatchNorm2d(target), nn.ReLU()]
            output_layer = nn.Linear(4 * maps * sides[0] * sides[1], len(train.classes), bias=False)
            return nn.Sequential(*layers, nn.Flatten(), nn.Dropout(settings["dropout"]), output_layer)

        modules = members(make, counts, settings, seed)
        layers_of_members = [scaled(module, counts.frames, settings["levels"]) for module in modules]
        return _Converted(layers_of_members, train.spikes, settings["levels"], settings["backend"])


def spike_counts(spikes: Spikes, examples: int) -> Floats:
    """Return the number of spikes of each neuron in each example, shape (examples, sheets, rows, columns)."""
    size = int(np.prod(spikes.shape))
    counts = np.bincount(spikes.example * size + spikes.neuron, minlength=examples * size)
    return counts.reshape(examples, *spikes.shape).astype(np.float32)


def scaled(module: Any, frames: Floats, levels: int) -> list[Layer]:
    """Scale weights and biases of a module so that nearly all activations of its hidden layers are at most `levels`.

    The last layer is scaled so that its outputs equal the outputs of the module.

    Args:
        module: a sequence of layers.
        frames: inputs on which the activations are measured.
        levels: largest number of spikes of a neuron.
    """
    import torch

    layers, previous_scale, x = [], 1.0, torch.from_numpy(frames)
    with torch.no_grad():
        for layer in module:
            x = layer(x)
            if hasattr(layer, "weight"):
                positive = np.asarray(x[x > 0])
                is_output = layer is module[-1]
                scale = levels / float(np.quantile(positive, COMMON)) if len(positive) and not is_output else 1.0
                bias = np.zeros(len(layer.weight), np.float32) if layer.bias is None else layer.bias.numpy() * scale
                layers.append((layer.weight.numpy() * (scale / previous_scale), bias))
                previous_scale = scale
    return layers


class _Converted:
    """Converted networks with common input and output neurons. An output potential is the sum over the members.

    Args:
        members: layers of each network.
        like: spikes whose shape and steps the input has.
        levels: largest number of spikes of a neuron.
        backend: backend of the simulation.
    """

    def __init__(self, members: list[list[Layer]], like: Spikes, levels: int, backend: str = "event") -> None:
        if like.step < 1.0:
            raise ModelError(f"method 'converted-cnn': steps of {like.step} ms: expected 1 ms or more")
        parameters: Any = {"tau_m": float("inf"), "t_ref": 0.0, "E_L": 0.0, "V_reset": 0.0}
        cell = neuro.iaf_psc_delta(V_th=1.0, reset_by_subtraction=True, **parameters)
        layers, first_release = len(members[0]) - 1, math.ceil(like.steps * like.step) + 3
        release_times = [float(first_release + k * (levels + 2)) for k in range(layers)]
        net = neuro.Network("converted-cnn", resolution=1.0)
        net.population(INPUT, like.shape, neuro.spike_generator())
        times = [[1.0], [2.0], *([time - 1.0, time] for time in release_times)]
        clock = net.population("clock", layers + 2, neuro.spike_generator(spike_times=times))
        class_weights = np.concatenate([member[-1][0] for member in members], axis=1)
        # Output neurons never fire: the threshold is the potential with all excitatory inputs at the highest level.
        unreachable = max(1.0, levels * float(class_weights.clip(min=0.0).sum(axis=1).max()))
        net.population(OUTPUT, len(class_weights), neuro.iaf_psc_delta(V_th=unreachable, **parameters))
        for m, (*maps, (weight_of_classes, _)) in enumerate(members):
            source, (_, rows, columns) = INPUT, like.shape
            for k, (weight, bias) in enumerate(maps):
                name, size, rows, columns = f"maps_{m}_{k}", weight.shape[2], -(-rows // 2), -(-columns // 2)
                net.population(name, (len(weight), rows, columns), cell)
                rule = neuro.grid(kernel=(size, size), stride=2, padding=size // 2)
                net.connect(source, name, rule, weight=weight.astype(np.float64), delay=1.0)
                # An additional half threshold rounds to the nearest whole number of spikes. The largest weight of a
                # chip nearly fills the register of a step's input. Therefore no other input arrives in the step of the
                # inhibition, and its release arrives in two steps, half in each.
                offset = np.repeat(0.5 + bias.astype(np.float64), rows * columns)[None]
                signals = ("held", 0, -HELD * levels), ("bias", 1, offset), ("open", k + 2, HELD * levels / 2.0)
                for signal, neuron, strength in signals:
                    net.connect(
                        clock[neuron], name, neuro.all_to_all(), weight=strength, delay=1.0, name=f"{name}_{signal}"
                    )
                source = name
            net.connect(source, OUTPUT, neuro.all_to_all(), weight=weight_of_classes.T.astype(np.float64), delay=1.0)
        self.net, self._steps, self._backend = net, int(release_times[-1]) + levels + 4, backend

    def _show(self, sim: Any, data: Examples) -> tuple[Any, Showing]:
        """Run the examples one after another. Return their classes by the highest output potential, and the runs."""
        showing, spikes = Showing(sim, INPUT, OUTPUT), data.spikes
        ends, classes = np.searchsorted(spikes.example, np.arange(len(data) + 1)), []
        for k in range(len(data)):
            rows = slice(ends[k], ends[k + 1])
            steps, neurons = 1 + (spikes.at[rows] * spikes.step).astype(np.int64), spikes.neuron[rows]
            showing.show(steps, neurons, self._steps, len(neurons))
            classes.append(int(np.argmax(sim.get(OUTPUT, "V_m"))))
        return np.array(classes), showing

    def predict(self, data: Examples) -> Any:
        """Return the class of each example."""
        return self._show(neuro.compile(self.net, backend=self._backend), data)[0]

    def costs(self, data: Examples) -> Costs:
        """Return NeuroBench's counts and the bills of chips, averaged over the first examples."""
        n = min(PRICED, len(data))
        sim = neuro.compile(self.net, backend=self._backend)
        _, showing = self._show(sim, data.take(np.arange(n)))
        choice = HostWork("choice", on_numbers(len(data.classes), len(data.classes)), "recording", times=n)
        return spiking_costs(sim, showing.taken, n, host=(*showing.host(""), choice))


LEAST = 22
"""Smallest side of the input in px, because a kernel has 11 cells of 2 px."""


class ReMuS(Method):
    """Prototypes learnt by reward-modulated STDP; the first prototype to fire in a pseudo-frame decides the class.

    The method is `neuro recognise train --method remus` with the same preset. Its events are the spikes of the
    examples: all events of a step have the same time, and several events of a pixel in a step are a single event.
    """

    called_by = "remus"
    title = "reward-modulated STDP on pseudo-frames, as neuro recognise"
    spiking = True
    settings = {"preset": "best", "epochs": 8}
    space = {"preset": ("best", "adapted"), "epochs": (4, 8, 16)}

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _RecogniserModel:
        """Train on examples; see `Method`.

        Raises:
            ModelError: the input is not that of an event camera, no example has a pseudo-frame, or the preset is
                unknown.
        """
        from neuro_recognise.methods import method_of
        from neuro_recognise.observations import observed
        from neuro_recognise.recogniser import learn

        sheets, rows, columns = train.spikes.shape
        if sheets != 2 or min(rows, columns) < LEAST:
            message = f"method '{self.called_by}': the input has the shape {train.spikes.shape}"
            expected = f"expected the two polarities of an event camera, at least {LEAST} x {LEAST} px"
            raise ModelError(f"{message}: {expected}", hint="use n-mnist, poker-dvs or dvs-gesture")
        method = method_of(self.called_by, settings["preset"], {"epochs": settings["epochs"]}).fitting((columns, rows))
        observations = replace(observed(method, recordings(train), train.classes), labels=train.labels)
        return _RecogniserModel(learn(method, observations, digest="", seed=seed))


class _RecogniserModel:
    """A recogniser of `neuro recognise` as a model of the benchmark."""

    def __init__(self, recogniser: Recogniser) -> None:
        self.recogniser = recogniser

    def predict(self, data: Examples) -> Any:
        """Return the class of each example; -1 if it has no score."""
        from neuro_recognise.method import choose

        return choose(self.recogniser.scores(recordings(data)))

    def costs(self, data: Examples) -> Costs:
        """Return NeuroBench's counts and the bills of chips, averaged over the first examples.

        Examples differ in length, and the counts use their mean length. In real time, a pseudo-frame takes 64 ms.
        """
        n = min(PRICED, len(data))
        answer = self.recogniser.answer(recordings(data.take(np.arange(n))))
        assert answer.run is not None
        sim, counts = answer.run()
        return spiking_costs(sim, counts, n, steps=counts.raw_counts.steps // n, host=answer.host)
