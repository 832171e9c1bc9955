"""Two layers of small fields: features that are learnt without labels, and a layer above that learns by reward."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import part, setting
from neuro_recognise.method import Answer, Course, Drawings, Learnt
from neuro_recognise.methods.frame_networks import MasquelierThorpeLayer
from neuro_recognise.methods.framewise import AT_ONCE, ORDERS, Framewise, Inputs, Layer, RemusLayer, from_text
from neuro_recognise.parts.frames import Encoder, Frames, LogLatency
from neuro_recognise.shown import Array, Features

CHOSEN = "chosen on 160 of the 800 digits that fold 1 of 5, seed 0, learns from"


@dataclass(frozen=True)
class Layered(Framewise):
    """Features of frames of ReMuS's front end, learnt by STDP and pooled, and a layer above that learns by reward.

    The layers learn one after the other. While the features learn, `local_winners` keeps them different. Afterwards
    the first feature of each place spikes; in a cell of the pool, the first spike of each feature passes. These spikes
    are the trials of the layer above.

    Attributes:
        features: the layer below, which learns without labels.
        examples: recordings that the features learn from, at most.
        cell: rows and columns of places that are pooled.
    """

    title = "STDP below, reward-modulated STDP above, no field above 7"
    source = "thesis lines 3192 and 3441; as Mozafari et al., Pattern Recognition 94:87, 2019, with the rules here"
    unobserved = (*Framewise.unobserved, "features", "examples", "cell")
    measured = {"N-MNIST": "not yet"}

    encoder: Encoder = part(Encoder, LogLatency(window=16.0))
    features: Layer = part(Layer, MasquelierThorpeLayer(maps=100, field=5, theta=10.0))
    examples: int = setting(160, "", "recordings that the features learn from, at most", CHOSEN, at_least=1)
    cell: int = setting(2, "places", "side of a cell of the pool", CHOSEN, at_least=1)
    layer: Layer = part(
        Layer,
        RemusLayer(field=7, theta=40.0, weight=0.5, Ar_minus=-0.003, Ap_plus=0.0),
    )
    epochs: int = setting(6, "", "how often the layer above is shown all recordings", CHOSEN, at_least=1)
    order: str = setting("frames", "", "what is shuffled in each epoch", CHOSEN, words=ORDERS)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, expected, found in (
            ("features", MasquelierThorpeLayer, self.features),
            ("encoder", LogLatency, self.encoder),
        ):
            if not isinstance(found, expected):
                raise ModelError(f"{self.place()}: {name} = {found.called()}: expected {expected.called()}")

    def fitting(self, size: tuple[int, int]) -> Self:
        """With the sensor's size; refused where a field of the features is larger than the front end's sheet."""
        settled = super().fitting(size)
        if min(settled.places) < 1:
            most = min(settled.front_end.shape[1:])
            field = self.features.as_words()["field"]
            raise ModelError(
                f"{self.place()}: features.field = {field}: expected at most {most}, the cells of the front end"
            )
        return settled

    @property
    def places(self) -> tuple[int, int, int]:
        """Maps, rows and columns of the features."""
        _, rows, columns = self.front_end.shape
        words, less = self.features.as_words(), self.features.as_words()["field"] - 1
        return words["maps"], rows - less, columns - less

    @property
    def inputs(self) -> Inputs:
        """What the layer above is shown: the pooled features."""
        maps, rows, columns = self.places
        return replace(self.front_end, shape=(maps, -(-rows // self.cell), -(-columns // self.cell)))

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Teach the features, then the layer above.

        Returns:
            As of `Framewise.fit`; ``features`` are the weights of the layer below and ``below`` its network as text.
        """
        settings = {
            name: getattr(self, name) for name in ("size", "segmenter", "representation", "bank", "pool", "encoder")
        }
        below = Framewise(**settings, layer=self.features, epochs=1, order="frames")
        chosen = np.random.default_rng(course.seed).permutation(len(shown))[: self.examples]
        # Learnt again after a kill, to the same bits: one pass over few recordings.
        alone = replace(
            course, checkpoint=None, report=lambda p: course.report(replace(p, what="learning the features"))
        )
        learnt = below.fit(shown.take(chosen), alone)
        words: Learnt = {"features": learnt["c1_s2"], "below": learnt["network"], "seed": learnt["seed"]}
        return {**super().fit(self.entering(words, course.backend)(shown), course), **words}

    def entering(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Features]:
        """A function from the spikes of the front end to those of the pooled features."""
        net = from_text(str(learnt["below"]))
        weights = np.asarray(learnt["features"])
        net.projections["c1_s2"] = replace(net.projections["c1_s2"], weight=weights)
        net.groups["choice"] = replace(net.groups["choice"], choice=neuro.local_winners(of="s2", radius=0))
        sim = neuro.compile(net, backend=backend, seed=int(np.asarray(learnt["seed"])))

        def enter(shown: Features) -> Features:
            evidence: list[dict[str, Array]] = []
            for batch in shown.batches(AT_ONCE):
                frames = Frames.of(batch)
                results = sim.trials(self.encoder.times(frames.codes, learnt), frames.ids, frames.offsets)
                sim.forget(before=sim.time)
                frame, codes, ids = self._pooled(results)
                lengths = np.bincount(frame, minlength=len(frames))
                ends = np.searchsorted(frames.recording[frame], np.arange(1, len(batch)))
                of_frames = np.split(lengths, np.searchsorted(frames.recording, np.arange(1, len(batch))))
                each = zip(batch.evidence, np.split(codes, ends), np.split(ids, ends), of_frames, strict=True)
                evidence += [dict(one, codes=c, ids=i, lengths=n) for one, c, i, n in each]
            return replace(shown, evidence=evidence)

        return enter

    def _pooled(self, results: neuro.TrialResults) -> tuple[Array, Array, Array]:
        """The frame, tick and id of the first spike of each feature in each cell, frame after frame by ticks."""
        frame = np.repeat(np.arange(len(results)), np.diff(results.wins.offsets))
        feature, row, column = np.unravel_index(results.wins.neurons, self.places)
        ids = np.ravel_multi_index((feature, row // self.cell, column // self.cell), self.inputs.shape)
        # Wins are in the order of their ticks, so the first of equal ids of a frame is the earliest.
        first = np.sort(np.unique(frame * np.prod(self.inputs.shape) + ids, return_index=True)[1])
        return frame[first], results.wins.steps[first], ids[first]

    def network(self, learnt: Learnt) -> None:
        """None: trials begin anew only the output's states, so each layer runs in trials of its own."""

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """Without a run for bills, which would be of the layer above alone."""
        ask = super().asker(learnt, backend)
        return lambda shown: replace(ask(shown), run=None)

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """What each feature looks for, and how the learning of the layer above went."""
        from neuro_recognise.telling.pictures import history, images

        drawn = self.drawn(np.asarray(learnt["features"]))
        about = "a picture a feature: the bank's filters, each as strong as its weight"
        features = images(drawn, [""] * len(drawn), "What the features look for", about)
        return {"features": features, "learning": history(np.asarray(learnt["history"]), len(classes))}
