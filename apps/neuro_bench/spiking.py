"""Spiking networks for classes: by surrogate gradients, converted from a convolutional network, or by a local rule.

The converted network learns on counts of spikes and then runs on integrate-and-fire neurons. A layer adds up all its
input before it says how much that was. A clock's spike holds its neurons far below the threshold from the beginning on;
another lets go when the layer before has said all. Then each neuron fires as often as its potential contains the
threshold, or not at all, which is the rectified sum in whole numbers. Without the clock a neuron fires while what
inhibits it is still to come, and no spike can be taken back: that is what converted networks lose (Rueckauer et al.,
Front. Neurosci. 11:682, 2017). Weights are scaled so that nearly all activations lie within the spikes that a layer may
fire (Diehl et al., IJCNN 2015). Batch normalisation becomes weights and biases; the clock says the bias as well.
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
from neuro_bench.artificial import members
from neuro_bench.costs import Costs, spiking_costs
from neuro_bench.features import recordings
from neuro_bench.task import Examples, Floats, Method, Spikes, check_installed

if TYPE_CHECKING:
    from neuro_recognise.recogniser import Recogniser


PRICED = 50
"""Examples that the bill is the mean of."""
INPUT, OUTPUT, CHIP = "input", "out", "loihi"


class Spiking(Method):
    """Base of these: an input, a hidden layer and a neuron a class, of which the one that fires most decides.

    An epoch shows each recording once, so many versions of it are as many epochs.
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
        """The network before it learns; weights are drawn for the spikes that come in a step."""
        spikes, h = train.spikes, train.spikes.step
        cell = neuro.iaf_psc_delta(tau_m=settings["tau"], t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0)
        net = neuro.Network(self.called_by, resolution=h)
        net.population(INPUT, spikes.shape, neuro.spike_generator())
        net.population("hidden", settings["hidden"], cell)
        net.population(OUTPUT, len(train.classes), cell)
        each = max(1.0, len(spikes.at) / (len(train) * spikes.steps))

        def connect(name: str, source: str, target: str, std: float, delay: Any = h) -> None:
            weight = neuro.normal(mean=0.0, std=std)
            net.connect(source, target, neuro.all_to_all(), weight=weight, delay=delay, name=name)

        span = neuro.uniform(low=h, high=10.0 * h) if self.delayed else h
        connect("in_hidden", INPUT, "hidden", 0.8 / each**0.5, span)
        if self.back:
            connect("hidden_hidden", "hidden", "hidden", settings["back"] / settings["hidden"] ** 0.5)
        connect("hidden_out", "hidden", OUTPUT, 0.1)
        return net

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
        """Learn by surrogate gradients; see `Method`."""
        check_installed(self, "torch")
        from neuro_train.trainer import learn

        plan = self.plan(train, settings, seed)
        trained = learn(self.network(train, settings, seed), batch_data(train), plan)
        return _Trained(trained, plan, settings["backend"])

    def plan(self, train: Examples, settings: Mapping[str, Any], seed: int) -> Any:
        """The settings as `neuro train` has them."""
        from neuro_train.plan import TrainingPlan

        words: Any = {name: settings[name] for name in ("rate", "decay", "temperature", "slope", "batch", "shift")}
        words["epochs"] = -(-settings["epochs"] // train.versions)
        learns = ("in_hidden=weight,delay", "hidden_out=weight") if self.delayed else ()
        duration = train.spikes.steps * train.spikes.step
        return TrainingPlan(input=INPUT, output=OUTPUT, trainable=learns, duration=duration, seed=seed, **words)


def batch_data(shown: Examples) -> Any:
    """Examples as `neuro train` has recordings."""
    from neuro_torch import Events
    from neuro_train.data import BatchData

    spikes = shown.spikes
    events = Events(len(shown), spikes.steps, {INPUT: (spikes.example, spikes.at, spikes.neuron)})
    return BatchData(events, shown.labels, shown.classes, spikes.shape, "")


class _Trained:
    """What learnt; it is asked itself, on "torch", or its network on a backend."""

    def __init__(self, trained: Any, plan: Any, backend: str) -> None:
        self.net, self._module, self._plan, self._backend = trained.net, trained.module, plan, backend

    def predict(self, shown: Examples) -> Any:
        """The class of each, -1 for silence."""
        from neuro_train.tested import by_module, on_backend

        data = batch_data(shown)
        if self._backend == "torch":
            return by_module(self._module, data, self._plan).decided
        return on_backend(self.net, self._backend, data, self._plan).decided

    def costs(self, shown: Examples) -> Costs:
        """By NeuroBench's counts, and the bills of chips, of the first examples."""
        some = shown.take(np.arange(min(PRICED, len(shown))))
        events = batch_data(some).events
        sim = neuro.compile(self.net, backend=CHIP, seed=self._plan.seed)
        showing = Showing(sim, INPUT, OUTPUT)
        for k in range(len(some)):
            train = events.trains[INPUT].of([k])
            showing.show(train.step, train.neuron, events.steps)
        return spiking_costs(sim, showing.taken, len(some))


class Recurrent(Spiking):
    """A hidden layer that sees the input and itself.

    Its surrogate is narrow: along recurrent synapses the derivative of a wide one reaches neurons that are far from a
    spike, step after step, and what it says is no gradient of anything.
    """

    called_by = "recurrent"
    title = "recurrent spiking network, by surrogate gradients"
    back = True
    settings = {**Spiking.settings, "slope": 4.0, "back": 0.5, "batch": 50, "rate": 0.02}
    space = {**Spiking.space, "slope": (4.0, 8.0), "back": (0.25, 0.5, 1.0), "rate": (0.01, 0.02, 0.04)}


class Dense(Spiking):
    """A hidden layer that sees the input."""

    called_by = "dense"
    title = "spiking network with one hidden layer, by surrogate gradients"


class Delays(Spiking):
    """A hidden layer to which spikes take times that learn as weights do."""

    called_by = "delays"
    title = "spiking network with learnt delays, by surrogate gradients"
    delayed = True
    settings = {**Spiking.settings, "hidden": 256, "tau": 50.0}


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


LEAST = 22
"""px of a side: a kernel has 11 cells of 2 px."""


class ReMuS(Method):
    """Prototypes that learn by reward-modulated STDP; the first to fire in a pseudo-frame names the class.

    As `neuro recognise train --method remus` with the same preset, on the spikes of the examples. A step has one time,
    and several events of a pixel in it are one.
    """

    called_by = "remus"
    title = "reward-modulated STDP on pseudo-frames, as neuro recognise"
    spiking = True
    settings = {"preset": "best", "epochs": 8}
    space = {"preset": ("best", "adapted"), "epochs": (4, 8, 16)}

    def fit(self, train: Examples, settings: Mapping[str, Any], seed: int) -> _Recognises:
        """Learn from examples; see `Method`.

        Raises:
            ModelError: the input is no event camera's, no example has a pseudo-frame, or there is no such preset.
        """
        from neuro_recognise.methods import method_of
        from neuro_recognise.observations import observed
        from neuro_recognise.recogniser import learn

        sheets, rows, columns = train.spikes.shape
        if sheets != 2 or min(rows, columns) < LEAST:
            found = f"method '{self.called_by}': the input has the shape {train.spikes.shape}"
            expected = f"expected the two polarities of an event camera, at least {LEAST} x {LEAST} px"
            raise ModelError(f"{found}: {expected}", hint="n-mnist, poker-dvs and dvs-gesture have such")
        method = method_of(self.called_by, settings["preset"], {"epochs": settings["epochs"]}).fitting((columns, rows))
        shown = replace(observed(method, recordings(train), train.classes), labels=train.labels)
        return _Recognises(learn(method, shown, digest="", seed=seed))


class _Recognises:
    """A recogniser that is asked about examples."""

    def __init__(self, recogniser: Recogniser) -> None:
        self.recogniser = recogniser

    def predict(self, shown: Examples) -> Any:
        """The class of each, -1 where nothing speaks for any."""
        from neuro_recognise.method import choose

        return choose(self.recogniser.scores(recordings(shown)))

    def costs(self, shown: Examples) -> Costs:
        """By NeuroBench's counts, and the bills of chips, of the first examples; what cuts and filters is not counted.

        Examples differ in length; that of the counts is the mean. Real time is the network's own, 64 ms a pseudo-frame.
        """
        n = min(PRICED, len(shown))
        answer = self.recogniser.answer(recordings(shown.take(np.arange(n))))
        assert answer.run is not None
        sim, taken = answer.run()
        return spiking_costs(sim, taken, n, steps=taken.raw_counts.steps // n)
