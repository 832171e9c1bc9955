"""Segments and representations of a dense recording: one pass over the events each, in million events a second."""

import numpy as np
import pytest

from neuro.events import Events
from neuro.events.representations import (
    binary_frame,
    event_frame,
    event_spike_tensor,
    hats,
    leaky_surface,
    time_surface,
    voxel_grid,
)
from neuro.events.segmentation import count_segments, msd_segments, peak_segments, time_segments

EVENTS = 4_000_000
SIZE = (640, 480)
US = 1_000_000

SEGMENTS = {
    "time_segments, 10 ms": lambda t: time_segments(t, 10_000),
    "count_segments, 10 000": lambda t: count_segments(t, 10_000),
    "msd_segments": lambda t: msd_segments(t, threshold=50_000.0),
    "peak_segments, 5 ms": lambda t: peak_segments(t, 5000),
}
ARRAYS = {
    "event_frame": event_frame,
    "event_frame, 100 segments": lambda e: event_frame(e, segments=np.arange(101) * (EVENTS // 100)),
    "binary_frame": binary_frame,
    "time_surface": lambda e: time_surface(e, tau_us=30_000),
    "time_surface, 100 times": lambda e: time_surface(e, tau_us=30_000, at_us=np.arange(1, 101) * (US // 100)),
    "leaky_surface": lambda e: leaky_surface(e, tau_us=30_000),
    "leaky_surface, linear": lambda e: leaky_surface(e, tau_us=30_000, decay="linear"),
    "voxel_grid, 5 bins": lambda e: voxel_grid(e, 5),
    "event_spike_tensor, 9 bins": event_spike_tensor,
    "hats": hats,
}


@pytest.fixture(scope="module")
def events():
    """A second of a busy scene: edges that wander, and noise."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, US, EVENTS))
    x = (200 + 150 * np.sin(t / 2e5) + rng.normal(0, 40, EVENTS)).clip(0, SIZE[0] - 1).astype(np.uint16)
    y = rng.integers(0, SIZE[1], EVENTS)
    return Events(t, x, y, rng.integers(0, 2, EVENTS), SIZE)


@pytest.mark.parametrize("what", SEGMENTS)
def test_segments(what, benchmark, figure, events):
    SEGMENTS[what](events.t[:1000])
    benchmark.pedantic(SEGMENTS[what], args=(events.t,), rounds=5)
    figure(what, EVENTS / benchmark.stats.stats.min / 1e6, "M events/s", "")


@pytest.mark.parametrize("what", ARRAYS)
def test_arrays(what, benchmark, figure, events):
    ARRAYS[what](events)
    benchmark.pedantic(ARRAYS[what], args=(events,), rounds=3)
    figure(what, EVENTS / benchmark.stats.stats.min / 1e6, "M events/s", "")
