"""Where a recording is cut into parts: by the clock, by count, or where the motion is.

| method | a segment ends | thesis |
| --- | --- | --- |
| `time_segments`, `TimeWindows` | after a fixed time | hard segmentation (HES) |
| `count_segments`, `Counts` | after a fixed number of events | hard segmentation (HES) |
| `msd_segments`, `MSD` | when a leaky neuron reaches its threshold | soft segmentation (SES), ReMuS |
| `peak_segments`, `Peaks` | where a leaky neuron's potential peaks | soft segmentation (SES), EDHMAX |

The functions give the bounds of a whole recording: segment i is ``events[bounds[i]:bounds[i + 1]]``. The classes
are the same with a memory: `segmented` cuts a recording with them that comes in parts, and gives the same segments.

Source: thesis sections 3.3 (lines 875-890) and 6.1.1 (lines 2165-2176).
"""

from __future__ import annotations

from collections.abc import Callable

from neuro.core.registry import Registry
from neuro.events.segmentation.cutters import (
    MSD,
    Counts,
    Cutter,
    Peaks,
    Times,
    TimeWindows,
    count_segments,
    msd_segments,
    peak_segments,
    segmented,
    time_segments,
)

SEGMENTERS: Registry[Callable[..., Times]] = Registry(
    "segmenter",
    (time_segments, count_segments, msd_segments, peak_segments),
    group="neuro.segmenters",
)
"""All segmenters by name: functions of times, us, and named parameters that give the bounds of segments."""

__all__ = [
    "MSD",
    "SEGMENTERS",
    "Counts",
    "Cutter",
    "Peaks",
    "TimeWindows",
    "count_segments",
    "msd_segments",
    "peak_segments",
    "segmented",
    "time_segments",
]
