"""Networks of `neuro_models` that learn by gradients; the output neuron that fires most decides.

Learning needs torch, by `neuro_train`; what was learnt runs on every backend without it.
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
from neuro.apps import install, setting
from neuro_events import Events
from neuro_models import path
from neuro_recognise.method import Answer, Course, Learnt, Method, Progress
from neuro_recognise.methods.framewise import from_text, to_text
from neuro_recognise.shown import Array, Evidence, Features, Floats
from neuro_torch import Events as Spikes
from neuro_train.data import BatchData as Taught
from neuro_train.plan import TrainingPlan

INPUT, OUTPUT = "pixels", "out"
ON_FOLDS = "folds of N-MNIST's training recordings, docs/how-to/train.md, which its accuracy is of, too"
GUESS = "prototype, one fold of N-MNIST's training recordings"
CHOSEN = "two folds of N-MNIST's training recordings, of another seed than its accuracy is of; docs/how-to/train.md"
TRAINER = "neuro train, docs/how-to/train.md"
POKER = {"size": [34, 34], "step": 1.0, "duration": 20.0, "epochs": 120, "warp": 0.0, "mirror": 0.5}
"""Chosen by folds of POKER-DVS that others than its accuracy is of (seeds 10 to 12), but of the same recordings."""
SEEN = ("size", "step", "duration", "scale")
"""Settings that what a recording shows depends on."""


@dataclass(frozen=True)
class Gradients(Method):
    """Base of these methods: a network with the populations ``pixels`` and ``out``, and how it learns.

    Class attributes:
        file: the network, in `neuro_models`; it has the parameters height, width, classes and resolution.
        learns: what of which projection learns; the weights of all if there is none.
        of_network: settings that are parameters of the network.
    """

    spikes = True
    needs = "torch"
    file: ClassVar[str]
    learns: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    of_network: ClassVar[tuple[str, ...]] = ("hidden",)

    step: float = setting(5.0, "ms", "of the network; events of a pixel in one are one spike", ON_FOLDS, above=0)
    duration: float = setting(105.0, "ms", "of a recording", "N-MNIST's first saccade", above=0)
    scale: int = setting(1, "px", "in a row and in a column that are one neuron", TRAINER, at_least=1)
    epochs: int = setting(60, "", "how often all recordings are shown", ON_FOLDS, at_least=1)
    batch: int = setting(20, "", "recordings between two steps of learning", TRAINER, at_least=1)
    rate: float = setting(0.01, "", "the largest learning rate", ON_FOLDS, above=0)
    weight_decay: float = setting(0.1, "", "of weights in each step, times the rate", ON_FOLDS, at_least=0)
    temperature: float = setting(3.0, "", "spikes that make a class e times likelier", TRAINER, above=0)
    slope: float = setting(1.0, "", "of the surrogate, per V_th - V_reset", TRAINER, above=0)
    shift: int = setting(2, "px", "recordings are moved while learning, at most", ON_FOLDS, at_least=0)
    warp: float = setting(0.15, "", "they are turned (rad), made larger and sheared, at most", ON_FOLDS, at_least=0)
    mirror: float = setting(0.0, "", "share of them that are mirrored, left to right", TRAINER, at_least=0, below=1)
    bits: int = setting(8, "", "of weights on Loihi's grid while learning; 0: as they are", ON_FOLDS, at_least=0)
    neurons_per_core: int = setting(8, "", "on a chip; 0: as many as it allows", ON_FOLDS, at_least=0)

    @property
    def pixels(self) -> tuple[int, int, int]:
        """The shape of the pixels: OFF then ON, rows, columns."""
        width, height = self.size
        return (2, -(-height // self.scale), -(-width // self.scale))

    def observing(self) -> Mapping[str, Any]:
        """The field, the steps, and how many pixels are one."""
        return {name: value for name, value in self.as_words().items() if name in SEEN}

    def observe(self, events: Events) -> Evidence:
        """The spikes of the pixels: ``step`` and ``neuron``, (spikes,)."""
        words: Any = {"shape": self.pixels, "step": self.step, "duration": self.duration, "scale": self.scale}
        train = Spikes.of_recordings([self.inside(events)], INPUT, **words).trains[INPUT]
        return {"step": train.step.astype(np.uint16), "neuron": train.neuron.astype(np.uint32)}

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Teach the network on one thread of torch, so that the same training gives the same bits.

        Returns:
            ``network`` as YAML text, ``weight.NAME`` and ``delay.NAME`` by projection, ``history`` (epochs,) the share
            of recordings that were decided rightly in each.

        Raises:
            ModelError: torch is not installed.
        """
        if find_spec("torch") is None:
            message = f"{self.place()} learns by PyTorch, which is not installed"
            raise ModelError(message, hint=install("torch"))
        import torch

        from neuro_train.trainer import learn

        before = self.before(len(shown.classes))
        words: Any = ("duration", "scale", "epochs", "batch", "rate", "temperature", "slope", "shift", "warp", "mirror")
        plan = TrainingPlan(
            input=INPUT,
            output=OUTPUT,
            trainable=tuple(f"{name}={','.join(each)}" for name, each in self.learns.items()),
            decay=self.weight_decay,
            bits=self.bits or None,
            seed=course.seed,
            **{word: getattr(self, word) for word in words},
        )

        def report(epoch: int, noted: Mapping[str, float]) -> None:
            course.report(Progress("learning", epoch, self.epochs, noted.get("right")))

        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            trained = learn(before, self._taught(shown), plan, course.checkpoint, report)
        finally:
            torch.set_num_threads(threads)
        return self.learnt_of(trained.net) | {"history": trained.curves["right"]}

    def before(self, classes: int) -> neuro.Network:
        """The network before it learns.

        Args:
            classes: neurons of the output.
        """
        _, height, width = self.pixels
        words = {name: getattr(self, name) for name in self.of_network}
        words |= {"height": height, "width": width, "classes": classes, "resolution": self.step}
        return neuro.load(path(self.file), params=words)

    def learnt_of(self, net: neuro.Network) -> dict[str, Array | str]:
        """What `fit` gives of a network that has learnt."""
        learnt: dict[str, Array | str] = {}
        plain = copy(net)
        plain.projections = dict(net.projections)
        for name, part in net.projections.items():
            known = {"weight": part.weight, "delay": part.delay}
            held: dict[str, Any] = {word: getattr(value, "values", value) for word, value in known.items()}  # of a file
            listed = {word: values for word, values in held.items() if isinstance(values, np.ndarray)}
            learnt |= {f"{word}.{name}": values for word, values in listed.items()}
            numbers: Any = dict.fromkeys(listed, net.resolution)
            plain.projections[name] = replace(part, **numbers)
        return {"network": to_text(plain), **learnt}

    def network(self, learnt: Learnt) -> neuro.Network:
        """The network with what it has learnt."""
        net = from_text(str(learnt["network"]))
        for key, values in learnt.items():
            word, dot, name = key.partition(".")
            if dot:
                listed: Any = {word: np.asarray(values)}
                net.projections[name] = replace(net.projections[name], **listed)
        return net

    def answer(self, learnt: Learnt, shown: Features, backend: str = "event") -> Answer:
        """The output neuron that fires most, of several the first to fire; a recording without a spike is silent."""
        return self.asker(learnt, backend)(shown)

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """With a network that is compiled once and begins anew with each recording."""
        sim = neuro.compile(self.network(learnt), backend=backend)
        h, end = self.step, round(self.duration / self.step) * self.step

        def ask(shown: Features) -> Answer:
            scores, taken = [], []
            for one in shown.evidence:
                sim.reset()
                sim.inject(INPUT, (one["step"] + 1.0) * h, one["neuron"].astype(np.int64))
                sim.run(end)
                scores.append(_scores(*sim.spikes(OUTPUT), len(shown.classes), end))
                taken.append(sim.taken())
            return Answer(np.array(scores), {}, lambda: (sim, reduce(add, taken)), self.neurons_per_core or None)

        return ask

    def _taught(self, shown: Features) -> Taught:
        """Recordings as the trainer has them."""
        step, neuron = shown.column("step"), shown.column("neuron")
        recording = np.repeat(np.arange(len(shown)), np.diff(step.offsets))
        spikes = {INPUT: (recording, step.values.astype(np.int64), neuron.values.astype(np.int64))}
        events = Spikes(len(shown), round(self.duration / self.step), spikes)
        return Taught(events, shown.labels, shown.classes, self.pixels, "")


@dataclass(frozen=True)
class Dense(Gradients):
    """A hidden layer that sees all pixels."""

    title = "a dense network of spikes, by surrogate gradients"
    source = "Shrestha and Orchard, NeurIPS 2018; Wu et al., Front. Neurosci. 12:331, 2018 (the form)"
    file = "dense"
    presets = {"poker": POKER}
    measured = {"N-MNIST": "94.8 %", "POKER-DVS": "99.6 %"}

    hidden: int = setting(128, "", "neurons of the hidden layer", ON_FOLDS, at_least=1)


@dataclass(frozen=True)
class Conv(Gradients):
    """Kernels see the pixels at each place, and a neuron a class sees what they found."""

    title = "a convolution of spikes, by surrogate gradients"
    source = "Shrestha and Orchard, NeurIPS 2018; Lee et al., Front. Neurosci. 10:508, 2016 (the form)"
    file = "conv"
    measured = {"N-MNIST": "95.4 %"}
    of_network = ("maps", "kernel", "stride")

    maps: int = setting(8, "", "kernels", GUESS, at_least=1)
    kernel: int = setting(5, "px", "side of a kernel", GUESS, at_least=1)
    stride: int = setting(2, "px", "from place to place", GUESS, at_least=1)
    duration: float = setting(100.0, "ms", "of a recording", CHOSEN, above=0)
    epochs: int = setting(45, "", "how often all recordings are shown", CHOSEN, at_least=1)
    weight_decay: float = setting(0.01, "", "of weights in each step, times the rate", CHOSEN, at_least=0)
    temperature: float = setting(1.5, "", "spikes that make a class e times likelier", CHOSEN, above=0)
    neurons_per_core: int = setting(16, "", "on a chip; 0: as many as it allows", CHOSEN, at_least=0)


@dataclass(frozen=True)
class Recurrent(Gradients):
    """A hidden layer that sees all pixels and itself."""

    title = "a recurrent network of spikes, by surrogate gradients"
    source = "Bellec et al., NeurIPS 2018; Cramer et al., IEEE TNNLS 33:2744, 2022 (the form)"
    file = "recurrent"
    measured = {"N-MNIST": "94.0 %"}

    hidden: int = setting(128, "", "neurons of the hidden layer", ON_FOLDS, at_least=1)


@dataclass(frozen=True)
class LearntDelays(Gradients):
    """A hidden layer that sees all pixels, whose spikes take times to the output that learn as weights do."""

    known_as = "learnt_delays"
    title = "weights and delays of spikes, by surrogate gradients"
    source = "Shrestha and Orchard, NeurIPS 2018; Hammouamri et al., ICLR 2024 (the form)"
    file = "learnt_delays"
    measured = {"N-MNIST": "94.4 %"}
    learns = {"in_hidden": ("weight",), "hidden_out": ("weight", "delay")}

    hidden: int = setting(128, "", "neurons of the hidden layer", ON_FOLDS, at_least=1)


def _scores(times: Floats, ids: Iterable[int], classes: int, end: float) -> Floats:
    """Spikes of each class, and less than one for the earliest; NaN of all where there is none."""
    counts, first = np.zeros(classes), np.full(classes, end)
    np.add.at(counts, np.asarray(ids), 1.0)
    np.minimum.at(first, np.asarray(ids), times)
    return counts + (1.0 - first / end) / 2.0 if counts.any() else np.full(classes, np.nan)
