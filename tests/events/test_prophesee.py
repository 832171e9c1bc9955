"""DAT, and RAW files in EVT 2.0, 2.1 and 3.0 or without a word of their coding."""

import struct

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from event_tests import random_events, read_pieces, rows
from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats import FORMATS
from neuro.events.formats.evt import EVT21, SLICE
from neuro.events.source import Source

DAT = b"% Data file containing CD events.\n% Version 2\n% Height 480\n% Width 640\n\x0c\x08"
EVT2 = b"% evt 2.0\n% format EVT2;height=480;width=640\n% geometry 640x480\n% end\n"
EVT21_ = b"% evt 2.1\n% format EVT21;endianness=little;height=480;width=640\n"
EVT3 = b"% evt 3.0\n% format EVT3;height=720;width=1280\n% geometry 1280x720\n% end\n"
T_DAT, T_EVT2 = 2**32, 2**34
TRIGGER = 10 << 28 | 1
ROW, SINGLE, BASE, VECT_12, VECT_8, LOW, HIGH = (kind << 12 for kind in (0, 2, 3, 4, 5, 6, 8))
ON, TRIGGER_3, OTHER_ROW = 1 << 11, 10 << 12, 1 << 12


def cd(t, x=1, y=2, p=1):
    """An event of DAT."""
    return struct.pack("<II", t, p << 28 | y << 14 | x)


def event(low, x=1, y=2, p=1):
    return p << 28 | low << 22 | x << 11 | y


def high(value):
    return 8 << 28 | value


def event21(low, x, y, p, bits):
    return event(low, x, y, p) << 32 | bits


def words(*values, kind="<u4"):
    return np.array(values, kind).tobytes()


def words21(*values, legacy=False):
    data = np.array(values, "<u8")
    return data.view("<u4").reshape(-1, 2)[:, ::-1].tobytes() if legacy else data.tobytes()


def words3(*values):
    return words(*values, kind="<u2")


def literal2(data, wide=False):
    """What the specification of EVT 2.0 or 2.1 says, word by word: events, their words, words left out."""
    begin = before = None
    wraps, left, found, places = 0, 0, [], []
    for k, word in enumerate(np.frombuffer(data, "<u8" if wide else "<u4").tolist()):
        bits, word = (word & 0xFFFFFFFF, word >> 32) if wide else (1, word)
        kind, value = word >> 28, word & 0xFFFFFFF
        if kind == 8:
            if before is not None and before >= 15 * 2**24 and value < 2**24:
                wraps += T_EVT2
            begin, before = wraps + value * 64, value
        elif kind < 2 and begin is not None:
            for i in range(32):
                if bits >> i & 1:
                    found.append((begin + (word >> 22 & 63), (word >> 11 & 2047) + i, word & 2047, kind))
                    places.append(k)
        else:
            left += 1
    return found, places, left


def literal3(data):
    """The same for EVT 3.0."""
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


def as_specified(name, header, data, literal, size, block):
    """Read at once and in blocks, words are what the specification says of them."""
    found, places, left = literal
    for blocks in ((), (block,)):
        reader = FORMATS[name].open(Source(header + data))
        assert read_pieces(reader, *blocks) == (found, [len(header) + size * k for k in places], None)
        assert reader.metadata.get("other_words", 0) == left


def test_fields_of_dat():
    events = load(DAT + cd(7, 639, 479, 0) + cd(2**32 - 1, 3, 5))
    assert (rows(events), events.sensor_size) == ([(7, 639, 479, 0), (2**32 - 1, 3, 5, 1)], (640, 480))
    header = {"data": "file containing CD events.", "version": "2", "height": "480", "width": "640"}
    assert events.metadata == {"format": "dat", "t0": 7, "version": 2, "event_type": 12, "header": header}


@pytest.mark.parametrize("header", [b"% Version 1\n", b"% Version 0\r\n% Date 2014-01-01\r\n", b"% Date 2014\n%\n"])
def test_version_1_of_dat(header):
    data = header + b"\0\x08" + words(5, 1 << 17 | 239 << 9 | 303, 6, 0xFFFC0000)
    events = load(data, name="a.dat")
    assert rows(events) == [(5, 303, 239, 1), (6, 0, 0, 0)]
    assert (events.sensor_size, events.metadata["version"]) == ((304, 240), 1)
    assert load(b"% Date 2020\n\x0c\x08" + cd(1, 400, 300), name="a.dat").x.tolist() == [400]  # of the new kind


@pytest.mark.parametrize(("data", "size"), [
    (b"% Version 2\n\x0c\x08" + cd(1, 303, 239), (304, 240)), (b"% Version 2\n\x0c\x08" + cd(1, 304, 0), (640, 480)),
    (b"% Version 2\n\x0c\x08" + cd(1, 0, 480), (1280, 720)), (b"% Version 2\n\x0c\x08" + cd(1, 1280, 0), (1281, 1)),
    (b"% Version 2\n% Remark " + b"x" * 10_000 + b"\n% Width 20\n% Height 10\n\x0c\x08" + cd(1), (20, 10)),
    (b"% evt 2.0\n% geometry 320x240\n" + words(high(1), event(0)), (320, 240)),
    (b"% format EVT2;height=320;width=310\n% end\n" + words(high(1), event(0)), (310, 320)),
    (b"% evt 2.0\n% plugin_name hal_plugin_gen41_evk3\n" + words(high(1), event(0)), (1280, 720)),
    (b"% evt 2.0\n% plugin_name hal_plugin_gen31_fx3\n" + words(high(1), event(0)), (640, 480)),
    (b"% evt 2.0\n% sensor_name IMX636\n" + words(high(1), event(0)), (1280, 720)),
    (b"% evt 2.0\n% plugin_name hal_plugin_genx320_cx3\n" + words(high(1), event(0)), (320, 320)),
    (b"% evt 2.0\n" + words(high(1), event(0)), (640, 480)),
    (b"% evt 2.0\n" + words(high(1), event(0, 0, 480)), (1280, 720)),
    (b"% evt 2.0\n" + words(high(1), event(0, 0, 720)), (1, 721))
])  # fmt: skip
def test_sensors(data, size):
    assert load(data).sensor_size == next(stream(data)).sensor_size == size


def test_the_clock_of_dat_wraps():
    data = DAT + cd(T_DAT - 5) + cd(3) + cd(T_DAT - 1) + cd(0) + cd(1)
    expected = [T_DAT - 5, T_DAT + 3, 2 * T_DAT - 1, 2 * T_DAT, 2 * T_DAT + 1]
    for block in (8, 16, 24, 1 << 20):
        found, _, _ = read_pieces(FORMATS["dat"].open(Source(data)), block)
        assert [t for t, *_ in found] == expected
    with pytest.raises(EventFileError, match=f"time runs back from {T_DAT // 2 + 100} to 3 us"):
        load(DAT + cd(T_DAT // 2 + 100) + cd(3))


@given(st.lists(st.integers(0, 100) | st.integers(0, T_DAT - 1), max_size=40), st.integers(1, 100))
def test_any_block_of_dat(times, block):
    data = DAT + b"".join(cd(t, t % 640, t % 480, t % 2) for t in times)
    found = read_pieces(FORMATS["dat"].open(Source(data)), block)
    assert found == read_pieces(FORMATS["dat"].open(Source(data)))
    assert found[1] == [len(DAT) + 8 * k for k in range(len(times))]
    assert [(t % T_DAT, *rest) for t, *rest in found[0]] == [(t, t % 640, t % 480, t % 2) for t in times]


WORDS_2 = st.lists(
    st.one_of(
        st.builds(event, st.integers(0, 63), st.integers(0, 2047), st.integers(0, 2047), st.integers(0, 1)),
        st.builds(high, st.one_of(st.integers(0, 3), st.integers(2**28 - 3, 2**28 - 1))),
        st.integers(0, 2**32 - 1),
    ),
    max_size=30,
)


@given(WORDS_2, st.integers(0, 200), st.integers(1, 60))
@example([TRIGGER, event(1)], 0, 4)
@example([*[event(k % 64) for k in range(100)], high(2), event(5)], 0, 64)
@settings(max_examples=30)
def test_words_of_evt2_are_as_the_specification_says(some, run, block):
    data = words(*some, high(1), *[event(k % 64, k, 2 * k) for k in range(run)])
    as_specified("evt2", EVT2, data, literal2(data), 4, block)


WORDS_21 = st.lists(
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


@given(WORDS_21, st.integers(1, 60))
@settings(max_examples=30)
def test_words_of_evt21_are_as_the_specification_says(some, block):
    data = words21(high(1) << 32, *some)
    as_specified("evt21", EVT21_, data, literal2(data, wide=True), 8, block * EVT21.open(Source(EVT21_)).block_divisor)


VALUES = st.integers(0, 4095)
WORDS_3 = st.lists(
    st.one_of(
        st.builds(lambda kind, value: kind << 12 | value, st.sampled_from([0, 2, 3, 4, 5, 6]), VALUES),
        st.builds(lambda value: HIGH | value, st.one_of(st.integers(0, 3), st.integers(2046, 2050), st.just(4095))),
        st.integers(0, 65535),
    ),
    max_size=60,
)


@given(WORDS_3, st.integers(1, 50))
@example([BASE, *[VECT_12 | 0xFFF] * 40], 9)
@settings(max_examples=150)
def test_words_of_evt3_are_as_the_specification_says(some, block):
    data = words3(*some, HIGH | 7, ROW | 3, SINGLE | 5)
    as_specified("evt3", EVT3, data, literal3(data), 2, block * FORMATS["evt3"].open(Source(EVT3)).block_divisor)


def test_fields_of_evt2():
    events = load(EVT2 + words(high(3), event(63, 639, 479, 0), TRIGGER, high(5), event(0, 4, 5)))
    assert (rows(events), events.sensor_size) == ([(255, 639, 479, 0), (320, 4, 5, 1)], (640, 480))
    assert [events.metadata[key] for key in ("format", "t0", "other_words")] == ["evt2", 255, 1]


def test_first_word_may_look_like_a_line():
    data = words(high(1), event(1, 7, 9)).replace(words(high(1)), b"% \x01\x80")
    assert load(EVT2 + data).t.tolist() == load(b"% evt 2.0\n" + data).t.tolist() == [0x12025 * 64 + 1]


def test_the_clock_of_evt2_wraps():
    top = 2**28 - 1
    events = load(EVT2 + words(high(top), event(63), high(0), event(0), high(top), event(0), high(3), event(1)))
    assert events.t.tolist() == [T_EVT2 - 1, T_EVT2, 2 * T_EVT2 - 64, 2 * T_EVT2 + 193]


def test_a_late_event_is_found_in_a_long_file():
    data = EVT2 + words(*[word for k in range(30_000) for word in (high(k), event(1))], event(2, 700))
    with pytest.raises(EventFileError) as error:
        load(data)
    assert error.value.offset == len(EVT2) + 4 * 60_000


def test_evt2_tells_the_time_once_in_64_us(tmp_path):
    events = random_events(50)
    save(events, tmp_path / "a.raw", format="evt2")
    data = (tmp_path / "a.raw").read_bytes().split(b"% end\n")[-1]
    assert len(data) == 4 * (len(events) + len(np.unique(events.t >> 6)))


@pytest.mark.parametrize("order", [b";endianness=little", b";endianness=legacy", b""])
@pytest.mark.parametrize("legacy", [False, True])
def test_halves_of_evt21(order, legacy):
    legacy = order.endswith(b"legacy") if order else legacy
    values = [high(1) << 32, event21(3, 32, 7, 1, 0x80000001), high(2) << 32, event21(0, 64, 8, 0, 1 << 20 | 15)]
    events = load(b"% format EVT21" + order + b"\n" + words21(*values, legacy=legacy))
    assert rows(events) == [(67, 32, 7, 1), (67, 63, 7, 1), *((128, x, 8, 0) for x in (64, 65, 66, 67, 84))]
    assert (events.metadata["format"], events.sensor_size) == ("evt21", (640, 480))
    assert "no recording was available" in EVT21.untested


def test_fields_of_evt3():
    data = words3(
        HIGH | 1, LOW | 5, ROW | 719, SINGLE | ON | 1279, SINGLE | 3, TRIGGER_3,
        BASE | ON | 100, VECT_12 | 0x801, VECT_8 | 0x81, VECT_12 | 1, LOW | 6, VECT_8 | 0xF02,
    )  # fmt: skip
    events = load(EVT3 + data)
    assert (events.x.tolist(), events.t.tolist()) == ([1279, 3, 100, 111, 112, 119, 120, 133], [*[4101] * 7, 4102])
    assert (events.p.tolist(), set(events.y.tolist())) == ([1, 0, 1, 1, 1, 1, 1, 1], {719})
    assert (events.sensor_size, events.metadata["other_words"]) == ((1280, 720), 1)


@pytest.mark.parametrize(("some", "times"), [
    ([HIGH | 1, SINGLE, LOW | 9, SINGLE, HIGH | 1, SINGLE, HIGH | 2, SINGLE], [4096, 4105, 4105, 8192]),
    ([HIGH | 1, LOW | 811, LOW | 800, SINGLE], [4896]),
    ([HIGH | 4095, SINGLE, HIGH | 0, SINGLE, LOW | 1, SINGLE], [4095 << 12, 1 << 24, (1 << 24) + 1]),
    ([HIGH | 2048, SINGLE, HIGH, SINGLE, HIGH | 2049, HIGH, SINGLE], [1 << 23, 1 << 24, 2 << 24])
])  # fmt: skip
def test_the_clock_of_evt3(some, times):
    assert load(EVT3 + words3(HIGH, ROW, *some)).t.tolist() == times


def test_a_vector_does_not_run_round_the_columns():
    x = load(b"% evt 3.0\n" + words3(HIGH, ROW, BASE, *[VECT_12 | 1] * 6000)).x
    assert x.size == 6000
    assert (np.diff(x.astype(int)) >= 0).all()


def test_evt3_is_saved_in_slices_and_vectors(tmp_path):
    k = np.arange(2 * SLICE + 5)
    events = Events(k // 30, k % 30, k // 30 % 700, k // 60 % 2, (1280, 720))
    save(events, tmp_path / "a.raw")
    assert load(tmp_path / "a.raw") == events
    n = 36
    save(Events([0] * n, np.arange(n), [0] * n, [1] * n, (1280, 720)), tmp_path / "b.raw")
    assert (tmp_path / "b.raw").read_bytes() == EVT3 + words3(HIGH, LOW, ROW, BASE | ON, *[VECT_12 | 0xFFF] * 3)


def test_messages(messages):
    messages.calls(globals())


@pytest.mark.parametrize(("data", "what", "t"), [
    (DAT + cd(1) + cd(2, 0, 0, 2) + cd(3), "byte 81", [1]), (DAT + cd(1) + cd(2)[:7], "7 bytes left over", [1]),
    (EVT2 + words(high(1), event(1), event(2))[:-1], "byte 78: 3 bytes left over", [65]),
    (EVT3 + words3(HIGH, ROW, SINGLE | 3) + b"a", "1 bytes left over", [0])
])  # fmt: skip
def test_what_is_whole_is_read(data, what, t):
    with pytest.warns(EventFileWarning, match=what):
        assert load(data, strict=False).t.tolist() == t


def test_the_coding_is_told_by_the_words(tmp_path):
    events = random_events(500, (640, 480), length=20_000)
    for coding in ("evt2", "evt3"):
        save(events, tmp_path / "a.raw", format=coding, replace=True)
        data = (tmp_path / "a.raw").read_bytes().split(b"% end\n")[-1]
        for header in (b"", b"% Date 2018-01-01\n"):
            found = load(header + data, name="a.raw")
            assert (found, found.metadata["format"]) == (events, coding)
    wide = [w for k in range(50) for w in (high(k) << 32, event21(k, 32 * (k % 20), 9, k % 2, 1 << k % 32 | 1))]
    for legacy in (False, True):
        found = load(words21(*wide, legacy=legacy), name="a.raw")
        assert (found.metadata["format"], rows(found)) == ("evt21", literal2(words21(*wide), wide=True)[0])
