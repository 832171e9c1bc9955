"""Many spikes of one neuron in one step: they are counted, delivered and kept with 64 bits."""

import numpy as np
import pytest

import neuro
from neuro.model.synapses import SYNAPSES, Modulated
from neuro.results import read
from neuro.testing import observe
from neuro.testing.case import differences, run_on

BACKENDS = ["reference", "event"]


def multiplied(rounds: int, each: int) -> neuro.Network:
    """A spike that parrots multiply in each round."""
    net = neuro.Network("multiplied", resolution=1.0)
    net.population("p0", 1, neuro.spike_generator(spike_times=[[1.0]]))
    for k in range(1, rounds + 1):
        net.population(f"p{k}", 1, neuro.parrot_neuron())
        net.connect(f"p{k - 1}", f"p{k}", neuro.fixed_indegree(n=each), delay=1.0)
    net.population("last", 1, neuro.parrot_neuron())
    net.connect(f"p{rounds}", "last", neuro.one_to_one(), delay=1.0)
    net.population("cell", 1, neuro.iaf_psc_delta(V_th=1e9))
    net.connect(f"p{rounds}", "cell", neuro.one_to_one(), weight=1e-9, delay=1.0)
    return net


@pytest.mark.parametrize("backend", BACKENDS)
def test_more_than_31_bits_are_counted_delivered_and_kept(backend, tmp_path):
    sim = neuro.compile(multiplied(2, 50_000), backend)
    sim.run(4.0)
    number = 50_000**2
    assert [sim.counts().populations[name].spikes for name in ("p2", "last")] == [number, number]
    assert sim.get("cell", "V_m")[0] == pytest.approx(-70.0 + 2.5, abs=1e-12)
    assert [column.tolist() for column in sim.train("last")] == [[4], [0], [number]]
    state = tmp_path / "state.h5"
    sim.save(state)
    sim.run(2.0)
    other = neuro.compile(multiplied(2, 50_000), backend)
    other.restore(state)
    other.run(2.0)
    assert other.get("cell", "V_m")[0] == sim.get("cell", "V_m")[0]
    assert np.array_equal(other.train("p2")[2], [number])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_file_keeps_them(backend, tmp_path):
    sim = neuro.compile(multiplied(2, 50_000), backend)
    sim.run(4.0, out=tmp_path / "results.h5")
    assert read(tmp_path / "results.h5").populations["last"].multiplicity.tolist() == [50_000**2]


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_by_one_they_need_memory_and_are_refused(backend):
    sim = neuro.compile(multiplied(3, 50_000), backend)
    sim.run(5.0)
    with pytest.raises(
        neuro.ModelError, match=r"spikes of 'last': a list of 125,000,000,000,000 spikes needs \S+ byte"
    ):
        sim.spikes("last")


@pytest.mark.parametrize("backend", BACKENDS)
def test_more_than_63_bits_are_refused(backend):
    sim = neuro.compile(multiplied(5, 50_000), backend)
    with pytest.raises(
        neuro.ModelError,
        match=r"population 'p5': a neuron sent 2\^63 spikes or more, in a step or in total: expected fewer",
    ):
        sim.run(10.0)


def taught(rule, times: int, listens: dict[str, str]) -> neuro.Network:
    """Sources and targets that spike so many times in a step, and synapses between them that learn from it."""
    net = neuro.Network("taught", resolution=0.5)
    net.population("early", 1, neuro.spike_generator(spike_times=[[1.0, 9.0, 15.0]]))
    net.population("late", 1, neuro.spike_generator(spike_times=[[3.0, 12.0]]))
    net.population("sources", 3, neuro.parrot_neuron())
    net.population("targets", 2, neuro.parrot_neuron())
    net.connect("early", "sources", neuro.fixed_indegree(n=times), delay=0.5)
    net.connect("late", "targets", neuro.fixed_indegree(n=times), delay=0.5)
    if listens.get("signal"):
        net.signal(listens["signal"], to="targets")
    delay = neuro.uniform(low=1.0, high=4.0) if rule.delays else 1.5
    top = min(float(getattr(rule, "Wmax", 1.0)), 100.0)
    net.connect("sources", "targets", neuro.all_to_all(), rule, weight=0.5 * top, delay=delay, name="learnt")
    return net


PAIRS = [
    (kind, listens)
    for kind in SYNAPSES.values()
    if kind.learns == "pairs"
    for listens in ([{"signal": "level"}, {"dopamine": "early"}] if issubclass(kind, Modulated) else [{}])
    if "dopamine" not in listens or "tau_n" in kind.quantities()
]


def seen_after(sim: neuro.Simulation, ms: float) -> dict | None:
    """Run; return what can be read, or None where weights have left all bounds."""
    run_on(sim, ms)
    try:
        return observe(sim)
    except neuro.ModelError as error:
        if error.kind != "instability":
            raise
        return None


@pytest.mark.parametrize("times", [3, 1000])
@pytest.mark.parametrize(
    ("kind", "listens"), PAIRS, ids=[f"{kind.__name__} {'+'.join(words)}".strip() for kind, words in PAIRS]
)
def test_every_rule_hears_each_of_several_spikes(kind, listens, times):
    words = dict(listens) | ({"dopamine_rule": "all_to_all"} if "dopamine" in listens else {})
    runs = []
    for backend, threads in [("reference", 1), ("event", 1), *([("event", 2)] if times == 3 else [])]:
        sim = neuro.compile(taught(kind(**words), times, listens), backend, seed=1, threads=threads)
        if "signal" in listens:
            sim.signal("level", [0.5, 1.0])
        runs.append([seen_after(sim, 10.0) for _ in range(2)])
    expected, *others = runs
    for each in others:
        for reference, found in zip(expected, each, strict=True):
            if reference is None:
                assert found is None
            else:
                assert differences(reference, found, exact=False) == []
