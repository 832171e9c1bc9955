"""Networks of `neuro_models` that learn by surrogate gradients. The output neuron with the most spikes decides.

Learning needs torch, through `neuro_train`; the learnt network runs on every backend without it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import reduce
from importlib.util import find_spec
from operator import add
from typing import Any, ClassVar

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import PIXEL_SPIKE, install, setting
from neuro.chips import mean_work
from neuro.coding import Works, on_numbers
from neuro_events import Events
from neuro_models import path
from neuro_recognise.method import Answer, Course, Learnt, Method, Progress
from neuro_recognise.methods.framewise import from_text, to_text
from neuro_recognise.shown import Array, Evidence, Features, Floats
from neuro_torch import Events as Spikes
from neuro_train.data import BatchData as Taught
from neuro_train.plan import TrainingPlan

INPUT, OUTPUT = "pixels", "out"
ON_FOLDS = "folds of N-MNIST's training recordings, the same as for its accuracy, docs/reference/learning.md"
GUESS = "prototype, one fold of N-MNIST's training recordings"
CHOSEN = "two folds of N-MNIST's training recordings, another seed than for its accuracy; docs/reference/learning.md"
TRAINER = "neuro train, docs/how-to/train.md"
POKER = {"size": [34, 34], "step": 1.0, "duration": 20.0, "epochs": 120, "warp": 0.0, "mirror": 0.5}
"""Tuned on folds of POKER-DVS with seeds 10 to 12. The accuracy is of other seeds, on the same recordings."""
SEEN = ("size", "step", "duration", "scale")
"""Settings that evidence depends on."""


@dataclass(frozen=True)
class Gradients(Method):
    """Base of the methods that learn by gradients: a network with populations ``pixels`` and ``out``, and its training.

    Class attributes:
        file: name of the network in `neuro_models`; its parameters include height, width, classes and resolution.
        learns: trainable parameters by the name of the projection; if empty, all weights learn.
        of_network: settings that are parameters of the network.
    """

    spikes = True
    needs = "torch"
    file: ClassVar[str]
    learns: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    of_network: ClassVar[tuple[str, ...]] = ("hidden",)

    step: float = setting(
        5.0, "ms", "time step of the network; events of a pixel in a step are one spike", ON_FOLDS, above=0
    )
    duration: float = setting(105.0, "ms", "used duration of a recording", "N-MNIST's first saccade", above=0)
    scale: int = setting(1, "px", "side of the square of pixels that share a neuron", TRAINER, at_least=1)
    epochs: int = setting(60, "", "passes over all recordings", ON_FOLDS, at_least=1)
    batch: int = setting(20, "", "batch size in recordings", TRAINER, at_least=1)
    rate: float = setting(0.01, "", "largest learning rate", ON_FOLDS, above=0)
    weight_decay: float = setting(0.1, "", "weight decay per update, times the rate", ON_FOLDS, at_least=0)
    temperature: float = setting(3.0, "", "lead in spikes that makes a class e times as likely", TRAINER, above=0)
    slope: float = setting(1.0, "", "slope of the surrogate gradient, per V_th - V_reset", TRAINER, above=0)
    shift: int = setting(2, "px", "augmentation: largest shift of a recording", ON_FOLDS, at_least=0)
    warp: float = setting(0.15, "", "augmentation: largest rotation (rad), scaling and shear", ON_FOLDS, at_least=0)
    mirror: float = setting(0.0, "", "augmentation: share of mirrored recordings", TRAINER, at_least=0, below=1)
    bits: int = setting(8, "", "bits of weights on Loihi's grid during training; 0: float", ON_FOLDS, at_least=0)
    neurons_per_core: int = setting(8, "", "neurons per core of a chip; 0: the chip's limit", ON_FOLDS, at_least=0)

    @property
    def pixels(self) -> tuple[int, int, int]:
        """The shape of the pixels: (2, rows, columns), with OFF before ON."""
        width, height = self.size
        return (2, -(-height // self.scale), -(-width // self.scale))

    def observing(self) -> Mapping[str, Any]:
        """Return the field, the time step, the duration and the scale."""
        return {name: value for name, value in self.as_words().items() if name in SEEN}

    def observe(self, events: Events) -> Evidence:
        """Return the spikes of the pixels, ``step`` and ``neuron`` (spikes,), and the number of ``events`` (1,)."""
        parameters: Any = {"shape": self.pixels, "step": self.step, "duration": self.duration, "scale": self.scale}
        train = Spikes.of_recordings([self.inside(events)], INPUT, **parameters).trains[INPUT]
        end = np.searchsorted(events.t, (events.t[0] if len(events) else 0) + 1000.0 * self.duration)
        step, neuron = train.step.astype(np.uint16), train.neuron.astype(np.uint32)
        return {"step": step, "neuron": neuron, "events": np.array([end], np.int64)}

    def fit(self, features: Features, course: Course) -> Learnt:
        """Train the network on a single thread of torch, so that equal trainings give equal bits.

        Returns:
            ``network`` as YAML text; ``weight.NAME`` and ``delay.NAME`` of the projection NAME; ``history``, (epochs,)
            share of recordings that were decided rightly in each epoch.

        Raises:
            ModelError: torch is not installed.
        """
        if find_spec("torch") is None:
            message = f"{self.place()} learns by PyTorch, which is not installed"
            raise ModelError(message, hint=install("torch"))
        import torch

        from neuro_train.trainer import learn

        untrained = self.before(len(features.classes))
        names: Any = ("duration", "scale", "epochs", "batch", "rate", "temperature", "slope", "shift", "warp", "mirror")
        plan = TrainingPlan(
            input=INPUT,
            output=OUTPUT,
            trainable=tuple(f"{name}={','.join(parameter_names)}" for name, parameter_names in self.learns.items()),
            decay=self.weight_decay,
            bits=self.bits or None,
            seed=course.seed,
            **{word: getattr(self, word) for word in names},
        )

        def report(epoch: int, values: Mapping[str, float]) -> None:
            course.report(Progress("learning", epoch, self.epochs, values.get("right")))

        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            trained = learn(untrained, self._batch_data(features), plan, course.checkpoint, report)
        finally:
            torch.set_num_threads(threads)
        return self.learnt_of(trained.net) | {"history": trained.curves["right"]}

    def before(self, classes: int) -> neuro.Network:
        """Return the network before training.

        Args:
            classes: number of output neurons.
        """
        _, height, width = self.pixels
        parameters = {name: getattr(self, name) for name in self.of_network}
        parameters |= {"height": height, "width": width, "classes": classes, "resolution": self.step}
        return neuro.load(path(self.file), params=parameters)

    def learnt_of(self, net: neuro.Network) -> dict[str, Array | str]:
        """Split a trained network into text and arrays, as returned by `fit`."""
        learnt: dict[str, Array | str] = {}
        plain = copy(net)
        plain.projections = dict(net.projections)
        for name, part in net.projections.items():
            values_by_name = {"weight": part.weight, "delay": part.delay}
            plain_values: dict[str, Any] = {
                word: getattr(value, "values", value) for word, value in values_by_name.items()
            }  # only files have these
            arrays = {word: values for word, values in plain_values.items() if isinstance(values, np.ndarray)}
            learnt |= {f"{word}.{name}": values for word, values in arrays.items()}
            numbers: Any = dict.fromkeys(arrays, net.resolution)
            plain.projections[name] = replace(part, **numbers)
        return {"network": to_text(plain), **learnt}

    def network(self, learnt: Learnt) -> neuro.Network:
        """Return the network with its learnt values."""
        net = from_text(str(learnt["network"]))
        for key, values in learnt.items():
            word, dot, name = key.partition(".")
            if dot:
                arrays: Any = {word: np.asarray(values)}
                net.projections[name] = replace(net.projections[name], **arrays)
        return net

    def answer(self, learnt: Learnt, features: Features, backend: str = "event") -> Answer:
        """Score classes by the spike counts of the output neurons. The earlier first spike breaks ties.

        A recording without any output spike is silent.
        """
        return self.asker(learnt, backend)(features)

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """Compile the network once for all recordings. The network is reset before each recording."""
        sim = neuro.compile(self.network(learnt), backend=backend)
        h, end = self.step, round(self.duration / self.step) * self.step

        def ask(features: Features) -> Answer:
            scores, counts = [], []
            for item in features.evidence:
                sim.reset()
                sim.inject(INPUT, (item["step"] + 1.0) * h, item["neuron"].astype(np.int64))
                sim.run(end)
                scores.append(_scores(*sim.spikes(OUTPUT), len(features.classes), end))
                counts.append(sim.taken())
            total = reduce(add, counts)
            spikes, n, classes = total.counts.populations[OUTPUT].spikes, len(features), len(features.classes)
            # A spike takes the count and the first time; a class takes five operations to the score, and a comparison.
            counted = {"spike": on_numbers(2, 4), "recording": on_numbers(6 * classes, 3 * classes)}
            works: dict[str, Works] = {"pixels": {"event": PIXEL_SPIKE}, "counts": counted}
            uses = {"event": features.total("events"), "spike": float(spikes), "recording": float(n)}
            host = mean_work(works, uses, n)
            return Answer(np.array(scores), {}, lambda: (sim, total), self.neurons_per_core or None, host=host)

        return ask

    def _batch_data(self, features: Features) -> Taught:
        """Convert evidence to the trainer's data."""
        step, neuron = features.column("step"), features.column("neuron")
        recording = np.repeat(np.arange(len(features)), np.diff(step.offsets))
        spikes = {INPUT: (recording, step.values.astype(np.int64), neuron.values.astype(np.int64))}
        events = Spikes(len(features), round(self.duration / self.step), spikes)
        return Taught(events, features.labels, features.classes, self.pixels, "")


@dataclass(frozen=True)
class Dense(Gradients):
    """A hidden layer that receives all pixels."""

    title = "a dense network of spikes, by surrogate gradients"
    source = "Shrestha and Orchard, NeurIPS 2018; Wu et al., Front. Neurosci. 12:331, 2018 (the form)"
    file = "dense"
    presets = {"poker": POKER}
    measured = {"N-MNIST": "94.8 %", "POKER-DVS": "99.6 %"}

    hidden: int = setting(128, "", "neurons of the hidden layer", ON_FOLDS, at_least=1)


@dataclass(frozen=True)
class Conv(Gradients):
    """A convolution of the pixels, and output neurons that receive all its maps."""

    title = "a convolution of spikes, by surrogate gradients"
    source = "Shrestha and Orchard, NeurIPS 2018; Lee et al., Front. Neurosci. 10:508, 2016 (the form)"
    file = "conv"
    measured = {"N-MNIST": "95.4 %"}
    of_network = ("maps", "kernel", "stride")

    maps: int = setting(8, "", "number of maps, each with a kernel", GUESS, at_least=1)
    kernel: int = setting(5, "px", "side of a kernel", GUESS, at_least=1)
    stride: int = setting(2, "px", "distance between neighbouring neurons of a map", GUESS, at_least=1)
    duration: float = setting(100.0, "ms", "used duration of a recording", CHOSEN, above=0)
    epochs: int = setting(45, "", "passes over all recordings", CHOSEN, at_least=1)
    weight_decay: float = setting(0.01, "", "weight decay per update, times the rate", CHOSEN, at_least=0)
    temperature: float = setting(1.5, "", "lead in spikes that makes a class e times as likely", CHOSEN, above=0)
    neurons_per_core: int = setting(16, "", "neurons per core of a chip; 0: the chip's limit", CHOSEN, at_least=0)


@dataclass(frozen=True)
class Recurrent(Gradients):
    """A hidden layer that receives all pixels and its own spikes."""

    title = "a recurrent network of spikes, by surrogate gradients"
    source = "Bellec et al., NeurIPS 2018; Cramer et al., IEEE TNNLS 33:2744, 2022 (the form)"
    file = "recurrent"
    measured = {"N-MNIST": "94.0 %"}

    hidden: int = setting(128, "", "neurons of the hidden layer", ON_FOLDS, at_least=1)


@dataclass(frozen=True)
class LearntDelays(Gradients):
    """A hidden layer that receives all pixels; the delays to the output layer learn as well as the weights."""

    known_as = "learnt_delays"
    title = "weights and delays of spikes, by surrogate gradients"
    source = "Shrestha and Orchard, NeurIPS 2018; Hammouamri et al., ICLR 2024 (the form)"
    file = "learnt_delays"
    measured = {"N-MNIST": "94.4 %"}
    learns = {"in_hidden": ("weight",), "hidden_out": ("weight", "delay")}

    hidden: int = setting(128, "", "neurons of the hidden layer", ON_FOLDS, at_least=1)


def _scores(times: Floats, ids: Iterable[int], classes: int, end: float) -> Floats:
    """Return the spike count of each class, plus up to 0.5 for an early first spike; NaN if there are no spikes."""
    counts, first = np.zeros(classes), np.full(classes, end)
    np.add.at(counts, np.asarray(ids), 1.0)
    np.minimum.at(first, np.asarray(ids), times)
    return counts + (1.0 - first / end) / 2.0 if counts.any() else np.full(classes, np.nan)
