"""Mozafari's rewards: as ReMuS, but rewards are smaller the fewer mistakes there are, and punishments the more."""

from __future__ import annotations

from dataclasses import dataclass

import neuro
from neuro.apps import part, setting
from neuro_recognise.methods.framewise import Framewise
from neuro_recognise.parts.layers import Labelled, Layer, Shares
from neuro_recognise.settings import SPLITS

PAPER = "SpykeTorch's MozafariShallow, NORB"


@dataclass(frozen=True)
class MozafariLayer(Labelled):
    """Grids of neurons without leak that share a kernel; the first to fire names the class and is rewarded for it."""

    source = "models/neuro_models/mozafari.yaml"
    file = "mozafari"
    teaching = ("least",)

    per_class: int = setting(8, "", "maps of each class", f"{SPLITS}; as ReMuS", at_least=1)
    field: int = setting(11, "cells", "side of the receptive field", "thesis table 3", at_least=1)
    theta: float = setting(60.0, "mV", "threshold", f"{SPLITS}: no map dies, no frame is silent", above=0)
    weight: float = setting(0.8, "", "mean of the first weights", PAPER)
    spread: float = setting(0.05, "", "deviation of the first weights", PAPER, at_least=0)
    Ar_plus: float = setting(0.05, "", "rate on reward, input before the decision", PAPER)
    Ar_minus: float = setting(-0.003, "", "rate on reward, other inputs", PAPER)
    Ap_plus: float = setting(0.0005, "", "rate on punishment, other inputs", PAPER)
    Ap_minus: float = setting(-0.05, "", "rate on punishment, input before the decision", PAPER)
    dropout: float = setting(0.5, "", "share of the maps that are silent in a recording", PAPER)
    least: float = setting(0.2, "", "of the factors on rates, so that neither comes to rest", PAPER, above=0, at_most=1)

    def begin(self, sim: neuro.Simulation, epoch: int, last: Shares | None) -> None:
        """Let rates follow the shares of all frames that were decided wrongly and rightly; silence is neither.

        Before the first epoch they are those of guessing.
        """
        guessed = self.per_class / sim.weights("c1_s2").shape[0]
        shares = last or Shares(right=guessed, wrong=1.0 - guessed)
        sim.set("c1_s2", misses=self._factor(shares.wrong), hits=self._factor(shares.right))

    def _factor(self, share: float) -> float:
        return self.least + (1.0 - self.least) * share


Layer.known.add(MozafariLayer)


@dataclass(frozen=True)
class Mozafari(Framewise):
    """Frames of ReMuS's front end, and a layer whose learning follows the share of mistakes."""

    title = "reward-modulated STDP whose rates follow the share of mistakes"
    source = "Mozafari et al., IEEE TNNLS 29:6178, 2018; thesis eq. 120"
    presets = {"poker": {"theta": 30.0, "size": [34, 34]}}
    measured = {"N-MNIST": "88.9 %", "POKER-DVS": "95.0 %"}

    layer: Layer = part(Layer, MozafariLayer())
