"""The cortical microcircuit: its numbers, the same spikes on three simulators, and room for it before it is built."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import neuro
import neuro_models
from alike import alike, same
from neuro.cli.commands import app
from neuro.compiler import compile_network, memory
from neuro.compiler.shapes import resolve_shapes
from neuro.core.memory import free_memory
from neuro.model.network import Network
from neuro.testing import observe
from neuro.testing.case import differences
from refused import refused

NAMES = ("L23E", "L23I", "L4E", "L4I", "L5E", "L5I", "L6E", "L6I")
SIZES = (20683, 5834, 21915, 5479, 4850, 1065, 14395, 2948)


def circuit(**params: float) -> Network:
    return neuro.load(neuro_models.path("microcircuit"), params=params)


def test_the_whole_circuit_has_the_published_numbers():
    net = circuit()
    assert [net.populations[name].shape for name in NAMES] == [(n,) for n in SIZES]
    recurrent = {name: part.rule.n for name, part in net.projections.items() if part.rule.name == "fixed_total_number"}
    assert len(recurrent) == 55
    assert sum(recurrent.values()) == 298_880_968
    drawn = round(np.log(1 - 0.0437) / np.log(1 - 1 / (21915 * 20683)))
    assert recurrent["L4E_L23E"] == drawn
    weight = net.projections["L4E_L23E"].weight
    assert (weight.mean, weight.std, weight.low) == pytest.approx((175.6, 17.56, 0.0))
    inhibitory = net.projections["L6I_L6E"]
    drawn = inhibitory.weight
    assert (drawn.mean, drawn.std, drawn.high) == pytest.approx((-351.2, 35.12, 0.0))
    assert (inhibitory.delay.mean, inhibitory.delay.std) == (0.75, 0.375)
    assert net.populations["L6E_in"].model.rate == 2900 * 8.0
    assert net.populations["L5I"].model.I_e == 0.0


def test_a_smaller_circuit_makes_up_for_the_input_that_it_loses():
    """In-degrees fall by the factor, weights grow by its root, and mean input, in pA, stays."""
    share, rates = 0.1, dict(zip(NAMES, (0.903, 2.965, 4.414, 5.876, 7.569, 8.633, 1.105, 7.829), strict=True))

    def mean_input(net: Network, onto: str) -> float:
        total = net.populations[onto].model.I_e
        for part in net.projections.values():
            if part.target != onto:
                continue
            if part.rule.name == "one_to_one":
                total += 0.5e-3 * part.weight * net.populations[part.source].model.rate
            else:
                inputs = part.rule.n / net.populations[onto].shape[0]
                total += 0.5e-3 * part.weight.mean * inputs * rates[part.source]
        return total

    whole, small = circuit(), circuit(scale=share)
    for name, n in zip(NAMES, SIZES, strict=True):
        assert small.populations[name].shape == (round(share * n),)
        assert mean_input(small, name) == pytest.approx(mean_input(whole, name), rel=5e-3)  # 106 neurons of 106.5
    assert small.projections["L23E_L23E"].weight.mean == pytest.approx(87.8 / np.sqrt(share))
    fewer = circuit(scale=share, indegree=1.0)
    assert fewer.populations["L23E"].model.I_e == 0.0
    ratio = fewer.projections["L4E_L4I"].rule.n / whole.projections["L4E_L4I"].rule.n
    assert ratio == pytest.approx(share, rel=1e-3)


def test_event_equals_reference():
    net = circuit(scale=0.01, indegree=0.05)
    one = alike(net, 12.0, seed=3)[1]
    two = neuro.compile(net, seed=3, threads=2)
    two.run(12.0)
    assert two.counts().spikes > 200
    same(one, two)


@pytest.mark.usefixtures("nest")
def test_event_equals_nest():
    net = circuit(scale=0.02)
    found = []
    for backend in ("event", "nest"):
        sim = neuro.compile(net, backend, seed=4)
        sim.run(30.0)
        found.append(observe(sim))
    assert sum(found[0][name].size for name in found[0] if "spikes" in name) > 100
    spikes = [{name: told for name, told in each.items() if "spikes" in name or "V_m" in name} for each in found]
    assert len(spikes[1]) >= 16
    assert differences(*spikes, exact=False) == []


def test_neuro_run_knows_it_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    told = CliRunner().invoke(app, ["run", "microcircuit", "--for", "20", "--set", "scale=0.02", "--threads", "2"])
    assert told.exit_code == 0, told.output
    for name in NAMES:
        assert name in told.output
    results = neuro.results.read(tmp_path / "out.h5")
    assert results.populations["L4E"].size == 438
    assert "L23E_in" not in [name for name, part in results.populations.items() if part.recorded]
    (tmp_path / "microcircuit").write_text("neuro: 1\n")
    told = CliRunner().invoke(app, ["run", "microcircuit"])
    assert told.exit_code != 0  # a file of that name comes first


def test_a_circuit_for_which_there_is_no_room_is_refused(monkeypatch: pytest.MonkeyPatch, messages):
    monkeypatch.setattr(memory, "free_memory", lambda: 2_000_000_000)
    messages({"told": refused(lambda: neuro.compile(circuit(), seed=1)).partition("yaml:199:3: ")[2]})
    monkeypatch.setattr(memory, "MANY", 1000)
    monkeypatch.setattr(memory, "free_memory", lambda: None)
    compile_network(circuit(scale=0.01), 1)


def test_processes_on_other_machines_have_memory_of_their_own(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 2_000_000_000)
    net = circuit()
    shapes = resolve_shapes(net, {})
    memory.check_memory(net, shapes, 4)
    monkeypatch.setattr(memory, "neighbours", lambda: 4)
    assert "(4.7 GB) of memory" in refused(lambda: memory.check_memory(net, shapes, 4))


def test_free_memory_is_a_sane_number():
    free = free_memory()
    assert free is None or 0 < free < 1 << 50


def test_what_is_counted_covers_what_is_made(monkeypatch: pytest.MonkeyPatch):
    """The bytes of the arrays of synapses are those that were counted for them."""
    net = circuit(scale=0.03)
    monkeypatch.setattr(memory, "MANY", 0)
    monkeypatch.setattr(memory, "OVERHEAD", 1.0)
    monkeypatch.setattr(memory, "free_memory", lambda: 0)
    monkeypatch.setattr(memory, "LEAST", 0)
    assert "of memory" in refused(lambda: compile_network(net, 1))
    monkeypatch.undo()
    program = compile_network(net, 1)
    made = sum(p.targets.nbytes + p.weight.nbytes + p.delay.nbytes for p in program.projections if p.layout == "csr")
    asked = [part.rule.n * 16 for part in net.projections.values() if part.rule.name == "fixed_total_number"]
    assert made == sum(asked)


def test_round_is_of_numbers(tmp_path: Path):
    text = (
        "neuro: 1\nresolution: 0.1\nparameters: {x: 10.5, y: 3 ms}\n"
        "populations:\n  a: {model: parrot_neuron, shape: $(round(x))}\n"
    )
    (tmp_path / "net.yaml").write_text(text)
    assert neuro.load(tmp_path / "net.yaml").populations["a"].shape == (10,)
    assert neuro.load(tmp_path / "net.yaml", params={"x": 11.5}).populations["a"].shape == (12,)
    (tmp_path / "net.yaml").write_text(text.replace("round(x)", "round(y)"))
    assert "round of a value" in refused(lambda: neuro.load(tmp_path / "net.yaml"))
