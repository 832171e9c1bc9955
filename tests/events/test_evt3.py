import hashlib
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats.evt import EVT3, SLICE
from neuro.events.source import WHOLE, Source

HEADER = b"% evt 3.0\n% format EVT3;height=720;width=1280\n% geometry 1280x720\n% end\n"
ROW, SINGLE, BASE, VECT_12, VECT_8, LOW, HIGH = (kind << 12 for kind in (0, 2, 3, 4, 5, 6, 8))
ON = 1 << 11
TRIGGER, OTHER_ROW = 10 << 12, 1 << 12


def words(*values):
    return np.array(values, "<u2").tobytes()


def literal(data):
    """What the specification says, word by word: events, their words, words left out."""
    high = low = row = base = p = None
    wraps, left, found, places = 0, 0, [], []
    for k, word in enumerate(np.frombuffer(data, "<u2").tolist()):
        kind, value = word >> 12, word & 0xFFF
        bits = {2: 1, 4: value, 5: value & 0xFF}.get(kind)
        if high is None and kind != 8:
            left += 1
        elif kind == 8:
            if value != high:
                wraps += 2**24 if high is not None and high >= value + 2048 else 0
                high, low = value, 0
        elif kind == 6:
            low = value
        elif kind == 0:
            row = value & 0x7FF
        elif kind == 3:
            base, p = value & 0x7FF, value >> 11
        elif bits is None or row is None or (kind != 2 and base is None):
            row = None if kind == 1 else row
            left += 1
        else:
            first, on = (value & 0x7FF, value >> 11) if kind == 2 else (base, p)
            for i in range(12):
                if bits >> i & 1:
                    found.append((wraps + high * 4096 + low, first + i, row, on))
                    places.append(k)
            base = base if kind == 2 else base + (12 if kind == 4 else 8)
    return found, places, left


def pieces(data, block=WHOLE):
    """All events of a file as it is, their bytes, and the words left out."""
    reader = EVT3.open(Source(data))
    found, places = [], []
    for piece in reader.pieces(block):
        found += zip(piece.t.tolist(), piece.x.tolist(), piece.y.tolist(), piece.p.tolist(), strict=True)
        places += [piece.place(k) for k in range(piece.t.size)]
        assert piece.highest == (max(piece.x.tolist(), default=-1), max(piece.y.tolist(), default=-1))
        assert not piece.ordered or (np.diff(piece.t) >= 0).all()
    return found, places, reader.metadata.get("other_words", 0)


@pytest.mark.parametrize("name", ["evt3_gen41.raw", "evt3_imx636_wrap.raw"])
def test_decoding_is_the_known_one(shared, name):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())[name]
    events = load(folder / name)
    assert len(events) == truth["n_events"]
    assert hashlib.sha256(events.records().tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]
    assert events.sensor_size == (1280, 720)
    others = sum(truth["word_types"].get(kind, 0) for kind in ("0x7", "0xe", "0xf"))
    assert events.metadata["other_words"] == others
    assert sum(map(len, stream(folder / name))) == len(events)


def test_fields():
    data = words(
        HIGH | 1, LOW | 5, ROW | 719, SINGLE | ON | 1279, SINGLE | 3, TRIGGER,
        BASE | ON | 100, VECT_12 | 0x801, VECT_8 | 0x81, VECT_12 | 1, LOW | 6, VECT_8 | 0xF02,
    )  # fmt: skip
    events = load(HEADER + data)
    assert events.x.tolist() == [1279, 3, 100, 111, 112, 119, 120, 133]
    assert events.t.tolist() == [*[4101] * 7, 4102]
    assert events.p.tolist() == [1, 0, 1, 1, 1, 1, 1, 1]
    assert set(events.y.tolist()) == {719}
    assert (events.sensor_size, events.metadata["other_words"]) == ((1280, 720), 1)


@pytest.mark.parametrize(
    ("some", "times"),
    [
        ([HIGH | 1, SINGLE, LOW | 9, SINGLE, HIGH | 1, SINGLE, HIGH | 2, SINGLE], [4096, 4105, 4105, 8192]),
        ([HIGH | 1, LOW | 811, LOW | 800, SINGLE], [4896]),
        ([HIGH | 4095, SINGLE, HIGH | 0, SINGLE, LOW | 1, SINGLE], [4095 << 12, 1 << 24, (1 << 24) + 1]),
        ([HIGH | 2048, SINGLE, HIGH, SINGLE, HIGH | 2049, HIGH, SINGLE], [1 << 23, 1 << 24, 2 << 24]),
    ],
)
def test_clock(some, times):
    assert load(HEADER + words(HIGH, ROW, *some)).t.tolist() == times


def test_a_small_fall_of_the_high_time_is_no_wrap():
    with pytest.raises(EventFileError, match=r"byte 80: event 1: time runs back from 8388608 to 4096 us"):
        load(HEADER + words(HIGH | 2048, ROW, SINGLE, HIGH | 1, SINGLE))


def test_events_without_a_time_or_a_row_are_left_out():
    data = words(ROW | 1, SINGLE, HIGH | 1, SINGLE, VECT_8 | 1, ROW | 2, VECT_8 | 1, SINGLE | 7, OTHER_ROW, SINGLE)
    events = load(HEADER + data)
    assert events.records().tolist() == [(4096, 7, 2, 0)]
    assert events.metadata["other_words"] == 7


values = st.integers(0, 4095)
words_of_a_file = st.lists(
    st.one_of(
        st.builds(lambda kind, value: kind << 12 | value, st.sampled_from([0, 2, 3, 4, 5, 6]), values),
        st.builds(lambda value: HIGH | value, st.one_of(st.integers(0, 3), st.integers(2046, 2050), st.just(4095))),
        st.integers(0, 65535),
    ),
    max_size=60,
)


@given(words_of_a_file, st.integers(1, 50))
@example([BASE, *[VECT_12 | 0xFFF] * 40], 9)
@settings(deadline=None, max_examples=200)
def test_any_words_are_as_the_specification_says(some, block):
    data = words(*some, HIGH | 7, ROW | 3, SINGLE | 5)
    found, places, left = literal(data)
    expected = found, [len(HEADER) + 2 * k for k in places], left
    assert pieces(HEADER + data) == expected
    assert pieces(HEADER + data, block * EVT3.open(Source(HEADER)).swell) == expected


def test_a_vector_does_not_run_round_the_columns():
    x = load(b"% evt 3.0\n" + words(HIGH, ROW, BASE, *[VECT_12 | 1] * 6000)).x
    assert x.size == 6000
    assert (np.diff(x.astype(int)) >= 0).all()


ERRORS = {
    "a.raw: byte 76: 1 bytes left over after 2 words of 2 bytes": HEADER + words(HIGH, ROW) + b"a",
    "a.raw: byte 72: no word of EVT 3.0 tells the time of what follows": HEADER + words(ROW, SINGLE),
    "a.raw: byte 78: event 1: x is 1280, expected 0 to 1279 (sensor 1280x720)": (
        HEADER + words(HIGH, ROW, SINGLE, SINGLE | 1280)
    ),
    "a.raw: byte 76: event 0: y is 720, expected 0 to 719 (sensor 1280x720)": HEADER + words(HIGH, ROW | 720, SINGLE),
    "a.raw: byte 82: event 1: time runs back from 9 to 8 us; load(..., sort=True) sorts the events": (
        HEADER + words(HIGH, LOW | 9, ROW, SINGLE, LOW | 8, SINGLE)
    ),
    "a.raw: byte 10: the file ends within a line of its header": HEADER[:30],
}  # fmt: skip


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    with pytest.raises(EventFileError) as error:
        load(ERRORS[message], name="a.raw")
    assert str(error.value) == message


def test_what_is_whole_is_read():
    with pytest.warns(EventFileWarning, match="1 bytes left over"):
        assert load(HEADER + words(HIGH, ROW, SINGLE | 3) + b"a", strict=False).x.tolist() == [3]


@st.composite
def recordings(draw):
    """Events with runs of neighbours, and pauses of some wraps of the clock."""
    groups = draw(
        st.lists(
            st.tuples(
                st.sampled_from([0, 1, 5, 4096, 2**24 - 1, 2**24, 5 * 2**24 + 7]), st.integers(0, 2047),
                st.integers(0, 2047), st.integers(0, 1), st.lists(st.integers(0, 14), max_size=12),
            ),
            max_size=12,
        )
    )  # fmt: skip
    rows, t = [], draw(st.sampled_from([0, 1, 4095, 2**24 + 3, 2**26]))
    for pause, x, y, p, gaps in groups:
        t += pause
        columns = np.minimum(x + np.cumsum([0, *gaps]), 2047)
        rows += [(t, column, y, p) for column in columns]
    fields = np.array(rows, np.int64).reshape(-1, 4).T
    return Events(*fields, (2048, 2048))


@given(recordings(), st.integers(0, 60))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_saved_is_loaded(tmp_path, events, cut):
    path = tmp_path / "a.raw"
    save(iter([events[:cut], events[cut:]]), path, replace=True)
    assert load(path) == events
    assert load(path).metadata["format"] == "evt3"


def test_long_recordings_are_saved_in_slices(tmp_path):
    n = 2 * SLICE + 5
    k = np.arange(n)
    events = Events(k // 30, k % 30, k // 30 % 700, k // 60 % 2, (1280, 720))
    save(events, tmp_path / "a.raw")
    assert load(tmp_path / "a.raw") == events


def test_neighbours_are_saved_as_vectors(tmp_path):
    n = 36
    events = Events(np.zeros(n, int), np.arange(n), np.zeros(n, int), np.ones(n, int), (1280, 720))
    save(events, tmp_path / "a.raw")
    data = (tmp_path / "a.raw").read_bytes()
    assert data == HEADER + words(HIGH, LOW, ROW, BASE | ON, *[VECT_12 | 0xFFF] * 3)


@pytest.mark.parametrize(("t", "x", "y"), [(2**40, 1, 1), (5, 2048, 1), (5, 1, 2048)])
def test_cannot_hold(tmp_path, t, x, y):
    events = Events(np.array([0, t]), np.array([0, x]), np.array([0, y]), np.array([0, 0]), (3000, 3000))
    with pytest.raises(EventFileError) as error:
        save(events, tmp_path / "a.raw")
    assert str(error.value).partition("\n")[0] == (
        f"{tmp_path / 'a.raw'}: cannot hold event 1: t {t}, x {x}, y {y}; "
        "expected t 0 to 1099511627775 us, x and y 0 to 2047"
    )


def test_nothing_is_saved_and_loaded(tmp_path):
    save(Events([], [], [], [], (34, 34)), tmp_path / "a.raw")
    assert len(load(tmp_path / "a.raw")) == 0


def test_another_library_reads_it(tmp_path):
    """In the order of rising low times faery is right; across a wrap in a pause it is not."""
    faery = pytest.importorskip("faery", reason="faery is not installed")
    rng = np.random.default_rng(0)
    n = 10_000
    group = np.repeat(np.arange(n // 4), 4)
    t, y, p = np.cumsum(rng.integers(0, 3, n // 4)), rng.integers(0, 720, n // 4), rng.integers(0, 2, n // 4)
    x = rng.integers(0, 1200, n // 4)[group] + np.tile([0, 2, 5, 30], n // 4)
    events = Events(t[group], x, y[group], p[group], (1280, 720))
    save(events, tmp_path / "a.raw")
    read = faery.events_stream_from_file(tmp_path / "a.raw").to_array()
    for name, other in zip("txyp", read.dtype.names, strict=True):
        assert np.array_equal(read[other], getattr(events, name))
