"""Static synapses with delays of their own: delivered at arrival, in whatever order they lie, with the same spikes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from alike import alike, same
from beside import evaluated
from neuro.chips.inputs import lag
from neuro.compiler import compile_network, pairs, resolve
from neuro.compiler.rows import by_delay, draw_rows
from neuro.core.keyed_random import uniform
from neuro.model import distributions
from neuro.model.network import Network
from neuro.run.simulation import Simulation
from neuro.testing import observe
from neuro.testing.case import differences, run_on
from neuro.testing.trials import batch, recogniser, trial_results
from neuro_event.building.layout import in_runs
from neuro_event.loop import tables as t
from refused import refused

SETTINGS = settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
RULES = evaluated(__file__, "RULES", globals())
NORMAL = neuro.normal(mean=120.0, std=200.0)
LATE = neuro.uniform(low=1.0, high=15.0)


def wired(rule: Any, delay: Any, weight: Any, model: Any = None, n: int = 90) -> Network:
    """Noise onto cells that reach each other, so many that two threads share them."""
    net = Network("wired")
    net.population("noise", n, neuro.poisson_generator(rate=2500.0))
    net.population("cells", n, model or neuro.iaf_psc_exp(I_e=neuro.uniform(low=300.0, high=420.0)))
    net.population("others", 700, neuro.iaf_psc_exp(I_e=neuro.uniform(low=300.0, high=420.0)))
    net.connect("noise", "cells", neuro.fixed_indegree(n=3), weight=300.0, delay=neuro.uniform(low=0.1, high=4.0))
    net.connect("cells", "cells", rule, weight=weight, delay=delay, name="wires")
    net.connect("others", "others", neuro.fixed_outdegree(n=40), weight=NORMAL, delay=delay, name="wide")
    net.connect("cells", "others", neuro.fixed_outdegree(n=9), weight=-40.0, delay=delay, name="alike")
    return net


def delays() -> st.SearchStrategy[Any]:
    uniform = neuro.uniform(low=0.1, high=3.0), neuro.uniform(low=2.0, high=2.3)
    return st.sampled_from([*uniform, neuro.normal(mean=1.5, std=0.75, low=0.05)])


def networks() -> st.SearchStrategy[Network]:
    weights = st.sampled_from([60.0, -30.0, NORMAL, neuro.normal(mean=50.0, std=9.0, low=0.0)])
    models = st.sampled_from([None, neuro.iaf_psc_delta(I_e=350.0), neuro.parrot_neuron()])
    return st.builds(_sane, st.sampled_from(RULES), delays(), weights, models)


def _sane(rule: Any, delay: Any, weight: Any, model: Any) -> Network:
    """Parrots that hear each other would multiply spikes without end, and mV are smaller than pA."""
    if model is not None and model.name == "parrot_neuron":
        rule, delay = neuro.one_to_one(), neuro.uniform(low=2.0, high=3.0)
        return wired(rule, delay, weight, model)
    scaled = weight if model is None else 0.5 if isinstance(weight, float) else neuro.normal(mean=0.2, std=0.4)
    return wired(rule, delay, scaled, model)


def steered(sim: Simulation) -> dict[str, np.ndarray]:
    """Weights are set twice while spikes are under way, once of some synapses."""
    w = sim.get("wires", "weight")
    run_on(sim, 2.0)
    sim.set("wires", weight=np.linspace(1.5, 0.5, w.size) * w)
    run_on(sim, 0.5)
    sim.set("wires", weight=0.5 * w)
    run_on(sim, 6.0)
    return observe(sim)


def agreed(net: Network) -> None:
    """Steered alike, event does what the reference does."""
    found = [steered(neuro.compile(net, backend, seed=1)) for backend in ("reference", "event")]
    assert differences(*found, exact=False) == []


@SETTINGS
@given(net=networks(), seed=st.integers(0, 3))
def test_event_equals_reference_and_threads_change_no_bit(net: Network, seed: int):
    one, two = (steered(neuro.compile(net, "event", seed=seed, threads=threads)) for threads in (1, 2))
    assert differences(steered(neuro.compile(net, "reference", seed=seed)), one, exact=False) == []
    assert differences(one, two, exact=True) == []


@pytest.mark.parametrize("backend", ["reference", "event"])
def test_a_state_goes_on_bit_for_bit(backend: str, tmp_path: Path):
    net = wired(neuro.fixed_indegree(n=7), neuro.uniform(low=0.1, high=3.0), NORMAL)
    sims = [neuro.compile(net, backend, seed=1) for _ in range(2)]
    for sim in sims:
        sim.run(3.1)
    sims[0].save(tmp_path / "state.h5")
    sims[1].run(2.0)
    sims[1].restore(tmp_path / "state.h5")
    for sim in sims:
        sim.run(4.0)
    same(*sims)


def test_a_reset_takes_up_the_weights_that_were_set():
    net = wired(neuro.fixed_indegree(n=7), neuro.uniform(low=0.1, high=3.0), NORMAL)
    sims = alike(net, 2.0)
    for sim in sims:
        sim.set("wires", weight=0.3 * sim.get("wires", "weight"))
        sim.reset(weights=False)
        sim.run(6.0)
    same(*sims, exact=False)
    for sim in sims:
        sim.reset(weights=True)
        assert np.array_equal(sim.get("wires", "weight"), sim.program.projections[1].weight)


def test_what_a_trial_drops():
    """Spikes that are still under way, and all that arrive later, when the next trial begins or the network runs on."""
    net = recogniser(neuro.static(), neuro.fixed_indegree(n=30), stop="full")
    net.connect("sheet", "maps", neuro.all_to_all(), weight=neuro.uniform(low=-0.2, high=0.4), delay=LATE, name="late")
    times, ids, offsets, _ = batch(8)
    found = []
    for backend in ("reference", "event"):
        sim = neuro.compile(net, backend, seed=2)
        results = trial_results(sim.trials(times, ids, offsets))
        sim.run(9.0)
        found.append(results | observe(sim))
    assert in_runs(sim.program, sim.program.projections[1])
    assert differences(*found, exact=False) == []


def test_few_synapses_with_very_many_delays_go_into_a_ring():
    net = wired(neuro.fixed_indegree(n=7), neuro.uniform(low=0.1, high=3.0), NORMAL)
    late = neuro.uniform(low=0.1, high=300.0)
    net.connect("others", "cells", neuro.fixed_indegree(n=2), weight=9.0, delay=late, name="far")
    sim = neuro.compile(net, "event", seed=1)
    arrays = sim._engine._arrays  # type: ignore[attr-defined]
    assert arrays.joined == {0, 1, 2, 3}
    assert (arrays.net["projections"][:, t.LAG] == 0).tolist() == [p.name == "far" for p in sim.program.projections]
    alike(net, 8.0)


# very many synapses


@pytest.fixture
def many(monkeypatch: pytest.MonkeyPatch) -> None:
    """What holds for a million synapses holds for a hundred."""
    monkeypatch.setattr(distributions, "_MANY", 100)
    monkeypatch.setattr(pairs, "MANY", 100)
    monkeypatch.setattr(resolve, "MANY", 100)


@pytest.mark.parametrize("rule", RULES[2:7], ids=lambda rule: rule.name)
@pytest.mark.usefixtures("many")
def test_very_many_lie_by_delay(rule: Any, tmp_path: Path):
    delay = neuro.uniform(low=0.1, high=2.0)
    net = wired(rule, delay, NORMAL)
    program = compile_network(net, 1)
    part = next(p for p in program.projections if p.name == "wires")
    pre, post = program.connections(1)
    assert np.array_equal(np.lexsort((post, part.delay, pre)), np.arange(part.size))
    agreed(net)
    twin = compile_network(net, 1, threads=2)
    for one, two in zip(program.projections, twin.projections, strict=True):
        for name in ("row_ends", "targets", "weight", "delay"):
            assert np.array_equal(getattr(one, name), getattr(two, name))
    sim = neuro.compile(net, "event", seed=1)
    learnt = neuro.compile(sim.network(), "event", seed=9)
    for name in ("weight", "delay"):
        assert np.array_equal(learnt.get("wires", name), sim.get("wires", name))


def test_the_order_keeps_pairs_and_delays(monkeypatch: pytest.MonkeyPatch):
    net = wired(neuro.symmetric_pairwise_bernoulli(p=0.2), neuro.uniform(low=0.1, high=2.0), 3.0)
    found = []
    for least in (100, 1 << 20):
        monkeypatch.setattr(resolve, "MANY", least)
        program = compile_network(net, 1)
        part = program.projections[1]
        found.append(sorted(zip(*(ids.tolist() for ids in (*program.connections(1), part.delay)), strict=True)))
    assert found[0] == found[1]
    pairs = {(i, j): late for i, j, late in found[0]}
    assert all(pairs[j, i] in (late, pairs[i, j]) for (i, j), late in pairs.items())


DEGREES = st.lists(st.integers(0, 9) | st.integers(0, 2**31), min_size=1, max_size=600)


@given(st.integers(0, 2**64 - 1), st.integers(1, 70_000), DEGREES)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_draws_come_in_order(key: int, n: int, degrees: list[int]):
    ends = np.concatenate(([0], np.cumsum([*degrees, 1])))
    expected = np.sort((uniform(key, 0, np.arange(n)) * ends[-1]).astype(np.int64))
    targets = np.empty(n, dtype=np.int32)
    row_ends = draw_rows(key, ends, None, targets)
    assert np.array_equal(row_ends, np.searchsorted(expected, ends))
    assert np.array_equal(np.repeat(ends[:-1], np.diff(row_ends)) + targets, expected)


@pytest.mark.parametrize("autapses", [True, False])
def test_a_total_number_is_the_same_either_way(monkeypatch: pytest.MonkeyPatch, autapses: bool):
    but = None if autapses else np.arange(50)
    few = pairs.total_number(5000, 50, 50, but, True, 7)
    monkeypatch.setattr(pairs, "MANY", 1)
    many = pairs.total_number(5000, 50, 50, but, True, 7)
    for one, two in zip(few, many, strict=True):
        assert np.array_equal(one, two)


@given(st.lists(st.lists(st.tuples(st.integers(1, 9), st.integers(0, 99)), max_size=12), min_size=1, max_size=9))
def test_rows_are_sorted_by_delay(rows: list[list[tuple[int, int]]]):
    ends = np.cumsum([0, *(len(row) for row in rows)])
    if ends[-1] == 0:
        return
    flat = [entry for row in rows for entry in row]
    late, targets = (np.array(column, dtype=np.int32) for column in zip(*flat, strict=True))
    places = np.arange(late.size)
    by_delay(ends, late, int(late.min()), int(late.max()), targets, [places])
    order = [ends[k] + np.argsort([d for d, _ in row], kind="stable") for k, row in enumerate(rows)]
    expected = np.concatenate(order).astype(int).tolist()
    assert places.tolist() == expected
    assert list(zip(late.tolist(), targets.tolist(), strict=True)) == [flat[place] for place in expected]


@pytest.mark.usefixtures("many")
def test_the_engine_uses_the_arrays_of_the_program():
    """Where delays are drawn, joined rows take the place of the program's arrays."""
    sim = neuro.compile(wired(neuro.fixed_total_number(n=50), 2.0, NORMAL), "event", seed=1, threads=2)
    net = sim._engine._arrays.net  # type: ignore[attr-defined]
    for part in sim.program.projections[1:3]:
        assert np.shares_memory(net["targets"], part.targets)
        assert np.shares_memory(net["weights"], part.weight)


@pytest.mark.usefixtures("many")
def test_what_is_not_known_beforehand_is_packed_all_the_same():
    sim = neuro.compile(wired(neuro.pairwise_bernoulli(p=0.3), 2.0, NORMAL), "event", seed=1)
    parts, net = sim.program.projections, sim._engine._arrays.net  # type: ignore[attr-defined]
    assert np.array_equal(net["targets"], np.concatenate([part.targets for part in parts[1:]]))
    assert all(np.shares_memory(net["weights"], part.weight) for part in parts[1:3])


@pytest.mark.parametrize(("longest", "kept"), [(25.5, np.uint8), (25.6, np.int32)])
@pytest.mark.usefixtures("many")
def test_delays_of_very_many_take_a_byte_where_it_holds_them(longest: float, kept: Any):
    net = wired(neuro.fixed_total_number(n=3000), neuro.uniform(low=longest - 0.1, high=longest + 0.04), NORMAL)
    part = compile_network(net, 1).projections[1]
    assert part.delay.dtype == kept
    assert part.delay_span == (part.delay.min(), part.delay.max()) == (round(10 * longest) - 1, round(10 * longest))
    agreed(net)
    assert lag(compile_network(net, 1), 1).max() == round(10 * longest) + 1


@pytest.mark.usefixtures("many")
def test_drawn_delays_that_are_too_long_are_told():
    net = wired(neuro.fixed_total_number(n=3000), neuro.normal(mean=6600.0, std=0.0), NORMAL)
    assert "the longest drawn delay = 6600 ms: expected at most 6553.6 ms, 2^16 steps" in refused(
        compile_network, net, 1
    )


def test_the_weights_of_a_program_stay_as_they_were():
    net = wired(neuro.fixed_indegree(n=7), neuro.uniform(low=0.1, high=3.0), NORMAL)
    sim = neuro.compile(net, "event", seed=1)
    before = [part.weight.copy() for part in sim.program.projections]
    sim.set("wide", weight=1.0)
    sim.set("alike", weight=2.0)
    for part, weight in zip(sim.program.projections, before, strict=True):
        assert np.array_equal(part.weight, weight)
