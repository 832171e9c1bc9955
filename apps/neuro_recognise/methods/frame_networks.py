"""Methods that show frames to a network: ReMuS, Mozafari, Masquelier and Thorpe, MuST, EDHMAX with tempotrons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import neuro
from neuro.apps import part, setting
from neuro_recognise.method import SPLITS, Course, Drawings, Learnt
from neuro_recognise.methods.framewise import ORDERS, Framewise, Inputs, Labelled, Layer, Shares
from neuro_recognise.parts.banks import Bank, LeakyGabors, LocalMaximum, Pool
from neuro_recognise.parts.frames import Encoder, Frames, Latency, LogLatency, majority, potentials, votes
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.parts.segmenters import Segmenter, Ses
from neuro_recognise.shown import Features, Floats, Ints

ADAPTED = {"per_class": 2, "rescue": False, "dropout": 0.25, "decay": 0.7, "order": "recordings", "vote": "majority"}
"""Settings of the thesis, except a threshold of 60 and an epsilon of 0.0002, with which its rule learns.

Source: table 3, lines 2450-2463; majority is line 2431.
"""

THESIS = {**ADAPTED, "theta": 30.0, "epsilon": 0.004, "ties_after": True}
"""Table 3 and eq. 126 as printed. Epsilon on every wrong frame drives all weights to 1: decisions are at chance."""

PRINTED = {**THESIS, "literal": True, "scales": "all", "ranges": "filter", "spikes": "first"}
"""`THESIS` with the printed front end: eq. 122 as printed, r_min and r_max of each filter (line 3722), spikes of all
scales merged (line 2387).
"""

EARLY = {"representation": "leaky", "segmenter": "hes", "segmenter.window": 5.0}
"""A decision every 5 ms, from the first on: thesis section 6.2.8, lines 2549-2560."""

RELEARNS = {"least": 0.1, "Ap_minus": -0.08, "Ap_plus": 0.01}
"""Rewards that follow the share of mistakes, and punishment twice as strong. Each lesson moves the logit of a weight by
about its rate, so that punishments have to undo all rewards before. Chosen on seeds 5 to 7 of POKER-DVS, see
docs/reference/recognisers.md.
"""


PICTURES = {"segmenter": "whole", "sizes": [5], "sigmas": [2.0], "wavelengths": [2.5]}
"""Still pictures and filters of one scale, as Mozafari, Masquelier and Thorpe have: thesis lines 2271-2275."""


@dataclass(frozen=True)
class Remus(Framewise):
    """Pseudo-frames of a motion symbol detector, Gabor filters, log I2L, and a layer that learns by reward."""

    title = "reward-modulated STDP on the first spikes of pseudo-frames"
    source = "Mosca, MSc thesis, 2020, section 6.2"
    presets = {
        "best": {},
        "adapted": ADAPTED,
        "thesis": THESIS,
        "printed": PRINTED,
        "poker": {"theta": 30.0, "size": [34, 34]},
        "early": EARLY,
        "relearns": RELEARNS,
    }
    measured = {"N-MNIST": "91.4 %", "POKER-DVS": "98.5 %"}

    order: str = setting(
        "frames", "", "what is shuffled in each epoch", "benchmarks/recognisers.py; thesis: recordings", words=ORDERS
    )


NORB = "SpykeTorch's MozafariShallow, NORB"


@dataclass(frozen=True)
class MozafariLayer(Labelled):
    """Grids of neurons without leak that share a kernel; the first to fire names the class and is rewarded for it."""

    source = "models/neuro_models/mozafari.yaml"
    file = "mozafari"
    teaching = ("least",)

    per_class: int = setting(8, "", "maps of each class", f"{SPLITS}; as ReMuS", at_least=1)
    field: int = setting(11, "cells", "side of the receptive field", "thesis table 3", at_least=1)
    theta: float = setting(60.0, "mV", "threshold", f"{SPLITS}: no map dies, no frame is silent", above=0)
    weight: float = setting(0.8, "", "mean of the first weights", NORB)
    spread: float = setting(0.05, "", "deviation of the first weights", NORB, at_least=0)
    Ar_plus: float = setting(0.05, "", "rate on reward, input before the decision", NORB)
    Ar_minus: float = setting(-0.003, "", "rate on reward, other inputs", NORB)
    Ap_plus: float = setting(0.0005, "", "rate on punishment, other inputs", NORB)
    Ap_minus: float = setting(-0.05, "", "rate on punishment, input before the decision", NORB)
    dropout: float = setting(0.5, "", "share of the maps that are silent in a recording", NORB)
    least: float = setting(0.2, "", "of the factors on rates, so that neither comes to rest", NORB, above=0, at_most=1)

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Let rates follow the shares of all frames that were decided wrongly and rightly; silence is neither.

        Before the first epoch they are those of guessing.
        """
        guessed = self.per_class / sim.weights("c1_s2").shape[0]
        shares = last or Shares(right=guessed, wrong=1.0 - guessed)
        misses, hits = (self.least + (1.0 - self.least) * share for share in (shares.wrong, shares.right))
        sim.set("c1_s2", misses=misses, hits=hits)


Layer.known.add(MozafariLayer)


@dataclass(frozen=True)
class Mozafari(Framewise):
    """Frames of ReMuS's front end, and a layer whose learning follows the share of mistakes."""

    title = "reward-modulated STDP whose rates follow the share of mistakes"
    source = "Mozafari et al., IEEE TNNLS 29:6178, 2018; thesis eqs 120, 121; there natural images, one scale"
    presets = {"poker": {"theta": 30.0, "size": [34, 34]}, "pictures": PICTURES}
    measured = {"N-MNIST": "88.9 %", "POKER-DVS": "95.0 %"}

    layer: Layer = part(Layer, MozafariLayer())


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
    source = "Masquelier and Thorpe, PLoS Comput. Biol. 3:e31, 2007; there natural images, one scale, an RBF network"
    needs = "recognise"
    presets = {"poker": {"size": [34, 34], "field": 7, "theta": 25.0, "epochs": 3}, "pictures": PICTURES}
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
            features.append(features_of(results, frames, len(batch))[seen])
            labels.append(batch.labels[seen])
        return self.readout.fit(np.concatenate(features), np.concatenate(labels), len(shown.classes), course)

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, shown: Features
    ) -> Mapping[str, Floats]:
        """By the readout alone."""
        scores = self.readout.scores(learnt, features_of(results, frames, len(shown)))
        seen = np.isin(np.arange(len(shown)), frames.recording)
        return {"features": np.where(seen[:, None], scores, np.nan)}

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """What each map looks for."""
        from neuro_recognise.telling.pictures import images

        drawn = self.drawn(np.asarray(learnt["c1_s2"]))
        about = "a picture a map: the bank's filters, each as strong as its weight"
        return {"features": images(drawn, [""] * len(drawn), "What the maps look for", about)}


def features_of(results: neuro.TrialResults, frames: Frames, recordings: int) -> Floats:
    """(recordings, maps) largest potential of each map, the mean over the frames of a recording."""
    sums = np.zeros((recordings, results.potential.shape[1]))
    np.add.at(sums, frames.recording, results.potential)
    return sums / np.maximum(np.bincount(frames.recording, minlength=recordings), 1)[:, None]


OURS = "ours: the paper's numbers were not found"
TOP = 8
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
        pre, post, weight = sim.weights("c1_excited")
        matrix = np.zeros((pre.max() + 1, post.max() + 1))  # of all inputs to all neurons
        matrix[pre, post] = weight
        return {"thresholds": sim.get("excited", "theta") + self.theta, "c1_excited": matrix}

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
    presets = {"poker": {"size": [34, 34]}, "thesis": {"segmenter": "ses", "vote": "rate"}}
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
        chosen = [order[labels[order] == k][:TOP] for k in range(len(classes))]
        weights = np.asarray(learnt["c1_excited"]).T.reshape(-1, *self.inputs.shape)
        drawn = np.zeros((len(classes), TOP, *self.drawn(weights[:1]).shape[1:]))
        for k, some in enumerate(chosen):
            drawn[k, : len(some)] = self.drawn(weights[some])
        about = f"of each class the {TOP} with the highest thresholds; the bank's filters, each as strong as its weight"
        heads = [name if k == 0 else "" for name in classes for k in range(TOP)]
        title = "What the neurons look for"
        return {"features": images(drawn.reshape(-1, *drawn.shape[2:]), heads, title, about, TOP)}


CODE = "github BEJ97/MK-Tempotron, top_onN_MNIST.m"
RISE = 4.0
"""tau_m / tau_syn, as in that code."""
OUT_OF_REACH = 1e6
"""mV, of potentials of about 1."""
FRONT_END_OF_REMUS = {"segmenter": "msd", "bank": "gabors", "pool": "max", "encoder": "log_latency", "first": 150}


@dataclass(frozen=True)
class TempotronLayer(Labelled):
    """Neurons that see all inputs; after a mistake these change by what they added to the potential's largest value."""

    source = "Guetig and Sompolinsky, Nat. Neurosci. 9:420, 2006; models/neuro_models/tempotron.yaml"
    file = "tempotron"
    teaching = ("share", "step", "step_decay")

    per_class: int = setting(10, "", "neurons of each class", CODE, at_least=1)
    theta: float = setting(1.0, "mV", "threshold; the peak of a spike's potential is its weight", CODE, above=0)
    share: float = setting(0.1, "", "time constant of the membrane, as a share of the window", CODE, above=0)
    weight: float = setting(0.0, "", "mean of the first weights", CODE)
    spread: float = setting(0.1, "", "deviation of the first weights", CODE, at_least=0)
    step: float = setting(0.05, "", "size of a change", CODE, above=0)
    step_decay: float = setting(1.0, "", "factor on it from epoch to epoch", CODE, above=0, at_most=1)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Also time constants, and the capacity by which the peak of a potential is its weight."""
        tau = self.share * inputs.window / RISE
        peak = RISE ** (-1.0 / (RISE - 1.0))
        return super().following(inputs, classes) | {
            "tau_m": RISE * tau, "tau_syn": tau, "C_m": tau * peak, "lambda": self.step,
        }  # fmt: skip

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Let the step decay, and no neuron decide: each neuron is taught by itself."""
        sim.set("cells", V_th=OUT_OF_REACH)
        sim.set("c1_cells", lambda_=self.step * self.step_decay**epoch)

    def decided(self, results: neuro.TrialResults) -> Ints:
        """The class of the largest potential at the end; no neuron fires."""
        return np.asarray(results.potential.argmax(axis=1) // self.per_class)

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """With weights that stay: without bounds, chips could not teach them."""
        net.projections["c1_cells"] = replace(net.projections["c1_cells"], synapse=neuro.static())
        return net


Layer.known.add(TempotronLayer)


@dataclass(frozen=True)
class EdhmaxTempotron(Framewise):
    """Gabor filters that leak linearly, local maxima of them at peaks of the motion, and tempotrons."""

    known_as = "edhmax_tempotron"
    title = "leaking filters at peaks of the motion, and tempotrons"
    source = "Zhao et al., IEEE TNNLS 26:1963, 2015; thesis 6.1.1, lines 2165-2176"
    presets = {
        "poker": {"size": [34, 34], "leak": 0.05, "least": 0.8},
        "remus_front_end": {
            **FRONT_END_OF_REMUS, "per_class": 4, "spread": 0.01, "step": 0.02, "step_decay": 0.8, "epochs": 6,
        },
    }  # fmt: skip
    measured = {"N-MNIST": "71.5 %", "POKER-DVS": "73.2 %"}

    segmenter: Segmenter = part(Segmenter, Ses(threshold=200.0))
    bank: Bank = part(Bank, LeakyGabors())
    pool: Pool = part(Pool, LocalMaximum())
    encoder: Encoder = part(Encoder, Latency())
    layer: Layer = part(Layer, TempotronLayer())
    epochs: int = setting(10, "", "how often all recordings are shown", CODE, at_least=1)
    order: str = setting("frames", "", "what is shuffled in each epoch", CODE, words=ORDERS)

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, shown: Features
    ) -> Mapping[str, Floats]:
        """The neurons of a class, each of which was taught by itself, speak together."""
        return votes(results, frames.recording, len(shown), len(shown.classes), together=True)
