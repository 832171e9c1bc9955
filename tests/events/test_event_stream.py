import hashlib
import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, Events, load, save
from neuro.events.formats.event_stream import LONGEST_GAP, EventStream, generic
from neuro.events.source import Source

GENERIC = b"Event Stream\x02\x00\x00\x00"
DVS = b"Event Stream\x02\x00\x00\x01" + bytes([30, 0, 44, 1])
OVERFLOW, RESET = b"\xff", b"\xfe"


def event(gap, x, y, p=1):
    return bytes([gap << 1 | p, x & 255, x >> 8, y & 255, y >> 8])


@pytest.mark.parametrize("name", ["es_dvs_320x240.es", "es_poker_club_trcl0.es"])
def test_decoding_is_the_known_one(shared, name):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())[name]
    events = load(folder / name)
    assert len(events) == truth["n_events"]
    assert hashlib.sha256(events.records().tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]
    assert events.sensor_size == (truth["width"], truth["height"])


def test_rows_are_those_of_the_same_recording_in_other_files(shared):
    club = load(shared / "data" / "formats" / "es_poker_club_trcl0.es")
    arrays = np.load(shared / "data" / "poker_dvs" / "poker_dvs_shared.npz")
    k = arrays["names"].tolist().index("xclub04")
    part = slice(arrays["offsets"][k], arrays["offsets"][k + 1])
    assert part.stop - part.start == len(club)
    for name in "xyp":
        assert np.ptp(arrays[name][part]) == np.ptp(getattr(club, name))
        shift = arrays[name][part].astype(int) - getattr(club, name)
        assert np.unique(shift).size == 1, name


def test_generic_is_the_known_one(shared):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())["es_generic.es"]
    events = generic(folder / "es_generic.es")
    assert len(events) == truth["n_events"]
    assert [events[0][0], events[0][1].decode()] == truth["first"]
    assert (events[-1][0], len(events[-1][1])) == (truth["last_t"], truth["last_len"])


def test_fields():
    data = DVS + OVERFLOW + RESET + event(3, 29, 299, 0) + event(0, 1, 254) + OVERFLOW * 2 + event(126, 254, 2)
    events = load(data, sensor_size=(300, 300))
    assert events.records().tolist() == [(130, 29, 299, 0), (130, 1, 254, 1), (510, 254, 2, 1)]
    assert load(data[:32]).sensor_size == (30, 300)
    assert load(data[:32]).metadata == {"format": "event_stream", "t0": 130, "version": "2.0.0"}


def test_generic_fields():
    long = bytes(range(200))
    data = (
        GENERIC
        + b"\x05\x06abc"
        + OVERFLOW
        + RESET
        + b"\x00\x01\x00"
        + b"\xfd"
        + bytes([(200 & 127) << 1 | 1, 2])
        + long
    )
    assert generic(data) == [(5, b"abc"), (259, b""), (512, long)]
    assert generic(GENERIC) == []


BYTES = st.sampled_from([OVERFLOW, RESET, event(0, 1, 2), event(126, 254, 255, 0), event(9, 255, 254)])


@given(st.lists(BYTES, max_size=30), st.integers(1, 60))
@settings(deadline=None)
def test_any_block_gives_the_same(parts, block):
    results = []
    for size in (1 << 20, block):
        pieces = list(EventStream(Source(DVS + b"".join(parts))).pieces(size))
        columns = [[int(v) for piece in pieces for v in getattr(piece, name)] for name in "txyp"]
        places = [piece.place(k) for piece in pieces for k in range(piece.t.size)]
        highest = np.max([piece.highest for piece in pieces], axis=0, initial=-1).tolist()
        results.append((columns, places, highest))
    assert results[0] == results[1]
    begins = np.cumsum([len(DVS), *(len(part) for part in parts)])[:-1]
    assert results[0][1] == [begin for begin, part in zip(begins, parts, strict=True) if len(part) == 5]


@st.composite
def recordings(draw):
    width, height = size = draw(st.sampled_from([(1, 1), (34, 34), (1280, 720), (65535, 65535)]))
    n = draw(st.integers(0, 50))
    gaps = st.one_of(st.integers(0, 400), st.sampled_from([126, 127, 128, 254, 100_000]))
    t = np.cumsum(draw(st.lists(gaps, min_size=n, max_size=n)), dtype=np.int64)
    limits = (width - 1, height - 1, 1)
    columns = [np.array(draw(st.lists(st.integers(0, most), min_size=n, max_size=n)), np.int64) for most in limits]
    return Events(t, *columns, size)


@given(recordings(), st.integers(0, 50))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_saved_is_loaded(tmp_path, events, cut):
    path = tmp_path / "a.es"
    save(iter([events[:cut], events[cut:]]), path, replace=True)
    assert load(path) == events


def test_saving_a_file_gives_the_file(shared, tmp_path):
    path = shared / "data" / "formats" / "es_poker_club_trcl0.es"
    save(load(path), tmp_path / "a.es")
    assert (tmp_path / "a.es").read_bytes() == path.read_bytes()
    save(Events([], [], [], [], (34, 34)), tmp_path / "a.es", replace=True)
    assert len(load(tmp_path / "a.es")) == 0


def test_cannot_hold(tmp_path):
    def of(*t, size=(10, 10)):
        zero = np.zeros(len(t), int)
        return Events(np.array(t), zero, zero, zero, size)

    limits = f"expected t from 0 us on, and at most {LONGEST_GAP} us after the event before or 0"
    for parts, what in (
        ([of(1), of(1, LONGEST_GAP + 2)], f"event 2: t {LONGEST_GAP + 2}, x 0, y 0; {limits}"),
        ([of(-3, 5)], f"event 0: t -3, x 0, y 0; {limits}"),
        ([of(1, size=(65536, 2))], "event 0: its sensor is 65536x2, expected at most 65535x65535"),
    ):
        with pytest.raises(EventFileError) as error:
            save(iter(parts), tmp_path / "a.es")
        assert str(error.value).partition("\n")[0] == f"{tmp_path / 'a.es'}: cannot hold {what}"
        assert bool(error.value.hint) == what.startswith("event 0")  # no filter closes a gap
    assert not list(tmp_path.iterdir())


ERRORS = {
    "a.es: byte 0: begins with b'', expected b'Event Stream'": b"",
    "a.es: byte 14: the header has 14 bytes, expected 16": DVS[:14],
    "a.es: byte 18: the header has 18 bytes, expected 20": DVS[:18],
    "a.es: byte 12: version 1.0.0, expected 2": b"Event Stream\x01\x00\x00\x01",
    "a.es: byte 15: type 7, expected 0 to 4": b"Event Stream\x02\x00\x00\x07",
    "a.es: byte 15: has ATIS events, expected DVS events": b"Event Stream\x02\x00\x00\x02",
    "a.es: byte 15: has generic events, which neuro.events.formats.event_stream.generic reads": GENERIC,
    "a.es: byte 16: sensor size 0x5, expected at least 1x1": DVS[:16] + b"\0\0\x05\0",
    "a.es: byte 26: the last event is cut after 3 of 5 bytes": DVS + event(1, 2, 3) + OVERFLOW + b"abc",
    "a.es: byte 26: event 1: x is 30, expected 0 to 29 (sensor 30x300)": DVS + event(1, 2, 3) + RESET + event(1, 30, 3),
}


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    with pytest.raises(EventFileError) as error:
        load(ERRORS[message], name="a.es")
    assert str(error.value) == message


GENERIC_ERRORS = {
    "a.es: byte 0: begins with b'abc', expected b'Event Stream'": b"abc",
    "a.es: byte 15: has DVS events, expected generic events": DVS,
    "a.es: byte 21: the last event is cut after 1 bytes": GENERIC + b"\x05\x06abc\x01",
    "a.es: byte 21: the last event is cut after 3 bytes": GENERIC + b"\x05\x06abc\x01\x03\x03",
    "a.es: byte 21: an event has 4 bytes, but only 2 are left": GENERIC + b"\x05\x06abc\x01\x08ab",
}


@pytest.mark.parametrize("message", GENERIC_ERRORS)
def test_generic_messages(message):
    with pytest.raises(EventFileError) as error:
        generic(GENERIC_ERRORS[message], name="a.es")
    assert str(error.value) == message


def test_what_is_whole_is_kept():
    message = "a.es: byte 25: the last event is cut after 2 of 5 bytes; what is before it was read"
    with pytest.warns(EventFileWarning) as told:
        assert load(DVS + event(1, 2, 3) + b"ab", name="a.es", strict=False).t.tolist() == [1]
    assert [str(warning.message) for warning in told] == [message]
    message = "a.es: byte 21: the last event is cut after 1 bytes; what is before it was read"
    with pytest.warns(EventFileWarning) as told:
        assert generic(GENERIC + b"\x05\x06abc\x01", name="a.es", strict=False) == [(5, b"abc")]
    assert [str(warning.message) for warning in told] == [message]


def test_sizes_without_end_are_refused():
    with pytest.raises(EventFileError, match=r"byte 16: the last event is cut"):
        generic(GENERIC + b"\x05" + b"\xff" * 100_000)
    with pytest.raises(EventFileError, match=r"byte 16: the last event is cut"):
        generic(GENERIC + b"\x05" + b"\x01" * 100_000)


def test_other_libraries_read_what_is_saved(tmp_path):
    event_stream = pytest.importorskip("event_stream", reason="event_stream is not installed")
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.integers(0, 1000, 5000))
    events = Events(t, rng.integers(0, 640, 5000), rng.integers(0, 480, 5000), rng.integers(0, 2, 5000), (640, 480))
    save(events, tmp_path / "a.es")
    decoder = event_stream.Decoder(str(tmp_path / "a.es"))
    assert (decoder.type, decoder.width, decoder.height) == ("dvs", 640, 480)
    theirs = np.concatenate(list(decoder))
    for name, column in zip(("t", "x", "y", "on"), (events.t, events.x, events.y, events.p), strict=True):
        assert np.array_equal(theirs[name], column), name


def test_reading_is_imported_lightly():
    code = "import sys, neuro.events.formats.event_stream; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
