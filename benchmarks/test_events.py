"""Passes over events on one core: filters, segments and representations, in million events a second.

Filters get 5 million events on a 346x260 sensor, in parts of 0.2 s as from a stream. Other passes get a dense
recording.
"""

import numpy as np
import pytest

from neuro.events import Events
from neuro.events.filters import (
    TAR,
    BackgroundActivity,
    Crop,
    Downsample,
    Filter,
    Flip,
    HotPixels,
    Jitter,
    Polarity,
    Refractory,
    Reverse,
    Rotate90,
    Scale,
    Shift,
    ShotNoise,
    TARSurfaces,
    Transpose,
    chain,
)  # fmt: skip
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

SIZE = (346, 260)
COUNT = 5_000_000
FILTERS: dict[str, tuple[Filter, int]] = {
    "TAR, R = 1": (TAR(SIZE), 5),
    "TAR, R = 2": (TAR(SIZE, radius=2), 0),
    "TAR surfaces, R = 1": (TARSurfaces(SIZE), 0),
    "background activity": (BackgroundActivity(SIZE), 10),
    "refractory": (Refractory(SIZE), 10),
    "hot pixels": (HotPixels(SIZE, [(k, k) for k in range(100)]), 10),
    "polarity": (Polarity(SIZE), 10),
    "crop": (Crop(SIZE, x=(40, 300), y=(20, 200)), 10),
    "downsample": (Downsample(SIZE, 2), 10),
    "downsample, integrated": (Downsample(SIZE, 2, 4), 10),
    "shift": (Shift(SIZE, 1000), 10),
    "scale": (Scale(SIZE, 1.5), 10),
    "reverse": (Reverse(SIZE), 10),
    "jitter of 100 us": (Jitter(SIZE), 10),
    "jitter of 10 ms": (Jitter(SIZE, 10_000), 10),
    "flip": (Flip(SIZE), 10),
    "rotate": (Rotate90(SIZE), 10),
    "transpose": (Transpose(SIZE), 10),
    "noise of 1 Hz": (ShotNoise(SIZE, 1.0), 10),
    "chain of three": (chain(HotPixels(SIZE), BackgroundActivity(SIZE), Refractory(SIZE)), 0),
}


@pytest.fixture(scope="module")
def moving():
    """Return a million events per second of blobs that cross the picture on straight lines. A tenth is noise."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(0, 5_000_000, COUNT))
    blob = rng.integers(0, 8, COUNT)
    start = rng.uniform(0.0, 1.0, (8, 2))
    place = (start[blob] + t[:, None] * 1e-7 * (1 + blob[:, None])) % 1.0 * SIZE + rng.normal(0.0, 6.0, (COUNT, 2))
    noise = rng.random(COUNT) < 0.1
    place[noise] = rng.uniform(0.0, 1.0, (int(noise.sum()), 2)) * SIZE
    x, y = (np.clip(place[:, k], 0, SIZE[k] - 1).astype(np.uint16) for k in range(2))
    return Events(t, x, y, rng.integers(0, 2, COUNT), SIZE)


@pytest.mark.parametrize("name", FILTERS)
def test_filter(least_cpu, figure, moving, name):
    made, aim = FILTERS[name]
    parts = [moving.between(k, k + 200_000) for k in range(0, 5_000_000, 200_000)]

    def run():
        for _ in made.stream(parts):
            pass

    run()
    figure(f"filter: {name}", COUNT / least_cpu(run, 4) * 1e-6, "M events/s", f"at least {aim}" if aim else "")


EVENTS = 4_000_000
SCENE = (640, 480)
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
def busy():
    """Return the events of a second of a busy scene, with wandering edges and noise."""
    rng = np.random.default_rng(0)
    t = np.sort(rng.integers(0, US, EVENTS))
    x = (200 + 150 * np.sin(t / 2e5) + rng.normal(0, 40, EVENTS)).clip(0, SCENE[0] - 1).astype(np.uint16)
    y = rng.integers(0, SCENE[1], EVENTS)
    return Events(t, x, y, rng.integers(0, 2, EVENTS), SCENE)


@pytest.mark.parametrize("what", SEGMENTS)
def test_segments(what, benchmark, figure, busy):
    SEGMENTS[what](busy.t[:1000])
    benchmark.pedantic(SEGMENTS[what], args=(busy.t,), rounds=5)
    figure(what, EVENTS / benchmark.stats.stats.min / 1e6, "M events/s")


@pytest.mark.parametrize("what", ARRAYS)
def test_arrays(what, benchmark, figure, busy):
    ARRAYS[what](busy)
    benchmark.pedantic(ARRAYS[what], args=(busy,), rounds=3)
    figure(what, EVENTS / benchmark.stats.stats.min / 1e6, "M events/s")
