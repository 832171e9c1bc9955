import io

import numpy as np
import pytest

from event_tests import refusal
from neuro.events import Events, load, save, stream
from neuro.events.formats import FORMATS
from neuro.events.parts import windows


def event(x, y, t, p=1):
    return bytes([x, y, p << 7 | t >> 16, t >> 8 & 255, t & 255])


def test_bytes_and_open_files(tmp_path):
    data, path = event(3, 4, 100_000) + event(5, 6, 100_001, p=0), tmp_path / "a.bin"
    path.write_bytes(data)
    expected = load(path)
    assert (expected.t.tolist(), expected.p.tolist()) == ([100_000, 100_001], [1, 0])
    assert (load(data, format="nmnist"), load(data, name="a.bin")) == (expected, expected)
    assert (load(bytearray(data), name="a.BIN"), load(io.BytesIO(data), name="a.bin")) == (expected, expected)
    with path.open("rb") as file:
        assert load(file) == expected


def test_the_byte_of_a_fault():
    """Words that only turn the clock are counted, too."""
    data = event(1, 1, 0) + event(0, 240, 0) + event(1, 1, 1) + event(34, 0, 2)
    expected = "a.bin: byte 15: event 2: x is 34, expected 0 to 33 (sensor 34x34)"
    assert refusal(load, data, name="a.bin", sensor_size=(34, 34)) == expected


def test_unknown_formats():
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS.values())
    names = ", ".join(f.name for f in FORMATS.values())
    for name, format, what in (
        ("a.nothing", None, f"unknown kind of event file, expected one of: {titles}"),
        ("a.bin", "nothing", f"unknown format 'nothing', expected one of {names}"),
    ):
        assert refusal(load, b"", name=name, format=format) == f"{name}: {what}"
    assert "N-MNIST .bin (.bin)" in titles


@pytest.mark.parametrize(
    ("ending", "name"), [("bin", "nmnist"), (".ES", "event_stream"), ("h5", "hdf5"), ("dat", "dat")]
)
def test_a_format_is_called_by_its_ending_too(ending, name, tmp_path):
    events = Events([1, 2], [3, 4], [5, 6], [1, 0], (34, 34))
    save(events, tmp_path / "a", format=ending)
    save(events, tmp_path / "b", format=name)
    for path in (tmp_path / "a", tmp_path / "b"):
        for format in (ending, name):
            assert load(path, format=format).metadata["format"] == name
            assert np.array_equal(load(path, format=format).records(), events.records())


def test_an_ending_of_several_formats_calls_none(tmp_path):
    events = Events([1, 2], [3, 4], [5, 6], [1, 0], (34, 34))
    assert "cannot save as format 'raw', expected one of" in refusal(save, events, tmp_path / "a", format="raw")
    assert "unknown format 'aedat', expected one of" in refusal(load, b"", format="aedat")


def test_missing_files(tmp_path):
    for path, what in ((tmp_path / "no.bin", "no such file"), (tmp_path, "is a folder, expected a file")):
        assert refusal(load, path) == f"{path}: {what}"


def test_cannot_save_as(tmp_path):
    events, written = load(b"", format="nmnist"), [f for f in FORMATS.values() if f.write]
    endings = ", ".join(dict.fromkeys(suffix for f in written for suffix in f.suffixes))
    for path, format, what in (
        (tmp_path / "a.nothing", None, f"cannot save as '.nothing', expected {endings}"), (tmp_path / "a.bin", "aedat3",
        f"cannot save as format 'aedat3', expected one of {', '.join(f.name for f in written)}"),
        (tmp_path / "none" / "a.bin", None, "cannot be written: No such file or directory")
    ):  # fmt: skip
        assert refusal(save, events, path, format=format) == f"{path}: {what}"
    assert not list(tmp_path.iterdir())


def test_whole_numbers_as_floats_are_taken():
    data = b"".join(event(1, 1, 100 * k) for k in range(50))
    parts = stream(data, format="nmnist", window_us=1e3, start_us=1e3, stop_us=3e3)
    assert [len(part) for part in parts] == [10, 10]


def test_a_file_that_is_read_once_must_tell_its_sensor():
    given = io.BytesIO(event(1, 2, 3))
    assert refusal(list, stream(given, name="a.bin")) == (
        "a.bin: its sensor is not stated, and it cannot be read twice to look for it: "
        "give sensor_size=(width, height), or --sensor WxH"
    )
    assert len(list(stream(io.BytesIO(event(1, 2, 3)), name="a.bin", sensor_size=(34, 34)))) == 1


def test_nothing_is_not_saved(tmp_path):
    assert refusal(save, [], tmp_path / "a.h5") == (
        f"{tmp_path / 'a.h5'}: no parts to save, expected at least one: "
        "a recording without events is one, Events([], [], [], [], (width, height))"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_jump_within_a_part():
    far = Events([0, 10**12], [0, 1], [0, 1], [1, 0], (4, 4))
    assert refusal(list, windows([far], 1000, path="a.h5")) == (
        "a.h5: 999999999 windows of 1000 us without events before 1000000000000 us, expected at most 1000000: "
        "look for a jump in the times, or take longer windows"
    )
