"""Frames, voxel grids, spike tensors, surfaces and HATS: against their definitions, and what always holds."""

import sys
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from event_tests import random_events
from neuro.core.extras import install
from neuro.events import Events, load
from neuro.events.representations import (
    Hats,
    LeakySurface,
    TimeSurface,
    binary_frame,
    event_frame,
    event_spike_tensor,
    hats,
    leaky_surface,
    time_surface,
    voxel_grid,
)

WIDTH, HEIGHT = 7, 5
EVENT = st.tuples(st.integers(0, 30), st.integers(0, WIDTH - 1), st.integers(0, HEIGHT - 1), st.integers(0, 1))


def recording(rows, shift=0):
    steps, x, y, p = np.array(rows, np.int64).reshape(-1, 4).T
    return Events(np.cumsum(steps) + shift, x, y, p, (WIDTH, HEIGHT))


RECORDINGS = st.lists(EVENT, max_size=60).map(recording)
F8 = {"dtype": np.float64}
ALL = {
    "event_frame": event_frame, "binary_frame": binary_frame, "voxel_grid": partial(voxel_grid, bins=4, **F8),
    "event_spike_tensor": partial(event_spike_tensor, bins=4, **F8),
    "time_surface": partial(time_surface, tau_us=40, **F8),
    "leaky_surface": partial(leaky_surface, tau_us=40, decay="linear", **F8),
    "hats": partial(hats, cell=3, radius=1, tau_us=40, window_us=50, **F8)
}  # fmt: skip


def spread_literal(events, bins, start, stop, value):
    out = np.zeros((2, bins, *events.sensor_size[::-1]))
    for t, x, y, p in zip(events.t, events.x, events.y, events.p, strict=True):
        if start <= t <= stop:
            place = (bins - 1) * (t - start) / max(stop - start, 1)
            weights = np.maximum(0, 1 - np.abs(place - np.arange(bins)))
            out[p, :, y, x] += weights * value((t - start) / max(stop - start, 1), p)
    return out


def hats_literal(events, cell, radius, window, tau, itself):
    width, height = events.sensor_size
    size = 2 * radius + 1
    sums = np.zeros((-(-height // cell), -(-width // cell), 2, size, size))
    counts = np.zeros(sums.shape[:3], int)
    t, x, y, p = (a.astype(int) for a in (events.t, events.x, events.y, events.p))
    for i in range(len(t)):
        at = (y[i] // cell, x[i] // cell, p[i])
        counts[at] += 1
        sums[at][radius, radius] += itself
        dx, dy = x[:i] - x[i], y[:i] - y[i]
        near = (np.abs(dx) <= radius) & (np.abs(dy) <= radius) & (p[:i] == p[i]) & (t[i] - t[:i] <= window)
        near &= (x[:i] // cell == at[1]) & (y[:i] // cell == at[0])
        np.add.at(sums[at], (dy[near] + radius, dx[near] + radius), np.exp((t[:i][near] - t[i]) / tau))
    return sums, counts


def test_a_frame_by_hand():
    events = Events([1, 2, 3, 4], [0, 0, 2, 0], [1, 1, 0, 1], [1, 0, 0, 1], (3, 2))
    assert event_frame(events).tolist() == [[[0, 0, 1], [1, 0, 0]], [[0, 0, 0], [2, 0, 0]]]
    assert event_frame(events, polarity="signed").tolist() == [[0, 0, -1], [1, 0, 0]]
    assert event_frame(events, polarity="ignored").tolist() == [[0, 0, 1], [3, 0, 0]]
    assert event_frame(events).dtype == np.int32
    assert binary_frame(events).tolist() == [[False, False, True], [True, False, False]]
    assert binary_frame(events, polarity="separate")[1].tolist() == [[False, False, False], [True, False, False]]


def test_frames_of_segments():
    events, bounds = random_events(500, (31, 22)), np.array([0, 10, 10, 300, 500])
    frames = event_frame(events, segments=bounds)
    assert frames.shape == (4, 2, 22, 31)
    for frame, first, last in zip(frames, bounds[:-1], bounds[1:], strict=True):
        assert np.array_equal(frame, event_frame(events[first:last]))
    overlapping = binary_frame(events, segments=[[0, 300], [200, 500]])
    assert np.array_equal(overlapping[1], binary_frame(events[200:500]))
    assert event_frame(events, segments=[0], polarity="signed").shape == (0, 22, 31)


@given(events=RECORDINGS, cut=st.integers(0, 60))
@settings(max_examples=30)
def test_parts_add_up(events, cut):
    parts = (events[:cut], events[cut:])
    assert np.array_equal(sum(event_frame(part) for part in parts), event_frame(events))
    assert np.array_equal(np.any([binary_frame(part) for part in parts], axis=0), binary_frame(events))
    start, stop = (int(events.t[0]), int(events.t[-1])) if len(events) else (0, 0)
    for function in (voxel_grid, event_spike_tensor):
        options = {"start_us": start, "stop_us": stop, "dtype": np.float64}
        whole = function(events, 5, **options)
        assert sum(function(part, 5, **options) for part in parts) == pytest.approx(whole, abs=1e-12)


@pytest.mark.parametrize("name", ALL)
@given(rows=st.lists(EVENT, max_size=40), shift=st.integers(-(2**60), 2**60))
@settings(max_examples=30)
def test_the_origin_of_time_does_not_matter(name, rows, shift):
    assert np.array_equal(ALL[name](recording(rows, shift)), ALL[name](recording(rows)))


@pytest.mark.parametrize("name", ALL)
def test_no_events_make_zeros(name):
    found = ALL[name](recording([]))
    assert found.size >= WIDTH * HEIGHT
    assert not found.any()


@pytest.mark.parametrize("bins", [1, 2, 5])
def test_voxels_are_as_the_definition(bins):
    events = random_events(300, (31, 22))
    start, stop = int(events.t[0]), int(events.t[-1])
    ones = spread_literal(events, bins, start, stop, lambda t, p: 1)
    assert voxel_grid(events, bins, polarity="separate", dtype=np.float64) == pytest.approx(ones, abs=1e-12)
    assert voxel_grid(events, bins) == pytest.approx(ones[1] - ones[0], abs=1e-5)
    assert voxel_grid(events, bins).dtype == np.float32
    part = spread_literal(events, bins, 50_000, 120_001, lambda t, p: 1)
    found = voxel_grid(events, bins, start_us=50_000, stop_us=120_001, polarity="ignored", dtype=np.float64)
    assert found == pytest.approx(part.sum(0), abs=1e-12)


def test_voxels_by_hand():
    events = Events([0, 10, 40], [0, 0, 0], [0, 0, 0], [1, 1, 0], (1, 1))
    assert voxel_grid(events, 3).ravel().tolist() == [1.5, 0.5, -1.0]
    assert voxel_grid(events[:1], 3).ravel().tolist() == [1.0, 0.0, 0.0]
    assert event_spike_tensor(events, 3).ravel().tolist() == [0.0, 0.0, 1.0, 0.125, 0.125, 0.0]


@pytest.mark.parametrize(
    ("measurement", "value"), [("time", lambda t, p: t), ("polarity", lambda t, p: 2 * int(p) - 1)]
)
def test_spike_tensor_is_as_the_definition(measurement, value):
    events = random_events(300, (31, 22))
    expected = spread_literal(events, 9, int(events.t[0]), int(events.t[-1]), value)
    assert event_spike_tensor(events, measurement=measurement) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("itself", [False, True])
@pytest.mark.parametrize(("cell", "radius", "tau", "window"), [(10, 3, 1e9, 20_000), (4, 1, 300.0, 900), (8, 9, 1, 9)])
def test_hats_is_as_the_definition(itself, cell, radius, tau, window):
    events = random_events(2000, (31, 22), length=40_000)
    sums, counts = hats_literal(events, cell, radius, window, tau, itself)
    options = {"cell": cell, "radius": radius, "window_us": window, "tau_us": tau, "itself": itself}
    found = {n: hats(events, normalise=n, dtype=np.float64, **options) for n in ("none", "cell", "polarity")}
    assert found["none"] == pytest.approx(sums, rel=1e-9, abs=1e-12)
    assert found["cell"] == pytest.approx(sums / np.maximum(counts.sum(2), 1)[:, :, None, None, None], rel=1e-9)
    assert found["polarity"] == pytest.approx(sums / np.maximum(counts, 1)[..., None, None], rel=1e-9)
    assert sums.any()


def test_hats_forgets_to_exactly_nothing():
    t = np.append(np.cumsum(np.random.default_rng(0).integers(1, 9, 40)), 10_000)
    events = Events(t, np.arange(41) % 2, [0] * 41, [1] * 41, (2, 1))
    options = {"cell": 2, "radius": 1, "window_us": 100, "tau_us": 37.0, "normalise": "none", "dtype": np.float64}
    assert np.array_equal(hats(events, **options), hats(events[:40], **options))


@given(
    cuts=st.lists(st.integers(0, 600), max_size=40),
    window=st.sampled_from([1, 90, 900, 60_000]),
    tau=st.sampled_from([20.0, 5_000.0]),
)
@settings(max_examples=30)
def test_hats_grow_to_the_same_bits_however_the_recording_is_cut(cuts, window, tau):
    events = random_events(600, (31, 22), length=20_000)
    options = {"cell": 4, "radius": 2, "window_us": window, "tau_us": tau, "itself": True}
    grown = Hats(events.sensor_size, **options)
    for begin, end in pairwise([0, *sorted(cuts), 600]):
        grown.add(events[begin:end])
        expected = hats(events[:end], dtype=np.float64, **options)
        assert np.array_equal(grown.histograms(np.float64), expected)


def test_hats_hold_no_more_than_their_window():
    grown = Hats((8, 8), cell=4, window_us=1000)
    for part in range(50):
        grown.add(Events(np.arange(100) * 10 + part * 1000, np.arange(100) % 8, [3] * 100, [1] * 100, (8, 8)))
    grown.add(Events([60_000], [0], [0], [1], (8, 8)))
    assert len(grown._held) <= 102
    grown.add(Events([90_000], [0], [0], [1], (8, 8)))
    assert len(grown._held) == 2


def test_torch_gets_each_representation(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(from_numpy=lambda array: ("tensor", array)))
    for function in ALL.values():
        kind, array = function(random_events(50, (31, 22)), as_torch=True)
        assert (kind, type(array)) == ("tensor", np.ndarray)


def test_a_real_recording(shared):
    events = load(shared / "data/formats/ncaltech101_faces_easy_0001.bin")
    frame = event_frame(events)
    assert (frame.sum(), frame[1].sum(), hats(events).shape[2:]) == (67445, 33770, (2, 7, 7))
    assert voxel_grid(events, 5, polarity="ignored", dtype=np.float64).sum() == pytest.approx(67445, rel=1e-12)


def test_torch_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    for function in ALL.values():
        assert isinstance(function(recording([])), np.ndarray)
    with pytest.raises(ValueError, match="as_torch=True: torch is not installed") as error:
        event_frame(recording([]), as_torch=True)
    assert str(error.value) == f"as_torch=True: torch is not installed\n  hint: {install('torch')}"


def test_a_voxel_grid_over_all_of_int64():
    events = Events([-1 << 63, 0, (1 << 63) - 1], [0, 1, 0], [0, 0, 1], [1, 0, 1], (2, 2))
    expected = np.zeros((3, 2, 2))
    expected[0, 0, 0], expected[1, 0, 1], expected[2, 1, 0] = 1, -1, 1
    assert np.allclose(voxel_grid(events, 3), expected)


def test_hats_forgets_over_all_of_int64():
    assert not hats(Events([-1 << 63, (1 << 63) - 1], [0, 0], [0, 0], [1, 1], (2, 2))).any()


# surfaces

DECAYS = {
    "exponential": lambda u, dt, tau: u * np.exp(-dt / tau),
    "linear": lambda u, dt, tau: np.maximum(0, u - dt / tau),
}


def algorithm_15(events, tau, decay, at, order, separate=True, increment=1.0):
    """The whole frame at every event, as the thesis prints it."""
    u = np.zeros((1 + separate, HEIGHT, WIDTH))
    before = events.t[0] if len(events) else at
    for t, x, y, p in zip(events.t, events.x, events.y, events.p, strict=True):
        if order == "decay_first":
            u = DECAYS[decay](u, t - before, tau)
        u[p if separate else 0, y, x] += increment
        if order == "increment_first":
            u = DECAYS[decay](u, t - before, tau)
        before = t
    return DECAYS[decay](u, at - before, tau)


def last_times(events, at, decay, tau):
    out = np.zeros((2, HEIGHT, WIDTH))
    for t, x, y, p in zip(events.t, events.x, events.y, events.p, strict=True):
        out[p, y, x] = DECAYS[decay](1.0, at - t, tau)
    return out


@pytest.mark.parametrize("decay", DECAYS)
@pytest.mark.parametrize("order", ["decay_first", "increment_first"])
@given(events=RECORDINGS, later=st.integers(0, 100))
@settings(max_examples=25)
def test_leaky_surface_is_algorithm_15(decay, order, events, later):
    at = (int(events.t[-1]) if len(events) else 0) + later
    found = leaky_surface(events, tau_us=50, at_us=at, decay=decay, order=order, **F8)
    assert found == pytest.approx(algorithm_15(events, 50.0, decay, at, order), abs=1e-12)
    words = {"tau_us": 50, "at_us": at, "decay": decay, "order": order, "polarity": "ignored", "increment": 2.5}
    one = algorithm_15(events, 50.0, decay, at, order, separate=False, increment=2.5)[0]
    assert leaky_surface(events, **words, **F8) == pytest.approx(one, abs=1e-12)


@pytest.mark.parametrize("decay", DECAYS)
@given(events=RECORDINGS, later=st.integers(0, 100))
@settings(max_examples=25)
def test_time_surface_is_as_the_definition(decay, events, later):
    at = (int(events.t[-1]) if len(events) else 0) + later
    found = time_surface(events, tau_us=50, at_us=at, decay=decay, **F8)
    assert found == pytest.approx(last_times(events, at, decay, 50.0), abs=1e-14)
    assert np.array_equal(
        time_surface(events, tau_us=50, at_us=at, decay=decay, polarity="ignored", **F8), found.max(axis=0)
    )


@pytest.mark.parametrize("surface", [time_surface, leaky_surface])
@given(events=RECORDINGS, at=st.lists(st.integers(-10, 1200), max_size=5).map(sorted), inclusive=st.booleans())
@settings(max_examples=25)
def test_one_pass_gives_every_time(surface, events, at, inclusive):
    many = surface(events, tau_us=50, at_us=np.array(at, int), inclusive=inclusive)
    assert (many.shape, many.dtype) == ((len(at), 2, HEIGHT, WIDTH), np.float32)
    for when, found in zip(at, many, strict=True):
        before = events[: np.searchsorted(events.t, when, side="right" if inclusive else "left")]
        assert np.array_equal(found, surface(before, tau_us=50, at_us=when))


@pytest.mark.parametrize("kind", [TimeSurface, LeakySurface])
@given(events=RECORDINGS, data=st.data())
@settings(max_examples=25)
def test_any_cutting_into_parts_gives_the_same_surface(kind, events, data):
    cuts = sorted(data.draw(st.lists(st.integers(0, len(events)), max_size=5)))
    options = {"tau_us": 50, "decay": data.draw(st.sampled_from(sorted(DECAYS)))}
    if kind is LeakySurface:
        options["order"] = data.draw(st.sampled_from(["decay_first", "increment_first"]))
    whole, parts = kind((WIDTH, HEIGHT), **options), kind((WIDTH, HEIGHT), **options)
    whole.add(events)
    for first, last in zip([0, *cuts], [*cuts, len(events)], strict=True):
        parts.add(events[first:last])
        parts.at(int(events.t[last - 1]) if last else 0)  # reading changes nothing
    assert np.array_equal(parts.at(2000), whole.at(2000))


def test_times_over_all_of_int64():
    """What lies 2^63 us and more back is forgotten, and not in the future."""
    last = (1 << 63) - 1
    events = Events([-1 << 63, 0, last], [0, 1, 0], [0, 0, 1], [1, 0, 1], (2, 2))
    for surface in (time_surface, leaky_surface):
        for decay in ("exponential", "linear"):
            found = surface(events, tau_us=1e6, decay=decay)
            assert (np.argwhere(found).tolist(), found[1, 1, 0]) == ([[1, 1, 0]], 1)
