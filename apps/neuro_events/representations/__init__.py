"""Events as arrays: what networks and other programs take in.

| function | shape, type | holds |
| --- | --- | --- |
| `event_frame` | ([segments,] [2,] height, width) int32 | how many events |
| `binary_frame` | ([segments,] [2,] height, width) bool | whether there was an event |
| `time_surface` | ([times,] [2,] height, width) float32 | how long ago the last event was |
| `leaky_surface` | ([times,] [2,] height, width) float32 | events that are forgotten by and by |
| `voxel_grid` | ([2,] bins, height, width) float32 | events by place and time, signed |
| `event_spike_tensor` | (2, bins, height, width) float32 | what events measure, by polarity, time and place |
| `hats` | (rows, columns, 2, size, size) float32 | averaged time surfaces of cells |

An axis of 2 is the polarity: 0 = OFF, 1 = ON. Rows grow downwards. `polarity` says what becomes of it:
``"separate"`` (the axis of 2), ``"signed"`` (ON counts +1, OFF -1) or ``"ignored"``.
With ``as_torch=True`` the result is a torch tensor that shares the array's memory.
Without events all is 0. Times count from the recording's own, so that shifting all of them changes nothing.
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
"""All representations by name: functions of `Events` and named parameters that give an array."""

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
