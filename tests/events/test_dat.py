import hashlib
import json
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats import Damage
from neuro.events.formats.dat import DAT
from neuro.events.source import WHOLE, Source

HEADER = b"% Data file containing CD events.\n% Version 2\n% Height 480\n% Width 640\n"
CD = b"\x0c\x08"
T_LIMIT = 2**32


def event(t, x=1, y=2, p=1):
    return struct.pack("<II", t, p << 28 | y << 14 | x)


def pieces(data, block=WHOLE):
    """All pieces of a file, and the damage behind them if there is one."""
    found = []
    try:
        found.extend(DAT.open(Source(data)).pieces(block))
    except Damage as damage:
        return found, damage
    return found, None


@pytest.mark.parametrize(
    "name",
    [
        "gen4_first100k.dat",
        "ncars_background_obj_004211_td.dat",
        "ncars_background_obj_004212_td.dat",
        "ncars_background_obj_004213_td.dat",
        "ncars_cars_obj_004414_td.dat",
        "ncars_cars_obj_004415_td.dat",
        "ncars_cars_obj_004416_td.dat",
        "ncars_obj_004397_td.dat",
        "ncars_tonic_sample.dat",
    ],
)
def test_decoding_is_the_known_one(shared, name):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())[name]
    events = load(folder / name)
    assert len(events) == truth["n_events"]
    assert hashlib.sha256(events.records().tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]
    assert events.sensor_size == ((1280, 720) if "gen4" in name else (304, 240))


def test_fields():
    events = load(HEADER + CD + event(7, 639, 479, 0) + event(2**32 - 1, 3, 5))
    assert events.records().tolist() == [(7, 639, 479, 0), (2**32 - 1, 3, 5, 1)]
    assert events.sensor_size == (640, 480)
    assert events.metadata == {
        "format": "dat", "t0": 7, "version": 2, "event_type": 12,
        "header": {"data": "file containing CD events.", "version": "2", "height": "480", "width": "640"},
    }  # fmt: skip


@pytest.mark.parametrize("header", [b"% Version 1\n", b"% Version 0\r\n% Date 2014-01-01\r\n", b"% Date 2014\n%\n"])
def test_version_1(header):
    word = 1 << 17 | 239 << 9 | 303
    data = header + b"\0\x08" + struct.pack("<IIII", 5, word, 6, 0xFFFC0000)
    events = load(data, name="a.dat")
    assert events.records().tolist() == [(5, 303, 239, 1), (6, 0, 0, 0)]
    assert (events.sensor_size, events.metadata["version"]) == ((304, 240), 1)


def test_a_header_without_a_version_and_events_of_the_new_kind():
    assert load(b"% Date 2020\n" + CD + event(1, 400, 300), name="a.dat").x.tolist() == [400]


@pytest.mark.parametrize(
    ("x", "y", "size"),
    [(303, 239, (304, 240)), (304, 0, (640, 480)), (0, 480, (1280, 720)), (1280, 0, (1281, 1))],
)
def test_smallest_sensor_where_none_is_told(x, y, size):
    data = b"% Version 2\n" + CD + event(1, x, y)
    assert load(data).sensor_size == size
    assert [part.sensor_size for part in stream(data)] == [size]


def test_long_header():
    header = b"% Version 2\n" + b"% Remark " + b"x" * 10_000 + b"\n% Width 20\n% Height 10\n"
    assert load(header + CD + event(1)).sensor_size == (20, 10)


def test_clock_wraps():
    data = HEADER + CD + event(T_LIMIT - 5) + event(3) + event(T_LIMIT - 1) + event(0) + event(1)
    expected = [T_LIMIT - 5, T_LIMIT + 3, 2 * T_LIMIT - 1, 2 * T_LIMIT, 2 * T_LIMIT + 1]
    assert load(data).t.tolist() == expected
    for block in (8, 16, 24):
        found, _ = pieces(data, block)
        assert np.concatenate([piece.t for piece in found]).tolist() == expected
        assert all(piece.ordered for piece in found)


def test_a_fall_far_from_the_end_is_no_wrap():
    with pytest.raises(EventFileError, match=f"time runs back from {T_LIMIT // 2 + 100} to 3 us"):
        load(HEADER + CD + event(T_LIMIT // 2 + 100) + event(3))


ERRORS = {
    "a.dat: byte 0: begins with b'', expected a header of lines that begin with '%'": b"",
    "a.dat: byte 0: begins with b'abc', expected a header of lines that begin with '%'": b"abc",
    "a.dat: byte 34: the file ends within a line of its header": HEADER[:40],
    "a.dat: byte 0: the file ends within a line of its header": b"%",
    "a.dat: byte 71: the file ends before the kind and the size of its events": HEADER,
    "a.dat: byte 71: events of kind 0x0e and 8 bytes, expected kind 0x00 or 0x0c (of pixels) and 8 bytes": (
        HEADER + b"\x0e\x08" + bytes(8)
    ),
    "a.dat: byte 71: events of kind 0x0c and 9 bytes, expected kind 0x00 or 0x0c (of pixels) and 8 bytes": (
        HEADER + b"\x0c\x09" + bytes(9)
    ),
    "a.dat: byte 81: 3 bytes left over after 1 events of 8 bytes": HEADER + CD + event(1) + b"abc",
    "a.dat: byte 81: address 0x20000000 has bits above the polarity, expected none": (
        HEADER + CD + event(1) + event(2, 0, 0, 2) + event(3)
    ),
    "a.dat: byte 81: event 1: x is 640, expected 0 to 639 (sensor 640x480)": HEADER + CD + event(1) + event(2, 640),
    "a.dat: byte 81: event 1: time runs back from 9 to 8 us; load(..., sort=True) sorts the events": (
        HEADER + CD + event(9) + event(8)
    ),
    "a.dat: byte 0: header: version is '3', expected 0, 1 or 2": b"% Version 3\n" + CD,
    "a.dat: byte 12: header: width is '-4', expected a width and a height of 1 to 65536 px": (
        b"% Version 2\n% Width -4\n% Height 3\n" + CD
    ),
    "a.dat: byte 12: header: width is '4', expected a width and a height of 1 to 65536 px": (
        b"% Version 2\n% Width 4\n" + CD
    ),
}


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    with pytest.raises(EventFileError) as error:
        load(ERRORS[message], name="a.dat")
    assert str(error.value) == message


def test_a_raw_file_is_no_dat():
    with pytest.raises(EventFileError) as error:
        load(b"% evt 3.0\n", name="a.dat", format="dat")
    assert str(error.value) == "a.dat: byte 0: header: evt is '3.0', expected none, this being that of a RAW file"


def test_what_is_whole_is_read():
    data = HEADER + CD + event(1) + event(2, 0, 0, 2) + event(3)
    with pytest.warns(EventFileWarning, match="byte 81"):
        assert load(data, strict=False).t.tolist() == [1]
    with pytest.warns(EventFileWarning, match="7 bytes left over"):
        assert load(HEADER + CD + event(1) + event(2)[:7], strict=False).t.tolist() == [1]


@st.composite
def recordings(draw):
    n = draw(st.integers(0, 40))
    times = st.one_of(st.integers(0, 100), st.integers(0, T_LIMIT - 1))
    t = np.sort(np.array(draw(st.lists(times, min_size=n, max_size=n)), np.int64))
    x, y, p = (
        np.array(draw(st.lists(st.integers(0, most), min_size=n, max_size=n)), np.int64) for most in (2047, 2047, 1)
    )
    return Events(t, x, y, p, (2048, 2048))


@given(recordings(), st.integers(1, 100), st.integers(0, 40))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_saved_is_loaded(tmp_path, events, block, cut):
    path = tmp_path / "a.dat"
    save(iter([events[:cut], events[cut:]]), path, replace=True)
    assert load(path) == events
    found, damage = pieces(path, block)
    assert damage is None
    for name in "txyp":
        column = np.concatenate([np.zeros(0, np.int64), *(getattr(piece, name) for piece in found)])
        assert np.array_equal(column, getattr(events, name))
    data = path.read_bytes()
    for piece in found:
        for k in range(piece.t.size):
            assert struct.unpack_from("<I", data, piece.place(k))[0] == piece.t[k]


@pytest.mark.parametrize(("t", "x", "y"), [(T_LIMIT, 1, 1), (-1, 1, 1), (5, 1 << 14, 1), (5, 1, 1 << 14)])
def test_cannot_hold(tmp_path, t, x, y):
    events = Events(np.array([min(t, 0), t]), np.array([0, x]), np.array([0, y]), np.array([0, 0]), (20_000, 20_000))
    k = int(t >= 0)
    x, y = (events.x[k], events.y[k])
    with pytest.raises(EventFileError) as error:
        save([events[:0], events], tmp_path / "a.dat")
    assert str(error.value).partition("\n")[0] == (
        f"{tmp_path / 'a.dat'}: cannot hold event {k}: t {t}, x {x}, y {y}; "
        "expected t 0 to 4294967295 us, x and y 0 to 16383"
    )


def test_nothing_is_saved_and_loaded(tmp_path):
    save(Events([], [], [], [], (34, 34)), tmp_path / "a.dat")
    assert len(load(tmp_path / "a.dat")) == 0


@pytest.mark.parametrize("library", ["expelliarmus", "faery"])
def test_other_libraries_read_it(tmp_path, library):
    module = pytest.importorskip(library, reason=f"{library} is not installed")
    rng = np.random.default_rng(0)
    n = 10_000
    events = Events(
        np.cumsum(rng.integers(0, 5, n)), rng.integers(0, 1280, n), rng.integers(0, 720, n), rng.integers(0, 2, n),
        (1280, 720),
    )  # fmt: skip
    path = tmp_path / "a.dat"
    save(events, path)
    if library == "expelliarmus":
        read = module.Wizard(encoding="dat").read(path)
    else:
        read = module.events_stream_from_file(path).to_array()
    for name, other in zip("txyp", read.dtype.names, strict=True):
        assert np.array_equal(read[other], getattr(events, name))
