"""Networks and runs that need more bytes than are free: refused before anything is made."""

import itertools
import subprocess
import sys
import time

import pytest

import neuro
from neuro.compiler import memory
from refused import refused


def _population(size):
    net = neuro.Network("vast", resolution=0.1)
    net.population("a", size, neuro.iaf_psc_exp())
    return net


def _connected(rule, synapse=None, **words):
    net = _population(100_000)
    net.connect("a", "a", rule, *([synapse] if synapse else []), weight=1.0, delay=1.0, name="aa", **words)
    return net


def _in_views():
    net = _population(200_000)
    a = net.populations["a"]
    net.connect(a[:100_000], a[100_000:], neuro.all_to_all(), weight=1.0, delay=1.0, name="aa")
    return net


def _within(radius):
    net = neuro.Network("vast", resolution=0.1)
    net.population("a", (300, 320), neuro.iaf_psc_exp())
    rule = neuro.distance_dependent(p=1.0, mask=neuro.circular(radius=radius))
    net.connect("a", "a", rule, weight=1.0, delay=1.0, name="aa")
    return net


@pytest.fixture(autouse=True)
def room(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 16_000_000_000)


@pytest.mark.parametrize(
    ("make", "most"),
    [
        (lambda: _population(10**9), "population 'a', 1,000,000,000 neurons"),
        (lambda: _connected(neuro.fixed_indegree(100_000)), "projection 'aa', 10,000,000,000 synapses"),
        (lambda: _connected(neuro.pairwise_bernoulli(1.0)), "projection 'aa', 10,000,000,000 synapses"),
        (lambda: _connected(neuro.symmetric_pairwise_bernoulli(0.5)), "projection 'aa', 9,999,900,000 synapses"),
        (lambda: _connected(neuro.all_to_all(), neuro.stdp(Wmax=9.0)), "projection 'aa', 10,000,000,000 synapses"),
        (lambda: _connected(neuro.all_to_all(autapses=False)), "projection 'aa', 10,000,000,000 synapses"),
        (lambda: _within(500.0), "projection 'aa', 9,216,000,000 synapses"),
        (_in_views, "projection 'aa', 10,000,000,000 synapses"),
    ],
)
@pytest.mark.parametrize("backend", ["event", "reference"])
def test_a_network_beyond_memory_is_refused_at_once(make, most, backend):
    net = make()
    began = time.process_time()
    message = refused(lambda: neuro.compile(net, backend))
    assert time.process_time() - began < 2.0
    assert message.startswith("test_room.py:")
    assert "network 'vast' needs about" in message
    assert "expected at most the free 16,000,000,000 bytes (16.0 GB)\n" in message
    assert f"hint: most are for {most}: " in message


def test_synapses_that_are_not_stored_need_no_room():
    sim = neuro.compile(_connected(neuro.all_to_all()))
    sim.run(0.1)
    assert sim.program.projections[0].size == 10**10


@pytest.mark.parametrize("out", [None, "run.h5"])
def test_probes_beyond_memory_or_disk_are_refused_before_the_run(out, tmp_path, monkeypatch):
    net = _population(100_000)
    net.probe("v", "a", "V_m", every=0.1)
    sim = neuro.compile(net)
    message = refused(lambda: sim.run(100_000.0, out=out and tmp_path / out))
    assert "network 'vast' needs about 800,008,000,000 bytes (800.0 GB) o" in message
    assert message.endswith(
        "hint: most are for probe 'v', 1,000,000 times 100,000 values: 800,008,000,000 bytes (800.0 GB)"
    )
    assert sim.time == 0.0


def test_a_time_without_end_is_legal_where_nothing_grows():
    neuro.compile(_population(1)).check_room(10**13)


def test_a_limit_of_addresses_is_room():
    code = "import resource; resource.setrlimit(resource.RLIMIT_AS, (8 << 30,) * 2)\n"
    code += "from neuro.core.memory import free_memory; print(free_memory())"
    free = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert 0 < int(free) < 8 << 30


def test_check_names_it_also_when_the_free_bytes_change(monkeypatch, tmp_path, answer):
    """The search for all mistakes looks twice; each time other bytes are free."""
    free = itertools.count(16_000_000_000, 4096)
    monkeypatch.setattr(memory, "free_memory", lambda: next(free))
    file = tmp_path / "vast.yaml"
    file.write_text(
        "neuro: 1\npopulations:\n  a: {model: iaf_psc_exp, shape: 100000}\nprojections:\n"
        "  aa: {from: a, to: a, rule: {fixed_indegree: {n: 100000}}, weight: {normal: {mean: 1.0, std: 0.1}}}\n"
    )
    status, out, err = answer("check", file)
    assert (status, out) == (2, "")
    assert f"{file}:5:3: network 'network' needs about " in err
    assert "most are for projection 'aa', 10,000,000,000 synapses" in err
