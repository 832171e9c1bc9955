"""What came before is kept: after a full disk, a kill, damage in a pipe, and events for which a format has no room."""

import io
import signal
import subprocess
import sys

import numpy as np
import pytest

from event_tests import random_events
from neuro.events import Events, load, save
from neuro.events.formats import FORMATS, held, written

SIZE = (34, 34)
ENDINGS = {f.name: f.suffixes[0] for f in written()}
GROWING = sorted(f.name for f in written() if f.grows)


def read(path, name):
    """A part as its note tells to read it; a format without a sensor gets it."""
    return load(path, format=name, sensor_size=SIZE)


@pytest.fixture(scope="module")
def events():
    whole = random_events(4000, SIZE, 4_000_000)
    return whole[whole.y != 240]


def parts_of(events, count=100):
    return [events[k : k + count] for k in range(0, len(events), count)]


class Stopped(Exception):
    """The source of the events ends with it."""


def until(events, parts, error):
    yield from parts_of(events)[:parts]
    raise error


@pytest.mark.parametrize("error", [Stopped("the network"), KeyboardInterrupt()])
@pytest.mark.parametrize("name", ENDINGS)
def test_a_source_that_fails_leaves_what_came(events, tmp_path, name, error):
    path = tmp_path / f"a{ENDINGS[name]}"
    with pytest.raises(type(error)) as told:
        save(until(events, 7, error), path, format=name, keep=True)
    part, reader = tmp_path / f"{path.name}.part", name if name in GROWING else "csv"
    assert [file.name for file in tmp_path.iterdir()] == [part.name]
    assert told.value.__notes__[-1] == (
        f"the events so far are kept: 'neuro events info {part} --from {reader}' reads {part}"
    )
    assert np.array_equal(read(part, reader).records(), events[:700].records())
    if name != "evt2" and name != "evt3":  # both end in .raw, and their header tells
        assert len(load(part, sensor_size=SIZE)) == 700


@pytest.mark.parametrize("name", ENDINGS)
def test_a_whole_recording_leaves_no_part(events, tmp_path, name):
    path = tmp_path / f"a{ENDINGS[name]}"
    save(iter(parts_of(events)), path, format=name, keep=True)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert np.array_equal(read(path, name).records(), events.records())
    assert load(path, format=name, sensor_size=SIZE).metadata["format"] == name
    save(Events([], [], [], [], SIZE), path, format=name, keep=True, replace=True)
    assert len(read(path, name)) == 0


def test_metadata_are_kept_in_formats_that_have_them(tmp_path):
    told = Events([1, 2], [3, 4], [5, 6], [0, 1], SIZE, {"camera": "left"})
    for ending in (".h5", ".npz"):
        save(told, tmp_path / f"a{ending}", keep=True)
        assert load(tmp_path / f"a{ending}").metadata["camera"] == "left"


def test_no_part_is_ever_replaced(events, tmp_path):
    names = []
    for _ in range(3):
        with pytest.raises(Stopped):
            save(until(events, 2, Stopped()), tmp_path / "a.dat", keep=True)
        names.append(sorted(file.name for file in tmp_path.iterdir()))
    assert names[-1] == ["a.2.dat.part", "a.3.dat.part", "a.dat.part"]
    save(events, tmp_path / "a.dat", keep=True)
    assert len(list(tmp_path.iterdir())) == 4
    assert all(len(load(tmp_path / name)) == 200 for name in names[-1])
    with pytest.raises(Stopped):
        save(until(events, 0, Stopped()), tmp_path / "b.bin", keep=True)  # no event came
    assert not list(tmp_path.glob("b*"))


WRITER = """
import resource, sys, numpy as np
from neuro.events import Events, save
limit, *words = sys.argv[1:]
if limit != "none":
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
def parts(count):
    for k in range(count):
        t = 1000 * k + np.arange(100)
        yield Events(t, t % 34, t % 30, t % 2, (34, 34))
        if limit == "none":
            print(k, flush=True)
for name, path in zip(words[::2], words[1::2]):
    try:
        save(parts(500 if limit != "none" else 10**6), path, format=name, keep=True)
    except Exception as error:
        print(str(error).replace(chr(10), " "), *error.__notes__, flush=True)
"""


def run_writer(limit, *words):
    command = [sys.executable, "-c", WRITER, str(limit), *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def test_a_full_disk_leaves_what_fits(tmp_path):
    """Here a limit of the size of a file, which the system treats as a full disk; parts are whole or not there."""
    paths = {name: tmp_path / f"{name}{ENDINGS[name]}" for name in GROWING}
    with run_writer(5003, *(word for pair in paths.items() for word in pair)) as running:
        told = running.communicate(timeout=120)[0].splitlines()
    for (name, path), line in zip(paths.items(), told, strict=True):
        part = tmp_path / f"{path.name}.part"
        assert "cannot be written: File too large" in line
        assert f"the events so far are kept: 'neuro events info {part} --from {name}'" in line
        kept = read(part, name)
        assert (len(kept) >= 100, len(kept) % 100, part.stat().st_size <= 5003) == (True, 0, True)
    assert {file.name for file in tmp_path.iterdir()} == {f"{path.name}.part" for path in paths.values()}


@pytest.mark.parametrize(("name", "number"), [("nmnist", signal.SIGTERM), ("aedat4", signal.SIGKILL)])
def test_a_killed_process_leaves_what_came(tmp_path, name, number):
    path = tmp_path / f"a{ENDINGS[name]}"
    with run_writer("none", name, path) as running:
        while int(running.stdout.readline()) < 20:
            pass
        running.send_signal(number)
        running.stdout.read()
        running.wait(60)
    found = read(tmp_path / f"{path.name}.part", name if name in GROWING else "csv")
    assert (len(found) >= 2000, len(found) % 100, found.t.tolist()[:3]) == (True, 0, [0, 1, 2])


def test_what_a_format_has_no_room_for_is_left_out_and_counted(tmp_path):
    """Each format that names its room keeps all other events, in the order in which they came."""
    far = Events([5, 6, 1 << 62, (1 << 62) + 1], [1, 20_000, 2, 3], [1, 2, 3, 4], [0, 1, 0, 1], (32_768, 32_768))
    for f in written():
        counts = []
        kept = list(held(iter([far[:2], far[2:]]), f, counts.append))
        rows = np.concatenate([part.records() for part in kept])
        save(iter(kept), tmp_path / "a", format=f.name, replace=True)
        assert np.array_equal(load(tmp_path / "a", format=f.name, sensor_size=far.sensor_size).records(), rows)
        assert sum(counts) + len(rows) == 4
        if f.name in ("nmnist", "evt2", "evt3", "aedat2"):
            assert [row[0] for row in rows.tolist()] == [5]
        if f.name in ("csv", "txt", "hdf5", "npz"):
            assert len(rows) == 4


def test_event_stream_leaves_out_what_follows_a_gap_that_is_too_long(tmp_path):
    far, counts = Events([5, 6, 1 << 50, (1 << 50) + 1], [1] * 4, [1] * 4, [1] * 4, SIZE), []
    kept = list(held(iter([far[:1], far[1:3], far[3:]]), FORMATS["event_stream"], counts.append))
    save(iter(kept), tmp_path / "a.es")
    assert (load(tmp_path / "a.es").t.tolist(), counts) == ([5, 6], [1, 1])


def test_a_pipe_that_breaks_off_leaves_what_came(events, tmp_path, monkeypatch, answer):
    """Events from standard input cannot be had again; those of a file can, so nothing is left of their copy."""
    monkeypatch.chdir(tmp_path)
    save(events, tmp_path / "in.dat")
    cut = (tmp_path / "in.dat").read_bytes()[:-3]
    for words in (["convert", "-", "out.es"], ["filter", "-", "out.es", "refractory: {period_us: 1}"]):
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(cut)))
        status, _, err = answer("events", *words)
        assert status == 2
        assert "5 bytes left over" in err
        assert "the events so far are kept: 'neuro events info out.es.part --from event_stream'" in err
        assert 0 < len(load(tmp_path / "out.es.part")) <= len(events) - 1
        (tmp_path / "out.es.part").unlink()
    (tmp_path / "cut.dat").write_bytes(cut)
    assert answer("events", "convert", "cut.dat", "out.es").status == 2
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cut.dat", "in.dat"]
