"""Joined rows: projections by the hundred with few synapses each are delivered together, and no bit differs."""

import sys
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from alike import alike, same
from neuro.compiler import compile_network, connect, pairs, resolve
from neuro.core.memory import discard
from neuro.kernels.jit import kernel
from neuro.model.network import Network
from neuro.program.compact import CompactProjection
from neuro.run.simulation import Simulation
from neuro.testing import observe
from neuro.testing.case import differences, run_on
from neuro_event import EventBackend
from neuro_event.building import joined_rows, layout
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import FAR, add_steps, add_steps_by_sign
from refused import refused

CHECKS = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
SETTINGS = settings(max_examples=8, deadline=None, derandomize=True, suppress_health_check=CHECKS)
LATE = neuro.uniform(low=0.1, high=1.0)
WEIGHT = neuro.normal(mean=60.0, std=150.0)


def network(order: list[tuple[int, int]], sizes: tuple[int, ...] = (60, 90, 70), plain: int | None = None) -> Network:
    """Populations under noise, connected in an order; `plain` is the number of a connection with one delay."""
    net = Network("joined")
    cells = [neuro.iaf_psc_exp(I_e=neuro.uniform(low=300.0, high=420.0)), neuro.iaf_psc_delta(I_e=350.0)]
    for k, size in enumerate(sizes):
        net.population(f"noise{k}", size, neuro.poisson_generator(rate=2500.0))
        net.population(f"p{k}", size, cells[k % 2])
        net.connect(f"noise{k}", f"p{k}", neuro.one_to_one(), weight=(300.0, 3.0)[k % 2], delay=1.0)
    for i, (source, target) in enumerate(order):
        weight = WEIGHT if target % 2 == 0 else neuro.normal(mean=0.3, std=0.6)
        delay = 1.0 if i == plain else LATE
        rule = neuro.fixed_indegree(n=12 + i % 4)
        net.connect(f"p{source}", f"p{target}", rule, weight=weight, delay=delay, name=f"wires{i}")
    return net


EVERY = [(source, target) for target in range(3) for source in range(3)]


def steered(sim: Simulation, again: Path | None = None) -> dict[str, np.ndarray]:
    """Weights are set while spikes are under way, and a state is saved and taken up."""
    run_on(sim, 3.0)
    w = sim.get("wires1", "weight")
    sim.set("wires1", weight=np.linspace(1.5, 0.5, w.size) * w)
    run_on(sim, 0.5)
    sim.set("wires0", weight=0.0)
    sim.set("wires1", weight=0.5 * w)
    if again is not None:
        sim.save(again)
    run_on(sim, 1.0)
    if again is not None:
        sim.run(1.0)
        sim.restore(again)
        run_on(sim, 1.0)
    run_on(sim, 3.5)
    return observe(sim)


def joined(sim: Simulation) -> set[str]:
    """The projections in joined rows."""
    arrays = sim._engine._arrays  # type: ignore[attr-defined]
    return {sim.program.projections[q].name for q in arrays.joined}


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """No projection is delivered in runs by itself, as in large networks with few synapses."""
    monkeypatch.setattr(layout, "_FEW_RUNS", 0)


def orders() -> st.SearchStrategy[list[tuple[int, int]]]:
    return st.lists(st.sampled_from(EVERY), min_size=4, max_size=12) | st.permutations(EVERY)


@SETTINGS
@given(order=orders(), seed=st.integers(0, 3), few=st.booleans())
def test_event_equals_reference(order: list[tuple[int, int]], seed: int, few: bool):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(layout, "_FEW_RUNS", 0 if few else layout._FEW_RUNS)
        expected, found = (neuro.compile(network(order), backend, seed=seed) for backend in ("reference", "event"))
        assert differences(steered(expected), steered(found), exact=False) == []


@SETTINGS
@given(order=orders(), seed=st.integers(0, 3), threads=st.integers(2, 3))
def test_threads_change_no_bit(order: list[tuple[int, int]], seed: int, threads: int):
    net = network(order, (1300, 600, 700))
    one, two = (neuro.compile(net, "event", seed=seed, threads=n) for n in (1, threads))
    assert differences(steered(one), steered(two), exact=True) == []


@SETTINGS
@given(order=orders(), seed=st.integers(0, 3))
def test_rows_by_themselves_have_the_same_bits(order: list[tuple[int, int]], seed: int):
    found = []
    for series in (joined_rows._longest_series, lambda *given: []):
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(joined_rows, "_longest_series", series)
            sim = neuro.compile(network(order), "event", seed=seed)
            run_on(sim, 8.0)
            alone = sim._engine._arrays.net["projections"][3:, t.JOINED_ROW] >= 0  # type: ignore[attr-defined]
            assert alone.all() == bool(found), "else all are by themselves only if no series is joined"
            found.append(observe(sim))
    assert differences(*found, exact=True) == []


@pytest.mark.parametrize("rings", [False, True])
def test_a_state_goes_on_bit_for_bit(rings: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    if rings:
        monkeypatch.setattr(layout, "_FEW_RUNS", 0)
    one, two = (neuro.compile(network(EVERY), "event", seed=1) for _ in range(2))
    assert joined(one) == {f"wires{k}" for k in range(9)}
    assert differences(steered(one), steered(two, tmp_path / "state.h5"), exact=True) == []


def test_a_state_of_before_there_were_joined_rows(tmp_path: Path):
    choose = joined_rows.choose
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(layout, "_FEW_RUNS", 0)
        patched.setattr(joined_rows, "choose", lambda program: frozenset())
        old = neuro.compile(network(EVERY), "event", seed=1)
        run_on(old, 3.0)
        old.save(tmp_path / "state.h5")
        patched.setattr(joined_rows, "choose", choose)
        new = neuro.compile(network(EVERY), "event", seed=1)
        new.restore(tmp_path / "state.h5")
        assert joined(new) == set()
        for sim in (old, new):
            sim.set("wires1", weight=30.0)
            run_on(sim, 4.0)
        same(old, new)


def test_weights_that_are_set_before_the_first_step_and_kept_by_a_reset():
    sims = [neuro.compile(network(EVERY), backend, seed=1) for backend in ("reference", "event")]
    for sim in sims:
        sim._engine.run(0)  # rows are laid out before the weight is set
        sim.set("wires4", weight=0.0)
        run_on(sim, 6.0)
    same(*sims, exact=False)
    for sim in sims:
        sim.set("wires5", weight=1.0)
        sim.reset(weights=False)
        run_on(sim, 6.0)
    same(*sims, exact=False)


def test_parrots_and_named_receptors():
    net = network([(0, 0), (1, 0), (0, 1), (1, 1)])
    net.population("parrots", 80, neuro.parrot_neuron())
    drawn = neuro.uniform(low=1.0, high=90.0)
    for source in ("p0", "p1"):
        net.connect(source, "parrots", neuro.fixed_indegree(n=2), weight=-3.0, delay=LATE)
        for receptor in ("in", "ex"):
            name = f"{source}_{receptor}"
            to = neuro.static(receptor=receptor)
            net.connect(source, "p2", neuro.fixed_indegree(n=3), to, weight=drawn, delay=LATE, name=name)
    assert len(joined(alike(net, 8.0)[1])) == 10


def test_models_that_collect_their_input():
    net = Network("quiet")
    for k in range(3):
        net.population(f"p{k}", 90, neuro.iaf_psc_exp(I_e=neuro.uniform(low=300.0, high=420.0)))
    for source, target in EVERY:
        net.connect(f"p{source}", f"p{target}", neuro.fixed_indegree(n=3), weight=WEIGHT, delay=LATE)
    assert len(joined(alike(net, 30.0)[1])) == 9


def test_which_projections_are_joined():
    for net, expected, by_itself in (
        (network(EVERY), range(3, 12), []),  # behind the noise
        (network([(target, source) for source, target in EVERY]), range(3, 12), []),
        (network([(0, 0), (1, 1), (2, 2)]), (3, 4, 5), []),  # also alone
        (network(EVERY, plain=4), (3, 4, 5, 6, 9, 10, 11), [8]),  # one delay stays in its place among sums
    ):
        engine: Any = neuro.compile(net, seed=1)._engine
        engine.run(0)
        alone = np.flatnonzero(engine._arrays.net["projections"][:, t.JOINED_ROW] >= 0).tolist()
        assert (sorted(engine._arrays.joined.difference(alone)), alone) == (list(expected), by_itself)


@pytest.mark.usefixtures("few")
def test_few_synapses_with_very_many_delays_are_not_joined():
    net = network(EVERY)
    for target in ("p0", "p2"):
        late = neuro.uniform(low=0.1, high=300.0)
        net.connect("p0", target, neuro.fixed_indegree(n=2), weight=9.0, delay=late, name=f"far_{target}")
    assert joined(alike(net, 8.0)[1]) == {f"wires{k}" for k in range(9)}


@pytest.mark.usefixtures("few")
def test_few_synapses_of_many_delays_are_joined_where_rings_would_take_longer():
    net = network(EVERY, (60, 300, 300))
    net.population("rare", 60, neuro.iaf_psc_exp(I_e=400.0))
    for target in ("p0", "p1", "p2"):
        net.connect("rare", target, neuro.fixed_total_number(n=90), weight=0.5, delay=LATE, name=f"rare_{target}")
        for source in ("p0", "p1"):
            more = f"{source}_{target}_more"
            net.connect(source, target, neuro.fixed_indegree(n=9), weight=1.0, delay=LATE, name=more)
    sim = alike(net, 8.0)[1]
    program = sim.program
    rare = [q for q, p in enumerate(program.projections) if p.name.startswith("rare")]
    assert joined_rows._is_sparse(program, rare)
    assert not all(joined_rows._in_runs(program, q) for q in rare)
    assert len(joined(sim)) == 18, "else what comes before or after them onto a target would have rings, too"


def test_a_silent_network_looks_once_a_source_and_kind_of_input():
    sim = neuro.compile(network(EVERY), "event", seed=1)
    sim.run(1.0)
    arrays = sim._engine._arrays  # type: ignore[attr-defined]
    assert arrays.net["joined"][:, t.TARGET].tolist() == 6 * [t.NONE], "by sign, and onto one receptor"


SINGLE = neuro.normal(mean=60.0, std=20.0, low=0.0, single=True)


def large(single: bool = True) -> Network:
    """What counts as a large network here: joined rows are the only copy of its synapses."""
    net = network([(0, 0)], (1300, 600, 700))
    weight = SINGLE if single else WEIGHT
    for k, (source, target) in enumerate(EVERY):
        inhibits = source == 2 and target != 1
        w = neuro.normal(mean=-60.0, std=20.0, high=0.0, single=True) if inhibits else 0.3 if target == 1 else weight
        net.connect(f"p{source}", f"p{target}", neuro.fixed_indegree(n=5), weight=w, delay=LATE, name=f"wires{k + 1}")
    return net


def interrupt(*given: object) -> None:
    raise KeyboardInterrupt


@pytest.fixture
def many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every network has very many synapses."""
    for module in (pairs, resolve):
        monkeypatch.setattr(module, "MANY", 10)


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.usefixtures("many")
def test_rows_in_place_of_the_programs_arrays(single: bool):
    net = large(single)
    first, other = compile_network(net, 1), compile_network(net, 1)
    for threads in (1, 2, 1):  # rows for other threads are made of those that are there
        engine = EventBackend().build(first, threads=threads)
        engine.run(20)
        freed = 0
        for q, (part, twin) in enumerate(zip(first.projections, other.projections, strict=True)):
            assert part.targets.dtype == twin.targets.dtype
            assert part.weight.dtype == np.float64
            for name in ("targets", "weight", "delay", "row_ends"):
                assert np.array_equal(getattr(part, name), getattr(twin, name)), (part.name, name)
            assert np.array_equal(engine.get_synapses(q, "weight"), np.broadcast_to(twin.weight, twin.size))
            freed += isinstance(part, CompactProjection) and part._supply is not None
        assert freed == 10, "all but one to one"
    expected, found = (neuro.compile(net, backend, seed=1) for backend in ("reference", "event"))
    assert differences(steered(expected), steered(found), exact=False) == []


@pytest.mark.usefixtures("many")
def test_rows_of_blocks_as_they_were_drawn(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(connect, "LEAST", 400)
    monkeypatch.setattr(connect, "LEAST_OF_SOURCE", 0)
    first, other = (compile_network(large(), 1) for _ in range(2))
    parts = [part for part in first.projections if isinstance(part, CompactProjection)]
    assert min(len(part.blocks) for part in parts) > 1
    before = [(part.targets, part.weight, part.delay) for part in other.projections]  # in order from now on
    nets = []
    for program in (first, other):
        engine = EventBackend().build(program)
        engine.run(1)
        nets.append(engine._arrays.net)  # type: ignore[attr-defined]
    for name in layout.JOINED_ARRAYS:
        assert np.array_equal(nets[0][name], nets[1][name]), name
    for part, arrays in zip(first.projections, before, strict=True):
        for found, expected in zip((part.targets, part.weight, part.delay), arrays, strict=True):
            assert np.array_equal(found, expected), part.name


@pytest.mark.usefixtures("many")
def test_a_reset_and_a_state_where_rows_are_the_only_copy(tmp_path: Path):
    sims = [neuro.compile(large(), "event", seed=1, threads=threads) for threads in (1, 1, 2)]
    found = [steered(sims[0]), steered(sims[1], tmp_path / "state.h5"), steered(sims[2])]
    for each in found[1:]:
        assert differences(found[0], each, exact=True) == []
    for sim in sims:
        sim.reset(weights=True)
        assert differences(found[0], steered(sim), exact=True) == []


@pytest.mark.usefixtures("many")
@pytest.mark.parametrize(("ran", "before"), [(0.0, False), (2.0, False), (2.0, True)])
def test_rows_that_were_laid_out_anew_leave_no_second_copy(ran: float, before: bool):
    sim = neuro.compile(large(), "event", seed=1)
    described = {p.name: sim.get(p.name, "weight") for p in sim.program.projections}
    if before:
        sim.set("wires2", weight=9.0)
    sim._engine.run(0)  # type: ignore[attr-defined]
    old = [weakref.ref(sim._engine._arrays.net[name]) for name in layout.JOINED_ARRAYS]  # type: ignore[attr-defined]
    sim.run(ran)
    sim.set("wires1", weight=9.0)
    sim.run(2.0)
    assert not any(each() is not None for each in old)
    sim.reset(weights=True)
    sim.run(1.0)
    for name, weight in described.items():
        assert np.array_equal(sim.get(name, "weight"), weight)


@pytest.mark.usefixtures("many")
def test_places_that_lie_far_apart():
    net = Network("far")
    net.population("cells", 300, neuro.iaf_psc_exp(I_e=neuro.uniform(low=600.0, high=900.0)))
    net.population("silent", 140_000, neuro.poisson_generator(rate=0.0))
    net.population("others", 300, neuro.iaf_psc_exp(I_e=neuro.uniform(low=300.0, high=420.0)))
    for target in ("cells", "others"):
        net.connect("cells", target, neuro.fixed_indegree(n=9), weight=WEIGHT, delay=LATE, name=f"to_{target}")
    sims = alike(net, 15.0)
    assert sims[1].counts().projections["to_others"].synaptic_ops > 0
    arrays = sims[1]._engine._arrays.net  # type: ignore[attr-defined]
    assert arrays["joined_steps"].size > 2 * 300 * 9, "what lies far is reached by several steps"


@pytest.mark.usefixtures("many", "few")
def test_rows_take_the_place_of_no_arrays_in_another_order():
    net = network(EVERY)
    net.connect("p0", "p2[:30]", neuro.all_to_all(), weight=WEIGHT, delay=LATE, name="all")
    sims = alike(net, 4.0)
    assert "all" in joined(sims[1])
    expected, found = (sim.program.projections[-1] for sim in sims)
    for name in ("targets", "weight", "delay"):
        assert np.array_equal(getattr(expected, name), getattr(found, name)), name


@pytest.mark.usefixtures("many")
def test_arrays_that_are_lost_are_not_read(monkeypatch: pytest.MonkeyPatch):
    program = compile_network(large(), 1)
    part = program.projections[4]
    before = part.targets

    monkeypatch.setattr(CompactProjection, "discard", interrupt)
    with pytest.raises(KeyboardInterrupt):
        EventBackend().build(program).run(1)
    assert before.any()
    lost = program.projections[3]
    assert f"projection '{lost.name}': its synapses are lost" in refused(lambda: lost.weight.sum())


def test_a_row_of_more_synapses_than_places_is_refused(monkeypatch: pytest.MonkeyPatch):
    sim = neuro.compile(network(EVERY), "event", seed=1)
    monkeypatch.setattr(joined_rows, "MOST", 200)
    assert "synapses that are delivered together: expected at most 200" in refused(sim.run, 1.0)


def test_rows_that_are_interrupted_are_laid_out_again(monkeypatch: pytest.MonkeyPatch):
    sim, whole = (neuro.compile(network(EVERY), "event", seed=1) for _ in range(2))

    with monkeypatch.context() as patched:
        patched.setattr(joined_rows, "_lay_row", interrupt)
        with pytest.raises(KeyboardInterrupt):
            sim._engine.run(1)
    for each in (sim, whole):
        run_on(each, 6.0)
    same(whole, sim)


@pytest.mark.parametrize("by_sign", [False, True])
def test_what_lies_between_far_places_is_not_touched(by_sign: bool):
    @kernel
    def add(steps, weights, buf):  # type: ignore[no-untyped-def]
        zero = np.uint64(0)
        if by_sign:
            add_steps_by_sign(steps, weights, zero, zero, 3, zero, np.uint64(1), 1.0, buf)
        else:
            add_steps(steps, weights, zero, zero, 3, zero, 1.0, buf)

    buf = np.zeros(FAR + 9)
    between = buf[FAR + 1 : FAR + 2].view(np.uint64)
    between[:] = 0x7FF0000000000001  # a signalling NaN: to add anything to it changes its bits
    add(np.array([1, FAR, 2], dtype=np.uint16), np.array([3.0, -0.0, 4.0]), buf)
    assert buf[[1, FAR + 3]].tolist() == [3.0, 4.0]
    assert between[0] == 0x7FF0000000000001, "it may be another thread's"


def test_pages_are_given_back():
    array = np.ones(1 << 23, dtype=np.uint16)
    third = array.size // 3
    discard(array, 0, third)
    discard(array, third, 2 * third)
    assert array[2 * third :].all()
    if sys.platform == "linux":
        assert not array[1 << 11 : third].any()
        assert np.count_nonzero(array[: 2 * third]) < 1 << 20, "less than a huge page, and the page of the first item"
    left = array.sum()
    discard(array, array.size - 9, array.size - 5)
    assert array.sum() == left
