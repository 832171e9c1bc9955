"""The same arrays as tonic makes, where it makes the same representation.

`golden/tonic.json` holds what tonic 1.7.0 gave for the recording below; where tonic is installed, a larger one is
compared with it live. Two things of tonic's are not copied: its voxel grid leaves out what falls behind the last bin,
and reads every event as ON if the polarity is of type bool, as its own readers give it.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from neuro.events import Events
from neuro.events.representations import event_frame, hats, time_surface, voxel_grid
from neuro.events.segmentation import count_segments, time_segments

GOLDEN = json.loads((Path(__file__).parent / "golden" / "tonic.json").read_text())
F8 = {"dtype": np.float64}


def small():
    k = np.arange(60)
    t, x, y, p = 1000 + 37 * k + k * k % 11, k * k % 4, (k * 7 + k // 5) % 3, k * k * k // 3 % 2
    return Events(t, x, y, p, (4, 3))


def ours(events, window, count, bins, dt, tau, cell, size, memory):
    n = int(events.t[-1] - events.t[0]) // dt
    ends = events.t[0] + dt * np.arange(1, n + 1)
    averaged = hats(
        events, cell=cell, radius=size // 2, window_us=memory, tau_us=tau, itself=True, normalise="polarity", **F8
    )
    return {
        "frames by time": event_frame(events, segments=time_segments(events.t, window)),
        "frames by count": event_frame(events, segments=count_segments(events.t, count)),
        "voxel grid": voxel_grid(events, bins + 1, **F8)[:-1],
        "time surface": time_surface(events, tau_us=tau, at_us=ends, inclusive=False, **F8),
        "averaged time surface": averaged.reshape(-1, 2, size, size),
    }


@pytest.mark.parametrize("what", list(GOLDEN)[1:])
def test_as_tonic_gave_it(what):
    found = ours(small(), window=500, count=25, bins=3, dt=700, tau=300, cell=3, size=3, memory=400)[what]
    expected = np.array(GOLDEN[what])
    assert found.shape == expected.shape
    assert expected.any()
    tolerance = 1e-6 if what == "averaged time surface" else 1e-11  # tonic's is in float32
    assert found == pytest.approx(expected, rel=tolerance, abs=tolerance)


def test_live():
    transforms = pytest.importorskip("tonic.transforms", reason="tonic is not installed")
    rng = np.random.default_rng(0)
    n, sensor = 5000, (40, 33, 2)
    events = Events(np.sort(rng.integers(10**6, 2 * 10**6, n)), *(rng.integers(0, m, n) for m in sensor), sensor[:2])
    records = np.zeros(n, [("t", "i8"), ("x", "i4"), ("y", "i4"), ("p", "i1")])
    for name in "txyp":
        records[name] = getattr(events, name)
    found = ours(events, window=9000, count=70, bins=8, dt=9000, tau=5000, cell=10, size=7, memory=50_000)
    averaged = transforms.ToAveragedTimesurface(
        sensor, cell_size=10, surface_size=7, time_window=50_000, tau=5000, decay="exp"
    )
    expected = {
        "frames by time": transforms.ToFrame(sensor, time_window=9000)(records.copy()),
        "frames by count": transforms.ToFrame(sensor, event_count=70)(records.copy()),
        "voxel grid": transforms.ToVoxelGrid(sensor, n_time_bins=8)(records.copy())[:, 0],
        "time surface": transforms.ToTimesurface(sensor, dt=9000, tau=5000)(records.copy()),
        "averaged time surface": averaged(records.copy()),
    }
    for what, array in expected.items():
        assert found[what] == pytest.approx(np.asarray(array), rel=1e-5, abs=1e-6), what
