"""Two layers with small receptive fields: features learnt without labels, and a layer above that learns by reward."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import part, setting
from neuro_recognise.method import Answer, Course, Drawings, Learnt, Progress
from neuro_recognise.methods.frame_networks import MasquelierThorpeLayer
from neuro_recognise.methods.framewise import (
    AT_ONCE,
    FRONT_END,
    ORDERS,
    Framewise,
    Inputs,
    Layer,
    RemusLayer,
    from_text,
)  # fmt: skip
from neuro_recognise.parts.frames import Encoder, LogLatency
from neuro_recognise.shown import Array, Features

CHOSEN = "chosen on 160 of the 800 training digits of fold 1 of 5, seed 0"


@dataclass(frozen=True)
class Layered(Framewise):
    """On ReMuS's front end, features that learn by STDP, a pool, and a layer above that learns by reward.

    The layers learn one after the other. While the features learn, inhibition by `local_winners` makes them
    differ. Afterwards only the first feature at each place spikes, and each cell of the pool passes the first spike of
    each feature. The pooled spikes of a frame are a trial of the layer above.

    Attributes:
        features: the lower layer, which learns without labels.
        examples: largest number of recordings that the features learn from.
        cell: side of a cell of the pool, in places.
    """

    title = "STDP below, reward-modulated STDP above"
    source = "thesis lines 3192 and 3441; as Mozafari et al., Pattern Recognition 94:87, 2019, with the rules here"
    unobserved = (*Framewise.unobserved, "features", "examples", "cell")
    measured = {"N-MNIST": "92.3 %"}

    encoder: Encoder = part(Encoder, LogLatency(window=16.0))
    features: Layer = part(Layer, MasquelierThorpeLayer(maps=100, field=5, theta=10.0))
    examples: int = setting(160, "", "largest number of recordings for the features", CHOSEN, at_least=1)
    cell: int = setting(2, "places", "side of a cell of the pool", CHOSEN, at_least=1)
    layer: Layer = part(Layer, RemusLayer(field=7, theta=40.0, weight=0.5, Ar_minus=-0.003, Ap_plus=0.0))
    epochs: int = setting(6, "", "passes of the layer above over all recordings", CHOSEN, at_least=1)
    order: str = setting("frames", "", "items to shuffle in each epoch", CHOSEN, words=ORDERS)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, expected in (("features", MasquelierThorpeLayer), ("encoder", LogLatency)):
            if not isinstance(chosen := getattr(self, name), expected):
                raise ModelError(f"{self.place()}: {name} = {chosen.called()}: expected {expected.called()}")

    def fitting(self, size: tuple[int, int]) -> Self:
        """Fill in the sensor's size, and check that the features' receptive field fits into the front end."""
        settled = super().fitting(size)
        if min(settled.places) < 1:
            side, field = min(settled.front_end.shape[1:]), self.features.as_words()["field"]
            expected = f"expected at most {side}, the cells of the front end"
            raise ModelError(f"{self.place()}: features.field = {field}: {expected}")
        return settled

    @property
    def places(self) -> tuple[int, int, int]:
        """Maps, rows and columns of the features."""
        settings, (_, rows, columns) = self.features.as_words(), self.front_end.shape
        return settings["maps"], rows - settings["field"] + 1, columns - settings["field"] + 1

    @property
    def inputs(self) -> Inputs:
        """Shape, window and grid of the pooled features, the input of the layer above."""
        maps, rows, columns = self.places
        return replace(self.front_end, shape=(maps, -(-rows // self.cell), -(-columns // self.cell)))

    def fit(self, features: Features, course: Course) -> Learnt:
        """Train the features, then the layer above.

        Returns:
            See `Framewise.fit`; also ``features``, the weights of the lower layer, and ``below``, its network as text.
        """
        front = {name: getattr(self, name) for name in ("size", *FRONT_END)}
        below = Framewise(**front, layer=self.features, epochs=1, order="frames")
        chosen = np.random.default_rng(course.seed).permutation(len(features))[: self.examples]

        def tell(progress: Progress) -> None:
            course.report(replace(progress, what="learning the features"))

        # No checkpoint: the short pass is repeated after an interruption, and gives the same bits.
        learning = below.fit(features.take(chosen), replace(course, checkpoint=None, report=tell))
        arrays: Learnt = {"features": learning["c1_s2"], "below": learning["network"], "seed": learning["seed"]}
        return {**super().fit(self.entering(arrays, course.backend)(features), course), **arrays}

    def entering(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Features]:
        """Return a function that converts spikes of the front end to spikes of the pooled features."""
        net = from_text(str(learnt["below"]))
        net.projections["c1_s2"] = replace(net.projections["c1_s2"], weight=np.asarray(learnt["features"]))
        net.groups["choice"] = replace(net.groups["choice"], choice=neuro.local_winners(of="s2", radius=0))
        sim = neuro.compile(net, backend=backend, seed=int(np.asarray(learnt["seed"])))

        def enter(features: Features) -> Features:
            evidence: list[dict[str, Array]] = []
            for batch in features.batches(AT_ONCE):
                results, frames = self.present(sim, learnt, batch)
                frame, codes, ids = self._pooled(results)
                lengths, following = np.bincount(frame, minlength=len(frames)), np.arange(1, len(batch))
                parts = (np.split(part, np.searchsorted(frames.recording[frame], following)) for part in (codes, ids))
                frame_lengths = np.split(lengths, np.searchsorted(frames.recording, following))
                rows = zip(batch.evidence, *parts, frame_lengths, strict=True)
                evidence += [dict(item, codes=c, ids=i, lengths=n) for item, c, i, n in rows]
            return replace(features, evidence=evidence)

        return enter

    def _pooled(self, results: neuro.TrialResults) -> tuple[Array, Array, Array]:
        """Return frame, tick and id of the first spike of each feature in each cell, ordered by frame and tick."""
        frame = np.repeat(np.arange(len(results)), np.diff(results.wins.offsets))
        feature, row, column = np.unravel_index(results.wins.neurons, self.places)
        ids = np.ravel_multi_index((feature, row // self.cell, column // self.cell), self.inputs.shape)
        # Wins are ordered by tick, so the first of equal ids in a frame is the earliest.
        first = np.sort(np.unique(frame * np.prod(self.inputs.shape) + ids, return_index=True)[1])
        return frame[first], results.wins.steps[first], ids[first]

    def network(self, learnt: Learnt) -> None:
        """Return None. Each layer runs trials of its own, because a trial resets only the states of the output."""

    def asker(self, learnt: Learnt, backend: str = "event") -> Callable[[Features], Answer]:
        """Prepare `answer` without a run for bills, because the run would include only the layer above."""
        ask = super().asker(learnt, backend)
        return lambda features: replace(ask(features), run=None)

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw each feature, and the learning curve of the layer above."""
        from neuro_recognise.telling.pictures import history, images

        pictures = self.images(np.asarray(learnt["features"]))
        caption = "one image per feature: the bank's filters, scaled by the weights"
        features = images(pictures, [""] * len(pictures), "Learnt features", caption)
        return {"features": features, "learning": history(np.asarray(learnt["history"]), len(classes))}
