"""Filters of events: noise out, noise in, parts of the sensor, other times and places.

A filter is made for a sensor size with its parameters, called with a recording or part after part of one, and goes on
where it was: cut anywhere, the parts give what the whole gives. `chain` puts filters one behind the other.
`FILTERS` has them by name.
"""

from __future__ import annotations

from neuro.core.registry import Registry
from neuro.events.filters._filter import Chain, Filter, FilterError, Sieve, chain, complete
from neuro.events.filters.noise import BackgroundActivity, HotPixels, Polarity, Refractory, ShotNoise, hot_pixels
from neuro.events.filters.places import Crop, Downsample, Flip, Rotate90, Transpose
from neuro.events.filters.tar import TAR, TARSurfaces
from neuro.events.filters.times import Jitter, Reverse, Scale, Shift

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
