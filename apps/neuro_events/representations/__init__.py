"""Representations of events as arrays, for networks and other programs.

| function | shape, type | values |
| --- | --- | --- |
| `event_frame` | ([segments,] [2,] height, width) int32 | number of events |
| `binary_frame` | ([segments,] [2,] height, width) bool | True for pixels with an event |
| `time_surface` | ([times,] [2,] height, width) float32 | decayed age of the last event |
| `leaky_surface` | ([times,] [2,] height, width) float32 | leaky sum of events |
| `voxel_grid` | ([2,] bins, height, width) float32 | signed sum of events by time bin and pixel |
| `event_spike_tensor` | (2, bins, height, width) float32 | sum of a measurement by polarity, time bin and pixel |
| `hats` | (rows, columns, 2, size, size) float32 | averaged time surfaces of cells |

An axis of size 2 is the polarity: 0 = OFF, 1 = ON. Row 0 is at the top. `polarity` selects the treatment of polarity:
``"separate"`` (an axis of size 2), ``"signed"`` (ON counts +1, OFF -1) or ``"ignored"``.
With ``as_torch=True`` the result is a torch tensor that shares the array's memory.
Without events all values are 0. Times are relative to the recording, so a shift of all times changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from neuro.apps import Registry
from neuro_events.representations.frames import binary_frame, event_frame, event_spike_tensor, voxel_grid
from neuro_events.representations.surfaces import Hats, LeakySurface, TimeSurface, hats, leaky_surface, time_surface

REPRESENTATIONS: Registry[Callable[..., Any]] = Registry(
    "representation",
    (event_frame, binary_frame, time_surface, leaky_surface, voxel_grid, event_spike_tensor, hats),
    group="neuro.representations",
)
"""Representations by name: functions from ``Events`` and keyword parameters to an array."""

__all__ = [
    "REPRESENTATIONS",
    "Hats",
    "LeakySurface",
    "TimeSurface",
    "binary_frame",
    "event_frame",
    "event_spike_tensor",
    "hats",
    "leaky_surface",
    "time_surface",
    "voxel_grid",
]
