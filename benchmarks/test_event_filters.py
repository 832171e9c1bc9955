"""Filters of events: 5 million on a 346x260 sensor, one core, in parts of 0.2 s as a stream gives them."""

import time

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
    """Blobs on straight ways through the picture, a million events a second, and a tenth of them noise."""
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
def test_filter(benchmark, figure, moving, name):
    made, aim = FILTERS[name]
    parts = [moving.between(k, k + 200_000) for k in range(0, 5_000_000, 200_000)]

    taken = []

    def run():
        began = time.process_time()
        for _ in made.stream(parts):
            pass
        taken.append(time.process_time() - began)

    run()
    benchmark.pedantic(run, rounds=4)
    figure(f"filter: {name}", COUNT / min(taken) * 1e-6, "M events/s", f"at least {aim}" if aim else "")
