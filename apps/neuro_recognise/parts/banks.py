"""Layer S1: what oriented filters answer to the events of each frame."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from neuro import ModelError
from neuro.apps import Registry
from neuro.events import Events
from neuro_recognise.parts.gabor import gabor_bank
from neuro_recognise.parts.representations import Counts, Representation
from neuro_recognise.settings import SPLITS, Part, setting
from neuro_recognise.shown import Floats, Ints

__all__ = ["Bank", "Gabors", "LeakyGabors"]

TABLE_2 = "thesis table 2, line 2350"
COUNTS = Counts()


@dataclass(frozen=True)
class Bank(Part):
    """Base of the banks of filters: sizes, widths and wavelengths go together, one each a scale.

    Class attributes:
        shown: whether it is shown what a representation holds; else it sees each event by itself.
    """

    kind = "bank"
    shown: ClassVar[bool] = True

    sizes: tuple[int, ...] = setting((3, 5, 7, 9), "px", "sides of the filters, odd", TABLE_2, above=0)
    sigmas: tuple[float, ...] = setting((1.2, 2.0, 2.8, 3.6), "px", "their effective widths", TABLE_2, above=0)
    wavelengths: tuple[float, ...] = setting((1.5, 2.5, 3.5, 4.6), "px", "their wavelengths", TABLE_2, above=0)
    orientations: tuple[float, ...] = setting((0.0, 45.0, 90.0, 135.0), "degrees", "0 is a vertical bar", TABLE_2)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not len(self.sizes) == len(self.sigmas) == len(self.wavelengths):
            raise ModelError("sizes, sigmas and wavelengths: expected as many of each, one a scale")
        if even := [size for size in self.sizes if size % 2 == 0]:
            raise ModelError(f"sizes: found {even[0]}: expected odd numbers, so that a filter has a middle")

    @property
    @abstractmethod
    def filters(self) -> Floats:
        """(scales, orientations, side, side), each in the middle of the largest's side."""

    @abstractmethod
    def responses(self, events: Events, bounds: Ints, side: int, seen: Representation = COUNTS) -> Floats:
        """What the filters answer.

        Args:
            events: a recording inside the field.
            bounds: (frames + 1,) frame i is ``[bounds[i], bounds[i + 1])``.
            side: of a cell, px; of each only the largest response is given.
            seen: what a frame shows.

        Returns:
            (frames, scales, orientations, rows, columns) of cells, not below 0.
        """


@dataclass(frozen=True)
class Gabors(Bank):
    """Gabor filters over what each pixel of a frame holds."""

    source = "thesis 6.2.2, eqs 122-124, lines 2337-2370"

    gamma: float = setting(0.3, "", "aspect ratio; less than 1 is longer along the bar", TABLE_2, above=0)
    literal: bool = setting(
        False, "", "eq. 122 as printed, not filters of zero mean and unit norm", "literal ones cost 2 points on N-MNIST"
    )

    @cached_property
    def filters(self) -> Floats:
        """(scales, orientations, side, side)."""
        return gabor_bank(
            self.sizes, self.sigmas, self.wavelengths, self.gamma, self.orientations, literal=self.literal
        )

    def responses(self, events: Events, bounds: Ints, side: int, seen: Representation = COUNTS) -> Floats:
        """Rectified "same" convolution of each frame with each filter."""
        from neuro_recognise.parts._bank_kernels import largest_responses

        width, height = events.sensor_size
        out = np.empty((len(bounds) - 1, len(self.sizes), len(self.orientations), height // side, width // side))
        sizes = np.array(self.sizes, np.int64)
        largest_responses(*seen.pixels(events, bounds), self.filters, sizes, height, width, side, out)
        return out


@dataclass(frozen=True)
class LeakyGabors(Bank):
    """Gabor filters that each event adds to, whose responses leak to 0 at a constant rate and are never reset."""

    shown = False
    source = "Zhao et al., IEEE TNNLS 26:1963, 2015, section III-A; MK-Tempotron, zb_filters2.m, conv_integNoFire.m"

    gamma: float = setting(0.3, "", "aspect ratio; less than 1 is longer along the bar", TABLE_2, above=0)
    leak: float = setting(0.01, "1/ms", "of a response", "MK-Tempotron: 1e-8/ns on N-MNIST", at_least=0)
    signed: bool = setting(False, "", "whether OFF events subtract", SPLITS)

    @classmethod
    def called(cls) -> str:
        """``leaky_gabors``."""
        return "leaky_gabors"

    @cached_property
    def filters(self) -> Floats:
        """(scales, orientations, side, side), round and smoothed."""
        return gabor_bank(
            self.sizes, self.sigmas, self.wavelengths, self.gamma, self.orientations, circular=True, smooth=True
        )

    def responses(self, events: Events, bounds: Ints, side: int, seen: Representation = COUNTS) -> Floats:
        """Absolute values at the end of each frame; frames before have left their rest."""
        from neuro_recognise.parts._bank_kernels import leaky_responses

        width, height = events.sensor_size
        out = np.empty((len(bounds) - 1, len(self.sizes), len(self.orientations), height // side, width // side))
        sizes, sign = np.array(self.sizes, np.int64), np.where(self.signed & (events.p == 0), -1.0, 1.0)
        times = (events.t, events.x, events.y, sign)
        leaky_responses(*times, bounds, self.filters, sizes, height, width, self.leak / 1000.0, side, out)
        return out


Bank.known = Registry("bank", (Gabors, LeakyGabors))
