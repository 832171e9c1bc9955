"""How HFirst is set."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_recognise.parts.gabor import gabor_bank
from neuro_recognise.settings import Settings, setting

CODE = "HFIRST.m of the authors' code"


@dataclass(frozen=True)
class HFirstSettings(Settings):
    """The numbers of HFirst.

    Source: Orchard et al., IEEE TPAMI 37:2028, 2015, with the values of the authors' code, github.com/gorchard/HFIRST.
    """

    size: tuple[int, int] = setting((34, 34), "px", "width and height of the camera", "N-MNIST's", at_least=1)
    noise_us: int = setting(
        10_000, "us", "an event counts if a neighbour had one so long ago at most", "full_NMINST_example.m", above=0
    )
    orientations: int = setting(12, "", "of the Gabor filters, from 0 degrees in equal steps", CODE, at_least=1)
    field: int = setting(7, "px", "side of the Gabor filters, odd", CODE, at_least=1)
    sigma: float = setting(2.8, "px", "their width", CODE, above=0)
    wavelength: float = setting(5.0, "px", "of their cosine", CODE, above=0)
    gamma: float = setting(0.3, "", "their aspect ratio", CODE, above=0)
    norm: float = setting(100.0, "mV", "L2 norm of each filter, whose mean is 0, and of each template", CODE, above=0)
    s1_threshold: float = setting(150.0, "mV", "threshold of S1", CODE, above=0)
    s1_leak: float = setting(25.0, "mV/ms", "linear leak of S1", CODE, at_least=0)
    pool: int = setting(4, "px", "side of a C1 cell", CODE, at_least=1)
    c1_resets: bool = setting(
        False, "", "whether a C1 spike resets all orientations of its cell", "an option; the authors' code has none"
    )
    s2_threshold: float = setting(150.0, "mV", "threshold of S2", CODE, above=0)
    s2_leak: float = setting(1.0, "mV/ms", "linear leak of S2", CODE, at_least=0)
    t_ref: float = setting(5.0, "ms", "refractory period of all layers", CODE, at_least=0)
    below: float = setting(1.0, "mV", "template weights below it become `unseen`", CODE)
    unseen: float = setting(-1.0, "mV", "weight of a C1 neuron that hardly spikes for a class", CODE)
    resolution: float = setting(
        0.1, "ms", "steps of the network", "ours; the authors' code rounds times down to 1 ms", above=0
    )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Orientations, rows and columns of C1; its neurons are counted in C order."""
        width, height = self.size
        return self.orientations, math.ceil(height / self.pool), math.ceil(width / self.pool)

    @cached_property
    def gabors(self) -> npt.NDArray[np.float64]:
        """The filters, (orientations, field, field) in mV."""
        degrees = [180.0 * k / self.orientations for k in range(self.orientations)]
        bank = gabor_bank((self.field,), (self.sigma,), (self.wavelength,), self.gamma, degrees)
        return np.asarray(self.norm * bank[0])

    def parameters(self, classes: int, templates: npt.NDArray[np.float64] | None = None) -> dict[str, Any]:
        """Those of the network `hfirst`; `templates` of (classes, C1 neurons) in mV, None before they are learnt."""
        names = ("orientations", "field", "s1_threshold", "s1_leak", "pool", "s2_threshold", "s2_leak", "t_ref")
        own = {name: getattr(self, name) for name in names}
        width, height = self.size
        sizes = {"height": height, "width": width, "classes": classes, "resolution": self.resolution}
        return own | sizes | {"gabors": self.gabors, "templates": self.unseen if templates is None else templates.T}
