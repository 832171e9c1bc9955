"""One network in several processes under mpirun: the same result, one file, one voice."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from neuro.core.provenance import ATTRIBUTE
from neuro.files.results import read
from neuro_models import areas

NEURO = Path(sys.executable).with_name("neuro")
NET = """\
neuro: 1
name: shared
resolution: 0.5
populations:
  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 40}
  relay: {model: parrot_neuron, shape: 40}
  exc: {model: {iaf_psc_exp: {tau_m: {uniform: {low: 8.0, high: 15.0}}}}, shape: 30}
  inh: {model: iaf_psc_delta, shape: 11}
projections:
  noise_relay: {from: noise, to: relay, rule: one_to_one, delay: 1.0}
  relay_exc:
    {from: relay, to: exc, rule: {fixed_indegree: {n: 9}}, weight: 150.0, delay: 1.5, synapse: {stdp: {Wmax: 300.0}}}
  exc_inh:
    {from: exc, to: inh, rule: all_to_all, weight: 1.0, delay: 0.5, synapse: {stdp_dopa: {dopamine: relay, Wmax: 3.0}}}
  inh_exc: {from: inh, to: exc, rule: all_to_all, weight: -80.0, delay: {uniform: {low: 0.5, high: 3.0}}}
probes:
  v: {of: exc, record: V_m, every: 5.0}
"""


@cache
def obstacle() -> str:
    """Why these tests cannot run here, or ""."""
    if shutil.which("mpirun") is None:
        return "mpirun is not installed"
    if find_spec("nest") is None:
        return "NEST is not installed"
    script = "import nest; raise SystemExit(not nest.build_info['have_mpi'])"
    built = subprocess.run([sys.executable, "-c", script], capture_output=True, check=False)
    return "this NEST was built without MPI: 'make test-mpi' builds one with it" if built.returncode else ""


@pytest.fixture(scope="module", autouse=True)
def _mpi():
    if obstacle():
        pytest.skip(obstacle())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("net.yaml").write_text(NET)
    return tmp_path


def mpirun(n: int, *command: object) -> list[str]:
    return ["mpirun", "--oversubscribe", "--allow-run-as-root", "-n", str(n), *map(str, command)]


def run(n: int, *words: object) -> subprocess.CompletedProcess[str]:
    command = mpirun(n, NEURO, "run", "net.yaml", *words)
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def test_the_same_result_from_1_2_and_4_processes(folder):
    told = {}
    for n in (1, 2, 4):
        done = run(n, "--backend", "nest", "--for", 100, "--out", f"{n}.h5")
        assert done.returncode == 0
        assert [line.partition(" took ")[0] for line in done.stderr.splitlines()] == ["100 ms"]
        told[n] = done.stdout.replace(f"{n}.h5", "out.h5")
    assert told[1] == told[2] == told[4]
    assert sorted(p.name for p in folder.iterdir()) == ["1.h5", "2.h5", "4.h5", "net.yaml"]
    one = read("1.h5")
    assert one.populations["exc"].ids.size > 100
    for other in (read("2.h5"), read("4.h5")):
        made = [json.loads(results.about[ATTRIBUTE])["network"] for results in (one, other)]
        assert made[0] == made[1]
        assert {**other.about, ATTRIBUTE: ""} == {**one.about, ATTRIBUTE: ""}
        for name, train in one.populations.items():
            assert train.counts == other.populations[name].counts
            for word in ("steps", "ids", "multiplicity"):
                np.testing.assert_array_equal(getattr(train, word), getattr(other.populations[name], word))
        for name, wires in one.projections.items():
            np.testing.assert_allclose(wires.weight, other.projections[name].weight, rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.traces["v"].values, other.traces["v"].values, rtol=0, atol=1e-9)


LARGE = """
import re, sys
import numpy as np
import neuro
net = neuro.Network("large", resolution=0.1)
for name in ("exc", "inh"):
    net.population(name, 2000, neuro.iaf_psc_exp(), initial={"V_m": neuro.normal(mean=-58.0, std=5.0)})
weight, delay = neuro.normal(mean=30.0, std=3.0), neuro.uniform(low=0.1, high=3.0)
net.connect("exc", "inh", neuro.fixed_total_number(n=3_000_000), weight=weight, delay=delay, name="drawn")
net.connect("inh", "exc", neuro.fixed_indegree(n=100), weight=-100.0, delay=delay, name="few")
sim = neuro.compile(net, "nest", seed=3)
own = [p.targets.nbytes + p.delay.nbytes for p in sim.program.projections]
status = open("/proc/self/status").read()
peak = int(re.search(r"VmHWM:\\s+(\\d+)", status)[1])
sim.run(30.0)
spikes = [sim.spikes(name) for name in ("exc", "inh")]
share = sim.program.share
values = {"own": own, "peak": peak, "fan": sim.counts().synaptic_ops}
values |= {f"{word} {k}": each[k] for word, each in zip(("exc", "inh"), spikes) for k in (0, 1)}
np.savez(f"large.{share.number}.{share.index}.npz", **values)
"""


def test_the_memory_of_a_process_is_its_share(folder):
    Path("large.py").write_text(LARGE)
    for n in (1, 2, 4):
        done = subprocess.run(mpirun(n, sys.executable, "large.py"), capture_output=True, check=False, timeout=300)
        assert done.returncode == 0
    alone = np.load("large.1.0.npz")
    for n in (2, 4):
        ranks = [np.load(f"large.{n}.{rank}.npz") for rank in range(n)]
        for found in ranks:
            np.testing.assert_allclose(found["own"], alone["own"] / n, rtol=0.05)
            assert found["peak"] < alone["peak"]
            assert found["fan"] == alone["fan"] > 0
            for name in alone.files[3:]:
                np.testing.assert_array_equal(found[name], alone[name])
        assert np.all(sum(found["own"] for found in ranks) == alone["own"])


BY_RULES = """
import sys, warnings
import numpy as np
import neuro
from neuro.core.system import leads
warnings.simplefilter("ignore")
net = neuro.Network("rules")
for name in ("exc", "inh"):
    net.population(name, 301, neuro.iaf_psc_exp(I_e=400.0), initial={"V_m": neuro.normal(mean=-60.0, std=4.0)})
late = neuro.normal(mean=1.5, std=0.75)
net.connect("exc", "exc", neuro.fixed_total_number(n=9000, draw="backend"),
    weight=neuro.uniform(low=20, high=60), delay=late)
net.connect("exc", "inh", neuro.fixed_outdegree(n=30, draw="backend"), weight=40.0, delay=late)
net.connect("inh", "exc", neuro.pairwise_bernoulli(p=0.1, draw="backend"), weight=-200.0, delay=late)
net.connect("inh", "inh", neuro.fixed_indegree(n=30), weight=-200.0, delay=late)
sim = neuro.compile(net, "nest", seed=3, threads=int(sys.argv[2]))
sim.set("exc", V_m=np.linspace(-65.0, -55.0, 301))
sim.run(100.0)
values = [*sim.spikes("exc")[0], *sim.spikes("exc")[1], *sim.get("inh", "V_m"), sim.counts().synaptic_ops]
if leads():
    np.save(f"rules.{sys.argv[1]}.{sys.argv[2]}.npy", values)
"""


def test_two_processes_and_two_threads_have_one_network_by_nests_rules(folder):
    Path("rules.py").write_text(BY_RULES)
    for ranks, threads in ((1, 2), (2, 1)):
        command = mpirun(ranks, sys.executable, "rules.py", ranks, threads)
        assert subprocess.run(command, capture_output=True, check=False, timeout=300).returncode == 0
    one, two = np.load("rules.1.2.npy"), np.load("rules.2.1.npy")
    assert one.size > 700
    np.testing.assert_array_equal(one, two)


WRONG = """
import neuro
net = neuro.Network("wrong")
net.population("cells", 40, neuro.iaf_psc_exp())
pre = list(range(40))
weight = [1.0] * 39 + [-1.0]
net.connect("cells", "cells", neuro.pairs(pre=pre, post=pre), neuro.stdp(Wmax=2.0), weight=weight, delay=1.0)
neuro.compile(net, "nest")
"""


def test_a_mistake_in_one_share_is_raised_in_all(folder):
    Path("wrong.py").write_text(WRONG)
    done = subprocess.run(
        mpirun(2, sys.executable, "wrong.py"), capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode != 0
    assert done.stderr.count("projection 'cells_cells': weight of synapse 39 -> 39 = -1: expected") >= 1


def test_areas_with_delays_between_them(folder):
    Path("net.yaml").unlink()
    areas.network(areas=2, scale=0.01, indegree=0.05, density=1.0).save("net.yaml")
    for n in (1, 2, 4):
        assert run(n, "--backend", "nest", "--for", 15, "--out", f"{n}.h5").returncode == 0
    one = read("1.h5")
    assert sum(train.ids.size for train in one.populations.values()) > 100
    for other in (read("2.h5"), read("4.h5")):
        for name, train in one.populations.items():
            np.testing.assert_array_equal(train.steps, other.populations[name].steps)
            np.testing.assert_array_equal(train.ids, other.populations[name].ids)


def test_a_killed_process_ends_all(folder):
    script = f'echo $$ > pid.$OMPI_COMM_WORLD_RANK; exec "{NEURO}" run net.yaml --backend nest --for 1e7 --out out.h5'
    going = subprocess.Popen(mpirun(4, "sh", "-c", script), stderr=subprocess.PIPE, text=True)
    try:
        pids = [Path(f"pid.{rank}") for rank in range(4)]
        until(lambda: all(pid.is_file() and pid.read_text().strip() for pid in pids))
        numbers = [int(pid.read_text()) for pid in pids]
        time.sleep(10.0)  # well into the run
        assert going.poll() is None
        os.kill(numbers[2], signal.SIGKILL)
        _, told = going.communicate(timeout=60)
    finally:
        going.kill()
    assert going.returncode != 0
    assert told.count("exited on signal 9 (Killed)") == 1
    assert "Traceback" not in told
    until(lambda: not any(Path(f"/proc/{number}").exists() for number in numbers))
    assert [p.name for p in folder.iterdir() if "out.h5" in p.name] == []


SCRIPT = """
import sys
import numpy as np
import neuro
from neuro.core.system import leads
sim = neuro.compile(neuro.load("net.yaml"), "nest")
for _ in range(3):
    sim.set_weights("inh_exc", np.linspace(-90.0, -50.0, 330))
    sim.set("exc", V_th=np.linspace(-56.0, -54.0, 30), V_m=-60.0)
    sim.run(20.0)
times, ids = sim.spikes("exc")
learnt = sim.network().projections["inh_exc"]
values = [*learnt.weight.ravel(), *learnt.delay.ravel(), *times, *ids, *sim.get("inh", "V_m"), sim.time]
values += [*sim.get("exc_inh", "c"), *sim.get("relay_exc", "K_plus")]
np.save(f"{sys.argv[1]}.{leads():d}.npy", values)
"""


def test_a_script_sees_the_same_in_each_process(folder):
    Path("script.py").write_text(SCRIPT)
    for n in (1, 2):
        command = mpirun(n, sys.executable, "script.py", n)
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    one, first, second = (np.load(f"{name}.npy") for name in ("1.1", "2.1", "2.0"))
    assert one.size > 100
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(first, one, rtol=0, atol=1e-9)


def until(done, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_mistake_is_told_once(folder):
    done = run(3, "--backend", "nest", "--record", "ecx", "--out", "out.h5")
    assert done.returncode != 0
    assert done.stderr.count("error: --record: unknown population 'ecx'") == 1
    assert "Traceback" not in done.stderr
    assert not Path("out.h5").exists()


def test_on_other_backends_each_process_is_its_own(folder):
    script = f'exec "{NEURO}" run net.yaml --seed $OMPI_COMM_WORLD_RANK --for 10 --out $OMPI_COMM_WORLD_RANK.h5'
    done = subprocess.run(mpirun(2, "sh", "-c", script), capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in folder.iterdir()) == ["0.h5", "1.h5", "net.yaml"]
    assert "0.h5: 10 ms" in done.stdout
    assert "1.h5: 10 ms" in done.stdout
