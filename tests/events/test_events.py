import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, strategies

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


def test_indices():
    assert (len(make()[[]]), make()[[2]].t.tolist()) == (0, [3])


def test_records_are_packed():
    records = make().records()
    assert (records.dtype, records.tobytes()[:13]) == (EVENT, bytes([1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]))


def test_as_one_array():
    events = make()
    assert np.asarray(events).dtype == EVENT
    np.testing.assert_array_equal(np.asarray(events), events.records())
    assert np.asarray(events)["x"].tolist() == [0, 1, 2]


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
    with pytest.raises(TypeError):
        a + 3
    with pytest.raises(TypeError):
        3 + a


def test_what_is_refused(messages):
    messages.calls(globals())
    assert Events(np.array([(1 << 63) - 1], np.uint64), [0], [0], [0], (3, 2)).t.tolist() == [(1 << 63) - 1]


def test_import_is_light():
    code = "import sys, neuro.events; print([m for m in ('numba', 'scipy', 'h5py') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_parts_by_place_and_polarity():
    events = Events([1, 2, 3, 4], [0, 5, 5, 9], [0, 1, 2, 3], [1, 0, 1, 0], (10, 4), {"a": 1})
    assert (events.inside((5, 9), (1, 3)).t.tolist(), events.inside((0, 10), (0, 4))) == ([2, 3], events)
    assert (events.of_polarity(1).t.tolist(), events.of_polarity(0).t.tolist()) == ([1, 3], [2, 4])
    assert events.of_polarity(1).metadata == {"a": 1}


def test_records_as_aertb_names_them():
    events = Events([7], [1], [2], [1], (3, 3))
    assert events.records("ts").dtype.names == ("ts", "x", "y", "p")
    assert events.records("ts").tolist() == events.records().tolist()


def test_between_any_whole_numbers():
    events = make((1, 2, (1 << 63) - 1))
    assert (len(events.between(-(10**30), 10**30)), len(events.between(-(1 << 63), (1 << 63) - 1))) == (3, 2)
    assert len(events.between(1 << 63, 1 << 64)) == 0
    assert events.between(2.0, np.uint64(1 << 63)).t.tolist() == [2, (1 << 63) - 1]
