"""Methods with networks on frames: ReMuS, Mozafari, Masquelier and Thorpe, MuST, and EDHMAX with tempotrons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import neuro
from neuro.apps import part, setting
from neuro.coding import Work, Works, on_numbers
from neuro_recognise.method import SPLITS, Course, Drawings, Learnt
from neuro_recognise.methods.framewise import ORDERS, Framewise, Inputs, Labelled, Layer, Shares
from neuro_recognise.parts.banks import Bank, LeakyGabors, LocalMaximum, Pool
from neuro_recognise.parts.frames import Encoder, Frames, Latency, LogLatency, majority, potentials, votes
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.parts.segmenters import Segmenter, Ses
from neuro_recognise.shown import Features, Floats, Ints

ADAPTED = {"per_class": 2, "rescue": False, "dropout": 0.25, "decay": 0.7, "order": "recordings", "vote": "majority"}
"""Settings of the thesis, except a threshold of 60 and an epsilon of 0.0002, with which its rule learns.

Source: table 3, lines 2450-2463; majority is line 2317, the order is ours.
"""

THESIS = {**ADAPTED, "theta": 30.0, "epsilon": 0.004, "ties_after": True}
"""Table 3 and eq. 126 as printed. Epsilon on every wrong frame drives all weights to 1, so accuracy is at chance."""

PRINTED = {**THESIS, "literal": True, "scales": "all", "ranges": "filter", "spikes": "first"}
"""`THESIS` with the front end as printed: eq. 122, r_min and r_max of each filter (line 3722), and merged spikes of all
scales (line 2387).
"""

EARLY = {"representation": "leaky", "segmenter": "hes", "segmenter.window": 5.0}
"""A decision every 5 ms from the beginning: thesis section 6.2.8, lines 2549-2560."""

RELEARNS = {"least": 0.1, "Ap_minus": -0.08, "Ap_plus": 0.01}
"""Rewards scaled by the share of mistakes, and punishments twice as strong. Each update moves the logit of a weight by
about its rate, so after a change of labels punishments must undo all earlier rewards. Chosen on seeds 5 to 7 of
POKER-DVS, see docs/reference/recognisers.md.
"""


PICTURES = {"segmenter": "whole", "sizes": [5], "sigmas": [2.0], "wavelengths": [2.5]}
"""Still images and filters of one scale, as in Mozafari, Masquelier and Thorpe: thesis lines 2271-2275."""


@dataclass(frozen=True)
class Remus(Framewise):
    """Frames of a motion symbol detector, Gabor filters, log-intensity latencies, and a layer that learns by reward."""

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

    order: str = setting("frames", "", "items to shuffle in each epoch", "benchmarks/recognisers.py", words=ORDERS)


NORB = "SpykeTorch's MozafariShallow, NORB"


@dataclass(frozen=True)
class MozafariLayer(Labelled):
    """Maps of non-leaky neurons with one shared kernel each. The first to fire decides the class and is rewarded."""

    source = "models/neuro_models/mozafari.yaml"
    file = "mozafari"
    teaching = ("least",)

    per_class: int = setting(8, "", "maps per class", f"{SPLITS}; as ReMuS", at_least=1)
    field: int = setting(11, "cells", "side of the receptive field", "thesis table 3", at_least=1)
    theta: float = setting(60.0, "mV", "threshold", f"{SPLITS}: no map dies, no frame is silent", above=0)
    weight: float = setting(0.8, "", "mean of the initial weights", NORB)
    spread: float = setting(0.05, "", "deviation of the initial weights", NORB, at_least=0)
    Ar_plus: float = setting(0.05, "", "rate on reward, input before the decision", NORB)
    Ar_minus: float = setting(-0.003, "", "rate on reward, other inputs", NORB)
    Ap_plus: float = setting(0.0005, "", "rate on punishment, other inputs", NORB)
    Ap_minus: float = setting(-0.05, "", "rate on punishment, input before the decision", NORB)
    dropout: float = setting(0.5, "", "share of the maps that are silenced in a recording", NORB)
    least: float = setting(0.2, "", "smallest factor on rates, so that learning never stops", NORB, above=0, at_most=1)

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Scale the rates by the shares of frames that were decided wrongly and rightly.

        Silent frames count as neither. In the first epoch, the shares of random guesses are used.
        """
        guessed = self.per_class / sim.weights("c1_s2").shape[0]
        shares = last or Shares(right=guessed, wrong=1.0 - guessed)
        misses, hits = (self.least + (1.0 - self.least) * share for share in (shares.wrong, shares.right))
        sim.set("c1_s2", misses=misses, hits=hits)


Layer.known.add(MozafariLayer)


@dataclass(frozen=True)
class Mozafari(Framewise):
    """Frames of ReMuS's front end, and a layer whose learning rates follow the share of mistakes."""

    title = "reward-modulated STDP whose rates follow the share of mistakes"
    source = "Mozafari et al., IEEE TNNLS 29:6178, 2018; thesis eqs 120, 121; there natural images, one scale"
    presets = {"poker": {"theta": 30.0, "size": [34, 34]}, "pictures": PICTURES}
    measured = {"N-MNIST": "88.9 %", "POKER-DVS": "95.0 %"}

    layer: Layer = part(Layer, MozafariLayer())


PAPER = "Masquelier and Thorpe 2007"


@dataclass(frozen=True)
class MasquelierThorpeLayer(Layer):
    """Maps of non-leaky neurons. Each map wins at most once per frame and silences the others around its winner."""

    source = "models/neuro_models/masquelier_thorpe.yaml"
    file = "masquelier_thorpe"
    supervised = False
    batch = 400
    teaching = ("highest",)

    maps: int = setting(
        40, "", "number of maps", f"{SPLITS}; the paper: 10 for each of two kinds of pictures", at_least=1
    )
    field: int = setting(11, "cells", "side of the receptive field", f"{SPLITS}; the paper: 16", at_least=1)
    theta: float = setting(50.0, "mV", "threshold while learning", f"{SPLITS}; 25 suits a field of 7", above=0)
    weight: float = setting(0.8, "", "mean of the initial weights", PAPER)
    spread: float = setting(0.05, "", "deviation of the initial weights", PAPER, at_least=0)
    A_plus: float = setting(2.0**-6, "", "initial rate, input before the winner", PAPER, above=0)
    highest: float = setting(0.25, "", "largest rate; the rate doubles every 400 frames", PAPER, above=0)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Add the radius of inhibition, half a field, and the rate of other inputs, -3/4 of A_plus."""
        return super().following(inputs, classes) | {"radius": self.field // 2, "A_minus": -0.75 * self.A_plus}

    def pace(self, sim: neuro.Simulation, n_frames: int) -> None:
        """Double the rates every 400 frames."""
        rate = min(self.A_plus * 2.0 ** min(n_frames // 400, 60), self.highest)
        sim.set("c1_s2", A_plus=rate, A_minus=-0.75 * rate)

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """Raise the threshold above the sum of all inputs, because potentials are read instead of spikes."""
        inputs = int(np.prod(np.shape(learnt["c1_s2"])[1:]))
        s2 = net.populations["s2"]
        assert isinstance(s2.model, neuro.iaf_psc_delta)
        net.populations["s2"] = replace(s2, model=replace(s2.model, V_th=inputs + 1.0))
        return net


Layer.known.add(MasquelierThorpeLayer)


@dataclass(frozen=True)
class MasquelierThorpe(Framewise):
    """Features that are frequent in frames of ReMuS's front end, and a linear support vector machine.

    Attributes:
        readout: classifier of the largest potential of each map, averaged over a recording's frames.
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
        "passes over all recordings",
        "rates are at their highest after 1600 frames: N-MNIST has ten times as many, POKER-DVS needs 3",
    )
    order: str = setting("frames", "", "items to shuffle in each epoch", "ours", words=ORDERS)
    vote: str = setting("features", "", "vote: the readout scores the mean of the frames", "ours", words=("features",))

    def afterwards(self, learnt: Learnt, features: Features, course: Course) -> Learnt:
        """Train the readout on the maps' responses to the same recordings."""
        vectors, labels = [], []
        for batch, results, frames in self.presented(self.simulation(learnt, course.backend), learnt, features):
            with_frames = np.unique(frames.recording)
            vectors.append(features_of(results, frames, len(batch))[with_frames])
            labels.append(batch.labels[with_frames])
        return self.readout.fit(np.concatenate(vectors), np.concatenate(labels), len(features.classes), course)

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, features: Features
    ) -> Mapping[str, Floats]:
        """Return the scores of the readout."""
        scores = self.readout.scores(learnt, features_of(results, frames, len(features)))
        has_frames = np.isin(np.arange(len(features)), frames.recording)
        return {"features": np.where(has_frames[:, None], scores, np.nan)}

    def vote_work(self, learnt: Learnt, neurons: int, classes: int) -> Works:
        """Return the operations of the mean potential of each map, of the readout, and of the choice."""
        scores = self.readout.work(learnt, neurons, classes)
        recording = None if scores is None else scores + on_numbers(neurons + classes, neurons)
        return {"frame": on_numbers(neurons, 2 * neurons), "recording": recording}

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw the kernel of each map."""
        from neuro_recognise.telling.pictures import images

        kernels = self.images(np.asarray(learnt["c1_s2"]))
        caption = "one image per map: the bank's filters, scaled by the weights"
        return {"features": images(kernels, [""] * len(kernels), "Learnt kernels of the maps", caption)}


def features_of(results: neuro.TrialResults, frames: Frames, recordings: int) -> Floats:
    """Return the largest potential of each map, averaged over the frames of a recording, (recordings, maps)."""
    sums = np.zeros((recordings, results.potential.shape[1]))
    np.add.at(sums, frames.recording, results.potential)
    return sums / np.maximum(np.bincount(frames.recording, minlength=recordings), 1)[:, None]


OURS = "ours: the paper's numbers were not found"
TOP = 8
"""Number of neurons of each class in a picture."""
SLOW = 1000.0
"""Time constant, in frames, with which a raised threshold decays."""


@dataclass(frozen=True)
class MustLayer(Layer):
    """Neurons that receive all inputs. The first neuron to fire learns, and its threshold rises."""

    source = "models/neuro_models/must.yaml"
    file = "must"
    supervised = False

    neurons: int = setting(400, "", "number of neurons", f"{OURS}; 800 are 2 to 5 points better", at_least=1)
    theta: float = setting(25.0, "mV", "initial threshold", OURS, above=0)
    rise: float = setting(5.0, "mV", "increase of the winner's threshold", OURS, at_least=0)
    A_plus: float = setting(0.05, "", "rate, input before the decision", OURS)
    A_minus: float = setting(-0.01, "", "rate, other inputs", OURS)
    total: float = setting(300.0, "", "sum of the weights of a neuron", OURS, above=0)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Add the decay of thresholds, and initial weights whose sum is about `total`."""
        return super().following(inputs, classes) | {
            "tau_theta": SLOW * inputs.window, "highest": min(1.0, 2.0 * self.total / float(np.prod(inputs.shape))),
        }  # fmt: skip

    def also(self, sim: neuro.Simulation) -> dict[str, Any]:
        """Return the threshold of each neuron, and the weights as a matrix."""
        pre, post, weight = sim.weights("c1_excited")
        matrix = np.zeros((pre.max() + 1, post.max() + 1))  # all inputs to all neurons
        matrix[pre, post] = weight
        return {"thresholds": sim.get("excited", "theta") + self.theta, "c1_excited": matrix}

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """Replace the neurons by neurons with constant thresholds, which chips support."""
        model = neuro.iaf_psc_delta(
            tau_m=np.inf, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=np.asarray(learnt["thresholds"], float)
        )
        net.populations["excited"] = replace(net.populations["excited"], model=model)
        return net


Layer.known.add(MustLayer)


@dataclass(frozen=True)
class Must(Framewise):
    """The first 150 spikes of frames of ReMuS's front end, and neurons that are assigned to classes after learning."""

    title = "unsupervised STDP with homeostasis, neurons assigned to classes afterwards"
    source = "Liu et al., 2020, after the thesis, section 6.1.5; homeostasis of Diehl and Cook 2015"
    presets = {"poker": {"size": [34, 34]}, "thesis": {"segmenter": "ses", "vote": "rate"}}
    measured = {"N-MNIST": "80.9 %", "POKER-DVS": "92.3 %"}

    encoder: Encoder = part(Encoder, LogLatency(first=150))
    layer: Layer = part(Layer, MustLayer())
    epochs: int = setting(3, "", "passes over all recordings", OURS, at_least=1)
    order: str = setting("frames", "", "items to shuffle in each epoch", OURS, words=ORDERS)
    vote: str = setting(
        "potentials", "", "vote of the frames; rate: wins per neuron of the class", OURS,
        words=("rate", "majority", "potentials"),
    )  # fmt: skip

    def afterwards(self, learnt: Learnt, features: Features, course: Course) -> Learnt:
        """Assign each neuron to the class in which it wins the largest share of frames; -1 if it never wins."""
        winners, labels = [], []
        for batch, results, frames in self.presented(self.simulation(learnt, course.backend), learnt, features):
            winners.append(results.winner)
            labels.append(batch.labels[frames.recording])
        count = len(np.asarray(learnt["thresholds"]))
        return {"labels": neuro.assign_labels(np.concatenate(winners), np.concatenate(labels), count)}

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, features: Features
    ) -> Mapping[str, Floats]:
        """Return scores of three rules: wins per neuron of a class, wins, and the largest potential in a class."""
        labels, classes = np.asarray(learnt["labels"]), len(features.classes)
        assigned = labels >= 0
        wins, sums = np.zeros((len(features), classes)), np.zeros((len(features), classes))
        decided = np.flatnonzero((results.winner >= 0) & assigned[results.winner])
        np.add.at(wins, (frames.recording[decided], labels[results.winner[decided]]), 1.0)
        for label in np.unique(labels[assigned]):
            np.add.at(sums[:, label], frames.recording, results.potential[:, labels == label].max(axis=1, initial=0.0))
        rate = wins / np.maximum(np.bincount(labels[assigned], minlength=classes), 1)
        rates = {"rate": np.where(wins.any(axis=1, keepdims=True), rate, np.nan)}
        return rates | {"majority": majority(wins, sums), "potentials": potentials(sums)}

    def vote_work(self, learnt: Learnt, neurons: int, classes: int) -> Works:
        """Return the operations of a vote. `rate` counts a win in each frame, and divides the wins of each class."""
        if self.vote != "rate":
            return super().vote_work(learnt, neurons, classes)
        return {"frame": on_numbers(1, 2), "recording": on_numbers(3 * classes, 3 * classes)}

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw weights of the neurons with the highest thresholds, which win most often, in one row per class."""
        from neuro_recognise.telling.pictures import images

        labels, thresholds = np.asarray(learnt["labels"]), np.asarray(learnt["thresholds"])
        order = np.argsort(-thresholds, kind="stable")
        rows = [order[labels[order] == k][:TOP] for k in range(len(classes))]
        weights = np.asarray(learnt["c1_excited"]).T.reshape(-1, *self.inputs.shape)
        pictures = np.zeros((len(classes), TOP, *self.images(weights[:1]).shape[1:]))
        for k, row in enumerate(rows):
            pictures[k, : len(row)] = self.images(weights[row])
        caption = f"the {TOP} neurons per class with the highest thresholds; the bank's filters, scaled by the weights"
        heads = [name if k == 0 else "" for name in classes for k in range(TOP)]
        title = "Learnt weights of the neurons"
        return {"features": images(pictures.reshape(-1, *pictures.shape[2:]), heads, title, caption, TOP)}


CODE = "github BEJ97/MK-Tempotron, top_onN_MNIST.m"
RISE = 4.0
"""tau_m / tau_syn, as in `CODE`."""
OUT_OF_REACH = 1e6
"""Threshold in mV that is never reached; potentials are about 1 mV."""
FRONT_END_OF_REMUS = {"segmenter": "msd", "bank": "gabors", "pool": "max", "encoder": "log_latency", "first": 150}


@dataclass(frozen=True)
class TempotronLayer(Labelled):
    """Neurons that receive all inputs. After an error, a weight changes by its input's part of the peak potential."""

    source = "Guetig and Sompolinsky, Nat. Neurosci. 9:420, 2006; models/neuro_models/tempotron.yaml"
    file = "tempotron"
    teaching = ("share", "step", "step_decay")

    per_class: int = setting(10, "", "neurons per class", CODE, at_least=1)
    theta: float = setting(1.0, "mV", "threshold; the peak of a spike's potential is its weight", CODE, above=0)
    share: float = setting(0.1, "", "time constant of the membrane, as a share of the window", CODE, above=0)
    weight: float = setting(0.0, "", "mean of the initial weights", CODE)
    spread: float = setting(0.1, "", "deviation of the initial weights", CODE, at_least=0)
    step: float = setting(0.05, "", "learning rate", CODE, above=0)
    step_decay: float = setting(1.0, "", "factor on the learning rate per epoch", CODE, above=0, at_most=1)

    def following(self, inputs: Inputs, classes: int) -> dict[str, Any]:
        """Add the time constants, and a capacitance for which the peak of a spike's potential is its weight."""
        tau = self.share * inputs.window / RISE
        peak = RISE ** (-1.0 / (RISE - 1.0))
        return super().following(inputs, classes) | {
            "tau_m": RISE * tau, "tau_syn": tau, "C_m": tau * peak, "lambda": self.step,
        }  # fmt: skip

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Decay the learning rate. Raise the threshold so that no neuron fires and neurons learn independently."""
        sim.set("cells", V_th=OUT_OF_REACH)
        sim.set("c1_cells", lambda_=self.step * self.step_decay**epoch)

    def decided(self, results: neuro.TrialResults) -> Ints:
        """Return the class of the largest potential, since no neuron fires."""
        return np.asarray(results.potential.argmax(axis=1) // self.per_class)

    def settled(self, net: neuro.Network, learnt: Learnt) -> neuro.Network:
        """Make the synapses static, because chips do not support this rule."""
        net.projections["c1_cells"] = replace(net.projections["c1_cells"], synapse=neuro.static())
        return net


Layer.known.add(TempotronLayer)


@dataclass(frozen=True)
class EdhmaxTempotron(Framewise):
    """Gabor filters with linear leak, their local maxima at peaks of the motion, and tempotrons."""

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
    epochs: int = setting(10, "", "passes over all recordings", CODE, at_least=1)
    order: str = setting("frames", "", "items to shuffle in each epoch", CODE, words=ORDERS)

    def votes(
        self, learnt: Learnt, results: neuro.TrialResults, frames: Frames, features: Features
    ) -> Mapping[str, Floats]:
        """Return scores that average over the neurons of a class, because each neuron learnt independently."""
        return votes(results, frames.recording, len(features), len(features.classes), mean_over_maps=True)

    def vote_work(self, learnt: Learnt, neurons: int, classes: int) -> Works:
        """Return the operations of a vote. The mean of a class takes a sum and a division in each frame."""
        works = super().vote_work(learnt, neurons, classes)
        assert works["frame"] is not None
        return {**works, "frame": works["frame"] + Work(classes)}
