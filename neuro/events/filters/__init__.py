"""Filters of events: noise out, noise in, parts of the sensor, other times and places.

A filter is made for a sensor size with its parameters, called with a recording or part after part of one, and goes on
where it was: cut anywhere, the parts give what the whole gives. `chain` puts filters one behind the other.
`FILTERS` has them by name.
"""

from __future__ import annotations

from neuro.core.registry import Registry
from neuro.events.filters._filter import Filter, FilterError, Sieve, complete
from neuro.events.filters.background import BackgroundActivity
from neuro.events.filters.chain import Chain, chain
from neuro.events.filters.crop import Crop
from neuro.events.filters.downsample import Downsample
from neuro.events.filters.flip import Flip
from neuro.events.filters.hot import HotPixels, hot_pixels
from neuro.events.filters.jitter import Jitter
from neuro.events.filters.noise import ShotNoise
from neuro.events.filters.polarity import Polarity
from neuro.events.filters.refractory import Refractory
from neuro.events.filters.reverse import Reverse
from neuro.events.filters.rotate import Rotate90
from neuro.events.filters.scale import Scale
from neuro.events.filters.shift import Shift
from neuro.events.filters.surfaces import TARSurfaces
from neuro.events.filters.tar import TAR
from neuro.events.filters.transpose import Transpose

FILTERS: Registry[type[Filter]] = Registry(
    "filter",
    (
        BackgroundActivity,
        Crop,
        Downsample,
        Flip,
        HotPixels,
        Jitter,
        ShotNoise,
        Polarity,
        Refractory,
        Reverse,
        Rotate90,
        Scale,
        Shift,
        TAR,
        TARSurfaces,
        Transpose,
    ),
    takes=lambda part: isinstance(part, type) and issubclass(part, Filter),
    group="neuro.filters",
    complete=complete,
)
"""All filters by a short name, for command lines; their parameters are the fields of the class."""

__all__ = [
    "FILTERS",
    "TAR",
    "BackgroundActivity",
    "Chain",
    "Crop",
    "Downsample",
    "Filter",
    "FilterError",
    "Flip",
    "HotPixels",
    "Jitter",
    "Polarity",
    "Refractory",
    "Reverse",
    "Rotate90",
    "Scale",
    "Shift",
    "ShotNoise",
    "Sieve",
    "TARSurfaces",
    "Transpose",
    "chain",
    "hot_pixels",
]
