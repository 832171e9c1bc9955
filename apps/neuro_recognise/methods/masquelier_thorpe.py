"""Masquelier and Thorpe: maps learn without labels what comes often, and a support vector machine reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import neuro
from neuro.apps import part, setting
from neuro_recognise.method import Course, Drawings, Learnt
from neuro_recognise.methods.framewise import ORDERS, Framewise
from neuro_recognise.parts.frames import Frames
from neuro_recognise.parts.layers import Inputs, Layer
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.settings import SPLITS
from neuro_recognise.shown import Features, Floats

PAPER = "Masquelier and Thorpe 2007"


@dataclass(frozen=True)
class MasquelierThorpeLayer(Layer):
    """Maps of neurons without leak; each wins once a frame at most and silences the others round its winner."""

    source = "models/neuro_models/masquelier_thorpe.yaml"
    file = "masquelier_thorpe"
    supervised = False
    batch = 400
    teaching = ("highest",)

    maps: int = setting(40, "", "of neurons", f"{SPLITS}; the paper: 10 for each of two kinds of pictures", at_least=1)
    field: int = setting(11, "cells", "side of the receptive field", f"{SPLITS}; the paper: 16", at_least=1)
    theta: float = setting(50.0, "mV", "threshold while learning", f"{SPLITS}; 25 suits a field of 7", above=0)
    weight: float = setting(0.8, "", "mean of the first weights", PAPER)
    spread: float = setting(0.05, "", "deviation of the first weights", PAPER, at_least=0)
    A_plus: float = setting(2.0**-6, "", "rate at first, input before the winner", PAPER, above=0)
    highest: float = setting(0.25, "", "rate, which doubles every 400 frames up to this", PAPER, above=0)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Also the radius of silence, half a field, and the rate of other inputs, -3/4 of A_plus."""
        return super().following(inputs, classes) | {"radius": self.field // 2, "A_minus": -0.75 * self.A_plus}

    def pace(self, sim: neuro.Simulation, seen: int) -> None:
        """Double the rates every 400 frames."""
        rate = min(self.A_plus * 2.0 ** min(seen // 400, 60), self.highest)
        sim.set("c1_s2", A_plus=rate, A_minus=-0.75 * rate)

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """With a threshold that all inputs together cannot reach: the potentials are what is read."""
        inputs = int(np.prod(np.shape(learnt["c1_s2"])[1:]))
        s2 = net.populations["s2"]
        assert isinstance(s2.model, neuro.iaf_psc_delta)
        net.populations["s2"] = replace(s2, model=replace(s2.model, V_th=inputs + 1.0))
        return net


Layer.known.add(MasquelierThorpeLayer)


@dataclass(frozen=True)
class MasquelierThorpe(Framewise):
    """Features that come often in frames of ReMuS's front end, and a linear support vector machine.

    Attributes:
        readout: separates classes by the mean over a recording's frames of each map's largest potential.
    """

    known_as = "masquelier_thorpe"
    title = "unsupervised STDP, read by a support vector machine"
    source = "Masquelier and Thorpe, PLoS Comput. Biol. 3:e31, 2007; there an RBF network reads"
    needs = "recognise"
    presets = {"poker": {"size": [34, 34], "field": 7, "theta": 25.0, "epochs": 3}}
    measured = {"N-MNIST": "85.0 %", "POKER-DVS": "95.4 %"}

    layer: Layer = part(Layer, MasquelierThorpeLayer())
    readout: Readout = part(Readout, Svm(C=0.1))
    epochs: int = setting(
        1,
        "",
        "how often all recordings are shown",
        "rates are at their highest after 1600 frames: N-MNIST has ten times as many, POKER-DVS needs 3",
    )
    order: str = setting("frames", "", "what is shuffled in each epoch", "ours", words=ORDERS)
    vote: str = setting("features", "", "how frames decide: the readout sees their mean", "ours", words=("features",))

    def afterwards(self, learnt: Learnt, shown: Features, course: Course) -> Learnt:
        """Teach the readout with what the maps answer to the same recordings."""
        features, labels = [], []
        for batch, results, frames in self.presented(self.simulation(learnt, course.backend), learnt, shown):
            seen = np.unique(frames.recording)
            features.append(_features(results, frames, len(batch))[seen])
            labels.append(batch.labels[seen])
        return self.readout.fit(np.concatenate(features), np.concatenate(labels), len(shown.classes), course)

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, shown: Features
    ) -> Mapping[str, Floats]:
        """By the readout alone."""
        scores = self.readout.scores(learnt, _features(results, frames, len(shown)))
        seen = np.isin(np.arange(len(shown)), frames.recording)
        return {"features": np.where(seen[:, None], scores, np.nan)}

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """What each map looks for."""
        from neuro_recognise.telling.pictures import images

        drawn = self.drawn(np.asarray(learnt["c1_s2"]))
        about = "a picture a map: the bank's filters, each as strong as its weight"
        return {"features": images(drawn, [""] * len(drawn), "What the maps look for", about)}


def _features(results: neuro.TrialResults, frames: Frames, recordings: int) -> Floats:
    """(recordings, maps) largest potential of each map, the mean over the frames of a recording."""
    sums = np.zeros((recordings, results.potential.shape[1]))
    np.add.at(sums, frames.recording, results.potential)
    return sums / np.maximum(np.bincount(frames.recording, minlength=recordings), 1)[:, None]
