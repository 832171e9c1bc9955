"""From one event file to another."""

import errno
import io
import subprocess
import sys
import warnings

import numpy as np
import pytest

from event_tests import random_events, refusal
from neuro.events import EventFileWarning, Events, load, save
from neuro.events.convert import STREAMED, convert, read, write
from neuro.events.formats import FORMATS


@pytest.fixture
def events():
    return random_events(3000, length=1 << 20)


WRITTEN = [f.name for f in FORMATS.values() if f.write]


class Pipe(io.RawIOBase):
    """Takes bytes, and cannot tell where it is."""

    def __init__(self):
        self.taken = []

    def writable(self):
        return True

    def write(self, data):
        self.taken.append(bytes(data))
        return len(self.taken[-1])


@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize("parts", [1, 3])
def test_a_pipe_takes_what_a_file_has_part_by_part(name, parts, events, tmp_path, monkeypatch):
    pipe = Pipe()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BufferedWriter(pipe, 1)))
    seen = []

    def given():
        for k in range(parts):
            seen.append(sum(map(len, pipe.taken)))
            yield events[k * len(events) // parts : (k + 1) * len(events) // parts]

    assert write(given(), "-", name) == len(events)
    taken = b"".join(pipe.taken)
    (tmp_path / "got").write_bytes(taken)
    assert np.array_equal(load(tmp_path / "got", format=name).records(), events.records())
    if name in STREAMED:
        save(events, tmp_path / "whole", format=name)
        assert (taken, sorted(set(seen))) == ((tmp_path / "whole").read_bytes(), seen)


@pytest.mark.parametrize("name", ["csv", "npz"])
def test_full_standard_output(name, events, monkeypatch):
    class Full(Pipe):
        def write(self, data):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BufferedWriter(Full(), 1)))
    assert refusal(write, [events], "-", name) == "<standard output>: cannot write: No space left on device"
    monkeypatch.setattr(Full, "write", lambda self, data: len(data))  # for the end of the file


def test_standard_input(events, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"# sensor 2x2\nt,x,y,p\n")))
    assert refusal(lambda: list(read("-", format="csv"))) == "<standard input>: has no events"
    save(events, tmp_path / "in.csv")
    with (tmp_path / "in.csv").open() as file:
        monkeypatch.setattr(sys, "stdin", file)
        seen = []
        assert convert("-", tmp_path / "out.h5", report=seen.append) == len(events) == seen[-1]
    assert load(tmp_path / "out.h5") == events


BEYOND = [
    (1 << 33, 3, "out.dat"), (0, 700, "out.bin"), (-5, 3, "out.aedat4"), (1 << 62, 3, "out.es"), (0, 700, "out.aedat2")
]  # fmt: skip


def test_what_is_refused(messages, tmp_path, monkeypatch):
    """With the filter that solves it; on the way to a file and to standard output."""
    monkeypatch.chdir(tmp_path)
    told = {}
    for t, x, name in BEYOND:
        save(Events([t], [x], [3], [0], (800, 34)), "in.npz", replace=True)
        told[f"{name} {t} {x}"] = refusal(convert, "in.npz", name)
    save(Events([5, 1 << 23], [1, 2], [3, 4], [0, 1], (34, 34)), "in.npz", replace=True)
    told["held"] = refusal(convert, "in.npz", "out.bin")
    for format in ("nmnist", None, "rosbag1"):
        told[f"standard output {format}"] = refusal(convert, "in.npz", "-", to_format=format)
    messages(told)
    assert [path.name for path in tmp_path.iterdir()] == ["in.npz"]


def test_damage_stops_or_is_told(events, tmp_path):
    save(events, tmp_path / "in.bin")
    (tmp_path / "in.bin").write_bytes((tmp_path / "in.bin").read_bytes()[:-2])
    assert "byte 14995: 3 bytes left over" in refusal(convert, tmp_path / "in.bin", tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()
    with pytest.warns(EventFileWarning, match="the events before it were read"):
        assert convert(tmp_path / "in.bin", tmp_path / "out.h5", strict=False) == len(events) - 1


def test_a_recording_without_events_keeps_its_sensor(tmp_path):
    save(Events([], [], [], [], (12, 7)), tmp_path / "in.es")
    with warnings.catch_warnings():
        assert convert(tmp_path / "in.es", tmp_path / "out.h5") == 0
    assert load(tmp_path / "out.h5").sensor_size == (12, 7)


@pytest.mark.slow
def test_a_large_file_needs_little_memory(tmp_path):
    n = 8_000_000
    rows = np.zeros((n, 5), np.uint8)
    rows[:, 2:] = (np.arange(n) * 8_000_000 // n)[:, None] >> np.array([16, 8, 0]) & 0xFF
    rows.tofile(tmp_path / "in.bin")
    code = (
        "import resource, sys; from neuro.events.convert import convert\n"
        "from neuro.events import load; load(bytes(5), name='a.bin')\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        f"done = convert({str(tmp_path / 'in.bin')!r}, {str(tmp_path / 'out.dat')!r})\n"
        "print(done, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert int(done[0]) == n
    assert int(done[1]) < 125  # MB; all events at once take 104 MB, and the mapped file 40 MB
