"""HOTS: histograms of time-surface prototypes that are learnt online, layer upon layer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from neuro.events import Events
from neuro_recognise.hots.hierarchy import Hierarchy, Layers
from neuro_recognise.method import Answer, Course, Learnt, Method, Progress
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.settings import part, setting
from neuro_recognise.shown import Evidence, Features, Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EVERY = 50
"""Recordings between two states that are kept."""


@dataclass(frozen=True)
class Hots(Method):
    """Events are given to the prototype that their surroundings resemble; how often each was is a recording's sign."""

    title = "hierarchy of time surfaces"
    source = "Lagorce et al., IEEE TPAMI 39:1346, 2017; thesis lines 2211-2280"
    needs = "recognise"
    presets = {
        "cells": {"layers": 1, "centres": 64, "tau": 30.0, "cell": 7},
        "poker": {"size": [35, 35], "layers": 1, "centres": 32, "tau": 2.0, "cell": 12},
    }
    measured = {"N-MNIST": "72.6 %", "POKER-DVS": "97.3 %"}

    hierarchy: Hierarchy = part(Hierarchy, Hierarchy())
    learn_from: int = setting(
        0, "", "recordings to learn prototypes from, drawn; 0: all", "the paper's are few", at_least=0
    )
    cell: int = setting(
        0, "px", "side of squares that are counted each by itself; 0: the whole field", "the paper", at_least=0
    )
    readout: Readout = part(Readout, Svm())

    def observing(self) -> Mapping[str, Any]:
        """The field alone: what is looked at are events."""
        return {"size": list(self.size)}

    def observe(self, events: Events) -> Evidence:
        """The events inside the field."""
        seen = self.inside(events)
        return {"t": seen.t - (seen.t[0] if len(seen) else 0), "x": seen.x, "y": seen.y, "p": seen.p}

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Learn prototypes layer by layer, then teach the readout."""
        layers = self._taught(shown, course)
        x = self._histograms(layers, shown)
        return {**layers.state(), **self.readout.fit(x, shown.labels, len(shown.classes), course)}

    def answer(self, learnt: Learnt, shown: Features, backend: str = "event") -> Answer:
        """Ask the readout; a recording without events is silent."""
        kept = {name: part for name, part in learnt.items() if not isinstance(part, str)}
        x = self._histograms(Layers.from_state(self.hierarchy, self.size, kept), shown)
        return Answer(np.where(x.any(axis=1, keepdims=True), self.readout.scores(learnt, x), np.nan))

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Mapping[str, Figure]:
        """The prototypes of each layer: what they see of the first one's polarities, and of all channels of others."""
        from neuro_recognise.telling.pictures import images

        drawn = {}
        for layer in range(self.hierarchy.layers):
            centres = np.asarray(learnt[f"centres_{layer}"]).transpose(3, 2, 0, 1)
            if layer == 0 and self.hierarchy.polarity:
                seen, about = centres[:, 1] - centres[:, 0], "blue ON, orange OFF"
            else:
                seen, about = centres.max(axis=1), "in any channel"
            title = f"The time surfaces of layer {layer + 1}"
            about = f"a picture a prototype; the darker, the later there was an event: {about}"
            drawn[f"layer-{layer + 1}"] = images(seen, [""] * len(seen), title, about)
        return drawn

    def _taught(self, shown: Features, course: Course) -> Layers:
        kept = course.resume()
        layers = Layers(self.hierarchy, self.size, seed=course.seed)
        if kept:
            layers = Layers.from_state(self.hierarchy, self.size, kept["layers"])
        chosen = np.arange(len(shown))
        if 0 < self.learn_from < len(shown):
            chosen = np.sort(np.random.default_rng([course.seed, 3]).permutation(len(shown))[: self.learn_from])

        def tell(reached: Layers, done: int, total: int) -> None:
            if done % EVERY == 0 or done == total:
                course.keep(layers=reached.state())
            course.report(Progress("learning prototypes", done, total))

        layers.learn(_Recordings(self, shown.take(chosen)), tell)
        return layers

    def _histograms(self, layers: Layers, shown: Features) -> Floats:
        """(recordings, cells and prototypes) shares of a recording's events."""
        found: Floats = np.stack(
            [layers.features(events, cell=self.cell).ravel() for events in _Recordings(self, shown)]
        ).astype(np.float64)
        shares: Floats = found / np.maximum(found.sum(axis=1, keepdims=True), 1.0)
        return shares


class _Recordings(Sequence[Events]):
    """Evidence as events again, one recording at a time."""

    def __init__(self, method: Hots, shown: Features) -> None:
        self._size, self._shown = method.size, shown

    def __len__(self) -> int:
        return len(self._shown)

    @overload
    def __getitem__(self, index: int) -> Events: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Events]: ...
    def __getitem__(self, index: int | slice) -> Events | Sequence[Events]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        one = self._shown.evidence[index]
        return Events(one["t"], one["x"], one["y"], one["p"], self._size)
