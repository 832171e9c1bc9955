"""Promises of a recording: a killed run is reported and repeated, a full disk is one error, memory is bounded."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
import neuro_models
from kills import arrays
from neuro import ModelError
from neuro.core.system import usable_cores
from refused import refused
from stopped_writers import small_disk

NET = """\
neuro: 1
name: pair
populations:
  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 20}
  exc: {model: iaf_psc_exp, shape: 10}
projections:
  noise_exc: {from: noise, to: exc, rule: all_to_all, weight: 300.0, delay: 1.0, synapse: {stdp: {Wmax: 900.0}}}
probes:
  v: {of: exc, record: V_m, every: 5.0}
"""
RUN = "from neuro.run import collect; collect.COMMIT_S = 0.02; from neuro.cli import main; main()"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text(NET)
    return tmp_path


def network():
    net = neuro.Network("n", resolution=1.0)
    net.population("noise", 200, neuro.poisson_generator(rate=900.0))
    net.population("a", 200, neuro.parrot_neuron())
    net.population("seen", 3, neuro.iaf_psc_delta())
    net.connect("noise", "a", neuro.one_to_one(), delay=1.0)
    learning = net.connect("a", "seen", neuro.all_to_all(), neuro.stdp(Wmax=9.0), weight=1.0, delay=1.0)
    net.probe("v", "seen", "V_m", every=1.0)
    net.probe("sent", learning, "weight", at="pre_spikes", synapses=[0])
    return net


def test_a_killed_run_is_reported_and_repeated(folder, run):
    words = ("run", "net.yaml", "--for", "1e7", "--backend", "reference", "--out", "out.h5")
    running = subprocess.Popen([sys.executable, "-c", RUN, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    part, deadline = Path("out.h5.part"), time.monotonic() + 60.0
    while time.monotonic() < deadline and running.poll() is None:
        with suppress(ModelError):
            if neuro.results.read(part).time >= 20.0:
                break
        time.sleep(0.01)
    running.kill()
    output = running.communicate()
    assert running.returncode == -signal.SIGKILL, output
    results = neuro.results.read(part)
    assert results.time >= 20.0
    assert results.spikes("exc")[0].size
    run("report", part, "--out", "page.html")
    assert f"{results.time:g} ms" in Path("page.html").read_text()
    run("rerun", part)


@pytest.mark.parametrize("live", [False, True])
def test_a_full_file_system_is_one_error(tmp_path, live):
    with small_disk(tmp_path / "disk", 16 << 10) as disk:
        if disk is None:
            pytest.skip("no file system can be mounted here")
        sim = neuro.compile(network(), "reference")

        def record():
            with sim.record_to(disk / "a.h5", live=live) as recording:
                for _ in range(20):
                    sim.run(100.0)
                    recording.commit()

        message = refused(record)
        assert message.startswith(f"{disk}/a.h5.part: cannot be written: No space left on device")
        assert message.count("cannot be written") == 1
        time_ms = sim.time
        sim.run(100.0)  # the simulation goes on without the file
        assert sim.time == time_ms + 100.0


def test_memory_stays_the_same_while_a_file_is_written(tmp_path):
    sim = neuro.compile(network(), threads=min(2, usable_cores()))
    with sim.record_to(tmp_path / "a.h5") as recording:
        for _ in range(3):
            sim.run(500.0)
            recording.commit()
            sizes = sim.memory()["spikes"]
            for records in sim._records.recorder.records.values():
                assert not records.arrays()["times_ms"].size
            assert not sim._engine.spikes(1, -1).steps.size
        for _ in range(5):
            sim.run(500.0)
            recording.commit()
            assert sim.memory()["spikes"] == sizes
    whole = neuro.compile(network())
    whole.run(4000.0)
    results = neuro.results.read(tmp_path / "a.h5")
    for name in ("v", "sent"):
        (times, values), (expected_times, expected) = results.trace(name), whole.trace(name)
        assert np.array_equal(times, expected_times)
        assert np.array_equal(
            values if name == "v" else values["weight"], expected if name == "v" else expected["weight"]
        )
    assert all(map(np.array_equal, results.spikes("a"), whole.spikes("a")))
    assert os.listdir(tmp_path) == ["a.h5"]


KILLED_AT_A_CHECKPOINT = """
import os, signal, sys
count = 0
def die(event, args):
    global count
    if event == "os.rename" and str(args[1]).endswith(".training"):
        count += 1
        if count == 2:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(die)
from neuro.cli import main
main()
"""
"""Runs the command, and kills the process when the second checkpoint is written and has not its name yet."""


def test_resume_continues_a_killed_run_of_a_world_to_the_same_bits(folder, run, answer):
    text = Path(neuro_models.path("cartpole")).read_text()
    Path("world.yaml").write_text(text.replace("explore: 400", "explore: 50\n  block: 200"))
    words = ("run", "world.yaml", "--set", "critics=5", "--steps", "900", "--seed", "3", "--out")
    run(*words, "whole.h5")
    for blocks, more in ((1, ()), (2, ("--resume",))):
        killed = subprocess.run([sys.executable, "-c", KILLED_AT_A_CHECKPOINT, *words, "out.h5", *more], check=False)
        assert killed.returncode == -signal.SIGKILL
        with h5py.File("out.h5.training") as checkpoint:
            assert checkpoint["counts"][2] == blocks  # the resumed run did not begin again
        assert not Path("out.h5").exists()
    refusal = answer(*words, "out.h5")
    assert refusal.status == 2
    assert "out.h5.training has an unfinished run\n  hint: --resume continues the run" in refusal.err
    # A new process removes what the killed ones left.
    subprocess.run([sys.executable, "-m", "neuro", *words, "out.h5", "--resume"], check=True)
    assert arrays(Path("out.h5")) == arrays(Path("whole.h5"))
    assert sorted(path.name for path in folder.glob("*.h5*")) == ["out.h5", "whole.h5"]
    run("rerun", "out.h5")
    run("report", "out.h5")
