import io
import os
import pickle
import threading

import numpy as np
import pytest

from neuro.core.errors import ModelError
from neuro.events import EventFileError, Events, load, save, stream
from neuro.events.formats import FORMATS
from neuro.events.parts import windows


def event(x, y, t, p=1):
    return bytes([x, y, p << 7 | t >> 16, t >> 8 & 255, t & 255])


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


def test_a_named_pipe_is_read_like_an_open_file(tmp_path):
    whole = Events(np.arange(500), np.arange(500) % 34, np.arange(500) % 30, np.arange(500) % 2, (34, 34))
    for ending in (".bin", ".csv", ".aedat", ".npz"):
        kept, pipe = tmp_path / f"kept{ending}", tmp_path / f"pipe{ending}"
        save(whole, kept)
        os.mkfifo(pipe)
        for read in (load, lambda path: next(stream(path, count=1000, sensor_size=(34, 34)))):
            threading.Thread(target=pipe.write_bytes, args=(kept.read_bytes(),), daemon=True).start()
            assert read(pipe) == whole


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
}  # fmt: skip


@pytest.mark.parametrize("message", ERRORS)
def test_messages(message):
    name, data, options = ERRORS[message]
    with pytest.raises(EventFileError) as error:
        load(data, name=name, **options)
    assert str(error.value) == message
    copy = pickle.loads(pickle.dumps(error.value))
    assert (copy.path, copy.what, copy.offset) == (name, error.value.what, error.value.offset)


def test_unknown_formats():
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS.values())
    names = ", ".join(f.name for f in FORMATS.values())
    for name, format, what in (
        ("a.nothing", None, f"unknown kind of event file, expected one of: {titles}"),
        ("a.bin", "nothing", f"unknown format 'nothing', expected one of {names}"),
    ):
        with pytest.raises(EventFileError) as error:
            load(b"", name=name, format=format)
        assert str(error.value) == f"{name}: {what}"
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
    with pytest.raises(EventFileError, match="cannot save as format 'raw', expected one of"):
        save(events, tmp_path / "a", format="raw")
    with pytest.raises(EventFileError, match="unknown format 'aedat', expected one of"):
        load(b"", format="aedat")


def test_missing_files(tmp_path):
    for path, what in ((tmp_path / "no.bin", "no such file"), (tmp_path, "is a folder, expected a file")):
        with pytest.raises(EventFileError) as error:
            load(path)
        assert str(error.value) == f"{path}: {what}"


def test_cannot_save_as(tmp_path):
    events = load(b"", format="nmnist")
    written = [f for f in FORMATS.values() if f.write]
    endings = ", ".join(dict.fromkeys(suffix for f in written for suffix in f.suffixes))
    for path, format, what in (
        (tmp_path / "a.nothing", None, f"cannot save as '.nothing', expected {endings}"),
        (
            tmp_path / "a.bin", "aedat3",
            f"cannot save as format 'aedat3', expected one of {', '.join(f.name for f in written)}",
        ),
        (tmp_path / "none" / "a.bin", None, "cannot be written: No such file or directory"),
    ):  # fmt: skip
        with pytest.raises(EventFileError) as error:
            save(events, path, format=format)
        assert str(error.value) == f"{path}: {what}"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("size", [(34, 34, 2), (33.5, 34), (34,), "34x34", 34])
def test_a_sensor_size_is_two_whole_numbers(size):
    with pytest.raises(ValueError, match="expected width and height of 1 to 65536 px"):
        load(event(1, 2, 3), format="nmnist", sensor_size=size)
    with pytest.raises(ValueError, match="expected width and height of 1 to 65536 px"):
        load(event(1, 2, 3), format="nmnist", sensor_size=(0, 5))


def test_a_jump_in_time_does_not_give_endless_windows():
    far = Events([0, 10**12], [0, 1], [0, 1], [1, 0], (4, 4))
    with pytest.raises(EventFileError, match="1000000000 windows of 1000 us without events before 1000000000000 us"):
        list(windows([far[:1], far[1:]], 1000))


@pytest.mark.parametrize("ending", [".npz", ".h5", ".csv", ".bin", ".dat"])
def test_parts_that_run_back_are_not_written(tmp_path, ending):
    events = Events([5, 9], [0, 1], [0, 1], [1, 0], (34, 34))
    with pytest.raises(EventFileError, match="time runs back from 9 to 5 us"):
        save([events, events], tmp_path / f"back{ending}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"start_us": "1"},
            "start_us = '1': expected a whole number of us from -2^63 to 2^63 - 1\n  hint: write 1 without quotes",
        ),
        ({"start_us": 1 << 63}, f"start_us = {1 << 63}: expected a whole number of us from -2^63 to 2^63 - 1"),
        ({"stop_us": -(1 << 64)}, f"stop_us = {-(1 << 64)}: expected a whole number of us from -2^63 to 2^63 - 1"),
        ({"stop_us": 0.5}, "stop_us = 0.5: expected a whole number of us from -2^63 to 2^63 - 1"),
        ({"window_us": float("nan")}, "window_us = .nan: expected a whole number of us from 1 to 2^63 - 1"),
        ({"window_us": float("inf")}, "window_us = .inf: expected a whole number of us from 1 to 2^63 - 1"),
        ({"window_us": "a"}, "window_us = 'a': expected a whole number of us from 1 to 2^63 - 1"),
        ({"window_us": 0}, "window_us = 0: expected a whole number of us from 1 to 2^63 - 1"),
        ({"window_us": True}, "window_us = true: expected a whole number of us from 1 to 2^63 - 1"),
        ({"count": 2.5}, "count = 2.5: expected a whole number >= 1"),
        ({"count": 0}, "count = 0: expected a whole number >= 1"),
        ({"count": 1, "window_us": 1}, "window_us and count are both given, expected one of them"),
        ({"sensor_size": (3,)}, "sensor_size = (3,): expected width and height of 1 to 65536 px"),
    ],
)
def test_arguments_of_a_stream_are_looked_at_in_the_call(options, message):
    with pytest.raises(ModelError) as error:
        stream("there is no such file.bin", **options)
    assert str(error.value) == message


@pytest.mark.parametrize("read", [load, stream])
def test_what_is_no_file(read):
    for source, message in (
        (5, "source is 5, expected a path, the bytes of a file, or an open binary file"),
        (None, "source is None, expected a path, the bytes of a file, or an open binary file"),
        (
            io.StringIO("1 2 3 4"),
            "source is an open text file, StringIO, expected a binary one\n  hint: open it as binary: open(path, 'rb')",
        ),
    ):
        with pytest.raises(ModelError) as error:
            read(source)
        assert str(error.value) == message


def test_whole_numbers_as_floats_are_taken():
    data = b"".join(event(1, 1, 100 * k) for k in range(50))
    parts = stream(data, format="nmnist", window_us=1e3, start_us=1e3, stop_us=3e3)
    assert [len(part) for part in parts] == [10, 10]


def test_a_file_that_is_read_once_must_tell_its_sensor():
    given = io.BytesIO(event(1, 2, 3))
    with pytest.raises(EventFileError) as error:
        list(stream(given, name="a.bin"))
    assert str(error.value) == (
        "a.bin: its sensor is not told, and it cannot be read twice to look for it: "
        "give sensor_size=(width, height), or --sensor WxH"
    )
    assert len(list(stream(io.BytesIO(event(1, 2, 3)), name="a.bin", sensor_size=(34, 34)))) == 1


def test_nothing_is_not_saved(tmp_path):
    with pytest.raises(EventFileError) as error:
        save([], tmp_path / "a.h5")
    assert str(error.value) == (
        f"{tmp_path / 'a.h5'}: no parts to save, expected at least one: "
        "a recording without events is one, Events([], [], [], [], (width, height))"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_jump_within_a_part():
    far = Events([0, 10**12], [0, 1], [0, 1], [1, 0], (4, 4))
    with pytest.raises(EventFileError) as error:
        list(windows([far], 1000, path="a.h5"))
    assert str(error.value) == (
        "a.h5: 999999999 windows of 1000 us without events before 1000000000000 us, expected at most 1000000: "
        "look for a jump in the times, or take longer windows"
    )
