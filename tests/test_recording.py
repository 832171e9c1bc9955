"""What is recorded goes to a file while it runs, and is read from there as from a simulation."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from beside import beside
from neuro.core import growing
from neuro.core.growing import JournaledFile, JournalReader
from neuro.core.hdf5 import FRONT
from neuro.files.parts import Stored
from refused import refused, refused as refusal


def network():
    net = neuro.Network("recorded")
    net.population("in", 5, neuro.poisson_generator(rate=80.0))
    net.population("parrots", 5, neuro.parrot_neuron())
    cells = net.population("cells", 4, neuro.iaf_psc_exp(I_e=300.0))
    net.connect("in", "parrots", neuro.one_to_one(), delay=1.0)
    net.connect("in", cells, neuro.all_to_all(), weight=300.0, delay=1.0, name="fixed")
    synapse = neuro.stdp(Wmax=400.0)
    learning = net.connect("parrots", cells, neuro.all_to_all(), synapse, weight=100.0, delay=1.0, name="learning")
    net.probe("states", cells[1:3], ["V_m", "I_syn_ex"], every=1.0)
    net.probe("mean", cells, "V_m", every=0.5, mean=True)
    net.probe("rate", cells, "rate", every=10.0)
    net.probe("weights", learning, "weight", every=10.0, synapses=[3, 0])
    net.probe("sent", learning, "weight", at="pre_spikes", synapses=[7, 3])
    return net


PROBES = ("states", "states.V_m", "mean", "rate", "weights", "sent")


def equal(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(np.array_equal(a[word], b[word]) for word in a)
    return np.array_equal(a, b)


def same(a, b):
    return all(np.array_equal(mine, theirs) for mine, theirs in zip(a, b, strict=True))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5"


@pytest.fixture
def simulated():
    sim = neuro.compile(network(), "reference")
    sim.run(80.0)
    return sim


@pytest.mark.parametrize("streamed", [True, False])
def test_a_file_answers_as_the_simulation_does(path, simulated, streamed):
    net = network()
    sim = neuro.compile(net, "reference")
    if streamed:
        with sim.record_to(path):
            sim.run(33.0)
            assert same(sim.spikes("cells", since=5.0), simulated.spikes("cells", since=5.0, until=33.0))
            assert sim.trace("rate")[0].tolist() == [10.0, 20.0, 30.0]
            sim.run(47.0)
    else:
        sim.run(80.0, out=path)
    results = neuro.results.read(path)
    cells = net.populations["cells"]
    for words in ({}, {"since": 10.0}, {"since": 3.3, "until": 40.0}, {"until": 12.0}):
        for part in ("parrots", "cells"):
            assert same(simulated.spikes(part, **words), results.spikes(part, **words))
        assert same(sim_view(simulated, words), results.spikes(cells[:2], **words))
    for name in PROBES:
        mine, theirs = simulated.trace(name), results.trace(name)
        assert np.array_equal(mine[0], theirs[0])
        assert equal(mine[1], theirs[1])
    for mine, theirs in zip(simulated.weights("learning"), results.weights(net.projections["learning"]), strict=True):
        assert np.array_equal(mine, theirs)
    assert results.counts() == simulated.counts()
    assert (results.time, results.finished, results.network() == net) == (80.0, True, True)
    assert (results.traces["states.V_m"].ids.tolist(), results.traces["states.V_m"].unit) == ([1, 2], "mV")
    assert os.listdir(path.parent) == ["run.h5"]


def sim_view(sim, words):
    times, ids = sim.spikes("cells", **words)
    return times[ids < 2], ids[ids < 2]


def test_spikes_of_a_time_are_read_alone(path):
    sim = neuro.compile(network(), "reference")
    sim.run(60.0, out=path)
    results = neuro.results.read(path)
    times, _ = results.spikes("cells", since=20.0, until=40.0)
    assert times.size
    assert isinstance(vars(results.populations["cells"])["steps"], Stored)
    assert isinstance(results.populations["cells"].times_ms, np.ndarray)


(CHILD,) = beside(__file__, "CHILD")


def test_a_killed_run_leaves_what_it_has_committed(path, monkeypatch, messages):
    monkeypatch.chdir(path.parent)
    folder = Path(__file__).parent
    words = [sys.executable, "-c", textwrap.dedent(CHILD), str(folder), str(folder / "helpers")]
    child = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    for _ in range(12):
        child.stdout.readline()
    os.kill(child.pid, signal.SIGKILL)
    child.communicate()
    hint = "run.h5.part has the records of an unfinished run"
    assert refused(neuro.results.read, "run.h5") == f"run.h5: no such file\n  hint: {hint}"
    results = neuro.results.read("run.h5.part")
    assert results.time >= 5.0
    assert not results.finished
    sim = neuro.compile(network(), "reference")
    sim.run(results.time)
    assert same(sim.spikes("cells"), results.spikes("cells"))
    for name in PROBES:
        assert equal(sim.trace(name)[1], results.trace(name)[1])
    assert results.counts() == sim.counts()
    messages({"told": refused(results.weights, "learning").replace(f"{path.parent}/", "")})


def test_a_kill_within_a_commit_leaves_one_state(tmp_path, monkeypatch):
    """After each write, and in the middle of each, the file on the disk reads as of one commit, whole."""
    path, copy = tmp_path / "a.h5", tmp_path / "copy.h5"
    write, committed, seen = growing._write, [], set()

    def torn(disk, at, data):
        for part in (data[: data.nbytes // 2], data):
            write(disk, at, part)
            if committed:
                shutil.copyfile(path, copy)
                with JournalReader(copy, "a test", "of a test").reading() as file:
                    k = int(file.attrs["k"])
                    assert k in (len(committed) - 1, len(committed))
                    assert np.array_equal(file["x"][()], np.arange(file["x"].size))
                    assert file["x"].size == 700 * (k + 1)
                    seen.add((len(committed), k))

    monkeypatch.setattr(growing, "_write", torn)
    with JournaledFile(path, "of a test") as disk:
        file = h5py.File(disk, "w", userblock_size=FRONT)
        data = file.create_dataset("x", (0,), "f8", maxshape=(None,), chunks=(500,), compression="gzip")
        for k in range(4):
            data.resize(700 * (k + 1), axis=0)
            data[700 * k :] = np.arange(700 * k, 700 * (k + 1))
            file.attrs["k"] = k
            file.create_dataset(f"more {k}", data=np.arange(100 * k))
            file.flush()
            disk.commit()
            committed.append(k)
        file.close()
        disk.commit()
    assert {(1, 0), (1, 1), (2, 1), (2, 2)} <= seen


def _record(sim, path, after=lambda: None):
    with sim.record_to(path):
        sim.run(20.0)
        sim._records.recording.commit()
        after()
        sim.run(20.0)


def test_a_full_disk(path, monkeypatch, messages):
    sim = neuro.compile(network(), "reference")
    write = growing._write

    def full(disk, at, data):
        if sim.time > 20.0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(disk, at, data)

    monkeypatch.setattr(growing, "_write", full)
    messages({"told": refused(_record, sim, path).replace(f"{path.parent}/", "")})
    assert neuro.results.read(f"{path}.part").time == 20.0


def test_a_run_leaves_what_earlier_ones_kept(path):
    def interrupted(ms):
        sim = neuro.compile(network(), "reference")
        with sim.record_to(path):
            if ms:
                sim.run(ms)
            raise KeyboardInterrupt

    for ms in (0.0, 5.0, 6.0):  # the first records nothing
        with pytest.raises(KeyboardInterrupt):
            interrupted(ms)
    neuro.compile(network(), "reference").run(7.0, out=path)
    times = {file.name: neuro.results.read(file).time for file in path.parent.iterdir()}
    assert times == {"run.h5.part": 5.0, "run.2.h5.part": 6.0, "run.h5": 7.0}
    path.unlink()
    assert "run.2.h5.part has the records of an unfinished run" in refused(neuro.results.read, path)


def test_a_folder_that_is_removed(tmp_path, messages):
    (tmp_path / "gone").mkdir()
    path = tmp_path / "gone" / "run.h5"
    sim = neuro.compile(network(), "reference")
    messages({"told": refused(_record, sim, path, lambda: shutil.rmtree(path.parent)).replace(f"{tmp_path}/", "")})


def test_what_cannot_be_recorded_to(path):
    sim, other = (neuro.compile(network(), "reference") for _ in range(2))
    with sim.record_to(path):
        for word, call in {
            "record_to": lambda: sim.run(1.0, out=path),
            "reset": sim.reset,
            "restore": lambda: sim.restore("nothing.h5"),
        }.items():
            told = f"{word}: found a simulation that records to {path}.part: expected the end of 'record_to'"
            assert refused(call) == told
        assert refused(other.run, 1.0, out=path) == f"{path}.part: another run writes it: expected another name"
    path.write_text("a letter")
    assert refused(other.run, 1.0, out=path) == f"{path}: exists and is not a file of results: expected a new name"


def test_what_a_file_does_not_have(path, messages):
    neuro.compile(network(), "reference").run(1.0, out=path)
    messages.calls({"r": neuro.results.read(path)})


def test_one_quantity_has_one_axis(path):
    """A rate and a mean are numbers along time; neurons have columns, also a single one."""
    net = neuro.Network("shapes", resolution=1.0)
    cells = net.population("cells", 3, neuro.iaf_psc_exp(I_e=500.0))
    wires = net.connect(cells, cells, neuro.all_to_all(), neuro.stdp(), weight=1.0)
    net.probe("rate", cells, "rate", every=10.0)
    net.probe("mean", cells, "V_m", every=10.0, mean=True)
    net.probe("means", wires, ["weight", "K_plus"], every=10.0, mean=True)
    net.probe("one", cells[1], "V_m", every=10.0)
    net.probe("all", cells, ["V_m", "I_syn_ex"], every=10.0)
    sim = neuro.compile(net)
    sim.run(20.0)
    sim.run(20.0, out=path)
    sim.run(10.0)
    whole, results = neuro.compile(net), neuro.results.read(path)
    whole.run(50.0)
    shapes = {"rate": (5,), "mean": (5,), "one": (5, 1)}
    for name, shape in shapes.items():
        assert whole.trace(name)[1].shape == whole.traces[name].values.shape == shape
        assert results.trace(name)[1].shape == results.traces[name].values.shape == (4, *shape[1:])
        assert np.array_equal(results.trace(name)[1], whole.trace(name)[1][:4])
        assert np.array_equal(sim.trace(name)[1], whole.trace(name)[1][4:])
    several = {name: {word: array.shape for word, array in whole.trace(name)[1].items()} for name in ("means", "all")}
    assert several == {"means": {"weight": (5,), "K_plus": (5,)}, "all": {"V_m": (5, 3), "I_syn_ex": (5, 3)}}


def test_a_probe_of_each_step_does_not_let_the_log_of_spikes_grow():
    """A step that finds the record full empties it; only what is under way needs a larger log."""
    net = neuro.Network("busy", resolution=1.0)
    net.population("drive", 64, neuro.poisson_generator(rate=900.0))
    cells = net.population("cells", 64, neuro.parrot_neuron())
    seen = net.population("seen", 1, neuro.iaf_psc_delta())
    net.connect("drive", cells, neuro.one_to_one())
    net.probe("V_m", seen, "V_m")
    sim = neuro.compile(net)
    sim.run(100.0)
    sim.forget(sim.time)
    held = sim.memory()["spikes"]
    for _ in range(10):
        sim.run(2000.0)
        sim.forget(sim.time)
    assert sim.memory()["spikes"] == held


def test_a_kill_within_a_commit_of_a_shorter_file_leaves_one_state(tmp_path, monkeypatch):
    path, copy, write, states = tmp_path / "a.h5", tmp_path / "copy.h5", growing._write, []

    def torn(disk, at, data):
        for part in (data[: data.nbytes // 2], data):
            write(disk, at, part)
            shutil.copyfile(path, copy)
            held = JournalReader(copy, "a test", "of a test")
            found = held._checked()
            states.append((found.front.size, bytes(found.at(FRONT, 1 << 20)).rstrip(b"\0")[:1]))

    with JournaledFile(path, "of a test") as disk:
        for size, content in ((40_000, b"a"), (20_000, b"b")):
            disk.seek(FRONT)
            disk.write(content * (size - FRONT))
            disk.truncate(size)
            disk.commit()
            monkeypatch.setattr(growing, "_write", torn)
    assert set(states) == {(40_000, b"a"), (20_000, b"b")}
    assert path.stat().st_size == 20_000


def test_another_process_writes_the_same_file(tmp_path):
    files = {}
    for live in (False, True):
        sim = neuro.compile(network(), "reference")
        with sim.record_to(tmp_path / f"{live}.h5", live=live) as recording:
            sim.run(20.0)
            recording.drain()
            sim.run(13.0)
            recording.commit()
            assert sim.held == (33.0 if live else 0.0)
            sim.run(7.0)
        assert same(sim.spikes("cells"), neuro.results.read(tmp_path / f"{live}.h5").spikes("cells"))
        files[live] = tmp_path / f"{live}.h5"
    rerun = pytest.importorskip("neuro_sweeps.rerun")
    assert rerun.first_difference(*files.values()) == ""


def test_what_keeps_another_process_from_writing_is_reported(path):
    part = path.with_name("run.h5.part")
    sim, other = (neuro.compile(network(), "reference") for _ in range(2))
    with sim.record_to(path, live=True):
        refused = refusal(lambda: other.record_to(path, live=True).__enter__())
        assert refused == f"{part}: another run writes it: expected another name"
        sim.run(5.0)
    assert neuro.results.read(path).duration_ms == 5.0

    def removed():
        with sim.record_to(path.with_name("other.h5"), live=True):
            path.with_name("other.h5.part").unlink()
            sim.run(5.0)

    assert refusal(removed) == f"{path.with_name('other.h5.part')}: cannot be written: it was removed"


def test_a_run_that_is_replayed_is_not_saved(path):
    sim = neuro.compile(network(), "reference")
    sim.run(5.0, out=path)
    sim.replay(neuro.results.read(path))
    sim.save(path.with_name("state.h5"))
    camera = neuro.Network("camera", resolution=1.0)
    camera.population("eye", (2, 3), neuro.event_camera(polarity="merge"))
    fed = neuro.compile(camera, "reference")
    with fed.record_to(path):
        fed.feed("eye", np.array([(1500, 1, 1, 1)], [(word, np.int64) for word in "txyp"]))
        fed.run(5.0)
    assert list(fed.steered) == []
    again = neuro.compile(camera, "reference")
    again.replay(neuro.results.read(path))
    for call in (again.save, again.restore):
        expected = f"{call.__name__}: a state cannot hold a replayed run: expected a simulation without 'replay'"
        assert refusal(call, path.with_name("state.h5")) == expected
    again.run(5.0)
    assert again.counts().populations["eye"].spikes == 1
    assert list(again.steered) == ["replay"]


@pytest.mark.parametrize("pieces", [(2500.0,), (1024.0, 1.0, 1475.0)])
def test_a_long_trace_of_one_neuron_is_that_of_the_reference(pieces):
    """The buffers of a probe hold 1,024 steps; a trace that fills several of them is complete and in order."""
    net = neuro.Network("long", resolution=1.0)
    cells = net.population("cells", 3, neuro.iaf_psc_exp(I_e=380.0))
    net.probe("v", cells[1:2], "V_m")
    traces = []
    for backend in ("event", "reference"):
        sim = neuro.compile(net, backend=backend, seed=1)
        for piece in pieces:
            sim.run(piece)
        traces.append(sim.trace("v"))
    assert len(traces[0][0]) == 2500
    for ours, reference in zip(*traces, strict=True):
        np.testing.assert_array_equal(ours, reference)
