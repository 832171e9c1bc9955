"""How HFirst is set."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_recognise.gabor import gabor_bank


@dataclass(frozen=True)
class HFirst:
    """The numbers of HFirst.

    Attributes:
        size: width and height of the camera, px; N-MNIST's.
        noise_us: an event counts if a neighbour had one so long ago at most, us; `full_NMINST_example.m`.
        orientations: of the Gabor filters, from 0 degrees in equal steps; `HFIRST.m`, as all that follows.
        field: their side, px.
        sigma: their width, px.
        wavelength: of their cosine, px.
        gamma: their aspect ratio.
        norm: L2 norm of each filter, whose mean is 0, and of each template, mV.
        s1_threshold: mV.
        s1_leak: mV/ms.
        pool: side of a C1 cell, px.
        c1_resets: whether a C1 spike resets all orientations of its cell; the authors' code has no such reset.
        s2_threshold: mV.
        s2_leak: mV/ms.
        t_ref: refractory period of all layers, ms.
        below: template weights below it become `unseen`, mV.
        unseen: weight of a C1 neuron that hardly spikes for a class, mV.
        resolution: steps of the network, ms; the authors' code rounds times down to 1 ms.

    Source: Orchard et al., IEEE TPAMI 37:2028, 2015, with the values of the authors' code, github.com/gorchard/HFIRST.
    """

    size: tuple[int, int] = (34, 34)
    noise_us: int = 10_000
    orientations: int = 12
    field: int = 7
    sigma: float = 2.8
    wavelength: float = 5.0
    gamma: float = 0.3
    norm: float = 100.0
    s1_threshold: float = 150.0
    s1_leak: float = 25.0
    pool: int = 4
    c1_resets: bool = False
    s2_threshold: float = 150.0
    s2_leak: float = 1.0
    t_ref: float = 5.0
    below: float = 1.0
    unseen: float = -1.0
    resolution: float = 0.1

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

    def parameters(self, classes: int) -> dict[str, Any]:
        """Those of the network `hfirst`."""
        names = ("orientations", "field", "s1_threshold", "s1_leak", "pool", "s2_threshold", "s2_leak", "t_ref")
        own = {name: getattr(self, name) for name in names}
        width, height = self.size
        sizes = {"height": height, "width": width, "classes": classes, "resolution": self.resolution}
        return own | sizes | {"gabors": self.gabors, "templates": self.unseen}
