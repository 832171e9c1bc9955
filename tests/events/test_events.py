import subprocess
import sys

import numpy as np
import pytest

from neuro.core.errors import ModelError
from neuro.events import EVENT, Events


def make(t=(1, 2, 3), x=(0, 1, 2), y=(0, 1, 1), p=(0, 1, 0), size=(3, 2)):
    return Events(np.array(t), np.array(x), np.array(y), np.array(p), size)


def test_types_and_length():
    events = make()
    assert (events.t.dtype, events.x.dtype, events.y.dtype, events.p.dtype) == ("i8", "u2", "u2", "u1")
    assert len(events) == 3
    assert repr(events) == "<Events 3 of 3x2, 1 to 3 us>"


def test_parts():
    events = make()
    assert events[1:].t.tolist() == [2, 3]
    assert events[events.p == 1].x.tolist() == [1]
    assert events[np.array([0, 2])].t.tolist() == [1, 3]
    assert events.between(2, 3).t.tolist() == [2]
    assert events[:0] == make((), (), (), ())
    assert events != make(p=(0, 1, 1))
    assert events != make(size=(4, 2))


def test_records_are_packed():
    records = make().records()
    assert records.dtype == EVENT
    assert records.tobytes()[:13] == bytes([1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": (0, 3, 9)}, "event 1: x is 3, expected 0 to 2 (sensor 3x2)"),
        ({"x": (0, -1, 9)}, "event 1: x is -1, expected 0 to 2 (sensor 3x2)"),
        ({"y": (0, 1, 2)}, "event 2: y is 2, expected 0 to 1 (sensor 3x2)"),
        ({"p": (2, 1, 1)}, "event 0: p is 2, expected 0 to 1 (sensor 3x2)"),
        ({"t": (1, 2, 1)}, "event 2: time runs back from 2 to 1 us"),
        ({"t": (3, 2, 1), "x": (0, 0, 7)}, "event 1: time runs back from 3 to 2 us"),
        ({"y": (0, 1)}, "y has shape (2,), expected (3,) like t"),
        ({"t": (0.0, 0.5, 1.0)}, "t has type float64, expected integers"),
        ({"size": (0, 2)}, "sensor size is 0x2, expected 1x1 to 65536x65536 px"),
    ],
)
def test_impossible_events(change, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011 (the text is compared below)
        make(**change)
    assert str(error.value) == message


def test_import_is_light():
    code = "import sys, neuro.events; print([m for m in ('numba', 'scipy', 'h5py') if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_parts_by_place_and_polarity():
    events = Events([1, 2, 3, 4], [0, 5, 5, 9], [0, 1, 2, 3], [1, 0, 1, 0], (10, 4), {"a": 1})
    assert events.inside((5, 9), (1, 3)).t.tolist() == [2, 3]
    assert events.inside((0, 10), (0, 4)) == events
    assert (events.of_polarity(1).t.tolist(), events.of_polarity(0).t.tolist()) == ([1, 3], [2, 4])
    assert events.of_polarity(1).metadata == {"a": 1}
    with pytest.raises(ValueError, match=r"polarity 2: expected 1 \(ON\) or 0 \(OFF\)"):
        events.of_polarity(2)


def test_records_as_aertb_names_them():
    events = Events([7], [1], [2], [1], (3, 3))
    assert events.records("ts").dtype.names == ("ts", "x", "y", "p")
    assert events.records("ts").tolist() == events.records().tolist()


@pytest.mark.parametrize(
    ("t", "message"),
    [
        (np.array([1, 1 << 63, 1 << 63], np.uint64), f"event 1: t is {1 << 63}, expected at most {(1 << 63) - 1} us"),
        ([1, 2, 1 << 64], "t has type object, expected integers"),
    ],
)  # fmt: skip
def test_times_beyond_int64_are_refused(t, message):
    with pytest.raises(ValueError, match="expected") as error:
        Events(t, [0, 0, 0], [0, 0, 0], [0, 0, 0], (3, 2))
    assert str(error.value) == message
    assert Events(np.array([(1 << 63) - 1], np.uint64), [0], [0], [0], (3, 2)).t.tolist() == [(1 << 63) - 1]


@pytest.mark.parametrize("size", [(3.5, 2), (3, 2, 2), 3, "32", None])
def test_a_sensor_is_two_whole_numbers(size):
    with pytest.raises(ModelError) as error:
        make(size=size)
    assert str(error.value) == f"sensor_size = {size!r}: expected width and height, two whole numbers"
    assert make(size=(np.int64(3), np.uint8(2))).sensor_size == (3, 2)


@pytest.mark.parametrize("index", [1, np.int64(1), "t", None, [[0, 1]], [0.0, 1.0], (0, 1, slice(None))])
def test_what_is_no_index(index):
    with pytest.raises(ModelError) as error:
        make()[index]
    assert str(error.value) == (
        f"events[{index!r}]: expected a slice, a mask or indices\n  hint: events.records()[k] is event k alone"
    )
    assert len(make()[[]]) == 0
    assert make()[[2]].t.tolist() == [3]


def test_between_any_whole_numbers():
    events = make((1, 2, (1 << 63) - 1))
    assert len(events.between(-(10**30), 10**30)) == 3
    assert len(events.between(-(1 << 63), (1 << 63) - 1)) == 2
    assert len(events.between(1 << 63, 1 << 64)) == 0
    assert events.between(2.0, np.uint64(1 << 63)).t.tolist() == [2, (1 << 63) - 1]
    for name, given in (("start_us", ("1", 2)), ("stop_us", (0, 2.5)), ("stop_us", (0, float("nan")))):
        with pytest.raises(ModelError) as error:
            events.between(*given)
        bad = given[name == "stop_us"]
        assert str(error.value) == f"{name} is {bad!r}, expected a whole number of us"
