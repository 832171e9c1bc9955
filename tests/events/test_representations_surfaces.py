"""Time surfaces and leaky surfaces: against their definitions, and what always holds."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from neuro.events import Events
from neuro.events.representations import LeakySurface, TimeSurface, leaky_surface, time_surface

SIZE = (6, 4)
EVENT = st.tuples(st.integers(0, 30), st.integers(0, SIZE[0] - 1), st.integers(0, SIZE[1] - 1), st.integers(0, 1))
F8 = {"dtype": np.float64}


def recording(rows):
    steps, x, y, p = np.array(rows, np.int64).reshape(-1, 4).T
    return Events(np.cumsum(steps), x, y, p, SIZE)


RECORDINGS = st.lists(EVENT, max_size=50).map(recording)
DECAYS = {
    "exponential": lambda u, dt, tau: u * np.exp(-dt / tau),
    "linear": lambda u, dt, tau: np.maximum(0, u - dt / tau),
}


def algorithm_15(events, tau, decay, at, order, separate=True):
    """The whole frame at every event, as the thesis prints it."""
    u = np.zeros((1 + separate, SIZE[1], SIZE[0]))
    before = events.t[0] if len(events) else at
    for t, x, y, p in zip(events.t, events.x, events.y, events.p, strict=True):
        if order == "decay_first":
            u = DECAYS[decay](u, t - before, tau)
        u[p if separate else 0, y, x] += 1
        if order == "increment_first":
            u = DECAYS[decay](u, t - before, tau)
        before = t
    return DECAYS[decay](u, at - before, tau)


def last_times(events, at, decay, tau):
    out = np.zeros((2, SIZE[1], SIZE[0]))
    for t, x, y, p in zip(events.t, events.x, events.y, events.p, strict=True):
        out[p, y, x] = DECAYS[decay](1.0, at - t, tau)
    return out


@pytest.mark.parametrize("decay", DECAYS)
@pytest.mark.parametrize("order", ["decay_first", "increment_first"])
@given(events=RECORDINGS, later=st.integers(0, 100))
@settings(max_examples=40)
def test_leaky_surface_is_algorithm_15(decay, order, events, later):
    at = (int(events.t[-1]) if len(events) else 0) + later
    found = leaky_surface(events, tau_us=50, at_us=at, decay=decay, order=order, **F8)
    assert found == pytest.approx(algorithm_15(events, 50.0, decay, at, order), abs=1e-12)
    one = leaky_surface(events, tau_us=50, at_us=at, decay=decay, order=order, polarity="ignored", **F8)
    assert one == pytest.approx(algorithm_15(events, 50.0, decay, at, order, separate=False)[0], abs=1e-12)


def test_the_order_of_algorithm_15_takes_from_an_event_what_passed_before_it():
    events = Events([0, 100], [0, 1], [0, 0], [1, 1], SIZE)
    first = leaky_surface(events, tau_us=50, **F8)[1, 0]
    assert first[:2].tolist() == [np.exp(-2), 1.0]
    late = leaky_surface(events, tau_us=50, order="increment_first", **F8)[1, 0]
    assert late[:2].tolist() == [np.exp(-2), np.exp(-2)]
    assert not leaky_surface(events, tau_us=50, decay="linear", order="increment_first").any()


@pytest.mark.parametrize("decay", DECAYS)
@given(events=RECORDINGS, later=st.integers(0, 100))
@settings(max_examples=40)
def test_time_surface_is_as_the_definition(decay, events, later):
    at = (int(events.t[-1]) if len(events) else 0) + later
    found = time_surface(events, tau_us=50, at_us=at, decay=decay, **F8)
    assert found == pytest.approx(last_times(events, at, decay, 50.0), abs=1e-14)
    assert np.array_equal(
        time_surface(events, tau_us=50, at_us=at, decay=decay, polarity="ignored", **F8), found.max(axis=0)
    )


@pytest.mark.parametrize("surface", [time_surface, leaky_surface])
@given(events=RECORDINGS, at=st.lists(st.integers(-10, 1200), max_size=5).map(sorted), inclusive=st.booleans())
@settings(max_examples=40)
def test_one_pass_gives_every_time(surface, events, at, inclusive):
    many = surface(events, tau_us=50, at_us=np.array(at, int), inclusive=inclusive)
    assert many.shape == (len(at), 2, SIZE[1], SIZE[0])
    assert many.dtype == np.float32
    for when, found in zip(at, many, strict=True):
        before = events[: np.searchsorted(events.t, when, side="right" if inclusive else "left")]
        assert np.array_equal(found, surface(before, tau_us=50, at_us=when))


@pytest.mark.parametrize("kind", [TimeSurface, LeakySurface])
@given(events=RECORDINGS, data=st.data())
@settings(max_examples=40)
def test_any_cutting_into_parts_gives_the_same_surface(kind, events, data):
    cuts = sorted(data.draw(st.lists(st.integers(0, len(events)), max_size=5)))
    options = {"tau_us": 50, "decay": data.draw(st.sampled_from(sorted(DECAYS)))}
    if kind is LeakySurface:
        options["order"] = data.draw(st.sampled_from(["decay_first", "increment_first"]))
    whole, parts = kind(SIZE, **options), kind(SIZE, **options)
    whole.add(events)
    for first, last in zip([0, *cuts], [*cuts, len(events)], strict=True):
        parts.add(events[first:last])
        parts.at(int(events.t[last - 1]) if last else 0)  # reading changes nothing
    assert np.array_equal(parts.at(2000), whole.at(2000))


def test_an_increment():
    events = Events([0], [0], [0], [0], SIZE)
    assert leaky_surface(events, tau_us=9, increment=2.5)[0, 0, 0] == 2.5


def test_times_need_not_be_where_events_are():
    events = Events([100], [0], [0], [1], SIZE)
    found = time_surface(events, tau_us=10, at_us=[50, 100, 110])[:, 1, 0, 0]
    assert found == pytest.approx([0.0, 1.0, np.exp(-1)])


def test_times_over_all_of_int64():
    """What lies 2^63 us and more back is forgotten, and not in the future."""
    last = (1 << 63) - 1
    events = Events([-1 << 63, 0, last], [0, 1, 0], [0, 0, 1], [1, 0, 1], (2, 2))
    for surface in (time_surface, leaky_surface):
        for decay in ("exponential", "linear"):
            found = surface(events, tau_us=1e6, decay=decay)
            assert np.argwhere(found).tolist() == [[1, 1, 0]]
            assert found[1, 1, 0] == 1
