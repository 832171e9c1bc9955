import hashlib
import io
import json
import struct
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from neuro.events import EventFileError, EventFileWarning, Events, load, save, stream
from neuro.events.formats.aedat import Aedat2
from neuro.events.source import Source

HEADER = b"#!AER-DAT2.0\r\n# made for a test\r\n"
DAVIS = HEADER + b"# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n#End of Preferences for this AEChip\r\n"


def words(*pairs):
    return b"".join(struct.pack(">II", address, time) for address, time in pairs)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("mnistdvs_0_scale04_0001.aedat", (128, 128)),
        ("mnistdvs_0_scale04_0001_qt1.aedat", (128, 128)),
        ("mnistdvs_0_scale08_0001_qt1.aedat", (128, 128)),
        ("mnistdvs_0_scale16_0001_qt1.aedat", (128, 128)),
        ("davis240_translBoxes.aedat", (240, 180)),
    ],
)
def test_decoding_is_the_known_one(shared, name, size):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())[name]
    events = load(folder / name)
    assert len(events) == truth["n_events"]
    assert hashlib.sha256(events.records().tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]
    assert events.sensor_size == size
    assert events.metadata["other_words"] == truth.get("n_aps_imu_words", 0)


def test_poker_dvs_is_as_published(shared):
    folder = shared / "data" / "poker_dvs"
    arrays = np.load(folder / "poker_dvs_shared.npz")
    with zipfile.ZipFile(folder / "poker_dvs_shared_aedat2.zip") as files:
        names = set(files.namelist())
        compared = 0
        for k, name in enumerate(arrays["names"]):
            if (file := f"{name}.aedat") not in names:
                continue
            events = load(files.read(file), name=file)
            part = slice(arrays["offsets"][k], arrays["offsets"][k + 1])
            for column, values in zip("xyp", (events.x, events.y, events.p), strict=True):
                assert np.array_equal(arrays[column][part], values), (name, column)
            compared += 1
    assert compared >= 60


def test_fields():
    events = load(HEADER + words((5 << 8 | 9 << 1, 7), (1 << 15, 8), (5 << 8 | 9 << 1 | 1, 9)))
    assert events.records().tolist() == [(7, 9, 5, 1), (9, 9, 5, 0)]
    assert events.metadata == {"format": "aedat2", "t0": 7, "chip": "DVS128", "other_words": 0, "external_events": 1}
    davis = load(DAVIS + words((5 << 22 | 9 << 12 | 1 << 11, 7), (1 << 31, 8), (1 << 10, 8), (140 << 22, 9)))
    assert davis.records().tolist() == [(7, 9, 5, 1), (9, 0, 140, 0)]
    assert davis.metadata == {"format": "aedat2", "t0": 7, "chip": "DAVIS240", "other_words": 1, "external_events": 1}


@pytest.mark.parametrize(
    ("chip", "size"),
    [
        ("ch.unizh.ini.jaer.chip.retina.DVS128", (128, 128)),
        ("eu.seebetter.ini.chips.davis.DAVIS240A", (240, 180)),
        ("eu.seebetter.ini.chips.davis.Davis346blue", (346, 260)),
        ("eu.seebetter.ini.chips.davis.DAVIS346cBSI", (346, 260)),
        ("eu.seebetter.ini.chips.davis.Davis640", (640, 480)),
    ],
)
def test_chips(chip, size):
    assert load(HEADER + f"# AEChip: {chip}\r\n".encode()).sensor_size == size


def test_word_that_looks_like_a_comment():
    first = 140 << 22  # its first byte is that of '#'
    assert words((first, 1))[:1] == b"#"
    assert load(DAVIS + words((first, 1), (0, 13 << 8 | 10))).t.tolist() == [1, 13 << 8 | 10]


def test_line_that_ends_the_header():
    text = b"#ab !cd\r\n#efghi\n"  # two words that are lines of text as well
    assert Aedat2(Source(DAVIS + b"#End Of ASCII Header\r\n" + text))._start == len(DAVIS) + 22


def test_long_header():
    lines = b"".join(b"#<entry key=%d/>\r\n" % k for k in range(20_000))
    data = HEADER + lines + words((2, 5))
    for given_as in (data, io.BytesIO(data)):
        assert load(given_as, name="a.aedat").records().tolist() == [(5, 1, 0, 1)]
    assert [part.t.tolist() for part in stream(io.BytesIO(data))] == [[5]]


def test_clock_wraps():
    assert load(HEADER + words((0, 2**32 - 5), (0, 3))).t.tolist() == [2**32 - 5, 2**32 + 3]
    late = HEADER + words((0, 2**32 - 5), (2, 3), (4, 2**32 - 1), (6, 4))
    assert load(late, sort=True).t.tolist() == [2**32 - 5, 2**32 - 1, 2**32 + 3, 2**32 + 4]
    assert load(late, sort=True).x.tolist() == [0, 2, 1, 3]


@given(
    st.lists(
        st.tuples(st.sampled_from([0, 1 << 31, 1 << 10, 1 << 11, 7 << 22 | 5 << 12]), st.integers(0, 2**32 - 1)),
        min_size=1, max_size=30,
    ),
    st.integers(1, 100),
)  # fmt: skip
@settings(deadline=None)
def test_any_block_gives_the_same(pairs, block):
    results = []
    for size in (1 << 20, block):
        reader = Aedat2(Source(DAVIS + words(*pairs)))
        pieces = list(reader.pieces(size))
        columns = [np.concatenate([getattr(piece, name) for piece in pieces]).tolist() for name in "txyp"]
        places = [piece.place(k) for piece in pieces for k in range(piece.t.size)]
        highest = np.max([piece.highest for piece in pieces], axis=0).tolist()
        results.append((columns, places, reader.metadata, highest))
        assert all(piece.ordered == bool(np.all(np.diff(piece.t) >= 0)) for piece in pieces)
    assert results[0] == results[1]
    events = [k for k, (address, _) in enumerate(pairs) if not address & (1 << 31 | 1 << 10)]
    assert results[0][1] == [len(DAVIS) + 8 * k for k in events]


@st.composite
def recordings(draw):
    width, height = size = draw(st.sampled_from([(128, 128), (34, 34), (240, 180), (346, 260), (500, 10), (640, 480)]))
    n = draw(st.integers(0, 50))
    limits = (2**32 - 1, width - 1, height - 1, 1)
    columns = [np.array(draw(st.lists(st.integers(0, most), min_size=n, max_size=n)), np.int64) for most in limits]
    return Events(np.sort(columns[0]), *columns[1:], size)


@given(recordings(), st.integers(0, 50))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_saved_is_loaded(tmp_path, events, cut):
    path = tmp_path / "a.aedat"
    save(iter([events[:cut], events[cut:]]), path, replace=True)
    assert load(path) == events


def test_smallest_camera_is_written(tmp_path):
    one = np.array([1])
    for size, chip in [
        ((128, 128), "DVS128"),
        ((129, 2), "DAVIS240"),
        ((346, 260), "DAVIS346"),
        ((2, 900), "DAVIS640"),
    ]:
        save(Events(one, one, one, one, size), tmp_path / "a.aedat", replace=True)
        events = load(tmp_path / "a.aedat")
        assert events.metadata["chip"] == chip
        assert events.sensor_size == size
    save(iter([Events([], [], [], [], (34, 34))]), tmp_path / "a.aedat", replace=True)
    assert len(load(tmp_path / "a.aedat")) == 0


@pytest.mark.parametrize(("t", "x", "y"), [(1 << 32, 1, 1), (7, 640, 1), (7, 1, 480)])
def test_cannot_hold(tmp_path, t, x, y):
    events = Events(np.array([0, t]), np.array([0, x]), np.array([0, y]), np.array([0, 0]), (1280, 720))
    with pytest.raises(EventFileError) as error:
        save(iter([events[:1], events[1:]]), tmp_path / "a.aedat")
    assert str(error.value).partition("\n")[0] == (
        f"{tmp_path / 'a.aedat'}: cannot hold event 1: t {t}, x {x}, y {y}; "
        "expected t 0 to 4294967295 us, x 0 to 639, y 0 to 479"
    )
    assert not list(tmp_path.iterdir())


def test_parts_of_two_recordings(tmp_path):
    one = np.array([1])
    first, other = (Events(one, one, one, one, size) for size in ((20, 20), (30, 30)))
    for parts, what in (
        ([first, other], "event 1: its sensor is 30x30, expected 20x20 as in the first part"),
        ([first, Events(one - 1, one, one, one, (20, 20))], "event 1: time runs back from 1 to 0 us"),
    ):
        with pytest.raises(EventFileError) as error:
            save(iter(parts), tmp_path / "a.aedat")
        assert str(error.value) == f"{tmp_path / 'a.aedat'}: cannot hold {what}"


ERRORS = {
    "a.aedat: byte 0: begins with b'#!AER-DAT1.0', expected the line #!AER-DAT2.0": b"#!AER-DAT1.0\r\n",
    "a.aedat: byte 0: begins with b'', expected the line #!AER-DAT2.0": b"",
    "a.aedat: byte 12: the first line does not end": b"#!AER-DAT2.0\0",
    "a.aedat: byte 41: 3 bytes left over after 1 words of 8 bytes": HEADER + words((0, 1)) + b"abc",
    "a.aedat: byte 41: address 0x00010000 is none of a DVS128": HEADER + words((0, 1), (1 << 16, 1)),
    "a.aedat: byte 43: chip x.Cochlea is not known, expected one of DVS128, DAVIS240, DAVIS346, DAVIS640": (
        HEADER + b"# AEChip: x.Cochlea\r\n"
    ),
    "a.aedat: byte 48: sensor size 0x5, expected 1x1 to 65536x65536": HEADER + b"# Sensor size: 0x5\r\n",
}


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    with pytest.raises(EventFileError) as error:
        load(ERRORS[message], name="a.aedat")
    assert str(error.value) == message


def test_what_is_whole_is_kept():
    for rest, what in (
        (b"ab", "2 bytes left over after 1 words of 8 bytes"),
        (words((1 << 16, 1), (0, 2)), "address 0x00010000 is none of a DVS128"),
    ):
        with pytest.warns(EventFileWarning) as told:
            events = load(HEADER + words((0, 1)) + rest, name="a.aedat", strict=False)
        assert events.t.tolist() == [1]
        assert [str(warning.message) for warning in told] == [f"a.aedat: byte 41: {what}; what is before it was read"]
