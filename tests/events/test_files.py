import hashlib
import io
import json
import pickle
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from neuro.events import EventFileError, Events, load, save

HEADER = b"#!AER-DAT2.0\r\n# made for a test\r\n"
DAVIS = HEADER + b"# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n#End of Preferences for this AEChip\r\n"


def words(*pairs):
    return b"".join(struct.pack(">II", address, time) for address, time in pairs)


def event(x, y, t, p=1):
    return bytes([x, y, p << 7 | t >> 16, t >> 8 & 255, t & 255])


@pytest.mark.parametrize(
    "name",
    [
        "nmnist_sample.bin",
        "ncaltech101_faces_easy_0001.bin",
        "mnistdvs_0_scale04_0001.aedat",
        "mnistdvs_0_scale04_0001_qt1.aedat",
        "mnistdvs_0_scale08_0001_qt1.aedat",
        "mnistdvs_0_scale16_0001_qt1.aedat",
        "davis240_translBoxes.aedat",
    ],
)
def test_decoding_is_the_known_one(shared, name):
    folder = shared / "data" / "formats"
    truth = json.loads((folder / "truth.json").read_text())[name]
    events = load(folder / name)
    assert len(events) == truth["n_events"]
    assert hashlib.sha256(events.records().tobytes()).hexdigest() == truth["events_sha256_t_i8_x_u2_y_u2_p_u1"]
    assert events.metadata.get("other_words", 0) == truth.get("n_aps_imu_words", 0)


def test_sensor_sizes(shared):
    folder = shared / "data" / "formats"
    assert load(folder / "nmnist_sample.bin").sensor_size == (34, 34)
    assert load(folder / "ncaltech101_faces_easy_0001.bin").sensor_size == (151, 173)
    assert load(folder / "ncaltech101_faces_easy_0001.bin", sensor_size=(240, 180)).sensor_size == (240, 180)
    assert load(folder / "mnistdvs_0_scale04_0001.aedat").sensor_size == (128, 128)
    assert load(folder / "davis240_translBoxes.aedat").sensor_size == (240, 180)


def test_bytes_and_open_files(tmp_path):
    data = event(3, 4, 100_000) + event(5, 6, 100_001, p=0)
    path = tmp_path / "a.bin"
    path.write_bytes(data)
    expected = load(path)
    assert expected.t.tolist() == [100_000, 100_001]
    assert expected.p.tolist() == [1, 0]
    assert load(data, format="nmnist") == expected
    assert load(data, name="a.bin") == expected
    assert load(bytearray(data), name="a.BIN") == expected
    assert load(io.BytesIO(data), name="a.bin") == expected
    with path.open("rb") as file:
        assert load(file) == expected


def test_overflow_marker():
    data = event(1, 2, 10) + event(0, 240, 0) + event(3, 4, 20)
    events = load(data, format="nmnist")
    assert events.t.tolist() == [10, 20 + 8192]
    assert events.x.tolist() == [1, 3]


def test_aedat2_fields():
    events = load(HEADER + words((5 << 8 | 9 << 1, 7), (1 << 15, 8), (5 << 8 | 9 << 1 | 1, 9)))
    assert events.records().tolist() == [(7, 9, 5, 1), (9, 9, 5, 0)]
    davis = load(DAVIS + words((5 << 22 | 9 << 12 | 1 << 11, 7), (1 << 31, 8), (1 << 10, 8), (140 << 22, 9)))
    assert davis.records().tolist() == [(7, 9, 5, 1), (9, 0, 140, 0)]
    assert davis.metadata == {"format": "aedat2", "t0": 7, "chip": "DAVIS240", "other_words": 2}


def test_aedat2_word_that_looks_like_a_comment():
    first = 140 << 22  # its first byte is that of '#'
    assert words((first, 1))[:1] == b"#"
    assert load(DAVIS + words((first, 1), (0, 13 << 8 | 10))).t.tolist() == [1, 13 << 8 | 10]


def test_aedat2_clock_wraps():
    events = load(HEADER + words((0, 2**32 - 5), (0, 3)))
    assert events.t.tolist() == [2**32 - 5, 2**32 + 3]


def test_sort():
    data = event(1, 1, 50) + event(2, 2, 40)
    assert load(data, format="nmnist", sort=True).x.tolist() == [2, 1]


ERRORS = {
    "a.bin: byte 5: 2 bytes left over after 1 events of 5 bytes": ("a.bin", event(1, 1, 1) + b"ab", {}),
    "a.bin: byte 5: event 1: time runs back from 50 to 40 us; load(..., sort=True) sorts the events": (
        "a.bin", event(1, 1, 50) + event(1, 1, 40), {},
    ),
    "a.bin: byte 15: event 2: x is 34, expected 0 to 33 (sensor 34x34)": (
        "a.bin", event(1, 1, 0) + event(0, 240, 0) + event(1, 1, 1) + event(34, 0, 2), {"sensor_size": (34, 34)},
    ),
    "a.aedat: byte 0: begins with b'#!AER-DAT3.1', expected the line #!AER-DAT2.0": (
        "a.aedat", b"#!AER-DAT3.1\r\n", {},
    ),
    "a.aedat: byte 12: the first line does not end": ("a.aedat", b"#!AER-DAT2.0\0", {}),
    "a.aedat: byte 41: 3 bytes left over after 1 words of 8 bytes": (
        "a.aedat", HEADER + words((0, 1)) + b"abc", {},
    ),
    "a.aedat: byte 33: address 0x00010000 is none of a DVS128": ("a.aedat", HEADER + words((1 << 16, 1)), {}),
    "a.aedat: byte 43: chip x.Cochlea is not known, expected one of DVS128, DAVIS240": (
        "a.aedat", HEADER + b"# AEChip: x.Cochlea\r\n", {},
    ),
    "a.txt: unknown kind of event file, expected one of: AEDAT 2.0 (.aedat .aedat2), N-MNIST .bin (.bin)": (
        "a.txt", b"", {},
    ),
    "a.bin: unknown format 'raw', expected one of aedat2, nmnist": ("a.bin", b"", {"format": "raw"}),
}  # fmt: skip


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    name, data, options = ERRORS[message]
    with pytest.raises(EventFileError) as error:
        load(data, name=name, **options)
    assert str(error.value) == message
    copy = pickle.loads(pickle.dumps(error.value))
    assert (copy.path, copy.what, copy.offset) == (name, error.value.what, error.value.offset)


def test_missing_files(tmp_path):
    for path, what in ((tmp_path / "no.bin", "no such file"), (tmp_path, "is a folder, expected a file")):
        with pytest.raises(EventFileError) as error:
            load(path)
        assert str(error.value) == f"{path}: {what}"


@st.composite
def recordings(draw):
    n = draw(st.integers(0, 50))
    t = np.sort(draw(st.lists(st.integers(0, 2**23 - 1), min_size=n, max_size=n)))
    rows = st.integers(0, 255).filter(lambda y: y != 240)
    x, y, p = (
        draw(st.lists(values, min_size=n, max_size=n)) for values in (st.integers(0, 255), rows, st.integers(0, 1))
    )
    fields = (np.array(values, np.int64) for values in (t, x, y, p))
    return Events(*fields, (256, 256))


@given(recordings())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_saved_is_loaded(tmp_path, events):
    path = tmp_path / "a.bin"
    save(events, path)
    assert load(path, sensor_size=(256, 256)) == events
    assert [file.name for file in tmp_path.iterdir()] == ["a.bin"]


@pytest.mark.parametrize(("t", "x", "y"), [(1 << 23, 1, 1), (0, 256, 1), (0, 1, 240)])
def test_bin_cannot_hold(tmp_path, t, x, y):
    events = Events(np.array([0, t]), np.array([0, x]), np.array([0, y]), np.array([0, 0]), (300, 300))
    with pytest.raises(EventFileError) as error:
        save(events, tmp_path / "a.bin")
    assert str(error.value) == (
        f"{tmp_path / 'a.bin'}: cannot hold event 1: t {t}, x {x}, y {y}; "
        "expected t 0 to 8388607 us, x and y 0 to 255, y not 240"
    )
    assert not list(tmp_path.iterdir())


def test_cannot_save_as(tmp_path):
    events = load(b"", format="nmnist")
    with pytest.raises(EventFileError) as error:
        save(events, tmp_path / "a.aedat")
    assert str(error.value) == f"{tmp_path / 'a.aedat'}: cannot save as '.aedat', expected .bin"
    with pytest.raises(EventFileError) as error:
        save(events, tmp_path / "none" / "a.bin")
    assert str(error.value) == f"{tmp_path / 'none' / 'a.bin'}: cannot write: No such file or directory"


def loads_or_says_why(data, name):
    try:
        assert isinstance(load(data, name=name), Events)
    except EventFileError as error:
        offset = error.offset
    else:
        return
    assert 0 <= offset <= len(data)


@given(st.binary(max_size=200), st.sampled_from(["a.bin", "a.aedat"]), st.sampled_from([b"", HEADER, DAVIS]))
def test_any_bytes(data, name, head):
    loads_or_says_why(head + data, name)


@given(st.data())
@settings(deadline=None)
def test_damaged_files(data):
    good = data.draw(
        st.sampled_from(
            [
                ("a.bin", b"".join(event(k % 30, 30 - k % 30, 900 * k) for k in range(40))),
                ("a.aedat", HEADER + words(*((k << 8 | k << 1, 100 * k) for k in range(40)))),
                ("a.aedat", DAVIS + words(*((k << 22 | k << 12, 100 * k) for k in range(40)))),
            ]
        )
    )
    name, bytes_ = good[0], bytearray(good[1])
    for _ in range(data.draw(st.integers(1, 4))):
        bytes_[data.draw(st.integers(0, len(bytes_) - 1))] = data.draw(st.integers(0, 255))
    loads_or_says_why(bytes(bytes_[: data.draw(st.integers(0, len(bytes_)))]), name)
