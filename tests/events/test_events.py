import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, strategies

from event_tests import refusal
from neuro.core.errors import ModelError
from neuro.events import EVENT, Events


def make(t=(1, 2, 3), x=(0, 1, 2), y=(0, 1, 1), p=(0, 1, 0), size=(3, 2)):
    return Events(np.array(t), np.array(x), np.array(y), np.array(p), size)


def test_types_and_length():
    events = make()
    assert (events.t.dtype, events.x.dtype, events.y.dtype, events.p.dtype, len(events)) == ("i8", "u2", "u2", "u1", 3)
    assert repr(events) == "<Events 3 of 3x2, 1 to 3 us>"


def test_parts():
    events = make()
    assert (events[1:].t.tolist(), events[events.p == 1].x.tolist()) == ([2, 3], [1])
    assert (events[np.array([0, 2])].t.tolist(), events.between(2, 3).t.tolist()) == ([1, 3], [2])
    assert events[:0] == make((), (), (), ())
    assert events != make(p=(0, 1, 1))
    assert events != make(size=(4, 2))


def test_records_are_packed():
    records = make().records()
    assert (records.dtype, records.tobytes()[:13]) == (EVENT, bytes([1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]))


def test_as_one_array():
    events = make()
    assert np.asarray(events).dtype == EVENT
    np.testing.assert_array_equal(np.asarray(events), events.records())
    assert np.asarray(events)["x"].tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match="events as one array are a copy: expected copy=None or True"):
        np.array(events, copy=False)


def test_one_by_one():
    assert (list(make()), [e.p for e in make()]) == ([(1, 0, 0, 0), (2, 1, 1, 1), (3, 2, 1, 0)], [0, 1, 0])
    assert all(type(value) is int for e in make() for value in e)
    assert list(make((), (), (), ())) == []


def test_duration():
    assert make(t=(5, 7, 1005)).duration == 1000
    assert make((1,), (0,), (0,), (0,)).duration == make((), (), (), ()).duration == 0


COLUMNS = strategies.lists(strategies.tuples(strategies.integers(-9, 9), strategies.integers(0, 2)), max_size=8)


@given(COLUMNS, COLUMNS)
def test_a_sum_is_sorted_by_time_and_the_first_comes_first(left, right):
    """The polarity tells the two apart."""
    a, b = (
        make([t for t, _ in sorted(rows)], [x for _, x in sorted(rows)], [0] * len(rows), [p] * len(rows))
        for p, rows in ((0, left), (1, right))
    )
    both = a + b
    assert np.all(np.diff(both.t) >= 0)
    assert (both[both.p == 0], both[both.p == 1]) == (a, b)
    assert np.all(np.diff(both.p.astype(int))[np.diff(both.t) == 0] >= 0)


def test_a_sum_keeps_what_both_recordings_say():
    a, b = (Events([1], [0], [0], [1], (3, 2), {"format": "dat", "t0": t0, "box": np.arange(3)}) for t0 in (1, 2))
    assert sorted((a + b).metadata) == ["box", "format"]


def test_sums_of_lists_and_arrays():
    a, b = Events([1, 5], [0, 1], [0, 0], [1, 0], (3, 2)), Events([3], [2], [1], [1], (3, 2))
    assert sum([a, b, a]) == a + b + a
    assert a + np.asarray(b) == np.asarray(a) + b == a + b
    for wrong in (np.zeros(3), np.zeros(2, [("t", int), ("x", int)])):
        with pytest.raises(ModelError, match=r"events \+ an array of .*: expected a structured array with t"):
            a + wrong
        assert "expected a structured array" in refusal(lambda wrong=wrong: wrong + a)
    with pytest.raises(TypeError):
        a + 3
    with pytest.raises(TypeError):
        3 + a


def test_a_sum_of_two_sensors_is_refused():
    assert refusal(lambda: make() + make(size=(4, 2))) == (
        "events of a 3x2 sensor + events of 4x2: expected one size\n"
        "  hint: neuro.events.filters.Crop and Downsample change a sensor's size"
    )


@pytest.mark.parametrize(("change", "message"), [
    ({"x": (0, 3, 9)}, "event 1: x is 3, expected 0 to 2 (sensor 3x2)"),
    ({"x": (0, -1, 9)}, "event 1: x is -1, expected 0 to 2 (sensor 3x2)"),
    ({"y": (0, 1, 2)}, "event 2: y is 2, expected 0 to 1 (sensor 3x2)"),
    ({"p": (2, 1, 1)}, "event 0: p is 2, expected 0 to 1 (sensor 3x2)"),
    ({"t": (1, 2, 1)}, "event 2: time runs back from 2 to 1 us"),
    ({"t": (3, 2, 1), "x": (0, 0, 7)}, "event 1: time runs back from 3 to 2 us"),
    ({"y": (0, 1)}, "y has shape (2,), expected (3,) like t"),
    ({"t": (0.0, 0.5, 1.0)}, "t has type float64, expected integers"), *(({"size": size},
    f"sensor_size = {size!r}: expected width and height of 1 to 65536 px") for size in ((0, 2), (3.5, 2), (3, 2, 2), 3,
    "32", None))
])  # fmt: skip
def test_impossible_events(change, message):
    assert refusal(make, **change) == message


def test_import_is_light():
    code = "import sys, neuro.events; print([m for m in ('numba', 'scipy', 'h5py') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_parts_by_place_and_polarity():
    events = Events([1, 2, 3, 4], [0, 5, 5, 9], [0, 1, 2, 3], [1, 0, 1, 0], (10, 4), {"a": 1})
    assert (events.inside((5, 9), (1, 3)).t.tolist(), events.inside((0, 10), (0, 4))) == ([2, 3], events)
    assert (events.of_polarity(1).t.tolist(), events.of_polarity(0).t.tolist()) == ([1, 3], [2, 4])
    assert events.of_polarity(1).metadata == {"a": 1}
    with pytest.raises(ValueError, match=r"polarity 2: expected 1 \(ON\) or 0 \(OFF\)"):
        events.of_polarity(2)


def test_records_as_aertb_names_them():
    events = Events([7], [1], [2], [1], (3, 3))
    assert events.records("ts").dtype.names == ("ts", "x", "y", "p")
    assert events.records("ts").tolist() == events.records().tolist()


@pytest.mark.parametrize(("t", "message"), [
    (np.array([1, 1 << 63, 1 << 63], np.uint64), f"event 1: t is {1 << 63}, expected at most {(1 << 63) - 1} us"),
    ([1, 2, 1 << 64], "t has type object, expected integers")
])  # fmt: skip
def test_times_beyond_int64_are_refused(t, message):
    with pytest.raises(ValueError, match="expected") as error:
        Events(t, [0, 0, 0], [0, 0, 0], [0, 0, 0], (3, 2))
    assert str(error.value) == message
    assert Events(np.array([(1 << 63) - 1], np.uint64), [0], [0], [0], (3, 2)).t.tolist() == [(1 << 63) - 1]


@pytest.mark.parametrize("index", [1, np.int64(1), "t", None, [[0, 1]], [0.0, 1.0], (0, 1, slice(None))])
def test_what_is_no_index(index):
    assert (
        refusal(lambda: make()[index])
        == f"events[{index!r}]: expected a slice, a mask or indices\n  hint: events.records()[k] is event k alone"
    )
    assert (len(make()[[]]), make()[[2]].t.tolist()) == (0, [3])


def test_between_any_whole_numbers():
    events = make((1, 2, (1 << 63) - 1))
    assert (len(events.between(-(10**30), 10**30)), len(events.between(-(1 << 63), (1 << 63) - 1))) == (3, 2)
    assert len(events.between(1 << 63, 1 << 64)) == 0
    assert events.between(2.0, np.uint64(1 << 63)).t.tolist() == [2, (1 << 63) - 1]
    expected = "expected a whole number of us from -2^63 to 2^63 - 1"
    for message, times in (
        (f"start_us = '1': {expected}\n  hint: write 1 without quotes", ("1", 2)),
        (f"stop_us = 2.5: {expected}", (0, 2.5)),
        (f"stop_us = .nan: {expected}", (0, float("nan"))),
    ):
        assert refusal(events.between, *times) == message
