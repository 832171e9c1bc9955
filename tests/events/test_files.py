import io
import pickle

import pytest

from neuro.events import EventFileError, Events, load, save
from neuro.events.files import windows
from neuro.events.formats import FORMATS


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
    titles = ", ".join(f"{f.title} ({' '.join(f.suffixes)})" for f in FORMATS)
    names = ", ".join(f.name for f in FORMATS)
    for name, format, what in (
        ("a.nothing", None, f"unknown kind of event file, expected one of: {titles}"),
        ("a.bin", "nothing", f"unknown format 'nothing', expected one of {names}"),
    ):
        with pytest.raises(EventFileError) as error:
            load(b"", name=name, format=format)
        assert str(error.value) == f"{name}: {what}"
    assert "N-MNIST .bin (.bin)" in titles


def test_missing_files(tmp_path):
    for path, what in ((tmp_path / "no.bin", "no such file"), (tmp_path, "is a folder, expected a file")):
        with pytest.raises(EventFileError) as error:
            load(path)
        assert str(error.value) == f"{path}: {what}"


def test_cannot_save_as(tmp_path):
    events = load(b"", format="nmnist")
    written = [f for f in FORMATS if f.write]
    endings = ", ".join(dict.fromkeys(suffix for f in written for suffix in f.suffixes))
    for path, format, what in (
        (tmp_path / "a.nothing", None, f"cannot save as '.nothing', expected {endings}"),
        (
            tmp_path / "a.bin", "aedat3",
            f"cannot save as format 'aedat3', expected one of {', '.join(f.name for f in written)}",
        ),
        (tmp_path / "none" / "a.bin", None, "cannot write: No such file or directory"),
    ):  # fmt: skip
        with pytest.raises(EventFileError) as error:
            save(events, path, format=format)
        assert str(error.value) == f"{path}: {what}"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("size", [(34, 34, 2), (33.5, 34), (34,), "34x34", 34])
def test_a_sensor_size_is_two_whole_numbers(size):
    with pytest.raises(ValueError, match="expected width and height, two whole numbers"):
        load(event(1, 2, 3), format="nmnist", sensor_size=size)
    with pytest.raises(ValueError, match="expected 1x1 to 65536x65536 px"):
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
