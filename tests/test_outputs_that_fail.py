"""What is left of a file that could not be written: nothing of ours, and nothing of others is gone."""

import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
import neuro.events.formats
from beside import beside
from neuro import events
from neuro.core import outputs
from neuro.core.hdf5 import new_file, writing
from neuro.core.outputs import Unwritable, check_output, marked, output, write_text
from refused import refused

OURS = marked("a text of ours", "# ours")


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_nothing_is_left_of_a_failure(tmp_path, error):
    def fail():
        with output(tmp_path / "a", OURS) as part:
            part.write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert os.listdir(tmp_path) == []


def test_errors_about_other_files_stay_theirs(tmp_path):
    with pytest.raises(FileNotFoundError, match="other"), output(tmp_path / "a", OURS):
        (tmp_path / "other").read_bytes()


class TestFull:
    """A disk that is full; files that are limited are the same to who writes them."""

    LIMIT = 1 << 18

    @pytest.fixture(autouse=True)
    def limited(self):
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (self.LIMIT, before[1]))
        yield
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    def text(self, path):
        write_text(path, "# ours" * self.LIMIT, OURS)

    def hdf5(self, path):
        with writing(path, "of a test") as file:
            for k in range(9):
                file[str(k)] = np.random.default_rng(k).random(20_000)

    def network(self, path):
        net = neuro.Network("n", resolution=1.0)
        net.population("a", 100_000, neuro.iaf_psc_delta(V_th=np.random.default_rng(0).uniform(20, 30, 100_000)))
        net.save(path)

    def recording(self, path):
        draw, n = np.random.default_rng(0), 400_000
        x, y, p = draw.integers(0, (34, 34, 2), (n, 3)).T
        events.save(events.Events(np.arange(n), x, y, p, (34, 34)), path)

    @pytest.mark.parametrize(
        ("kind", "name"),
        [("text", "a"), ("hdf5", "a.h5"), ("network", "a.yaml")]
        + [("recording", f"a{f.suffixes[0]}") for f in events.formats.FORMATS.values() if f.write],
    )
    def test_nothing_is_left(self, kind, name, tmp_path):
        before = h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE)
        with pytest.raises(ValueError, match=r"a(\.\w+)?: cannot be written: File too large(\n  hint: .*)?$"):
            getattr(self, kind)(tmp_path / name)
        assert os.listdir(tmp_path) == []
        assert h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE) == before


def test_a_full_file_system(tmp_path):
    if os.geteuid() or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", tmp_path]).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        with pytest.raises(Unwritable, match=r"a\.h5: cannot be written: No space left on device$"):
            TestFull().hdf5(tmp_path / "a.h5")
        assert os.listdir(tmp_path) == []
    finally:
        subprocess.run(["umount", tmp_path], check=True)


def test_an_hdf5_file_that_is_still_open_does_not_end_python_with_a_signal(tmp_path):
    """HDF5 closes it at the end of the process, when the Python file that it writes into is gone."""
    code = "import h5py, io, neuro.core.hdf5; file = h5py.File(io.BytesIO(), 'w'); file['a'] = [1]"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("most", [400, 3000, 20_000, 60_000])
def test_a_run_without_room_ends_with_one_error(tmp_path, most):
    net = neuro.Network("n", resolution=1.0)
    net.population("a", 2000, neuro.iaf_psc_delta())
    net.probe("v", "a", "V_m", every=1.0)
    sim = neuro.compile(net, "reference")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        assert "a.h5.part: cannot be written: File too large" in refused(sim.run, 20.0, out=tmp_path / "a.h5")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    kept = {left: neuro.results.read(left).time for left in tmp_path.iterdir()}
    assert all(time < 20.0 for time in kept.values())  # only what a commit has completed
    sim.run(20.0, out=tmp_path / "a.h5")  # a recording that a failure left stays
    parts = {left for left, time in kept.items() if time > 0.0}
    assert set(tmp_path.iterdir()) == parts | {tmp_path / "a.h5"}


def test_the_files_of_sonata_are_replaced_together(tmp_path):
    def network(size):
        net = neuro.Network("n", resolution=1.0)
        net.population("a", size, neuro.iaf_psc_delta())
        net.connect("a", "a", neuro.fixed_indegree(200), weight=1.0, name="aa")
        return neuro.compile(net, "reference")

    neuro.save_sonata(network(300), tmp_path / "n.json")
    complete = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, before[1]))
    try:
        with pytest.raises(Unwritable, match=r"n_edges\.h5: cannot be written: File too large$"):
            neuro.save_sonata(network(500), tmp_path / "n.json")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == complete


def test_a_pipe_that_nobody_reads_is_refused(tmp_path):
    os.mkfifo(tmp_path / "a")
    with pytest.raises(Unwritable, match=r"a: is a pipe that nobody reads: expected a reader, or the name of a file$"):
        check_output(tmp_path / "a", OURS)


def test_other_errors_of_hdf5_stay(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"name = '.*/b'"), new_file(tmp_path / "a"):
        h5py.File(tmp_path / "b", "r")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unwritable to root")
def test_a_protected_file_stays(tmp_path):
    path = tmp_path / "a"
    path.write_text("# ours")
    path.chmod(0o400)
    assert re.search(r"a: cannot be written: Permission denied$", refused(write_text, path, "# ours", OURS))


(KILLED,) = beside(__file__, "KILLED")


def test_what_a_killed_process_left_is_removed(tmp_path, monkeypatch):
    path = tmp_path / "a"
    path.write_text("# ours: old")
    with subprocess.Popen([sys.executable, "-c", KILLED, path], stdout=subprocess.PIPE, text=True) as running:
        part = running.stdout.readline().strip()
        monkeypatch.setattr(outputs, "_swept", set())
        check_output(path, OURS)
        assert (tmp_path / part).exists()  # it is still written
        running.send_signal(signal.SIGKILL)
    assert path.read_text() == "# ours: old"
    assert sorted(os.listdir(tmp_path)) == [part, "a"]
    elsewhere = tmp_path / part.replace(outputs._HOST, "another-machine")
    elsewhere.write_text("half")
    monkeypatch.setattr(outputs, "_swept", set())
    write_text(path, "# ours: new", OURS)
    assert sorted(os.listdir(tmp_path)) == [elsewhere.name, "a"]


def _left(folder, process=99_999_999):
    return folder / f".a.{outputs._HOST}.{process}.0.part"


def test_sweeping_takes_files_of_this_user_only(tmp_path, monkeypatch):
    monkeypatch.setattr(outputs, "_swept", set())
    _left(tmp_path).mkdir()
    _left(tmp_path, "9" * 23).touch()
    _left(tmp_path, "9" * 9).touch()
    before = set(os.listdir(tmp_path)) - {_left(tmp_path, "9" * 9).name}
    write_text(tmp_path / "a", "# ours", OURS)
    assert set(os.listdir(tmp_path)) == {*before, "a"}


def test_leftovers_of_others_stay(tmp_path, monkeypatch):
    monkeypatch.setattr(outputs, "_swept", set())
    _left(tmp_path).touch()
    monkeypatch.setattr(os, "getuid", lambda: 4321)
    write_text(tmp_path / "a", "# ours", OURS)
    assert sorted(os.listdir(tmp_path)) == [_left(tmp_path).name, "a"]


@pytest.mark.parametrize("call", ["scandir", "unlink"])
def test_sweeping_that_is_refused_is_no_error(call, tmp_path, monkeypatch):
    """As in a folder that may be written to but not read, and in one with the sticky bit."""
    monkeypatch.setattr(outputs, "_swept", set())
    _left(tmp_path).touch()
    real = getattr(os, call)

    def refuse(path, *more, **named):
        if Path(path) in (tmp_path, _left(tmp_path)):
            raise PermissionError(13, "Permission denied")
        return real(path, *more, **named)

    monkeypatch.setattr(os, call, refuse)
    write_text(tmp_path / "a", "# ours", OURS)
    assert (tmp_path / "a").read_text() == "# ours"
