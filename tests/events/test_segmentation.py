from itertools import pairwise

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from neuro.events import Events, load, msd_segments
from neuro.events.segmentation import (
    MSD,
    Counts,
    Peaks,
    TimeWindows,
    count_segments,
    peak_segments,
    segmented,
    time_segments,
)

METHODS = {
    "time": (lambda: TimeWindows(70), lambda t, rest: time_segments(t, 70, rest=rest)),
    "count": (lambda: Counts(7), lambda t, rest: count_segments(t, 7, rest=rest)),
    "msd": (lambda: MSD(1e-4, 4.0), lambda t, rest: msd_segments(t, tau=1e-4, threshold=4.0, rest=rest)),
    "peaks": (lambda: Peaks(60, tau_us=50), lambda t, rest: peak_segments(t, 60, tau_us=50, rest=rest)),
}
TIMES = st.lists(st.integers(0, 40), max_size=120).map(lambda steps: np.cumsum(np.array(steps, np.int64)))


def msd_literal(t, tau, threshold):
    bounds, v, last = [0], 0.0, t[0] if len(t) else 0
    for k, now in enumerate(t):
        v, last = v * np.exp((last - now) * 1e-6 / tau) + 1.0, now
        if v >= threshold:
            bounds.append(k + 1)
            v = 0.0
    return bounds


def peaks_literal(t, search, tau, rise, threshold):
    grid = np.linspace(0, 10 * tau, 200_001)
    kernel = lambda s: np.exp(-s / tau) - (np.exp(-s / rise) if rise else 0.0)  # noqa: E731
    highest = kernel(grid).max()
    v = np.array([kernel(now - t[: k + 1]).sum() for k, now in enumerate(t)]) / highest
    near, order = np.abs(t[:, None] - t[None, :]) <= search, np.arange(len(t))
    after, before = near & (order[None, :] > order[:, None]), near & (order[None, :] < order[:, None])
    top = (v > np.where(before, v, -1).max(1)) & (v >= np.where(after, v, -1).max(1)) & (v > threshold)
    return [0, *(np.flatnonzero(top) + 1)]


def recording(t):
    zero = np.zeros(len(t), int)
    return Events(t, zero, zero, zero, (1, 1))


def test_without_leak_it_counts():
    assert msd_segments(np.zeros(32, np.int64), threshold=10.0).tolist() == [0, 10, 20, 30]


def test_slow_events_make_no_segment():
    assert msd_segments(np.arange(100) * 20_000, tau=0.02, threshold=2.0).tolist() == [0]


def test_as_the_definition():
    t = np.cumsum(np.random.default_rng(0).integers(0, 300, 5000))
    assert msd_segments(t).tolist() == msd_literal(t, 0.02, 150.0)
    assert msd_segments(np.array([], np.int64)).tolist() == [0]
    assert msd_segments(t - 10**15).tolist() == msd_segments(t).tolist()


def test_windows():
    t = np.array([5, 9, 14, 15, 36, 44])
    assert time_segments(t, 10).tolist() == [0, 3, 4, 4]  # [5, 15), [15, 25), [25, 35); [35, 45) has not ended
    assert time_segments(t, 10, rest=True).tolist() == [0, 3, 4, 4, 6]
    assert time_segments(t, 10, start_us=0).tolist() == [0, 2, 4, 4, 5]
    assert time_segments(t - 10**15, 10).tolist() == time_segments(t, 10).tolist()


def test_counts():
    assert count_segments(np.arange(7), 3).tolist() == [0, 3, 6]
    assert count_segments(np.arange(7), 3, rest=True).tolist() == [0, 3, 6, 7]
    assert count_segments(np.arange(6), 3, rest=True).tolist() == [0, 3, 6]


def test_a_burst_ends_at_its_peak():
    burst = np.repeat(np.arange(0, 1000, 100), [1, 2, 3, 4, 5, 4, 3, 2, 1, 1])
    t = np.concatenate([burst, burst + 100_000])
    assert peak_segments(t, 20_000, tau_us=80, rise_us=0).tolist() == [0, 15, 41]  # after the five at 400 us
    assert peak_segments(t, 20_000, tau_us=80, rise_us=0, threshold=10.0).tolist() == [0]


def test_one_event_has_no_peak_since_its_potential_rises_later():
    assert peak_segments(np.array([3]), 10).tolist() == [0]
    assert peak_segments(np.array([3]), 10, rise_us=0).tolist() == [0, 1]


def test_the_search_holds_both_its_ends():
    alone = {"tau_us": 1, "rise_us": 0}  # nothing is left of an event when the next comes
    t = np.array([0, 1000])
    assert peak_segments(t, 1000, **alone).tolist() == [0, 1]  # of two alike the first
    assert peak_segments(t, 999, **alone).tolist() == [0, 1, 2]
    t = np.array([0, 1000, 1000])
    assert (peak_segments(t, 1000, **alone).tolist(), peak_segments(t, 999, **alone).tolist()) == ([0, 3], [0, 1, 3])


@pytest.mark.parametrize("rise", [0.0, 12.5, 49.0])
def test_peaks_are_as_the_definition(rise):
    t = np.cumsum(np.random.default_rng(1).integers(1, 60, 600))
    found = peak_segments(t, 150, tau_us=50, rise_us=rise, threshold=0.4)
    assert found.tolist() == peaks_literal(t, 150, 50.0, rise, 0.4)
    assert len(found) > 20


def test_the_rise_is_a_quarter_of_the_decay():
    s = np.linspace(0, 100, 100_001)
    kernel = np.exp(-s / 50) - np.exp(-s / 12.5)
    v = kernel[10_000] / kernel.max()  # of one event, 10 us later
    assert peak_segments(np.array([0, 10]), 5, tau_us=50, threshold=v - 1e-6).tolist() == [0, 2]
    assert peak_segments(np.array([0, 10]), 5, tau_us=50, threshold=v + 1e-6).tolist() == [0]


@pytest.mark.parametrize("method", METHODS)
@given(t=TIMES, data=st.data(), rest=st.booleans())
@settings(max_examples=30)
def test_any_cutting_into_parts_gives_the_same_segments(method, t, data, rest):
    fresh, at_once = METHODS[method]
    cuts, events = sorted(data.draw(st.lists(st.integers(0, len(t)), max_size=6))), recording(t)
    parts, bounds = [events[a:b] for a, b in zip([0, *cuts], [*cuts, len(t)], strict=True)], at_once(t, rest)
    expected = [events[a:b] for a, b in pairwise(bounds)]
    found = list(segmented(iter(parts), fresh(), rest=rest))
    assert [len(part) for part in found] == [len(part) for part in expected]
    assert all(a == b for a, b in zip(found, expected, strict=True))


@pytest.mark.parametrize("method", METHODS)
@given(t=TIMES, shift=st.integers(-(2**60), 2**60))
@settings(max_examples=25)
def test_the_origin_of_time_does_not_matter(method, t, shift):
    _, at_once = METHODS[method]
    assert (at_once(t + shift, False).tolist(), at_once(t, True)[-1]) == (at_once(t, False).tolist(), len(t))


def test_segmented_needs_no_parts():
    assert list(segmented(iter([]), Counts(3))) == []
    assert list(segmented(recording(np.array([], int)), Counts(3), rest=True)) == []
    assert [len(part) for part in segmented(recording(np.arange(8)), Counts(3), rest=True)] == [3, 3, 2]


def test_a_real_recording(shared):
    t = load(shared / "data/formats/nmnist_sample.bin").t
    assert msd_segments(t).tolist() == msd_literal(t, 0.02, 150.0)
    assert peak_segments(t[:2000], 5000).tolist() == peaks_literal(t[:2000], 5000, 20_000.0, 5000.0, 0.0)
    peaks = t[peak_segments(t, 50_000)[1:] - 1]
    assert len(peaks) == 3  # the camera moves three times, 100 ms each
    assert (peaks // 105_000).tolist() == [0, 1, 2]
