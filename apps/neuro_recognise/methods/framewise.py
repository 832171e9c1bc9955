"""Methods that cut a recording into frames, make spikes of each, and show these to a network as trials.

A training is epochs over all frames, kept after each, so that it can go on after a kill.
"""

from __future__ import annotations

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
from neuro_events import Events
from neuro_models import path as network_path
from neuro_recognise.method import Answer, Course, Drawings, Learnt, Method, Pictures, Progress, TrialView, View
from neuro_recognise.parts.banks import Bank, Counts, Gabors, Max, Pool, Representation
from neuro_recognise.parts.frames import VOTES, Encoder, Frames, LogLatency, ended_by, votes
from neuro_recognise.parts.segmenters import Msd, Segmenter
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints, unlabelled

TABLE_3 = "thesis table 3, lines 2450-2463"
EQ_126 = "docs/how-to/remus.md; thesis eq. 126: true"
BEST = "benchmarks/recognisers.py"
FOLLOWS = {"maps": "the classes and per_class", "rows": "the field and the pool", "columns": "the field and the pool"}
"""Parameters of networks that cannot be set, and what they follow from."""


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a network is shown.

    Attributes:
        shape: channels, rows and columns of the ids.
        window: length of a frame's code, ms.
        resolution: grid of its times, ms.
    """

    shape: tuple[int, int, int]
    window: float
    resolution: float


@dataclass(frozen=True, slots=True)
class Shares:
    """How the frames of an epoch were decided while they were learnt from; the rest were silent.

    Attributes:
        right: share of all frames.
        wrong: likewise.
    """

    right: float
    wrong: float


@dataclass(frozen=True)
class Layer(Part):
    """Base of these networks. Fields are parameters of the network's file, but for those of `teaching`.

    Class attributes:
        file: the network, in `neuro_models`.
        teaching: fields that are no parameters of the network.
        supervised: whether maps have classes, which it learns by; else it learns without labels.
        batch: frames that are shown between two calls of `pace`.
    """

    kind = "network"
    file: ClassVar[str]
    teaching: ClassVar[tuple[str, ...]] = ()
    supervised: ClassVar[bool] = True
    batch: ClassVar[int] = 1000

    spikes: str = setting(
        "once", "", "which spikes of an input teach, see neuro.Trials", "as it is with scales=strongest",
        words=("once", "first", "each"),
    )  # fmt: skip

    @classmethod
    def called(cls) -> str:
        """The name of its file."""
        return cls.file

    def network(self, inputs: Inputs, classes: int) -> neuro.Network:
        """The network for a number of classes, before learning.

        Raises:
            ModelError: a value is out of the network's bounds.
        """
        values = {name: value for name, value in self.as_words().items() if name not in ("spikes", *self.teaching)}
        net = neuro.load(network_path(self.file), params=values | self.following(inputs, classes))
        assert net.trials_section is not None
        net.trials_section = replace(net.trials_section, spikes=self.spikes)
        return net

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Parameters that follow from the input and the classes."""
        channels, rows, columns = inputs.shape
        words = {"orientations": channels, "rows": rows, "columns": columns}
        return words | {"window": inputs.window, "resolution": inputs.resolution}

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """What is done before each epoch.

        Args:
            sim: is taught.
            epoch: from 0.
            last: of the epoch before; None before the first.
        """

    def pace(self, sim: neuro.Simulation, seen: int) -> None:
        """What is done before each batch of frames.

        Args:
            sim: is taught.
            seen: how many frames it has been taught, in all epochs.
        """

    def decided(self, results: neuro.TrialResults) -> Ints:
        """(frames,) the class that was decided for while it was taught, -1 for none."""
        return results.label

    def also(self, sim: neuro.Simulation) -> dict[str, Any]:
        """What has been learnt beside weights, as arrays by name."""
        return {}

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """The network that is asked, once it has its weights."""
        return net


@dataclass(frozen=True)
class Labelled(Layer):
    """Base of networks in which each class has equally many maps, one after the other."""

    per_class: int = setting(1, "", "maps of each class", at_least=1)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Also the number of maps."""
        return super().following(inputs, classes) | {"maps": classes * self.per_class}


@dataclass(frozen=True)
class RemusLayer(Labelled):
    """Grids of neurons without leak that share a kernel; the first to fire names the class and is rewarded for it."""

    source = "thesis 6.2.4, table 3; what it leaves open stands in models/neuro_models/remus.yaml"
    file = "remus"
    teaching = ("rate_decay", "least", "margin")

    per_class: int = setting(8, "", "grids of each class", f"{BEST}; {TABLE_3}: 2", at_least=1)
    field: int = setting(11, "cells", "side of the receptive field", TABLE_3, at_least=1)
    theta: float = setting(60.0, "mV", "threshold", f"{BEST}; {TABLE_3}: 30, of fewer spikes", above=0)
    weight: float = setting(0.8, "", "mean of the first weights", "ours; open in the thesis")
    spread: float = setting(0.05, "", "deviation of the first weights", "ours; open in the thesis", at_least=0)
    Ar_plus: float = setting(0.075, "", "rate on reward, input before the decision", TABLE_3)
    Ar_minus: float = setting(-0.025, "", "rate on reward, other inputs", TABLE_3)
    Ap_plus: float = setting(0.005, "", "rate on punishment, other inputs", TABLE_3)
    Ap_minus: float = setting(-0.04, "", "rate on punishment, input before the decision", TABLE_3)
    epsilon: float = setting(
        2e-4, "", "growth of the right class' weights after a mistake, without rescue",
        f"ours; {TABLE_3}: 0.004, which drives all weights to 1",
    )  # fmt: skip
    rescue: bool = setting(True, "", "whether a mistake rewards the best-excited grid of the right class", BEST)
    wrong: float = setting(
        -1.0, "", "reward of a wrong decision; 1, with rescue=false and epsilon=0, learns without labels",
        "thesis 6.2.5, line 2432", at_least=-1, at_most=1,
    )  # fmt: skip
    ties_after: bool = setting(False, "", "whether on reward an input in the decision's tick counts as late", EQ_126)
    dropout: float = setting(0.5, "", "share of the grids that are silent in a recording", f"{BEST}; {TABLE_3}: 0.25")
    decay: float = setting(0.8, "", "factor on dropout from epoch to epoch", f"{BEST}; {TABLE_3}: 0.7")
    rate_decay: float = setting(1.0, "", "factor on rates, epoch by epoch", "none in the thesis", above=0, at_most=1)
    least: float = setting(
        1.0, "", "least factor on rewards, which follows the share of mistakes in the epoch before; 1: no factor",
        "as eq. 120, docs/reference/recognisers.md", above=0, at_most=1,
    )  # fmt: skip
    margin: float = setting(
        0.0, "", "least distance of weights from 0 and 1 at the start of an epoch, so that labels can change",
        "docs/reference/recognisers.md", at_least=0, below=0.5,
    )  # fmt: skip

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Bring weights back to the margin, let the rates decay, and those of rewards follow the mistakes."""
        if self.margin:
            sim.set_weights("c1_s2", np.clip(sim.weights("c1_s2"), self.margin, 1.0 - self.margin))
        rates = {name: getattr(self, name) for name in ("Ar_plus", "Ar_minus", "Ap_plus", "Ap_minus", "epsilon")}
        mistakes = self.least + (1.0 - self.least) * (last.wrong if last else 1.0)
        rates |= {name: rates[name] * mistakes for name in ("Ar_plus", "Ar_minus")}
        sim.set("c1_s2", **{name: rate * self.rate_decay**epoch for name, rate in rates.items()})


Layer.known = Registry("network", (RemusLayer,))


def taught(net: neuro.Network) -> list[str]:
    """The projections that learn from trials."""
    return [name for name, projection in net.projections.items() if projection.synapse.learns == "trials"]


def to_text(net: neuro.Network) -> str:
    """A network without large arrays as YAML text."""
    with tempfile.TemporaryDirectory() as folder:
        net.save(Path(folder) / "network.yaml")
        return (Path(folder) / "network.yaml").read_text("utf-8")


def from_text(text: str) -> neuro.Network:
    """The network that a YAML text describes; its parts have no places, as there is no file to look into."""
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
"""The scale of the filters by which weights are drawn."""
AT_ONCE = 100
"""Recordings whose frames are in memory while a network answers."""


@dataclass(frozen=True)
class Framewise(Method):
    """Base of these methods.

    Attributes:
        segmenter: cuts a recording into frames.
        representation: what of the events is seen at the end of each.
        bank: filters each frame.
        pool: passes responses on.
        encoder: makes spikes of them.
        layer: the network that is shown these and learns.
        epochs: how often all recordings are shown.
        order: what is shuffled in each epoch, whole recordings or all their frames.
        vote: how the frames of a recording decide, see `neuro_recognise.parts.frames`.
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
    epochs: int = setting(8, "", "how often all recordings are shown", "learning has settled by then", at_least=1)
    order: str = setting("recordings", "", "what is shuffled in each epoch", "thesis section 6.2.5", words=ORDERS)
    vote: str = setting("potentials", "", "how frames decide", "docs/how-to/recognise.md; majority: 2431", words=VOTES)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.representation.remembers and not self.bank.shown:
            bank, seen = self.bank.called(), self.representation.called()
            raise ModelError(
                f"{self.place()}: bank '{bank}' sees each event by itself: found representation '{seen}'",
                hint="representation=counts, or bank=gabors",
            )

    def changed(self, values: Mapping[str, Any]) -> Self:
        """Settings with some values changed; see `Settings.changed`.

        Raises:
            ModelError: also where a value follows from others.
        """
        for name in values:
            if name in FOLLOWS and not self.layer.takes(name):
                raise ModelError(f"'{name}' cannot be set: it follows from {FOLLOWS[name]}")
        return super().changed(values)

    def fitting(self, size: tuple[int, int]) -> Self:
        """With the sensor's size; refused where a cell is larger."""
        settled = super().fitting(size)
        if min(settled.size) < self.pool.side:
            raise ModelError(f"size = {list(settled.size)}: expected at least {self.pool.side} px each, a cell")
        return settled

    def fixed(self) -> Mapping[str, Any]:
        """All but the number of epochs: more may be asked for."""
        return {name: value for name, value in self.as_words().items() if name != "epochs"}

    @property
    def front_end(self) -> Inputs:
        """The sheet of the front end's spikes."""
        width, height = self.size
        channels = self.encoder.channels(len(self.bank.sizes), len(self.bank.orientations))
        shape = (channels, height // self.pool.side, width // self.pool.side)
        return Inputs(shape, self.encoder.window, self.encoder.resolution)

    @property
    def inputs(self) -> Inputs:
        """The sheet of spikes that the network is shown."""
        return self.front_end

    def observe(self, events: Events) -> Evidence:
        """The spikes of each frame.

        Returns:
            ``codes`` and ``ids`` (spikes,); ``lengths`` (frames,) their number; ``ends`` (frames,) when a frame is
            known to be complete, us after the first event; ``lasts`` (1,) us from the first event to the last.
        """
        first = int(events.t[0]) if len(events) else 0
        seen = self.inside(events)
        bounds = self.segmenter.bounds(seen.t)
        responses = self.bank.responses(seen, bounds, self.pool.side, self.representation)
        codes, ids, lengths = self.encoder.encode(self.pool.passed(responses, self.bank.sizes))
        ends = self.segmenter.complete_at(seen.t, bounds) - first
        fitting = np.min_scalar_type(int(np.prod(self.front_end.shape)))
        lasts = events.t[-1:] - events.t[:1]
        return {"codes": codes, "ids": ids.astype(fitting), "lengths": lengths, "ends": ends, "lasts": lasts}

    def observe_until(self, events: Events, times_us: Sequence[int]) -> list[Evidence]:
        """The frames that were complete by then; where the last may end elsewhere later, each beginning by itself."""
        if self.segmenter.tentative:
            return super().observe_until(events, times_us)
        whole = self.observe(events)
        return [ended_by(whole, us) for us in times_us]

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Teach the network.

        Returns:
            ``network`` before learning as YAML text, weights by the name of their projection, ``history`` (epochs,) the
            share of frames that were decided rightly in each and ``mistakes`` that of those decided wrongly, ``seed``,
            and what the encoder learnt.

        Raises:
            ModelError: a value is out of the network's bounds, or there is nothing to learn from.
        """
        frames = frames_to_learn_from(shown)
        net = self.layer.network(self.inputs, len(shown.classes))
        codes = self.encoder.learn(frames.codes)
        sim = neuro.compile(net, backend=course.backend, seed=course.seed)
        shares: list[Shares] = []
        silent_epochs = 0
        if found := course.resume():
            both = zip(found["history"].tolist(), found["mistakes"].tolist(), strict=True)
            shares = [Shares(*each) for each in both]
            restore(sim, found["state"])
        for epoch in range(len(shares), self.epochs):
            self.layer.begin(sim, epoch, shares[-1] if shares else None)
            shares.append(self._epoch(sim, frames, shown.labels, codes, epoch, course))
            silent_epochs = silent_epochs + 1 if shares[-1] == Shares(right=0.0, wrong=0.0) else 0
            course.keep(**told_of(shares), state=state_of(sim))
        if silent_epochs:
            epochs = f"the last {silent_epochs} epochs" if silent_epochs > 1 else "the last epoch"
            message = f"{self.called()}: no neuron fired in any of the {len(frames)} frames of {epochs}"
            message += f", so nothing is decided: {self.way_out_of_silence()}"
            warnings.warn(message, neuro.ModelWarning, stacklevel=2)
        learnt: dict[str, Array | str] = {name: sim.weights(name) for name in taught(net)}
        learnt |= {"network": to_text(net), **told_of(shares), "seed": np.array(course.seed)}
        learnt |= codes | self.layer.also(sim)
        return {**learnt, **self.afterwards(learnt, shown, course)}

    def afterwards(self, learnt: Learnt, shown: Features, course: Course) -> Learnt:
        """What is learnt once the network has, from what it answers to the same recordings; more arrays by name."""
        return {}

    def _epoch(
        self, sim: neuro.Simulation, frames: Frames, labels: Ints, codes: Learnt, epoch: int, course: Course
    ) -> Shares:
        """Show all recordings once; return how the frames were decided, NaN where there is no right and wrong."""
        done, right, wrong = 0, 0, 0
        rng = np.random.default_rng([course.seed, epoch])
        if self.order == "frames":
            turn = rng.permutation(len(frames))
        else:
            place = np.empty(len(labels), np.int64)
            place[rng.permutation(len(labels))] = np.arange(len(labels))
            turn = np.argsort(place[frames.recording], kind="stable")
        for first in range(0, len(turn), self.layer.batch):
            batch = frames.take(turn[first : first + self.layer.batch])
            self.layer.pace(sim, epoch * len(frames) + done)
            wanted = labels[batch.recording] if self.layer.supervised else None
            times = self.encoder.times(batch.codes, codes)
            results = sim.trials(
                times, batch.ids, batch.offsets, labels=wanted, learn=True, samples=batch.recording, epoch=epoch
            )
            sim.forget(before=sim.time)
            done += len(results)
            if wanted is not None:
                decided = self.layer.decided(results)
                right += int(np.count_nonzero(decided == wanted))
                wrong += int(np.count_nonzero((decided != wanted) & (decided >= 0)))
            share = None if wanted is None else right / done
            course.report(Progress(f"epoch {epoch + 1} of {self.epochs}", done, len(frames), share))
        if not self.layer.supervised:
            return Shares(right=float("nan"), wrong=float("nan"))
        return Shares(right=right / len(frames), wrong=wrong / len(frames))

    def network(self, learnt: Learnt) -> neuro.Network | None:
        """The network with what it has learnt; None where several decide one after the other."""
        return self.deciding(learnt)

    def deciding(self, learnt: Learnt) -> neuro.Network:
        """The network that decides, with what it has learnt."""
        net = from_text(str(learnt["network"]))
        for name in taught(net):
            net.projections[name] = replace(net.projections[name], weight=learnt[name])
        return self.layer.settled(net, learnt)

    def simulation(self, learnt: Learnt, backend: str = "event") -> neuro.Simulation:
        """The learnt network, ready to be shown recordings."""
        return neuro.compile(self.deciding(learnt), backend=backend, seed=int(learnt["seed"]))

    def present(self, sim: neuro.Simulation, learnt: Learnt, shown: Features) -> tuple[neuro.TrialResults, Frames]:
        """Show all frames of recordings without teaching: how each ended, and the frames."""
        frames = Frames.of(shown)
        results = sim.trials(self.encoder.times(frames.codes, learnt), frames.ids, frames.offsets)
        sim.forget(before=sim.time)
        return results, frames

    def presented(
        self, sim: neuro.Simulation, learnt: Learnt, shown: Features
    ) -> Iterator[tuple[Features, neuro.TrialResults, Frames]]:
        """Show many recordings without teaching, a batch in memory after the other: each, and as `present` gives."""
        for batch in shown.batches(AT_ONCE):
            yield batch, *self.present(sim, learnt, batch)

    def entering(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Features]:
        """A function from the front end's spikes to those that the deciding network is shown: here the same."""
        return lambda shown: shown

    def answer(self, learnt: Learnt, shown: Features, backend: str = "event") -> Answer:
        """By each vote; a recording without frames is silent."""
        return self.asker(learnt, backend)(shown)

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """With a network that is compiled once; `Answer.run` gives it as it is after the last question."""
        sim, entering = self.simulation(learnt, backend), self.entering(learnt, backend)

        def ask(shown: Features) -> Answer:
            sim.reset()  # noise and rounding are drawn by the step
            found: dict[str, list[Floats]] = {}
            taken: list[neuro.TrialCounts] = []
            for batch, results, frames in self.presented(sim, learnt, entering(shown)):
                for name, scores in self.votes(learnt, results, frames, batch).items():
                    found.setdefault(name, []).append(scores)
                taken.append(results.taken)
            votes = {name: np.concatenate(scores) for name, scores in found.items()}
            return Answer(votes[self.vote], votes, lambda: (sim, reduce(add, taken)), duration_s=shown.duration_s())

        return ask

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, shown: Features
    ) -> Mapping[str, Floats]:
        """What speaks for each class, (recordings, classes), by each way of letting frames decide."""
        return votes(results, frames.recording, len(shown), len(shown.classes))

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """The events of each frame, and the spikes that the network is shown, with the winner."""
        seen, evidence = self.inside(events), self.observe(events)
        at_ms = evidence["ends"] / 1000.0
        if not len(at_ms):
            return []
        bounds = self.segmenter.bounds(seen.t)
        shown = self.entering(learnt)(unlabelled([evidence], tuple(classes)))
        results, frames = self.present(self.simulation(learnt), learnt, shown)
        named = [f" for {name}" for name in classes] if self.layer.supervised else [""] * results.potential.shape[1]
        labels = tuple(
            f"neuron {neuron} wins{named[label]}" if label >= 0 else "none wins"
            for neuron, label in zip(results.winner.tolist(), results.label.tolist(), strict=True)
        )
        times, size = self.encoder.times(frames.codes, learnt), int(np.prod(self.inputs.shape))
        bands = self.encoder.bands(self.bank.sizes, self.bank.orientations) if self.inputs == self.front_end else ()
        return [
            Pictures("Frame", at_ms, self.representation.pixels(seen, bounds).pictures(self.size)),
            TrialView("Its spikes", at_ms, self.encoder.window, size, frames.offsets, times, frames.ids, labels, bands),
        ]

    def drawn(self, kernels: Floats) -> Floats:
        """What weights (features, orientations, rows, columns) of cells look for, (features, height, width) in px."""
        from neuro_recognise.telling.pictures import reconstructed

        return reconstructed(kernels, self.bank.filters[DRAWN % len(self.bank.sizes)], self.pool.side)

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Where classes have maps with kernels these, and how the learning went."""
        from neuro_recognise.telling.pictures import history, prototypes

        drawn = {}
        if self.layer.supervised:
            if "c1_s2" in learnt:
                drawn["prototypes"] = prototypes(np.asarray(learnt["c1_s2"]), classes, self.bank.orientations)
            drawn["learning"] = history(np.asarray(learnt["history"]), len(classes))
        return drawn


def frames_to_learn_from(shown: Features) -> Frames:
    """Return all frames of recordings.

    Raises:
        ModelError: there are none.
    """
    frames = Frames.of(shown)
    if not len(frames):
        raise ModelError("no recording is long enough for a frame: expected some to learn from")
    return frames


def told_of(shares: Sequence[Shares]) -> dict[str, Array]:
    """Shares of frames by epoch: ``history`` of right decisions, ``mistakes`` of wrong ones."""
    return {"history": np.array([one.right for one in shares]), "mistakes": np.array([one.wrong for one in shares])}


def state_of(sim: neuro.Simulation) -> Array:
    """The file that `Simulation.save` writes, as bytes."""
    with tempfile.TemporaryDirectory() as folder:
        sim.save(Path(folder) / "state.h5")
        return np.fromfile(Path(folder) / "state.h5", np.uint8)


def restore(sim: neuro.Simulation, state: Array) -> None:
    """Go on from what `state_of` gave."""
    with tempfile.TemporaryDirectory() as folder:
        state.tofile(Path(folder) / "state.h5")
        sim.restore(Path(folder) / "state.h5")
