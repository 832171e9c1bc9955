"""EVT 2.0, EVT 2.1 and RAW files that do not tell their coding."""

import hashlib
import json

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats import Damage
from neuro.events.formats.evt import EVT2, EVT21
from neuro.events.source import WHOLE, Source

HEADER = b"% evt 2.0\n% format EVT2;height=480;width=640\n% geometry 640x480\n% end\n"
HEADER21 = b"% evt 2.1\n% format EVT21;endianness=little;height=480;width=640\n"
T_LIMIT = 2**34
TRIGGER = 10 << 28 | 1


def event(low, x=1, y=2, p=1):
    return p << 28 | low << 22 | x << 11 | y


def high(value):
    return 8 << 28 | value


def words(*values):
    return np.array(values, "<u4").tobytes()


def event21(low, x, y, p, bits):
    return event(low, x, y, p) << 32 | bits


def words21(*values, legacy=False):
    data = np.array(values, "<u8")
    return data.view("<u4").reshape(-1, 2)[:, ::-1].tobytes() if legacy else data.tobytes()


def literal(data, wide=False):
    """What the specification says, word by word: events, their words, words left out."""
    begin = before = None
    wraps, left, found, places = 0, 0, [], []
    for k, word in enumerate(np.frombuffer(data, "<u8" if wide else "<u4").tolist()):
        bits, word = (word & 0xFFFFFFFF, word >> 32) if wide else (1, word)
        kind, value = word >> 28, word & 0xFFFFFFF
        if kind == 8:
            if before is not None and before >= 15 * 2**24 and value < 2**24:
                wraps += T_LIMIT
            begin, before = wraps + value * 64, value
        elif kind < 2 and begin is not None:
            for i in range(32):
                if bits >> i & 1:
                    found.append((begin + (word >> 22 & 63), (word >> 11 & 2047) + i, word & 2047, kind))
                    places.append(k)
        else:
            left += 1
    return found, places, left


def pieces(format, data, block=WHOLE):
    """All events of a file as it is, their bytes, and the words left out."""
    reader = format.open(Source(data))
    found, places = [], []
    for piece in reader.pieces(block):
        found += zip(piece.t.tolist(), piece.x.tolist(), piece.y.tolist(), piece.p.tolist(), strict=True)
        places += [piece.place(k) for k in range(piece.t.size)]
        assert piece.highest == (max(piece.x.tolist(), default=-1), max(piece.y.tolist(), default=-1))
        assert not piece.ordered or (np.diff(piece.t) >= 0).all()
    return found, places, reader.metadata.get("other_words", 0)


def test_decoding_is_the_known_one(shared):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())["evt2_gen3.raw"]
    events = load(folder / "evt2_gen3.raw")
    assert len(events) == truth["n_events"]
    assert hashlib.sha256(events.records().tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]
    assert events.sensor_size == (640, 480)
    assert events.metadata["header"]["plugin_name"] == "hal_plugin_gen3_fx3"


def test_fields():
    events = load(HEADER + words(high(3), event(63, 639, 479, 0), TRIGGER, high(5), event(0, 4, 5)))
    assert events.records().tolist() == [(255, 639, 479, 0), (320, 4, 5, 1)]
    assert events.sensor_size == (640, 480)
    assert {key: events.metadata[key] for key in ("format", "t0", "other_words")} == {
        "format": "evt2", "t0": 255, "other_words": 1,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("header", "size"),
    [
        (b"% evt 2.0\n% geometry 320x240\n", (320, 240)),
        (b"% format EVT2;height=320;width=310\n% end\n", (310, 320)),
        (b"% evt 2.0\n% plugin_name hal_plugin_gen41_evk3\n", (1280, 720)),
        (b"% evt 2.0\n% plugin_name hal_plugin_gen31_fx3\n", (640, 480)),
        (b"% evt 2.0\n% sensor_name IMX636\n", (1280, 720)),
        (b"% evt 2.0\n% plugin_name hal_plugin_genx320_cx3\n", (320, 320)),
        (b"% evt 2.0\n", (640, 480)),
    ],
)
def test_sensors(header, size):
    data = header + words(high(1), event(0))
    assert load(data).sensor_size == size
    assert next(stream(data)).sensor_size == size


def test_no_sensor_told():
    assert load(b"% evt 2.0\n" + words(high(1), event(0, 0, 480))).sensor_size == (1280, 720)
    assert load(b"% evt 2.0\n" + words(high(1), event(0, 0, 720))).sensor_size == (1, 721)


def test_first_word_may_look_like_a_line():
    data = words(high(1), event(1, 7, 9)).replace(words(high(1)), b"% \x01\x80")
    assert load(HEADER + data).t.tolist() == [0x12025 * 64 + 1]
    assert load(b"% evt 2.0\n" + data).t.tolist() == [0x12025 * 64 + 1]


words_of_a_file = st.lists(
    st.one_of(
        st.builds(event, st.integers(0, 63), st.integers(0, 2047), st.integers(0, 2047), st.integers(0, 1)),
        st.builds(high, st.one_of(st.integers(0, 3), st.integers(2**28 - 3, 2**28 - 1))),
        st.integers(0, 2**32 - 1),
    ),
    max_size=30,
)


@given(words_of_a_file, st.integers(0, 200), st.integers(1, 60))
@example([TRIGGER, event(1)], 0, 4)
@settings(deadline=None)
def test_any_words_are_as_the_specification_says(some, run, block):
    data = words(high(1), *some, *[event(k % 64, k, 2 * k) for k in range(run)])
    found, places, left = literal(data)
    expected = found, [len(HEADER) + 4 * k for k in places], left
    assert pieces(EVT2, HEADER + data) == expected
    assert pieces(EVT2, HEADER + data, block) == expected


def test_words_before_the_first_time_are_left_out():
    data = words(*[event(k % 64) for k in range(100)], high(2), event(5))
    assert pieces(EVT2, HEADER + data) == ([(133, 1, 2, 1)], [len(HEADER) + 404], 100)


def test_clock_wraps():
    top = 2**28 - 1
    events = load(HEADER + words(high(top), event(63), high(0), event(0), high(top), event(0), high(3), event(1)))
    assert events.t.tolist() == [T_LIMIT - 1, T_LIMIT, 2 * T_LIMIT - 64, 2 * T_LIMIT + 193]


ERRORS = {
    "a.raw: byte 78: 1 bytes left over after 2 words of 4 bytes": HEADER + words(high(1), event(1)) + b"a",
    "a.raw: byte 70: no word of EVT 2.0 tells the time of what follows": HEADER + words(event(1)),
    "a.raw: byte 78: event 1: x is 640, expected 0 to 639 (sensor 640x480)": (
        HEADER + words(high(1), event(1), event(1, 640))
    ),
    "a.raw: byte 82: event 1: time runs back from 129 to 65 us; load(..., sort=True) sorts the events": (
        HEADER + words(high(2), event(1), high(1), event(1))
    ),
    "a.raw: byte 10: the file ends within a line of its header": HEADER[:30],
    "a.raw: byte 0: header: format is 'EVT4', expected that of EVT 2.0, 2.1 or 3.0": b"% format EVT4\n",
    "a.raw: byte 0: header: evt is '4.0', expected that of EVT 2.0, 2.1 or 3.0": b"% evt 4.0\n",
    "a.raw: byte 0: header: format is 'EVT2;endianness=big', expected endianness little": (
        b"% format EVT2;endianness=big\n"
    ),
    "a.raw: byte 10: header: geometry is '640', expected a width and a height of 1 to 65536 px": (
        b"% evt 2.0\n% geometry 640\n"
    ),
    "a.raw: byte 0: no words, and no header that tells their coding": b"",
    "a.raw: byte 12: no words, and no header that tells their coding": b"% Date 2018\n",
    "a.raw: byte 0: no header tells the coding, and the words are none of EVT 2.0, 2.1 or 3.0": bytes(range(40)),
}


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    with pytest.raises(EventFileError) as error:
        load(ERRORS[message], name="a.raw")
    assert str(error.value) == message


def test_another_coding_than_asked_for():
    with pytest.raises(EventFileError) as error:
        load(HEADER, name="a.raw", format="evt21")
    assert str(error.value) == (
        "a.raw: byte 10: header: format is 'EVT2;height=480;width=640', expected that of EVT 2.1"
    )
    with pytest.raises(EventFileError) as error:
        load(b"", name="a.raw", format="evt2")
    assert str(error.value) == "a.raw: byte 0: is empty, expected a header or words of EVT 2.0"


def test_what_is_whole_is_read():
    with pytest.warns(EventFileWarning, match="byte 78: 3 bytes left over"):
        assert load(HEADER + words(high(1), event(1), event(2))[:-1], strict=False).t.tolist() == [65]


def test_a_late_event_is_found_in_a_long_file():
    data = HEADER + words(*[word for k in range(30_000) for word in (high(k), event(1))], event(2, 700))
    with pytest.raises(EventFileError) as error:
        load(data)
    assert error.value.offset == len(HEADER) + 4 * 60_000


@st.composite
def recordings(draw):
    n = draw(st.integers(0, 40))
    times = st.one_of(st.integers(0, 300), st.integers(0, T_LIMIT - 1))
    t = np.sort(np.array(draw(st.lists(times, min_size=n, max_size=n)), np.int64))
    x, y, p = (
        np.array(draw(st.lists(st.integers(0, most), min_size=n, max_size=n)), np.int64) for most in (2047, 2047, 1)
    )
    return Events(t, x, y, p, (2048, 2048))


@given(recordings(), st.integers(0, 40))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_saved_is_loaded(tmp_path, events, cut):
    path = tmp_path / "a.raw"
    save(iter([events[:cut], events[cut:]]), path, replace=True, format="evt2")
    assert load(path) == events
    words = np.frombuffer(path.read_bytes().split(b"% end\n")[-1], "<u4")
    assert words.size == len(events) + len(np.unique(events.t >> 6))


@pytest.mark.parametrize(("t", "x", "y"), [(T_LIMIT, 1, 1), (5, 2048, 1), (5, 1, 2048)])
def test_cannot_hold(tmp_path, t, x, y):
    events = Events(np.array([0, t]), np.array([0, x]), np.array([0, y]), np.array([0, 0]), (3000, 3000))
    with pytest.raises(EventFileError) as error:
        save(events, tmp_path / "a.raw", format="evt2")
    assert str(error.value).partition("\n")[0] == (
        f"{tmp_path / 'a.raw'}: cannot hold event 1: t {t}, x {x}, y {y}; "
        "expected t 0 to 17179869183 us, x and y 0 to 2047"
    )


def test_nothing_is_saved_and_loaded(tmp_path):
    save(Events([], [], [], [], (34, 34)), tmp_path / "a.raw", format="evt2")
    assert len(load(tmp_path / "a.raw")) == 0


words21_of_a_file = st.lists(
    st.one_of(
        st.builds(
            event21, st.integers(0, 63), st.integers(0, 63).map(lambda k: 32 * k), st.integers(0, 2047),
            st.integers(0, 1), st.integers(0, 2**32 - 1),
        ),
        st.builds(lambda value: high(value) << 32, st.one_of(st.integers(0, 3), st.integers(2**28 - 3, 2**28 - 1))),
        st.integers(10 << 60, 11 << 60),
    ),
    max_size=20,
)  # fmt: skip


@given(words21_of_a_file, st.integers(1, 60))
@settings(deadline=None)
def test_evt21_is_as_the_specification_says(some, block):
    values = [high(1) << 32, *some]
    found, places, left = literal(words21(*values), wide=True)
    expected = found, [len(HEADER21) + 8 * k for k in places], left
    assert pieces(EVT21, HEADER21 + words21(*values)) == expected
    assert pieces(EVT21, HEADER21 + words21(*values), block * EVT21.open(Source(HEADER21)).swell) == expected


@pytest.mark.parametrize("order", [b";endianness=little", b";endianness=legacy", b""])
@pytest.mark.parametrize("legacy", [False, True])
def test_evt21_halves(order, legacy):
    if order:
        legacy = order.endswith(b"legacy")
    values = [high(1) << 32, event21(3, 32, 7, 1, 0x80000001), high(2) << 32, event21(0, 64, 8, 0, 1 << 20 | 15)]
    events = load(b"% format EVT21" + order + b"\n" + words21(*values, legacy=legacy))
    assert events.x.tolist() == [32, 63, 64, 65, 66, 67, 84]
    assert events.t.tolist() == [67, 67, *[128] * 5]
    assert events.p.tolist() == [1, 1, *[0] * 5]
    assert (events.metadata["format"], events.sensor_size) == ("evt21", (640, 480))
    assert "no recording was to be had" in EVT21.untested


def test_the_coding_is_told_by_the_words(tmp_path):
    rng = np.random.default_rng(0)
    n = 500
    events = Events(
        np.cumsum(rng.integers(0, 40, n)), rng.integers(0, 640, n), rng.integers(0, 480, n), rng.integers(0, 2, n),
        (640, 480),
    )  # fmt: skip
    for coding in ("evt2", "evt3"):
        save(events, tmp_path / "a.raw", format=coding, replace=True)
        data = (tmp_path / "a.raw").read_bytes().split(b"% end\n")[-1]
        for header in (b"", b"% Date 2018-01-01\n"):
            found = load(header + data, name="a.raw")
            assert found == events
            assert found.metadata["format"] == coding
    wide = [w for k in range(50) for w in (high(k) << 32, event21(k, 32 * (k % 20), 9, k % 2, 1 << k % 32 | 1))]
    for legacy in (False, True):
        found = load(words21(*wide, legacy=legacy), name="a.raw")
        assert found.metadata["format"] == "evt21"
        assert found.records().tolist() == literal(words21(*wide), wide=True)[0]


def test_damage_has_a_place():
    with pytest.raises(Damage) as error:
        pieces(EVT2, HEADER + words(event(1)))
    assert error.value.offset == len(HEADER)


@pytest.mark.parametrize("library", ["expelliarmus", "faery"])
def test_other_libraries_read_it(tmp_path, library):
    module = pytest.importorskip(library, reason=f"{library} is not installed")
    rng = np.random.default_rng(0)
    n = 10_000
    events = Events(
        np.cumsum(rng.integers(0, 50, n)), rng.integers(0, 1280, n), rng.integers(0, 720, n), rng.integers(0, 2, n),
        (1280, 720),
    )  # fmt: skip
    path = tmp_path / "a.raw"
    save(events, path, format="evt2")
    if library == "expelliarmus":
        read = module.Wizard(encoding="evt2").read(path)
    else:
        read = module.events_stream_from_file(path).to_array()
    for name, other in zip("txyp", read.dtype.names, strict=True):
        assert np.array_equal(read[other], getattr(events, name))
