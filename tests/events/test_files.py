import io

import numpy as np
import pytest

from neuro.events import Events, load, save, stream
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


COUNTED = event(1, 1, 0) + event(0, 240, 0) + event(1, 1, 1) + event(34, 0, 2)
"""Words that only turn the clock are counted, too."""


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


def test_what_is_refused(messages, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    empty, far = load(b"", format="nmnist"), Events([0, 10**12], [0, 1], [0, 1], [1, 0], (4, 4))
    once = io.BytesIO(event(1, 2, 3))
    messages.calls(globals() | locals() | {"windows": windows})
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
    assert len(list(stream(io.BytesIO(event(1, 2, 3)), name="a.bin", sensor_size=(34, 34)))) == 1


def test_whole_numbers_as_floats_are_taken():
    data = b"".join(event(1, 1, 100 * k) for k in range(50))
    parts = stream(data, format="nmnist", window_us=1e3, start_us=1e3, stop_us=3e3)
    assert [len(part) for part in parts] == [10, 10]
