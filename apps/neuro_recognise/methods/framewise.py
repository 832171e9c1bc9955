"""Methods that cut a recording into frames, encode each frame as spikes, and present the spikes to a network as trials.

Training runs for several epochs over all frames, with a checkpoint after each epoch.
"""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import Part, Registry, part, setting
from neuro.chips import HostWork, mean_work
from neuro.coding import Works, on_numbers
from neuro_events import Events
from neuro_models import path as network_path
from neuro_recognise.method import (
    Answer,
    Course,
    Drawings,
    FrameSize,
    Learnt,
    Method,
    Pictures,
    Progress,
    TrialView,
    View,
)  # fmt: skip
from neuro_recognise.parts.banks import Bank, Counts, Gabors, Max, Pool, Representation
from neuro_recognise.parts.frames import VOTES, Encoder, Frames, LogLatency, ended_by, votes
from neuro_recognise.parts.segmenters import Msd, Segmenter
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints, unlabelled

TABLE_3 = "thesis table 3, lines 2450-2463"
EQ_126 = "docs/how-to/remus.md; thesis eq. 126: true"
BEST = "benchmarks/recognisers.py"
FOLLOWS = {"maps": "the classes and per_class", "rows": "the field and the pool", "columns": "the field and the pool"}
"""Network parameters that cannot be set, and the settings that determine them."""


@dataclass(frozen=True, slots=True)
class Inputs:
    """The spikes that a network receives in a trial.

    Attributes:
        shape: channels, rows and columns of the ids.
        window: duration of a frame's code, ms.
        resolution: time grid of the spikes, ms.
    """

    shape: tuple[int, int, int]
    window: float
    resolution: float


@dataclass(frozen=True, slots=True)
class Shares:
    """Shares of an epoch's frames that were decided rightly and wrongly during learning. Other frames were silent.

    Attributes:
        right: share of right decisions among all frames.
        wrong: share of wrong decisions among all frames.
    """

    right: float
    wrong: float


@dataclass(frozen=True)
class Layer(Part):
    """Base of the networks that learn from frames. Fields are parameters of the network's file, except for `teaching`.

    Class attributes:
        file: name of the network in `neuro_models`.
        teaching: fields that are not parameters of the network.
        supervised: whether each map (neurons that share a kernel) belongs to a class and learns from labels.
        batch: number of frames between two calls of `pace`.
    """

    kind = "network"
    file: ClassVar[str]
    teaching: ClassVar[tuple[str, ...]] = ()
    supervised: ClassVar[bool] = True
    batch: ClassVar[int] = 1000

    spikes: str = setting(
        "once", "", "spikes of an input that learning uses, see neuro.Trials", "no effect with scales=strongest",
        words=("once", "first", "each"),
    )  # fmt: skip

    @classmethod
    def called(cls) -> str:
        """Return the name of the file."""
        return cls.file

    def network(self, inputs: Inputs, classes: int) -> neuro.Network:
        """Return the network for a number of classes, before learning.

        Raises:
            ModelError: a value is outside of the network's bounds.
        """
        values = {name: value for name, value in self.as_words().items() if name not in ("spikes", *self.teaching)}
        net = neuro.load(network_path(self.file), params=values | self.following(inputs, classes))
        assert net.trials_section is not None
        net.trials_section = replace(net.trials_section, spikes=self.spikes)
        return net

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Return the parameters that follow from the input and the classes."""
        channels, rows, columns = inputs.shape
        sizes = {"orientations": channels, "rows": rows, "columns": columns}
        return sizes | {"window": inputs.window, "resolution": inputs.resolution}

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Prepare the network for an epoch; the default does nothing.

        Args:
            sim: simulation that learns.
            epoch: index of the epoch, from 0.
            last: shares of the previous epoch; None before the first.
        """

    def pace(self, sim: neuro.Simulation, n_frames: int) -> None:
        """Prepare the network for a batch of frames; the default does nothing.

        Args:
            sim: simulation that learns.
            n_frames: number of frames presented so far in all epochs.
        """

    def decided(self, results: neuro.TrialResults) -> Ints:
        """Return the class that won each frame during learning, (frames,); -1 if no class won."""
        return results.label

    def also(self, sim: neuro.Simulation) -> dict[str, Any]:
        """Return arrays that were learnt in addition to weights, by name."""
        return {}

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """Return the network for inference; `net` has the learnt weights already."""
        return net


@dataclass(frozen=True)
class Labelled(Layer):
    """Base of networks in which each class has equally many maps, stored one after the other."""

    per_class: int = setting(1, "", "maps of each class", at_least=1)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Add the number of maps."""
        return super().following(inputs, classes) | {"maps": classes * self.per_class}


@dataclass(frozen=True)
class RemusLayer(Labelled):
    """Maps of non-leaky neurons with one kernel per map. The first map to fire decides the class and is rewarded."""

    source = "thesis 6.2.4, table 3; what it leaves open stands in models/neuro_models/remus.yaml"
    file = "remus"
    teaching = ("rate_decay", "least", "margin")

    per_class: int = setting(8, "", "maps per class", f"{BEST}; {TABLE_3}: 2", at_least=1)
    field: int = setting(11, "cells", "side of the receptive field", TABLE_3, at_least=1)
    theta: float = setting(60.0, "mV", "threshold", f"{BEST}; {TABLE_3}: 30, of fewer spikes", above=0)
    weight: float = setting(0.8, "", "mean of the initial weights", "ours; open in the thesis")
    spread: float = setting(0.05, "", "deviation of the initial weights", "ours; open in the thesis", at_least=0)
    Ar_plus: float = setting(0.075, "", "rate on reward, input before the decision", TABLE_3)
    Ar_minus: float = setting(-0.025, "", "rate on reward, other inputs", TABLE_3)
    Ap_plus: float = setting(0.005, "", "rate on punishment, other inputs", TABLE_3)
    Ap_minus: float = setting(-0.04, "", "rate on punishment, input before the decision", TABLE_3)
    epsilon: float = setting(
        2e-4, "", "growth of the right class's weights after a mistake, without rescue",
        f"ours; {TABLE_3}: 0.004, which drives all weights to 1",
    )  # fmt: skip
    rescue: bool = setting(True, "", "whether a mistake rewards the most excited map of the right class", BEST)
    wrong: float = setting(
        -1.0, "", "reward of a wrong decision; 1, with rescue=false and epsilon=0, learns without labels",
        "thesis 6.2.5, line 2432", at_least=-1, at_most=1,
    )  # fmt: skip
    ties_after: bool = setting(False, "", "whether on reward an input in the decision's tick counts as late", EQ_126)
    dropout: float = setting(0.5, "", "share of the maps that are silenced in a recording", f"{BEST}; {TABLE_3}: 0.25")
    decay: float = setting(0.8, "", "factor on dropout per epoch", f"{BEST}; {TABLE_3}: 0.7")
    rate_decay: float = setting(1.0, "", "factor on rates per epoch", "none in the thesis", above=0, at_most=1)
    least: float = setting(
        1.0, "", "least factor on rewards, which follows the share of mistakes in the epoch before; 1: no factor",
        "as eq. 120, docs/reference/recognisers.md", above=0, at_most=1,
    )  # fmt: skip
    margin: float = setting(
        0.0, "", "least distance of weights from 0 and 1 at the start of an epoch, so that labels can change",
        "docs/reference/recognisers.md", at_least=0, below=0.5,
    )  # fmt: skip

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Move weights back inside the margin, decay the rates, and scale rewards by the share of mistakes."""
        if self.margin:
            sim.set_weights("c1_s2", np.clip(sim.weights("c1_s2"), self.margin, 1.0 - self.margin))
        rates = {name: getattr(self, name) for name in ("Ar_plus", "Ar_minus", "Ap_plus", "Ap_minus", "epsilon")}
        mistakes = self.least + (1.0 - self.least) * (last.wrong if last else 1.0)
        rates |= {name: rates[name] * mistakes for name in ("Ar_plus", "Ar_minus")}
        sim.set("c1_s2", **{name: rate * self.rate_decay**epoch for name, rate in rates.items()})


Layer.known = Registry("network", (RemusLayer,))


def taught(net: neuro.Network) -> list[str]:
    """Return the names of the projections that learn from trials."""
    return [name for name, projection in net.projections.items() if projection.synapse.learns == "trials"]


def to_text(net: neuro.Network) -> str:
    """Return a network without large arrays as YAML text."""
    with tempfile.TemporaryDirectory() as folder:
        net.save(Path(folder) / "network.yaml")
        return (Path(folder) / "network.yaml").read_text("utf-8")


def from_text(text: str) -> neuro.Network:
    """Read a network from YAML text; its parts have no origin in a file."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "network.yaml").write_text(text, "utf-8")
        net = neuro.load(Path(folder) / "network.yaml")
    parts: tuple[dict[str, Any], ...] = (net.populations, net.projections, net.signals, net.groups, net.probes)
    for group in parts:
        group.update({name: replace(part, origin=None) for name, part in group.items()})
    net.trials_origin = None
    return net


ORDERS = ("recordings", "frames")
DRAWN = 1
"""Index of the filter scale that is used to draw weights."""
FRONT_END = ("segmenter", "representation", "bank", "pool", "encoder")
"""Parts of a method between events and spikes."""
AT_ONCE = 100
"""Number of recordings whose frames are in memory at once during inference."""


@dataclass(frozen=True)
class Framewise(Method):
    """Base of the methods that present frames to a network.

    Attributes:
        segmenter: rule that cuts a recording into frames.
        representation: pixel values at the end of each frame.
        bank: filters that are applied to each frame.
        pool: rule that selects responses.
        encoder: code of the responses as spikes.
        layer: network that receives the spikes and learns.
        epochs: number of passes over all recordings.
        order: items to shuffle in each epoch, "recordings" as a whole or all "frames".
        vote: rule by which the frames of a recording decide, see `neuro_recognise.parts.frames`.
    """

    spikes = True
    changeable = ("segmenter", "representation", "vote")
    unobserved: ClassVar[tuple[str, ...]] = ("layer", "epochs", "order", "vote", "readout")

    segmenter: Segmenter = part(Segmenter, Msd())
    representation: Representation = part(Representation, Counts())
    bank: Bank = part(Bank, Gabors())
    pool: Pool = part(Pool, Max())
    encoder: Encoder = part(Encoder, LogLatency())
    layer: Layer = part(Layer, RemusLayer())
    epochs: int = setting(8, "", "passes over all recordings", "learning has settled by then", at_least=1)
    order: str = setting("recordings", "", "items to shuffle in each epoch", "ours; open in the thesis", words=ORDERS)
    vote: str = setting("potentials", "", "vote of the frames", "docs/how-to/recognise.md; majority: 2317", words=VOTES)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.representation.remembers and not self.bank.framewise:
            bank, representation = self.bank.called(), self.representation.called()
            raise ModelError(
                f"{self.place()}: bank '{bank}' sees each event by itself: found representation '{representation}'",
                hint="representation=counts, or bank=gabors",
            )

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Return settings with some values changed; see `Settings.changed`.

        Raises:
            ModelError: see `Settings.changed`, or a value is determined by other settings.
        """
        for name in values:
            if name in FOLLOWS and not self.layer.takes(name):
                raise ModelError(f"'{name}' cannot be set: it follows from {FOLLOWS[name]}")
        return super().changed(values)

    def fitting(self, size: tuple[int, int]) -> Self:
        """Fill in the sensor's size, and check that the field holds at least one cell of the pool."""
        settled = super().fitting(size)
        if min(settled.size) < self.pool.side:
            raise ModelError(f"size = {list(settled.size)}: expected at least {self.pool.side} px each, a cell")
        return settled

    def fixed(self) -> Mapping[str, Any]:
        """Return all settings except the number of epochs, which may be increased to continue a training."""
        return {name: value for name, value in self.as_words().items() if name != "epochs"}

    @property
    def front_end(self) -> Inputs:
        """Shape, window and grid of the front end's spikes."""
        width, height = self.size
        channels = self.encoder.channels(len(self.bank.sizes), len(self.bank.orientations))
        shape = (channels, height // self.pool.side, width // self.pool.side)
        return Inputs(shape, self.encoder.window, self.encoder.resolution)

    @property
    def inputs(self) -> Inputs:
        """Shape, window and grid of the spikes that the network receives."""
        return self.front_end

    def observe(self, events: Events) -> Evidence:
        """Compute the spikes of each frame.

        Returns:
            ``codes`` and ``ids`` (spikes,); ``lengths`` (frames,) spikes per frame; ``ends`` (frames,) time at which a
            frame is known to be complete, us after the first event; ``pixels`` (frames,) pixels with events;
            ``lasts`` (1,) us from the first event to the last; ``events`` (1,) number of events.
        """
        first = int(events.t[0]) if len(events) else 0
        inside = self.inside(events)
        bounds = self.segmenter.bounds(inside.t)
        responses = self.bank.responses(inside, bounds, self.pool.side, self.representation)
        codes, ids, lengths = self.encoder.encode(self.pool.passed(responses, self.bank.sizes))
        ends = self.segmenter.complete_at(inside.t, bounds) - first
        fitting = np.min_scalar_type(int(np.prod(self.front_end.shape)))
        pixels = self.representation.pixels(inside, bounds).active(self.size[0])
        evidence = {"codes": codes, "ids": ids.astype(fitting), "lengths": lengths, "ends": ends, "pixels": pixels}
        return evidence | {"lasts": events.t[-1:] - events.t[:1], "events": np.array([len(events)])}

    def observe_until(self, events: Events, times_us: Sequence[int]) -> list[Evidence]:
        """Return the frames that were complete at each time.

        A segmenter whose last segment may still change observes each beginning separately.
        """
        if self.segmenter.tentative:
            return super().observe_until(events, times_us)
        observation = self.observe(events)
        ends = np.searchsorted(events.t, np.asarray(times_us) + (events.t[0] if len(events) else 0), "right")
        return [{**ended_by(observation, us), "events": np.array([n])} for us, n in zip(times_us, ends, strict=True)]

    def fit(self, features: Features, course: Course) -> Learnt:
        """Train the network.

        Returns:
            ``network`` before learning as YAML text, weights by the name of their projection, ``history`` and
            ``mistakes`` (epochs,) the shares of frames that were decided rightly and wrongly in each epoch, ``seed``,
            and what the encoder learnt.

        Raises:
            ModelError: a value is outside of the network's bounds, or there is nothing to learn from.
        """
        frames = frames_to_learn_from(features, self.segmenter)
        net = self.layer.network(self.inputs, len(features.classes))
        codes = self.encoder.learn(frames.codes)
        sim = neuro.compile(net, backend=course.backend, seed=course.seed)
        shares: list[Shares] = []
        silent_epochs = 0
        if state := course.resume():
            pairs = zip(state["history"].tolist(), state["mistakes"].tolist(), strict=True)
            shares = [Shares(*pair) for pair in pairs]
            restore(sim, state["state"])
        for epoch in range(len(shares), self.epochs):
            self.layer.begin(sim, epoch, shares[-1] if shares else None)
            shares.append(self._epoch(sim, frames, features.labels, codes, epoch, course))
            silent_epochs = silent_epochs + 1 if shares[-1] == Shares(right=0.0, wrong=0.0) else 0
            course.keep(**curves_of(shares), state=state_of(sim))
        if silent_epochs:
            epochs = f"the last {silent_epochs} epochs" if silent_epochs > 1 else "the last epoch"
            message = f"{self.called()}: no neuron fired in any of the {len(frames)} frames of {epochs}"
            message += f", so nothing is decided: {self.way_out_of_silence()}"
            warnings.warn(message, neuro.ModelWarning, stacklevel=2)
        learnt: dict[str, Array | str] = {name: sim.weights(name) for name in taught(net)}
        learnt |= {"network": to_text(net), **curves_of(shares), "seed": np.array(course.seed)}
        learnt |= codes | self.layer.also(sim)
        return {**learnt, **self.afterwards(learnt, features, course)}

    def afterwards(self, learnt: Learnt, features: Features, course: Course) -> Learnt:
        """Learn from the trained network's responses to the same recordings, e.g. a readout. Return arrays by name."""
        return {}

    def _epoch(
        self, sim: neuro.Simulation, frames: Frames, labels: Ints, codes: Learnt, epoch: int, course: Course
    ) -> Shares:
        """Present all recordings once. Return the shares of right and wrong decisions, NaN without labels."""
        presented, n_right, n_wrong = 0, 0, 0
        rng = np.random.default_rng([course.seed, epoch])
        if self.order == "frames":
            turn = rng.permutation(len(frames))
        else:
            place = np.empty(len(labels), np.int64)
            place[rng.permutation(len(labels))] = np.arange(len(labels))
            turn = np.argsort(place[frames.recording], kind="stable")
        for first in range(0, len(turn), self.layer.batch):
            batch = frames.take(turn[first : first + self.layer.batch])
            self.layer.pace(sim, epoch * len(frames) + presented)
            targets = labels[batch.recording] if self.layer.supervised else None
            times = self.encoder.times(batch.codes, codes)
            results = sim.trials(
                times, batch.ids, batch.offsets, labels=targets, learn=True, samples=batch.recording, epoch=epoch
            )
            sim.forget(before=sim.time)
            presented += len(results)
            if targets is not None:
                decided = self.layer.decided(results)
                n_right += int(np.count_nonzero(decided == targets))
                n_wrong += int(np.count_nonzero((decided != targets) & (decided >= 0)))
            share = None if targets is None else n_right / presented
            course.report(Progress(f"epoch {epoch + 1} of {self.epochs}", presented, len(frames), share))
        if not self.layer.supervised:
            return Shares(right=float("nan"), wrong=float("nan"))
        return Shares(right=n_right / len(frames), wrong=n_wrong / len(frames))

    def network(self, learnt: Learnt) -> neuro.Network | None:
        """Return the learnt network; None if several networks decide one after the other."""
        return self.deciding(learnt)

    def deciding(self, learnt: Learnt) -> neuro.Network:
        """Return the network that decides, with its learnt weights."""
        net = from_text(str(learnt["network"]))
        for name in taught(net):
            net.projections[name] = replace(net.projections[name], weight=learnt[name])
        return self.layer.settled(net, learnt)

    def simulation(self, learnt: Learnt, backend: str = "event") -> neuro.Simulation:
        """Compile the learnt network."""
        return neuro.compile(self.deciding(learnt), backend=backend, seed=int(learnt["seed"]))

    def present(self, sim: neuro.Simulation, learnt: Learnt, features: Features) -> tuple[neuro.TrialResults, Frames]:
        """Present all frames of recordings without learning. Return the results of the trials, and the frames."""
        frames = Frames.of(features)
        results = sim.trials(self.encoder.times(frames.codes, learnt), frames.ids, frames.offsets)
        sim.forget(before=sim.time)
        return results, frames

    def presented(
        self, sim: neuro.Simulation, learnt: Learnt, features: Features
    ) -> Iterator[tuple[Features, neuro.TrialResults, Frames]]:
        """Present recordings in batches without learning. Yield each batch with the results of `present`."""
        for batch in features.batches(AT_ONCE):
            yield batch, *self.present(sim, learnt, batch)

    def entering(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Features]:
        """Return a function from spikes of the front end to input of the deciding network; here the identity."""
        return lambda features: features

    def answer(self, learnt: Learnt, features: Features, backend: str = "event") -> Answer:
        """Compute the scores of each voting rule. A recording without frames is silent."""
        return self.asker(learnt, backend)(features)

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """Compile the network once for all calls. `Answer.run` returns the simulation as it is after the last call."""
        sim, entering = self.simulation(learnt, backend), self.entering(learnt, backend)

        def ask(features: Features) -> Answer:
            sim.reset()  # random numbers of noise and rounding depend on the step
            batches: dict[str, list[Floats]] = {}
            counts: list[neuro.TrialCounts] = []
            for batch, results, frames in self.presented(sim, learnt, entering(features)):
                for name, scores in self.votes(learnt, results, frames, batch).items():
                    batches.setdefault(name, []).append(scores)
                counts.append(results.taken)
            votes = {name: np.concatenate(scores) for name, scores in batches.items()}
            host = self.host(learnt, features, results.potential.shape[1])
            return Answer(
                votes[self.vote], votes, lambda: (sim, reduce(add, counts)), None, features.duration_s(), host
            )

        return ask

    def host(self, learnt: Learnt, features: Features, neurons: int) -> tuple[HostWork, ...]:
        """Return the operations of the front end and of the vote.

        Args:
            learnt: result of `fit`.
            features: evidence of the recordings.
            neurons: number of neurons whose frames decide.
        """
        _, rows, columns = self.front_end.shape
        bank, pixels = self.bank, int(np.prod(self.size))
        size = FrameSize(pixels, bank.sizes, len(bank.orientations), self.pool.side, rows * columns)
        parts = {name: getattr(self, name) for name in FRONT_END if name != "representation" or bank.framewise}
        works = {f"{name} {part.called()}": part.work(size) for name, part in parts.items()}
        works[f"vote {self.vote}"] = self.vote_work(learnt, neurons, len(features.classes))
        frames = float(sum(len(item["lengths"]) for item in features.evidence))
        uses = {"event": features.total("events"), "pixel": features.total("pixels"), "frame": frames}
        return mean_work(works, uses | {"recording": float(len(features))}, len(features))

    def vote_work(self, learnt: Learnt, neurons: int, classes: int) -> Works:
        """Return the operations of the vote.

        A vote finds the largest potential of each class in a frame, adds these up, and chooses a class. A majority also
        counts a win in each frame, and breaks ties by a sort and 4 operations per class.
        """
        majority = self.vote == "majority"
        ties = classes * (4 + math.ceil(math.log2(max(1, classes))))
        frame = on_numbers(neurons + classes + majority, neurons + 2 * classes)
        return {"frame": frame, "recording": on_numbers(2 * classes + majority * ties, 2 * classes)}

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, features: Features
    ) -> Mapping[str, Floats]:
        """Return scores of each voting rule, (recordings, classes)."""
        return votes(results, frames.recording, len(features), len(features.classes))

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """Return the pixel values of each frame, and the network's input spikes with the winner."""
        inside, evidence = self.inside(events), self.observe(events)
        ends = evidence["ends"] / 1000.0
        if not len(ends):
            return []
        bounds = self.segmenter.bounds(inside.t)
        features = self.entering(learnt)(unlabelled([evidence], tuple(classes)))
        results, frames = self.present(self.simulation(learnt), learnt, features)
        suffixes = [f" for {name}" for name in classes] if self.layer.supervised else [""] * results.potential.shape[1]
        labels = tuple(
            f"neuron {neuron} wins{suffixes[label]}" if label >= 0 else "none wins"
            for neuron, label in zip(results.winner.tolist(), results.label.tolist(), strict=True)
        )
        times, size = self.encoder.times(frames.codes, learnt), int(np.prod(self.inputs.shape))
        bands = self.encoder.bands(self.bank.sizes, self.bank.orientations) if self.inputs == self.front_end else ()
        return [
            Pictures("Frame", ends, self.representation.pixels(inside, bounds).pictures(self.size)),
            TrialView("Its spikes", ends, self.encoder.window, size, frames.offsets, times, frames.ids, labels, bands),
        ]

    def images(self, kernels: Floats) -> Floats:
        """Return images (features, height, width), px, of kernels (features, orientations, rows, columns) on cells."""
        from neuro_recognise.telling.pictures import reconstructed

        return reconstructed(kernels, self.bank.filters[DRAWN % len(self.bank.sizes)], self.pool.side)

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw the kernels of the classes' maps, if there are any, and the learning curve."""
        from neuro_recognise.telling.pictures import history, prototypes

        figures = {}
        if self.layer.supervised:
            if "c1_s2" in learnt:
                figures["prototypes"] = prototypes(np.asarray(learnt["c1_s2"]), classes, self.bank.orientations)
            figures["learning"] = history(np.asarray(learnt["history"]), len(classes))
        return figures


def frames_to_learn_from(features: Features, segmenter: Segmenter) -> Frames:
    """Return all frames of recordings. Warn if some recordings have events, but no frame.

    Args:
        features: evidence of the recordings.
        segmenter: rule that cut the recordings into frames.

    Raises:
        ModelError: there are no frames.
    """
    frames = Frames.of(features)
    without = np.setdiff1d(np.arange(len(features)), frames.recording)
    short = [evidence for k in without if "lasts" in (evidence := features.evidence[k]) and evidence["events"][0]]
    sizes = [(evidence["events"][0], evidence["lasts"][0]) for evidence in short]
    if len(frames) and not sizes:
        return frames
    events, us = np.median(sizes, axis=0) if sizes else (0.0, 0.0)
    values = ", ".join(f"{row.name} = {row.value:g}" for row in segmenter.rows() if not isinstance(row.value, str))
    proposed = segmenter.proposal(events, us) if events else {}
    hint = "the settings of the segmenter, as neuro recognise list METHOD shows them, decide where frames end"
    for name, value in proposed.items():
        hint = f"--set segmenter.{name}={value:g} gives a recording about four frames"
    what = f"{events:,.0f} events in {us / 1000:,.0f} ms (median); segmenter {segmenter.called()}, {values}"
    if not len(frames):
        raise ModelError(f"no recording is long enough for a frame: found {what}: expected a frame", hint=hint)
    message = f"{len(sizes)} of {len(features)} recordings are too short for a frame, so not learnt: {what}: {hint}"
    warnings.warn(message, neuro.ModelWarning, stacklevel=3)
    return frames


def curves_of(shares: Sequence[Shares]) -> dict[str, Array]:
    """Return the learning curves: shares of right decisions, ``history``, and of wrong ones, ``mistakes``, by epoch."""
    return {"history": np.array([s.right for s in shares]), "mistakes": np.array([s.wrong for s in shares])}


def state_of(sim: neuro.Simulation) -> Array:
    """Return the contents of the file that `Simulation.save` writes, as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        sim.save(Path(folder) / "state.h5")
        return np.fromfile(Path(folder) / "state.h5", np.uint8)


def restore(sim: neuro.Simulation, state: Array) -> None:
    """Restore a state from `state_of`."""
    with tempfile.TemporaryDirectory() as folder:
        state.tofile(Path(folder) / "state.h5")
        sim.restore(Path(folder) / "state.h5")
