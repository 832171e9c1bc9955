import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import neuro as framework
from neuro.cli.run import weights
from neuro.core.progress import STRETCH_S
from neuro.files.results import read
from neuro.run.collect import collect


def rows_of(out):
    """Rows of printed tables as lists of words."""
    return [line.split() for line in out.splitlines() if line.strip()]


def test_the_tables(neuro, network):
    answer = neuro(*RUN, "--out", "a.h5")
    assert answer.status == 0
    assert re.fullmatch(TOOK.format(50), answer.err)
    rows = rows_of(answer.out)
    assert " ".join(rows[0]) == "population model neurons spikes rate Hz"
    models = ["noise poisson_generator 20", "current dc_generator 1", "exc iaf_psc_exp 8", "one iaf_psc_exp 1"]
    assert [" ".join(row[:3]) for row in rows[2:6]] == models
    results = read("a.h5")
    spikes = results.populations["exc"].counts["spikes"]
    assert rows[4][3:] == [str(spikes), f"{spikes / 8 / 0.05:.2f}"]
    head = [" ".join(row) for row in rows].index("projection synapse synapses weight SD from to")
    weight = results.projections["noise_exc"].weight
    figures = [f"{value:.4g}" for value in (weight.mean(), weight.std(), weight.min(), weight.max())]
    assert rows[head + 2] == ["noise_exc", "stdp", "160", *figures]
    assert answer.out.splitlines()[-3:] == [
        "recorded: spikes of exc, one; v (V_m of 8 neurons at 50 times); v_one (V_m of 1 neuron at 500 times)",
        "a.h5: 50 ms",
        "next: neuro plot a.h5, or neuro report a.h5",
    ]


TOOK = r"{} ms simulated in [\d.e-]+ s: real-time factor [\d.e+-]+\n"
RUN = ("run", "net.yaml", "--backend", "reference", "--for", "50")


@pytest.fixture
def simulated(network):
    sim = framework.compile(framework.load(network), backend="reference", seed=0)
    sim.run(50.0)
    return sim


def test_a_run_without_a_record(neuro, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.yaml").write_text("neuro: 1\npopulations:\n  dc: {model: dc_generator, shape: 1}\n")
    out = neuro("run", "net.yaml", "--for", "1", "--backend", "reference", "--out", "a file.h5").out
    assert out.splitlines()[-2:] == ["recorded: nothing", "a file.h5: 1 ms"]


def test_the_file_says_what_the_simulation_says(neuro, network, simulated):
    neuro(*RUN)
    results = read("out.h5")
    for name in ("exc", "one"):
        times, ids = simulated.spikes(name)
        train = results.populations[name]
        assert train.multiplicity.sum() == times.size > 0
        assert np.array_equal(np.repeat(train.times_ms, train.multiplicity), times)
        assert np.array_equal(np.repeat(train.ids, train.multiplicity), ids)
    for name, kept in results.projections.items():
        for mine, theirs in zip((kept.pre, kept.post, kept.weight), simulated.weights(name), strict=True):
            assert np.array_equal(mine, theirs)
    for name, trace in results.traces.items():
        times, values = simulated.trace(name)
        assert np.array_equal(trace.times_ms, times)
        assert np.array_equal(trace.values, values)
    assert results.traces["v"].unit == "mV"
    assert results.populations["exc"].shape == (2, 4)
    assert not results.populations["noise"].recorded
    assert results.about["counts.synaptic_ops"] == simulated.counts().synaptic_ops
    assert results.projections["noise_exc"].counts["learning_updates"] > 0
    assert results.about["backend"] == "reference"
    assert results.about["neuro"] == framework.__version__
    assert results.network() == framework.load(network)


def test_a_long_run_in_stretches_is_the_same_run(neuro, network, monkeypatch):
    neuro(*RUN, "--out", "a.h5")
    monkeypatch.setattr("neuro.core.progress.STRETCH_S", STRETCH_S / 100)
    neuro(*RUN, "--out", "b.h5")
    a, b = read("a.h5"), read("b.h5")
    assert np.array_equal(a.populations["exc"].times_ms, b.populations["exc"].times_ms)
    assert np.array_equal(a.traces["v_one"].values, b.traces["v_one"].values)
    assert np.array_equal(a.projections["noise_exc"].weight, b.projections["noise_exc"].weight)


def test_parameters_are_set(neuro, network):
    neuro(*RUN, "--set", "w=1e+2", "--set", "rate=40", "--seed", "7")
    results = read("out.h5")
    assert results.network() == framework.load(network, params={"w": 100.0, "rate": 40.0})
    assert results.about["seed"] == 7


def test_what_was_learnt_is_written_frozen(neuro, network, simulated):
    assert neuro(*RUN, "--save-frozen", "learnt.yaml").status == 0
    learnt = framework.load("learnt.yaml")
    assert learnt == simulated.network(frozen=True)
    assert learnt.projections["noise_exc"].synapse == framework.static()
    before = Path("out.h5").stat().st_mtime_ns
    assert "expected a name ending in .yaml" in neuro(*RUN, "--save-frozen", "learnt.txt").err
    assert Path("out.h5").stat().st_mtime_ns == before


def test_record_keeps_what_is_named(neuro, network):
    assert neuro(*RUN, "--record", "noise", "--record", "exc").status == 0
    trains = read("out.h5").populations
    assert [name for name, train in trains.items() if train.recorded] == ["noise", "exc"]
    assert trains["noise"].multiplicity.sum() == trains["noise"].counts["spikes"] > 0


def test_weights_that_follow_from_the_network_are_left_out(neuro, network, monkeypatch):
    monkeypatch.setattr("neuro.run.collect.SMALL", 1)
    answer = neuro(*RUN)
    assert "static weights not written: current_exc, exc_one; --all-weights writes them\n" in answer.out
    kept = read("out.h5").projections
    assert kept["exc_one"].weight is None
    assert kept["exc_one"].synapses == 2
    assert kept["noise_exc"].weight.size == 160
    assert "left out" not in neuro(*RUN, "--all-weights").out
    assert read("out.h5").projections["exc_one"].weight.tolist() == [10.0, 20.0]


def test_arrays_are_in_the_file(neuro, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    net = framework.Network("large")
    a = net.population("a", 100, framework.iaf_psc_exp(I_e=np.linspace(0.0, 1000.0, 100)))
    net.connect(a, a, framework.all_to_all(), weight=np.arange(10_000.0))
    net.save("large.yaml")
    assert neuro("run", "large.yaml", "--backend", "reference", "--for", "1").status == 0
    for file in tmp_path.iterdir():
        if file.name != "out.h5":
            file.unlink()
    assert read("out.h5").network() == net


def test_the_event_backend_is_the_default(neuro, network):
    assert neuro("run", network, "--for", "10").status == 0
    assert read("out.h5").about["backend"] == "event"


def test_an_interrupted_run_leaves_what_was_recorded(network):
    command = [sys.executable, "-c", "from neuro.cli import main; main()", *RUN[:-1], "1e6"]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while running.poll() is None:
        with suppress(framework.ModelError):  # before the first commit the file cannot be read
            if read("out.h5.part").about:
                break
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    results = read("out.h5.part")
    told = f"interrupted: out.h5.part has the records up to {results.time:g} ms"
    assert (running.returncode, out) == (130, "")
    assert err.splitlines()[-1] == told
    assert sorted(os.listdir()) == [network, "out.h5.part"]
    assert not results.finished


def test_what_stood_there_stays_when_a_run_fails(neuro, network, monkeypatch):
    neuro(*RUN)
    precious = Path("out.h5").read_bytes()
    monkeypatch.setattr("neuro.run.collect.files_of", lambda net: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        neuro(*RUN)
    assert Path("out.h5").read_bytes() == precious
    assert sorted(os.listdir()) == ["net.yaml", "out.h5"]


@pytest.mark.parametrize("words", ["OMPI_COMM_WORLD_SIZE OMPI_COMM_WORLD_RANK", "PMI_SIZE PMI_RANK"])
def test_independent_runs_under_mpirun(neuro, network, monkeypatch, words):
    """On a backend that shares no network each process runs, writes and tells for itself."""
    size, rank = words.split()
    monkeypatch.setenv(size, "2")
    for k in "01":
        monkeypatch.setenv(rank, k)
        answer = neuro("run", network, "--for", "1", "--out", f"{k}.h5")
        assert answer.status == 0
        assert re.fullmatch(TOOK.format(1), answer.err)
        assert answer.out.endswith(f"{k}.h5: 1 ms\nnext: neuro plot {k}.h5, or neuro report {k}.h5\n")
        assert Path(f"{k}.h5").exists()
        answer = neuro("check", "nope.yaml")
        assert (answer.status, answer.out) == (2, "")
        assert answer.err.startswith("error: nope.yaml: no such file")


@pytest.mark.parametrize(("rank", "told"), [("0", "error: --record: unknown population 'ecx'"), ("1", "")])
def test_of_a_shared_run_one_tells(neuro, network, monkeypatch, rank, told):
    from neuro.core import system
    from neuro.program.program import WHOLE
    from neuro_reference import ReferenceBackend

    monkeypatch.setattr(ReferenceBackend, "share", lambda self: WHOLE, raising=False)
    monkeypatch.setattr(system, "_shared", False)
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setenv("PMI_RANK", rank)
    answer = neuro("run", network, "--backend", "reference", "--record", "ecx")
    assert answer.status == 2
    assert answer.err.partition("\n")[0] == told


@pytest.mark.parametrize("words", ["show net.yaml >&-", "run net.yaml --for 1 2>&-", "models <&- >&- 2>&-"])
def test_a_closed_stream_is_no_error(network, words):
    main = f'"{sys.executable}" -c "from neuro.cli import main; main()" {words}'
    done = subprocess.run(["sh", "-c", main], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


PROBED = """\
neuro: 1
populations:
  noise: {model: {poisson_generator: {rate: 500.0}}, shape: 4}
  cells: {model: iaf_psc_exp, shape: 3}
projections:
  into: {from: noise, to: cells, rule: all_to_all, weight: 400.0, synapse: {stdp: {Wmax: 900.0}}}
probes:
  both: {of: {cells: "0:2"}, record: [V_m, I_syn_ex], every: 1.0}
  one: {of: {cells: 0}, record: V_m, every: 10.0}
  mean: {of: cells, record: V_m, mean: true, every: 10.0}
  rate: {of: cells, record: rate, every: 10.0}
  w: {of: into, record: weight, every: 50.0}
  sent: {of: into, record: weight, at: pre_spikes}
"""


def test_every_kind_of_probe_is_told_drawn_and_shown(neuro, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "probed.yaml").write_text(PROBED)
    answer = neuro("run", "probed.yaml", "--for", "100", "--out", "out.h5")
    assert answer.status == 0
    (told,) = (line for line in answer.out.splitlines() if line.startswith("recorded:"))
    sent = read("out.h5").trace("sent")[0].size
    assert told == (
        "recorded: spikes of noise, cells; both.V_m (V_m of 2 neurons at 100 times); both.I_syn_ex (I_syn_ex of 2 "
        "neurons at 100 times); one (V_m of 1 neuron at 10 times); mean (mean V_m of cells at 10 times); "
        "rate (rate of cells at 10 times); w (weight of 12 synapses at 2 times); "
        f"sent (weight of into at {sent} pre spikes)"
    )
    assert neuro("plot", "out.h5").status == 0
    assert neuro("report", "out.h5").status == 0
    assert "weight of 4 of 12 synapses of into, as pre spikes leave it" in (tmp_path / "out.html").read_text()


def test_equal_weights_do_not_vary():
    net = framework.Network("equal")
    net.population("in", 3, framework.spike_generator(spike_times=[[1.0]] * 3))
    net.population("out", 7, framework.iaf_psc_exp())
    net.connect("in", "out", framework.all_to_all(), framework.stdp(Wmax=900.0, lambda_=0.0), weight=300.1)
    sim = framework.compile(net, "reference")
    sim.run(5.0)
    [row] = weights(collect(sim, net))
    assert row[2:] == ("21", "300.1", "0", "300.1", "300.1")
