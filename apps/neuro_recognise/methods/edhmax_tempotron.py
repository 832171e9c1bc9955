"""EDHMAX with tempotrons: filters that leak are read at peaks of the motion, and tempotrons tell the classes apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import neuro
from neuro.apps import part, setting
from neuro_recognise.method import Learnt
from neuro_recognise.methods.framewise import ORDERS, Framewise
from neuro_recognise.parts.banks import Bank, LeakyGabors, LocalMaximum, Pool
from neuro_recognise.parts.encoders import Encoder, Latency
from neuro_recognise.parts.frames import Frames, votes
from neuro_recognise.parts.layers import Inputs, Labelled, Layer, Shares
from neuro_recognise.parts.segmenters import Segmenter, Ses
from neuro_recognise.shown import Features, Floats, Ints

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
        found: Ints = results.potential.argmax(axis=1) // self.per_class
        return found

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
