"""Text that programs and people write: separators, ends of lines, order of columns, units, damage."""

import io
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from event_tests import damage_is_told, damaged, refusal, rows
from neuro.events import EventFileError, load, stream
from neuro.events.formats._columns import ORDERS
from neuro.events.formats.table import SAMPLE, Table
from neuro.events.source import Source

SIGNS = [",", ";", "\t", " ", " , ", ";  "]
ENDS = ["\n", "\r\n", "\r", "\r\r\n"]
EVENTS = st.lists(
    st.tuples(st.integers(0, 10**6), st.integers(0, 999), st.integers(0, 999), st.integers(0, 1)),
    min_size=1,
    max_size=12,
)


def text(events, order="txyp", sign=",", end="\n", names=True):
    head = [sign.join(order)] if names else []
    lines = head + [sign.join(str(event["txyp".index(name)]) for name in order) for event in events]
    return "".join(line + end for line in lines).encode()


def of(data, **options):
    return load(data, name="a.csv", **options)


def refused(call, *values, **words):
    """The message of the error by which a call is refused, "" where it is not."""
    try:
        call(*values, **words)
    except EventFileError as error:
        return str(error)
    return ""


@given(
    st.data(), EVENTS, st.permutations("txyp"), st.sampled_from(SIGNS), st.sampled_from(ENDS), st.booleans(),
    st.booleans()
)  # fmt: skip
def test_names_separators_and_ends_of_lines(data, events, order, sign, end, named, is_sorted):
    """With names, or with the order given, no rows decide anything; unsorted rows are refused or sorted."""
    order = "".join(order)
    if is_sorted:
        events = sorted(events, key=lambda event: event[0])
    written = text(events, order, sign, end, named)
    if data.draw(st.booleans()):
        written = written[: len(written) - len(end)]  # the last line may have no end
    given_order = {} if named else {"format": f"csv:{order}"}
    assert rows(of(written, sort=True, **given_order)) == sorted(events, key=lambda event: event[0])
    back = next(((a[0], b[0]) for a, b in pairwise(events) if b[0] < a[0]), None)
    if back is None:
        assert rows(of(written, **given_order)) == events
    else:
        assert f"time runs back from {back[0]} to {back[1]} us" in refusal(of, written, **given_order)


@given(EVENTS, st.sampled_from(ENDS), st.integers(1, 40))
def test_a_line_may_end_at_the_end_of_a_block(events, end, block):
    events = sorted(events, key=lambda event: event[0])

    class Slow(io.BytesIO):
        """A pipe from which few bytes come at a time."""

        def read(self, size=-1):
            return super().read(min(size, block) if size >= 0 else size)

    written = text(events * 1, end=end)
    for source in (Slow(written), io.BytesIO(written)):
        assert [row for part in stream(source, name="a.csv", sensor_size=(1000, 1000)) for row in rows(part)] == events


@pytest.mark.parametrize("end", ENDS)
def test_blocks_and_places(end, tmp_path):
    """Of a file of several blocks each event has its byte and its line."""
    events, path = [(10 * k, k % 240, k % 180, k % 2) for k in range(20_000)], tmp_path / "a.csv"
    path.write_bytes(written := text(events, end=end))
    pieces = list(Table(Source(path)).pieces(1))
    assert len(pieces) > 3
    assert [row for piece in pieces for row in rows(piece)] == events
    piece = pieces[2]
    assert written[piece.place(5) :].startswith(b"%d," % piece.t[5])
    assert written.splitlines()[piece.line(5) - 1].startswith(b"%d," % piece.t[5])


def test_cr_alone(shared):
    assert rows(load(shared / "cases" / "cr_only.csv")) == [(0, 1, 2, 1), (5, 1, 2, 0), (9, 3, 4, 1)]
    assert load(b"0,1,2,1\r5,1,2,0\r", name="events").metadata["format"] == "csv"


def test_messages(messages):
    messages.calls(globals())


BACK = "time runs back from 5 to 3 us"


def test_time_that_runs_back_without_names(shared):
    path = shared / "cases" / "time_runs_back.csv"
    assert refusal(load, path) == f"{path}: byte 8: line 2: {BACK}; load(..., sort=True) sorts the events"
    assert rows(load(path, sort=True)) == [(3, 1, 2, 0), (5, 1, 2, 1)]


def test_columns_of_which_two_orders_are_possible():
    data = b"5,1,2,1\n3,1,4,0\n"
    for sort in (False, True):
        told = refusal(of, data, sort=sort)
        assert told.startswith(f"a.csv: byte 0: columns without names may be t x y p, where {BACK}, or x y t p or ")
        assert told.endswith("expected the order, as --from csv:txyp or format='csv:txyp'")
        assert "may be t x y p" in refusal(load, data, name="events", sort=sort)
    assert rows(of(data, format="csv:txyp", sort=True)) == [(3, 1, 4, 0), (5, 1, 2, 1)]
    assert rows(of(data, format="csv:xytp")) == [(2, 5, 1, 1), (4, 3, 1, 0)]
    assert rows(of(b"x,y,t,p\n" + data, format="csv:txyp", sort=True)) == [(3, 1, 4, 0), (5, 1, 2, 1)]


ORDINARY = {
    "one row": ["7,5,6,1"],
    "some rows of a time": ["7,5,6,1", "7,4,4,0", "8,5,5,1"],
    "a time with a decimal point": ["0.000000 1 2 1", "0.000000 3 4 0"],
    "all columns with decimal points": ["7.0 1.0 2.0 1.0", "8.0 3.0 4.0 0.0"],
    "coordinates of one time, row by row": [f"33333,{x},{y},1" for y in range(40) for x in range(0, 30, 3)],
    "coordinates of one time in any order": [f"7,{k * 7 % 31},{k * 11 % 37},{k % 2}" for k in range(40)],
    "one pixel": [f"{k},5,6,1" for k in range(3)],
}


@pytest.mark.parametrize("name", ORDINARY)
def test_ordinary_rows_are_t_x_y_p(name):
    assert of("\n".join(ORDINARY[name] + [""]).encode()).metadata["columns"] == "t x y p"


@pytest.mark.parametrize(("lines", "other"), [
    (["1,2,5,1", "1,2,3,0"], "x y t p"), (["1,5,2,1", "1,3,2,0"], "x t y p"), (["1,2,3,1", "1,2,5,0"], "x y t p"),
    ([f"5,7,{10 * k},1" for k in range(100)], "x y t p"), (["3 2 0 1.0", "3 2 0 1.0", "4 2 0 1.0"], "x y p t")
])  # fmt: skip
def test_time_that_stands_still_is_no_evidence(lines, other):
    data = "\n".join([*lines, ""]).encode()
    for sort in (False, True):
        told = refusal(of, data, sort=sort)
        assert told.startswith("a.csv: byte 0: columns without names may be ")
        assert ", where time stands still at 1" in told or ", where time stands still at 5 us" in told
        assert other in told
        assert "--from csv:" in told
    assert len(of(data, format="csv:txyp")) == len(of(data, format=f"csv:{other.replace(' ', '')}", sort=True))


def test_decimal_points_tell_the_column_of_time():
    for sign in (" ", ","):
        data = "1 2 0 0.000000\n1 2 1 1.000000\n".replace(" ", sign).encode()
        assert rows(of(data)) == [(0, 1, 2, 0), (1_000_000, 1, 2, 1)]
        assert rows(of(data.replace(b"1.0", b"0.0"))) == [(0, 1, 2, 0), (0, 1, 2, 1)]
    assert "may be x y p t, where time runs back from 1 to 0" in refusal(of, b"5 1 1 1.0\n6 1 0 0.0\n")


@pytest.mark.parametrize("sign", [";", "; ", "\t", " "])
@pytest.mark.parametrize("end", ENDS[:3])
@pytest.mark.parametrize("names", [True, False])
def test_decimal_commas(sign, end, names):
    """As programs of many countries write 't;x;y;p' with 0,033333."""
    lines = [sign.join("txyp")] * names + [sign.join(row.split()) for row in ("0,000000 1 2 1", "0,033333 3 4 0")]
    data, expected = end.join([*lines, ""]).encode(), [(0, 1, 2, 1), (33_333, 3, 4, 0)]
    assert rows(of(data)) == rows(of(data, format="csv:s")) == expected
    assert rows(of(data.replace(b"0,000000", b"0"))) == expected
    assert rows(load(b"%geometry:640,480\n" + data, name="events")) == expected
    assert of(data.replace(b"0,000000", b"5").replace(b"0,033333", b"6")).t.tolist() == [5, 6]


def test_decimal_commas_after_many_rows_without():
    for sign in ";", " ":
        row, head = sign.join(("0", "1", "2", "1")) + "\n", sign.join("txyp") + "\n"
        data = (head + row * (SAMPLE // len(row) + 10) + sign.join(("0,033333", "1", "2", "1")) + "\n").encode()
        if sign == ";":
            assert "t is '0.033333', expected whole us, as before; --from csv:s" in refusal(of, data)
            assert of(data, format="csv:s").t[-1] == 33_333
        else:
            told = "'0,033333 1 2 1' has decimal commas, unlike the lines before: expected decimal points"
            assert told in refusal(of, data)


@given(EVENTS, st.booleans())
def test_rows_without_names_are_read_in_their_order_or_refused(events, is_sorted):
    """t x y p is the default; no other order is taken for it, and it is taken for no other by a few rows."""
    assume(len({event[0] for event in events}) > 1)
    if is_sorted:
        events = sorted(events, key=lambda event: event[0])
    ordered = sorted(events, key=lambda event: event[0])
    if is_sorted or not (told := refused(of, text(events, names=False), sort=True)):
        assert rows(of(text(events, names=False), sort=True)) == ordered
    else:
        assert "--from csv:txyp" in told


@pytest.mark.parametrize("order", ORDERS)
def test_many_rows_tell_their_order(order):
    draw = np.random.default_rng(5)
    events = [(7 * k + 1, *draw.integers(2, 200, 2).tolist(), k % 2) for k in range(200)]
    found = of(text(events, order, names=False))
    assert rows(found) == events
    assert found.metadata == {"format": "csv", "t0": 1, "columns": " ".join(order), "time_unit": "us"}


@pytest.mark.parametrize(
    ("place", "expected"), [("s", 5_000_000), ("ms", 5_000), ("us", 5), ("xytp:ms", 1000), ("ms:xytp", 1000), ("ns", 0)]
)
def test_order_and_unit_may_be_given(place, expected):
    assert of(b"5,3,1,1\n", format=f"csv:{place}").t.tolist() == [expected]
    assert load(b"5 3 1 1\n", format=f"txt:{place}").t.tolist() == [expected]


@pytest.mark.parametrize("first", ["0.000000", "0.", "1e0", "-3.0"])
@pytest.mark.parametrize("names", ["", "t,x,y,p\n"])
def test_a_decimal_point_tells_seconds_also_of_whole_times(first, names):
    """As v2e writes '%f %d %d %d': rows that are whole may fill all that is looked at."""
    us, count = round(float(first) * 10**6), SAMPLE // len(f"{first},1,2,1") + 10
    for many in (1, count):
        events = of((names + f"{first},1,2,1\n" * many + "1.033333,1,2,1\n").encode())
        assert (events.metadata["time_unit"], sorted(set(events.t.tolist()))) == ("s", sorted({us, 1_033_333}))


@pytest.mark.parametrize("row", ["0,1,2,1\n", "0.0,1.0,2.0,1.0\n"])
def test_a_fraction_after_whole_times_asks_for_the_unit(row):
    """Where all columns have a point it tells nothing: so numpy.savetxt writes whole numbers, too."""
    data = (row * (SAMPLE // len(row) + 10) + "0.033333,1,2,1\n").encode()
    told = refusal(of, data)
    assert "t is '0.033333', expected whole us, as before; --from csv:s or format='csv:s' reads seconds" in told
    assert (of(data, format="csv:s").t[-1], of((row * 3).encode()).metadata["time_unit"]) == (33_333, "us")


def test_damage_is_told_of_all_variants():
    """Flipped, inserted and missing bytes give events or an error at a byte of the file."""
    events = [(100 * k, k % 34, k % 30, k % 2) for k in range(8)]
    variants = st.tuples(st.sampled_from(ORDERS), st.sampled_from(SIGNS), st.sampled_from(ENDS), st.booleans())
    damage_is_told(variants.flatmap(lambda chosen: damaged(text(events, *chosen))), "csv", examples=60)


@settings(max_examples=60)
@given(st.integers(0, 7), st.sampled_from(ENDS), st.binary(min_size=1, max_size=3), st.integers(0, 6))
def test_bytes_in_a_row_never_make_an_event_vanish(row, end, inserted, at):
    """A row with inserted bytes is read as other values or refused; no row is lost without a word."""
    assume(not set(inserted) & set(b"\r\n#%"))
    events = [(100 * k, 10 + k, 20 + k, k % 2) for k in range(8)]
    lines = text(events, end=end).split(end.encode())
    lines[row + 1] = lines[row + 1][:at] + inserted + lines[row + 1][at:]
    data = end.encode().join(lines)
    if not refused(of, data, sort=True):
        assert len(of(data, sort=True)) == len(events)
