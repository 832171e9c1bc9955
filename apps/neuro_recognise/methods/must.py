"""MuST: neurons that see a whole frame learn without labels, and stand for the class for which they win most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import neuro
from neuro.apps import part, setting
from neuro_recognise.method import Course, Drawings, Learnt
from neuro_recognise.methods.framewise import ORDERS, Framewise
from neuro_recognise.parts.encoders import Encoder, LogLatency
from neuro_recognise.parts.frames import Frames, majority, potentials
from neuro_recognise.parts.layers import Inputs, Layer
from neuro_recognise.shown import Array, Features, Floats

OURS = "ours: the paper's numbers were not found"
DRAWN = 8
"""Neurons of each class in a picture."""
SLOW = 1000.0
"""Frames after which what raised a threshold is down to a share of 1/e."""


@dataclass(frozen=True)
class MustLayer(Layer):
    """Neurons that see all inputs; the first to fire learns, and its threshold rises."""

    source = "models/neuro_models/must.yaml"
    file = "must"
    supervised = False

    neurons: int = setting(400, "", "that learn", f"{OURS}; 800 are 2 to 5 points better", at_least=1)
    theta: float = setting(25.0, "mV", "threshold at first", OURS, above=0)
    rise: float = setting(5.0, "mV", "of the threshold of the neuron that wins", OURS, at_least=0)
    A_plus: float = setting(0.05, "", "rate, input before the decision", OURS)
    A_minus: float = setting(-0.01, "", "rate, other inputs", OURS)
    total: float = setting(300.0, "", "sum of the weights of a neuron", OURS, above=0)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Also the decay of thresholds, and first weights whose sum is about `total`."""
        return super().following(inputs, classes) | {
            "tau_theta": SLOW * inputs.window, "highest": min(1.0, 2.0 * self.total / float(np.prod(inputs.shape))),
        }  # fmt: skip

    def also(self, sim: neuro.Simulation) -> dict[str, Any]:
        """The threshold of each neuron."""
        return {"thresholds": sim.get("excited", "theta") + self.theta, "c1_excited": _matrix(sim)}

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """With neurons whose thresholds stay as they are, which chips have, too."""
        model = neuro.iaf_psc_delta(
            tau_m=np.inf, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=np.asarray(learnt["thresholds"], float)
        )
        net.populations["excited"] = replace(net.populations["excited"], model=model)
        return net


Layer.known.add(MustLayer)


@dataclass(frozen=True)
class Must(Framewise):
    """The first 150 spikes of frames of ReMuS's front end, and neurons that are named after they have learnt."""

    title = "unsupervised STDP with homeostasis, neurons named afterwards"
    source = "Liu et al., 2020, after the thesis, section 6.1.5; homeostasis of Diehl and Cook 2015"
    presets = {"poker": {"size": [34, 34]}}
    measured = {"N-MNIST": "80.9 %", "POKER-DVS": "92.3 %"}

    encoder: Encoder = part(Encoder, LogLatency(first=150))
    layer: Layer = part(Layer, MustLayer())
    epochs: int = setting(3, "", "how often all recordings are shown", OURS, at_least=1)
    order: str = setting("frames", "", "what is shuffled in each epoch", OURS, words=ORDERS)
    vote: str = setting(
        "potentials", "", "how frames decide; rate: wins for each neuron of the class", OURS,
        words=("rate", "majority", "potentials"),
    )  # fmt: skip

    def afterwards(self, learnt: Learnt, shown: Features, course: Course) -> Learnt:
        """Name each neuron by the class of whose frames it wins the largest share; -1 where it never wins."""
        winners, labels = [], []
        for batch, results, frames in self.presented(self.simulation(learnt, course.backend), learnt, shown):
            winners.append(results.winner)
            labels.append(batch.labels[frames.recording])
        of = len(np.asarray(learnt["thresholds"]))
        return {"labels": neuro.assign_labels(np.concatenate(winners), np.concatenate(labels), of)}

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, shown: Features
    ) -> Mapping[str, Floats]:
        """By wins for each neuron of a class, by wins, and by the largest potential of a class' neurons."""
        labels, classes = np.asarray(learnt["labels"]), len(shown.classes)
        named = labels >= 0
        wins, sums = np.zeros((len(shown), classes)), np.zeros((len(shown), classes))
        decided = np.flatnonzero((results.winner >= 0) & named[results.winner])
        np.add.at(wins, (frames.recording[decided], labels[results.winner[decided]]), 1.0)
        for label in np.unique(labels[named]):
            np.add.at(sums[:, label], frames.recording, results.potential[:, labels == label].max(axis=1, initial=0.0))
        rate = wins / np.maximum(np.bincount(labels[named], minlength=classes), 1)
        found = {"rate": np.where(wins.any(axis=1, keepdims=True), rate, np.nan)}
        return found | {"majority": majority(wins, sums), "potentials": potentials(sums)}

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """What the neurons that win most look for, a row a class."""
        from neuro_recognise.telling.pictures import images

        labels, thresholds = np.asarray(learnt["labels"]), np.asarray(learnt["thresholds"])
        order = np.argsort(-thresholds, kind="stable")
        chosen = [order[labels[order] == k][:DRAWN] for k in range(len(classes))]
        weights = np.asarray(learnt["c1_excited"]).T.reshape(-1, *self.inputs.shape)
        drawn = np.zeros((len(classes), DRAWN, *self.drawn(weights[:1]).shape[1:]))
        for k, some in enumerate(chosen):
            drawn[k, : len(some)] = self.drawn(weights[some])
        about = (
            f"of each class the {DRAWN} with the highest thresholds; the bank's filters, each as strong as its weight"
        )
        heads = [name if k == 0 else "" for name in classes for k in range(DRAWN)]
        title = "What the neurons look for"
        return {"features": images(drawn.reshape(-1, *drawn.shape[2:]), heads, title, about, DRAWN)}


def _matrix(sim: neuro.Simulation) -> Array:
    """Weights of all inputs to all neurons, (inputs, neurons)."""
    pre, post, weight = sim.weights("c1_excited")
    found = np.zeros((pre.max() + 1, post.max() + 1))
    found[pre, post] = weight
    return found
