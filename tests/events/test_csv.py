import io
from decimal import ROUND_HALF_UP, Decimal

import numpy as np
import pytest
from hypothesis import given, strategies as st

from event_tests import refusal
from neuro.events import EventFileError, EventFileWarning, Events, load, save

ROWS = [(-7, 3, 2, 1), (0, 3, 40000, 0), (10, 5, 0, 1), (10, 65535, 9, 0), (1 << 62, 0, 0, 1)]


def text(rows, order="txyp", sign=","):
    places = ["txyp".index(name) for name in order]
    return "".join(sign.join(str(row[k]) for k in places) + "\n" for row in rows).encode()


def of(data, **options):
    return load(data if isinstance(data, bytes) else data.encode(), name="a.csv", **options)


@pytest.mark.parametrize("order", ["pyxt", "txyp", "yxpt", "tpyx"])
def test_columns_are_found_by_name(order):
    name = {"t": "timestamp_us", "x": '"X"', "y": "ev_y", "p": "Polarity"}
    head = ",".join(name[key] for key in order) + "\n"
    assert of(head.encode() + text(ROWS, order)).records().tolist() == ROWS
    spaced = "# " + " ".join(order) + "\n"
    assert of(spaced.encode() + text(ROWS, order, " ")).records().tolist() == ROWS


def test_polarities_may_be_true_and_false():
    """As pandas writes them."""
    rows = [(1, 2, 3, 1), (2, 4, 5, 0), (3, 4, 5, 1)]
    assert of("t,x,y,p\n1,2,3,True\n2,4,5,False\n3,4,5,True\n").records().tolist() == rows
    assert of("2 3 TRUE 1\n4 5 false 2\n4 5 1 3\n").records().tolist() == rows
    with pytest.raises(EventFileError, match=r"line 2: p is 'Trua', expected a number$"):
        of("1,2,3,True\n2,4,5,Trua\n")
    with pytest.raises(EventFileError, match=r"line 2: x is 'True', expected a number$"):
        of("1,2,3,True\n2,True,5,1\n")


def test_txt_is_written_as_columns_with_spaces(tmp_path):
    events = Events([-5, 70], [1, 2], [3, 4], [0, 1], (34, 30))
    save(events, tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_text() == "# sensor 34x30\n# t x y p\n-5 1 3 0\n70 2 4 1\n"
    assert load(tmp_path / "a.txt") == events
    assert np.loadtxt(tmp_path / "a.txt", int).tolist() == [[-5, 1, 3, 0], [70, 2, 4, 1]]


def test_more_columns_than_needed():
    events = of(",t,x,label,y,p\n0,5,1,left,2,1\n1,6,3,nan,4,-1\n")
    assert events.records().tolist() == [(5, 1, 2, 1), (6, 3, 4, 0)]


def test_seconds_are_known_by_their_fraction():
    """The RPG's events.txt: t in s, x, y, p."""
    events = of("0.000000000 33 39 1\n1468939993.067416019 158 145 1\n1468939993.0674165 5 6 0\n")
    assert (events.t.tolist(), events.metadata["time_unit"]) == ([0, 1468939993067416, 1468939993067417], "s")
    assert of("1e0 1 2 1\n2.5e-6 1 2 1\n", sort=True).t.tolist() == [3, 1000000]


def test_times_that_are_whole_are_us():
    assert of("1.0,2.0,3.0,1.0\n2e1,2,3,0\n").records().tolist() == [(1, 2, 3, 1), (20, 2, 3, 0)]


@pytest.mark.parametrize(("name", "told", "us"), [
    ("t [s]", "12", 12000000), ("t_ms", "1.0005", 1001), ("ts (ns)", "1499", 1), ("time_us", "7", 7),
    ("t_ns", "1500", 2)
])  # fmt: skip
def test_the_unit_may_be_told(name, told, us):
    assert of(f"{name},x,y,p\n{told},1,2,1\n").t.tolist() == [us]


def test_savetxt(tmp_path):
    path, table = tmp_path / "a.txt", np.array(ROWS[1:4], np.float64)
    np.savetxt(path, table)
    assert load(path).records().tolist() == ROWS[1:4]
    np.savetxt(path, table, fmt="%d", delimiter=", ", header="t x y p")
    assert load(path).records().tolist() == ROWS[1:4]


@pytest.mark.parametrize("head", ["%geometry:640,480\n", "# sensor 640x480\n", "640 480\n", "\n#no\n640,480\n# x\n"])
def test_sensor(head):
    assert (of(head + "5 100 200 1\n").sensor_size, of("5 100 200 1\n").sensor_size) == ((640, 480), (101, 201))


def test_lines_of_all_kinds():
    plain = "1,2,3,1\n2,4,5,0\n"
    for same in ("\ufeff" + plain, plain.replace("\n", "\r\n"), plain[:-1], "\n1,2,3,1\n\n# x\n% y\n  2,4,5,0 \n\n",
                 "+1,2.,3.0,1,\n2,4,5,0,\n", "00001,2,3,1\n2,.4e1,50e-1,0\n"):  # fmt: skip
        assert of(same).records().tolist() == [(1, 2, 3, 1), (2, 4, 5, 0)]
    assert len(of("")) == len(of("t,x,y,p\n")) == 0


def test_known_by_content():
    assert load(b"1.5 2 3 1\n2.5 3 4 0\n", name="events").metadata["format"] == "csv"
    assert load(io.BytesIO(b"x,y,p,t\n1,2,1,5\n")).records().tolist() == [(5, 1, 2, 1)]
    for other in (b"hello world\n", b"1 2 3\n4 5 6\n", b"1 2 3 4"):
        assert "unknown kind of event file" in refusal(load, other, name="notes")


GOOD = "t,x,y,p\n1,2,3,1\n2,3,4,0\n"


def test_messages(messages):
    messages.calls(globals())


def test_what_is_whole():
    with pytest.warns(EventFileWarning, match="line 4: x is 'abc'"):
        assert len(of(GOOD + "3,abc,4,1\n4,1,2,1\n", strict=False)) == 2
    with pytest.warns(EventFileWarning, match="1 of 3 events"):
        assert len(of(GOOD + "0,1,4,1\n", strict=False)) == 2


@given(st.integers(-(10**12), 10**12), st.integers(0, 12))
def test_seconds_are_rounded_to_the_nearest_us(mantissa, digits):
    number = Decimal(mantissa).scaleb(-digits)
    expected = int((number * 10**6).to_integral_value(ROUND_HALF_UP))
    assert of(f"t_s,x,y,p\n{number:f},1,2,1\n").t.tolist() == [expected]
