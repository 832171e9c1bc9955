"""Filters of events: noise out, noise in, parts of the sensor, other times and places.

A filter is made for a sensor size with its parameters, called with a recording or part after part of one, and goes on
where it was: cut anywhere, the parts give what the whole gives. `chain` puts filters one behind the other.
`FILTERS` has them by name.
"""

from __future__ import annotations

from neuro.apps import Registry
from neuro_events.filters._filter import Chain, Filter, FilterError, Sieve, chain, complete
from neuro_events.filters.noise import (
    TAR,
    BackgroundActivity,
    HotPixels,
    Polarity,
    Refractory,
    ShotNoise,
    TARSurfaces,
    hot_pixels,
)
from neuro_events.filters.places import Crop, Downsample, Flip, Jitter, Reverse, Rotate90, Scale, Shift, Transpose

NOISE = (BackgroundActivity, HotPixels, Polarity, Refractory, ShotNoise, TAR, TARSurfaces)
MOVES = (Crop, Downsample, Flip, Jitter, Reverse, Rotate90, Scale, Shift, Transpose)

FILTERS: Registry[type[Filter]] = Registry(
    "filter",
    tuple(sorted((*NOISE, *MOVES), key=lambda kind: kind.called())),
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
