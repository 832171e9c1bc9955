"""Layers S1 and C1: representations of frames, filter banks on them, and pools of the responses.

A frame represents only its own events, or a surface that also remembers earlier events.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Registry, setting
from neuro.coding import Works, on_numbers
from neuro_events import Events, representations
from neuro_recognise.method import SPLITS, FrameSize, FrontEndPart
from neuro_recognise.shown import Array, Floats, Ints


class Pixels(NamedTuple):
    """Pixel values at the end of each segment; entries of the same pixel are added.

    Attributes:
        x, y: (entries,) columns and rows, px.
        value: (entries,) values above 0.
        bounds: (segments + 1,) indices; segment i has the entries ``[bounds[i], bounds[i + 1])``.
    """

    x: Array
    y: Array
    value: Floats
    bounds: Ints

    def pictures(self, size: tuple[int, int]) -> Floats:
        """Return images (segments, height, width) of a field with this width and height, px."""
        width, height = size
        segment = np.repeat(np.arange(len(self.bounds) - 1), np.diff(self.bounds))
        inside = slice(int(self.bounds[0]), int(self.bounds[-1]))
        images = np.zeros((len(self.bounds) - 1, height, width))
        np.add.at(images, (segment, self.y[inside], self.x[inside]), self.value[inside])
        return images

    def active(self, width: int) -> Ints:
        """Return the number of different pixels with entries in each segment, for a field of this width, px."""
        segments = len(self.bounds) - 1
        inside = slice(int(self.bounds[0]), int(self.bounds[-1]))
        places = self.y[inside].astype(np.int64) * width + self.x[inside]
        keys = places * segments + np.repeat(np.arange(segments), np.diff(self.bounds))
        return np.bincount(np.unique(keys) % max(1, segments), minlength=segments)


@dataclass(frozen=True)
class Representation(FrontEndPart):
    """Base of the representations.

    Class attributes:
        remembers: whether pixel values also depend on events before the segment.
    """

    kind = "representation"
    remembers: ClassVar[bool] = True

    @abstractmethod
    def pixels(self, events: Events, bounds: Ints) -> Pixels:
        """Return the pixel values at the last event of each segment.

        Args:
            events: a recording inside the field.
            bounds: (segments + 1,) indices; segment i has the events ``[bounds[i], bounds[i + 1])``.
        """


@dataclass(frozen=True)
class Counts(Representation):
    """Number of events per pixel in the segment."""

    remembers = False
    source = "thesis 6.2.1, lines 2321-2334"

    def pixels(self, events: Events, bounds: Ints) -> Pixels:
        """Return an entry of 1 for each event."""
        return Pixels(events.x, events.y, np.ones(len(events)), bounds)

    def work(self, size: FrameSize) -> Works:
        """Return an addition and a comparison for each event. The comparison finds the first event of a pixel."""
        return {"event": on_numbers(2, 4)}


@dataclass(frozen=True)
class _Remembering(Representation):
    """Base of surfaces, whose events decay over time.

    Class attributes:
        surface: a class of `neuro.events.representations`.
    """

    surface: ClassVar[Any]

    tau: float = setting(20.0, "ms", "time constant of the decay of an event", "that of MSD", above=0)

    def pixels(self, events: Events, bounds: Ints) -> Pixels:
        """Return the surface at all pixels that had an event."""
        width, height = events.sensor_size
        options = {"tau_us": 1000.0 * self.tau, "polarity": "ignored"}
        surface, begin = self.surface(events.sensor_size, **options), 0
        values = np.empty((len(bounds) - 1, height, width))
        for segment, end in enumerate(bounds[1:].tolist()):
            surface.add(events[begin:end])
            begin = end
            # The surface is read at the last event, whose pixel then has a large value even after a long pause.
            values[segment] = surface.at(int(events.t[end - 1]), np.float64)
        segments, y, x = np.nonzero(values)
        lengths = np.bincount(segments, minlength=len(values))
        return Pixels(x.astype(np.uint16), y.astype(np.uint16), values[segments, y, x], np.cumsum([0, *lengths]))


@dataclass(frozen=True)
class Leaky(_Remembering):
    """Sum of a pixel's events, each of which decays exponentially."""

    source = "thesis 6.2.8; appendix C, algorithm 15"
    surface = representations.LeakySurface

    def work(self, size: FrameSize) -> Works:
        """Return a leak of 5 operations: a comparison, a difference, a division, exp, and a product with a sum."""
        return {"event": on_numbers(5, 7), "frame": on_numbers(5 * size.pixels, 3 * size.pixels)}


@dataclass(frozen=True)
class Surface(_Remembering):
    """A pixel's last event, which decays exponentially."""

    source = "thesis 6.2.8; Lagorce et al., IEEE TPAMI 39:1346, 2017, eq. 2"
    surface = representations.TimeSurface

    def work(self, size: FrameSize) -> Works:
        """Return a comparison, a difference, a division and exp for each pixel. An event only copies its time."""
        return {"event": on_numbers(0, 4), "frame": on_numbers(4 * size.pixels, 2 * size.pixels)}


Representation.known = Registry("representation", (Counts, Leaky, Surface))


def gabor_bank(
    sizes: Sequence[int],
    sigmas: Sequence[float],
    wavelengths: Sequence[float],
    gamma: float,
    orientations: Sequence[float],
    *,
    literal: bool = False,
    circular: bool = False,
    smooth: bool = False,
) -> npt.NDArray[np.float64]:
    """Return one Gabor filter per scale and orientation.

    ``g = exp(-(x'^2 + gamma^2 y'^2) / (2 sigma^2)) cos(2 pi x' / wavelength)`` with x' and y' the
    coordinates rotated by the orientation; x points right, y down. The bar that a filter prefers runs
    along y', so orientation 0 is a vertical bar and 90 a horizontal one.

    Args:
        sizes: (scales,) odd side lengths, px.
        sigmas: (scales,) widths of the Gaussian, px.
        wavelengths: (scales,) wavelengths of the cosine, px.
        gamma: aspect ratio; less than 1 is longer along the bar.
        orientations: angles of the bars, degrees.
        literal: whether to use the values of the formula. Otherwise each filter has zero mean and unit L2 norm, so that
            uniform areas give no response and all scales respond equally strongly.
        circular: whether values at more than half a side from the centre are set to 0, before the mean is subtracted.
        smooth: whether to blur each filter by a box of 3 x 3 px, equivalent to blurring the image.

    Returns:
        (scales, orientations, side, side) filters, with side the largest size. Smaller filters are centred and padded
        with zeros.

    Source: thesis eqs 122-124, lines 2342-2346.
    """
    side = max(sizes)
    bank = np.zeros((len(sizes), len(orientations), side, side))
    for s, (size, sigma, wavelength) in enumerate(zip(sizes, sigmas, wavelengths, strict=True)):
        half = size // 2
        y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float64)
        margin = (side - size) // 2
        inner = slice(margin, margin + size)
        for o, angle in enumerate(np.deg2rad(orientations)):
            across = x * np.cos(angle) + y * np.sin(angle)
            along = -x * np.sin(angle) + y * np.cos(angle)
            g = np.exp(-(across**2 + gamma**2 * along**2) / (2 * sigma**2))
            g *= np.cos(2 * np.pi * across / wavelength)
            if circular:
                g[np.hypot(x, y) > size / 2] = 0.0
            if not literal:
                g -= g.mean()
                g /= np.linalg.norm(g)
            if smooth:  # mean over each pixel and its eight neighbours, 0 outside
                wide = np.pad(g, 1)
                g = np.mean([wide[i : i + size, j : j + size] for i in range(3) for j in range(3)], axis=0)
            bank[s, o, inner, inner] = g
    return bank


TABLE_2 = "thesis table 2, line 2350"
COUNTS = Counts()


@dataclass(frozen=True)
class Bank(FrontEndPart):
    """Base of the banks of filters.

    Class attributes:
        framewise: whether filters are applied to a representation; otherwise they are applied to single events.
    """

    kind = "bank"
    framewise: ClassVar[bool] = True

    sizes: tuple[int, ...] = setting((3, 5, 7, 9), "px", "sides of the filters, odd, one per scale", TABLE_2, above=0)
    orientations: tuple[float, ...] = setting((0.0, 45.0, 90.0, 135.0), "degrees", "0: vertical bars", TABLE_2)

    def __post_init__(self) -> None:
        super().__post_init__()
        if even := [size for size in self.sizes if size % 2 == 0]:
            raise ModelError(f"sizes: found {even[0]}: expected odd numbers, so that a filter has a middle")

    @cached_property
    @abstractmethod
    def filters(self) -> Floats:
        """(scales, orientations, side, side) filters. Smaller filters are centred and padded with zeros."""

    def _empty(self, events: Events, bounds: Ints, side: int) -> Floats:
        """Allocate an array (frames, scales, orientations, rows, columns) for the responses of cells."""
        width, height = events.sensor_size
        return np.empty((len(bounds) - 1, len(self.sizes), len(self.orientations), height // side, width // side))

    def responses(self, events: Events, bounds: Ints, side: int, representation: Representation = COUNTS) -> Floats:
        """Return the maximum in each cell of the rectified "same" correlation of each frame with each filter.

        Args:
            events: a recording inside the field.
            bounds: (frames + 1,) indices; frame i has the events ``[bounds[i], bounds[i + 1])``.
            side: side of a cell, px.
            representation: representation of a frame.

        Returns:
            (frames, scales, orientations, rows, columns) of cells, >= 0.
        """
        from neuro_recognise.parts._bank_kernels import largest_responses

        (width, height), out = events.sensor_size, self._empty(events, bounds, side)
        sizes = np.array(self.sizes, np.int64)
        largest_responses(*representation.pixels(events, bounds), self.filters, sizes, height, width, side, out)
        return out

    def work(self, size: FrameSize) -> Works:
        """Return a product with a sum for each value of all filters, and a comparison for each response at a pixel."""
        macs, responses = size.orientations * sum(side * side for side in size.sides), size.responses * size.side**2
        return {"pixel": on_numbers(macs, 1 + 2 * macs), "frame": on_numbers(responses, responses + size.responses)}


@dataclass(frozen=True)
class _OfGabors(Bank):
    """Base of banks of Gabor filters. `sizes`, `sigmas` and `wavelengths` have one value per scale."""

    sigmas: tuple[float, ...] = setting((1.2, 2.0, 2.8, 3.6), "px", "effective widths", TABLE_2, above=0)
    wavelengths: tuple[float, ...] = setting((1.5, 2.5, 3.5, 4.6), "px", "their wavelengths", TABLE_2, above=0)
    gamma: float = setting(0.3, "", "aspect ratio; less than 1 is longer along the bar", TABLE_2, above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not len(self.sizes) == len(self.sigmas) == len(self.wavelengths):
            raise ModelError("sizes, sigmas and wavelengths: expected one of each for each scale")

    @cached_property
    def filters(self) -> Floats:
        """Filters of `gabor_bank`."""
        return gabor_bank(self.sizes, self.sigmas, self.wavelengths, self.gamma, self.orientations, **self.shapes)

    @property
    def shapes(self) -> dict[str, bool]:
        """Keyword arguments of `gabor_bank`."""
        return {}


@dataclass(frozen=True)
class Gabors(_OfGabors):
    """Gabor filters on the pixel values of a frame."""

    source = "thesis 6.2.2, eqs 122-124, lines 2337-2370"

    literal: bool = setting(
        False, "", "whether eq. 122 is used as printed, without zero mean and unit norm", "2 points worse on N-MNIST"
    )

    @property
    def shapes(self) -> dict[str, bool]:
        """Return ``literal``."""
        return {"literal": self.literal}


@dataclass(frozen=True)
class Sobels(Bank):
    """Directional Sobel filters: the gradient of the pixel values in each direction, with unit norm.

    Each filter is a central difference along the direction and a binomial mean across it. The filter of a direction
    between the axes is the sum of the filters of both axes, weighted by cosine and sine.
    """

    known_as = "sobel"
    source = "thesis 8.2.2 and figure 81, lines 3183-3190"

    sizes: tuple[int, ...] = setting((3,), "px", "sides of the filters, odd, one per scale", "figure 81", above=1)
    orientations: tuple[float, ...] = setting(
        tuple(45.0 * k for k in range(8)), "degrees", "directions of the rise; 0: right, 90: down", "figure 81"
    )

    @cached_property
    def filters(self) -> Floats:
        """(scales, orientations, side, side) filters. Smaller filters are centred and padded with zeros."""
        side, angles = max(self.sizes), np.deg2rad(self.orientations)
        bank = np.zeros((len(self.sizes), len(angles), side, side))
        for s, size in enumerate(self.sizes):
            mean = np.array([comb(size - 1, k) for k in range(size)], float)
            rise = np.outer(mean, np.convolve([comb(size - 3, k) for k in range(size - 2)], [-1.0, 0.0, 1.0]))
            inner = slice((side - size) // 2, (side + size) // 2)
            turned = np.multiply.outer(np.cos(angles), rise) + np.multiply.outer(np.sin(angles), rise.T)
            bank[s, :, inner, inner] = turned / np.linalg.norm(turned, axis=(1, 2), keepdims=True)
        return bank


@dataclass(frozen=True)
class LeakyGabors(_OfGabors):
    """Gabor filters that are added at each event. Their responses leak to 0 at a constant rate and are never reset."""

    known_as = "leaky_gabors"
    framewise = False
    source = "Zhao et al., IEEE TNNLS 26:1963, 2015, section III-A; MK-Tempotron, zb_filters2.m, conv_integNoFire.m"

    leak: float = setting(0.01, "1/ms", "leak rate of a response", "MK-Tempotron: 1e-8/ns on N-MNIST", at_least=0)
    signed: bool = setting(False, "", "whether OFF events subtract", SPLITS)

    @property
    def shapes(self) -> dict[str, bool]:
        """Return ``circular`` and ``smooth``."""
        return {"circular": True, "smooth": True}

    def responses(self, events: Events, bounds: Ints, side: int, representation: Representation = COUNTS) -> Floats:
        """Return absolute responses at the end of each frame; responses carry over from earlier frames."""
        from neuro_recognise.parts._bank_kernels import leaky_responses

        (width, height), out = events.sensor_size, self._empty(events, bounds, side)
        sizes, sign = np.array(self.sizes, np.int64), np.where(self.signed & (events.p == 0), -1.0, 1.0)
        times = (events.t, events.x, events.y, sign)
        leaky_responses(*times, bounds, self.filters, sizes, height, width, self.leak / 1000.0, side, out)
        return out

    def work(self, size: FrameSize) -> Works:
        """Return the operations of an event under all filters, and of all responses at the end of a frame.

        The time since the last event and the leak in that time take 2 operations. A response takes 3 operations to
        move towards 0, and 1 to add a value of the filter. At the end of a frame, a response leaks once more, and takes
        a sign and a comparison.
        """
        area, responses = sum(side * side for side in size.sides), size.responses * size.side**2
        event = on_numbers(area * (2 + 4 * size.orientations), 4 + area * (2 + 3 * size.orientations))
        return {"event": event, "frame": on_numbers(7 * responses, 2 * responses + size.responses)}


Bank.known = Registry("bank", (Gabors, LeakyGabors, Sobels))


@dataclass(frozen=True)
class Pool(FrontEndPart):
    """Base of the pools, which select from the largest responses of cells of `side` x `side` px."""

    kind = "pool"

    side: int = setting(2, "px", "side of the cells", "thesis 6.2.2, line 2366", at_least=1)

    @abstractmethod
    def passed(self, responses: Floats, sizes: Sequence[int]) -> Floats:
        """Return a copy of the responses in which suppressed responses are 0.

        Args:
            responses: (frames, scales, orientations, rows, columns) of cells.
            sizes: sides of the filters of each scale, px.
        """


@dataclass(frozen=True)
class Max(Pool):
    """Max pooling: the largest response of each cell."""

    source = "thesis 6.2.2, lines 2363-2370"

    def passed(self, responses: Floats, sizes: Sequence[int]) -> Floats:
        """Return all responses unchanged."""
        return responses

    def work(self, size: FrameSize) -> Works:
        """Return no operations, because the bank's comparisons already find the largest responses."""
        return {}


@dataclass(frozen=True)
class LocalMaximum(Pool):
    """Responses that are a local maximum within their filter's side."""

    known_as = "local_maximum"
    source = "Zhao et al., IEEE TNNLS 26:1963, 2015, section III-A"

    side: int = setting(1, "px", "side of the cells", "none in the paper", at_least=1)
    least: float = setting(0.2, "", "smallest response that passes", "MK-Tempotron, top_onN_MNIST.m", at_least=0)

    def passed(self, responses: Floats, sizes: Sequence[int]) -> Floats:
        """Keep responses >= `least` that are the largest within half a filter, at the same orientation and scale."""
        from scipy.ndimage import maximum_filter

        highest = np.empty_like(responses)
        for scale, size in enumerate(sizes):
            around = 2 * (size // 2 // self.side) + 1
            highest[:, scale] = maximum_filter(responses[:, scale], (1, 1, around, around), mode="constant")
        return np.where((responses >= self.least) & (responses == highest), responses, 0.0)

    def work(self, size: FrameSize) -> Works:
        """Return the comparisons along the rows and columns of a neighbourhood, and two comparisons of the result."""
        around = sum(2 * (2 * (side // 2 // self.side)) + 2 for side in size.sides)
        return {"frame": on_numbers(around * size.orientations * size.cells, 3 * size.responses)}


Pool.known = Registry("pool", (Max, LocalMaximum))
