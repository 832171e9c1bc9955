"""ReMuS: grids of neurons that learn prototypes of objects by reward, and the first to fire names the class."""

from __future__ import annotations

from dataclasses import dataclass

from neuro.apps import setting
from neuro_recognise.methods.framewise import ORDERS, Framewise

ADAPTED = {"per_class": 2, "rescue": False, "dropout": 0.25, "decay": 0.7, "order": "recordings", "vote": "majority"}
"""Settings of the thesis, except a threshold of 60 and an epsilon of 0.0002, with which its rule learns.

Source: table 3, lines 2450-2463; majority is line 2431.
"""

THESIS = {**ADAPTED, "theta": 30.0, "epsilon": 0.004}
"""Table 3 as printed. Epsilon is added on every wrong frame, which drives all weights to 1: decisions are at chance."""

EARLY = {"representation": "leaky", "segmenter": "hes", "segmenter.window": 5.0}
"""A decision every 5 ms, from the first on: thesis section 6.2.8, lines 2549-2560."""


@dataclass(frozen=True)
class Remus(Framewise):
    """Pseudo-frames of a motion symbol detector, Gabor filters, log I2L, and a layer that learns by reward."""

    title = "reward-modulated STDP on the first spikes of pseudo-frames"
    source = "Mosca, MSc thesis, 2020, section 6.2"
    presets = {
        "best": {},
        "adapted": ADAPTED,
        "thesis": THESIS,
        "poker": {"theta": 30.0, "size": [34, 34]},
        "early": EARLY,
    }
    measured = {"N-MNIST": "91.4 %", "POKER-DVS": "98.5 %"}

    order: str = setting(
        "frames", "", "what is shuffled in each epoch", "benchmarks/recognisers.py; thesis: recordings", words=ORDERS
    )
