"""Filters of events: remove or add noise, select part of the sensor, change times and positions.

A filter is created for a sensor size and parameters, and called with a recording or with consecutive parts.
The state carries over, so the output does not depend on how the recording is divided into parts. `chain` applies
filters in sequence. `FILTERS` lists the filters by name.
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
"""Filters by their short names on the command line. The parameters of a filter are the fields of its class."""

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
