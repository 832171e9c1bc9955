"""Synapses of one delay learn at once, others lazily: both give what the reference gives, whatever happens between."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from beside import evaluated
from neuro.model.synapses import Synapse
from neuro.run.simulation import Simulation
from neuro_event.building import build
from neuro_event.loop import tables as t

SETTINGS = settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
RULES: dict[str, Any] = evaluated(__file__, "RULES", globals())
STEPS = 120
BUILD = build.build


@contextmanager
def lazily() -> Iterator[None]:
    """Networks that are compiled inside read histories, as all did before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "build", lambda program, threads, eager: BUILD(program, threads, eager=False))
        yield


def paths(sim: Simulation) -> list[int]:
    """Which plastic projections of a simulation learn eagerly."""
    found: Any = sim._engine
    return [int(row[t.EAGER]) for row in found._arrays.plastic["table"]]


@dataclass(frozen=True)
class Course:
    """A network of trains on both sides, and what is done to it on the way.

    Attributes:
        pre, post: steps of spikes by source and by target; one that is there twice has multiplicity two.
        acts: (step, what): "read", "weights", or a parameter and its value.
    """

    rule: str
    numbers: dict[str, float]
    delay: int
    tau_minus: float
    pre: list[list[int]]
    post: list[list[int]]
    acts: list[tuple[int, Any]]

    def network(self) -> neuro.Network:
        net = neuro.Network("trains", resolution=1.0)
        synapse: Synapse = RULES[self.rule](**self.numbers)
        for side, trains in (("pre", self.pre), ("post", self.post)):
            times = [[float(step) for step in sorted(train)] for train in trains]
            net.population(f"{side}_spikes", len(trains), neuro.spike_generator(spike_times=times))
            net.population(side, len(trains), neuro.parrot_neuron(tau_minus=self.tau_minus))
            net.connect(f"{side}_spikes", side, neuro.one_to_one(), delay=1.0)
        weight = synapse.Wmax * np.linspace(0.0, 1.0, len(self.pre) * len(self.post))  # type: ignore[attr-defined]
        net.population("heard", len(self.post), neuro.iaf_psc_delta(V_th=1e9, tau_m=7.0, tau_minus=self.tau_minus))
        net.connect("post", "heard", neuro.one_to_one(), delay=1.0)
        rule = neuro.all_to_all()
        shape = weight.reshape(len(self.pre), len(self.post))
        net.connect("pre", "post", rule, synapse, weight=shape, delay=float(self.delay), name="onto_parrots")
        net.connect("pre", "heard", rule, synapse, weight=shape, delay=float(self.delay), name="learnt")
        return net

    def run(self, sim: Simulation) -> list[np.ndarray]:
        """All that is seen of it."""
        seen, done = [], 0
        for step, act in [*sorted(self.acts, key=lambda a: a[0]), (STEPS, "read")]:
            sim.run(float(step - done))
            done = step
            if act == "weights":
                sim.set_weights("learnt", sim.weights("learnt")[2][::-1].copy())
            elif act != "read":
                sim.set("learnt", **{act[0]: act[1]})
                sim.set("onto_parrots", **{act[0]: act[1]})
            for name in ("onto_parrots", "learnt"):
                seen.append(sim.weights(name)[2])
                if self.rule.endswith("stdp"):
                    seen.append(sim.get(name, "K_plus"))
        return [*seen, *sim.spikes("post"), sim.get("heard", "V_m")]


@st.composite
def courses(draw: st.DrawFn) -> Course:
    trains = st.lists(st.lists(st.integers(1, STEPS), max_size=14), min_size=1, max_size=3)
    tau = st.sampled_from([1e-3, 0.1, 1.0, 5.0, 20.0, 1e4, 1e7])
    rule = draw(st.sampled_from(sorted(RULES)))
    numbers = {"tau_plus": draw(tau)}
    if rule == "triplets":
        numbers |= {"tau_plus_triplet": draw(tau), "tau_minus_triplet": draw(tau)}
    step_size = "Aplus" if rule == "triplets" else "lambda_"
    act = st.sampled_from(["read", "weights", ("tau_plus", 3.0), ("tau_plus", 1e-3), (step_size, 0.05)])
    acts = draw(st.lists(st.tuples(st.integers(1, STEPS), act), max_size=5))
    delay, tau_minus = draw(st.integers(1, 12)), draw(tau)
    return Course(rule, numbers, delay, tau_minus, draw(trains), draw(trains), acts)


@SETTINGS
@given(course=courses())
def test_eager_and_lazy_synapses_do_what_those_of_the_reference_do(course: Course):
    with lazily():
        lazy = neuro.compile(course.network(), "event", seed=1)
    eager, reference = (neuro.compile(course.network(), backend, seed=1) for backend in ("event", "reference"))
    assert (paths(eager), paths(lazy)) == ([1, 1], [0, 0])
    expected = course.run(reference)
    for sim in (eager, lazy):
        for there, here in zip(expected, course.run(sim), strict=True):
            assert here == pytest.approx(there, rel=1e-9, abs=1e-12)


@SETTINGS
@given(course=courses(), cut=st.integers(1, STEPS - 1))
def test_threads_and_states_do_not_matter(course: Course, cut: int, tmp_path_factory: pytest.TempPathFactory):
    one, two, again = (neuro.compile(course.network(), "event", seed=1, threads=n) for n in (1, 2, 1))
    expected = course.run(one)
    assert all(np.array_equal(a, b) for a, b in zip(expected, course.run(two), strict=True))
    state = tmp_path_factory.mktemp("state") / "state.h5"
    started, whole = (neuro.compile(course.network(), "event", seed=1) for _ in range(2))
    started.run(float(cut))
    started.save(state)
    again.restore(state)
    again.run(float(STEPS - cut))
    whole.run(float(STEPS))
    for name in ("learnt", "onto_parrots"):
        assert np.array_equal(again.weights(name)[2], whole.weights(name)[2])


def balanced(delay: Any, tau_minus: Any = 20.0) -> neuro.Network:
    net = neuro.Network("balanced", resolution=0.1)
    net.population("noise", 40, neuro.poisson_generator(rate=800.0))
    net.population("cells", 40, neuro.iaf_psc_delta(C_m=1.0, tau_m=20.0, E_L=0.0, V_reset=0.0, V_th=20.0))
    net.population("others", 40, neuro.iaf_psc_delta(V_th=-60.0, tau_minus=tau_minus))
    net.connect("noise", "cells", neuro.one_to_one(), weight=8.0, delay=1.0)
    rule = neuro.stdp(Wmax=1.0, mu_plus=0.0, mu_minus=0.0, lambda_=0.05)
    net.connect("cells", "cells", neuro.fixed_indegree(10), rule, weight=0.5, delay=delay, name="within")
    net.connect("cells", "others", neuro.fixed_indegree(10), rule, weight=0.5, delay=delay, name="across")
    return net


@pytest.mark.parametrize(
    ("net", "eager"),
    evaluated(__file__, "CASES", globals()),
    ids=["one delay", "delays of their own", "traces of their own"],
)
def test_which_projections_learn_at_once(net: neuro.Network, eager: list[int]):
    sims = [neuro.compile(net, backend, seed=2) for backend in ("reference", "event")]
    for sim in sims:
        sim.run(100.0)
    assert paths(sims[1]) == eager
    for name in ("within", "across"):
        assert sims[1].weights(name)[2] == pytest.approx(sims[0].weights(name)[2], rel=1e-9)
        assert np.ptp(sims[1].weights(name)[2]) > 0.0


def test_a_long_silence_leaves_nothing_of_traces():
    """A million steps later K+ and K- are 0, also where they pass through the smallest numbers there are."""
    times = [10.0, 14.0, 100_010.0, 100_013.0]
    for tau in (5.0, 120.0, 20_000.0):
        net = neuro.Network("silence", resolution=0.1)
        net.population("pre_spikes", 1, neuro.spike_generator(spike_times=[times]))
        net.population("post_spikes", 1, neuro.spike_generator(spike_times=[[t + 1.0 for t in times]]))
        net.population("post", 1, neuro.parrot_neuron(tau_minus=tau))
        net.connect("post_spikes", "post", neuro.one_to_one(), delay=0.1)
        rule = neuro.stdp(Wmax=1.0, mu_plus=0.0, mu_minus=0.0, lambda_=0.05, tau_plus=tau)
        net.connect("pre_spikes", "post", neuro.all_to_all(), rule, weight=0.5, delay=1.0, name="learnt")
        with lazily():
            lazy = neuro.compile(net, seed=1)
        eager = neuro.compile(net, seed=1)
        for sim in (lazy, eager):
            sim.run(100_020.0)
        assert paths(eager) == [1]
        assert eager.weights("learnt")[2] == pytest.approx(lazy.weights("learnt")[2], rel=1e-12)
        assert eager.get("learnt", "K_plus") == pytest.approx(lazy.get("learnt", "K_plus"), rel=1e-11)


def test_a_state_that_was_saved_lazily_goes_on_lazily(tmp_path: Path):
    net = balanced(1.5)
    with lazily():
        lazy = neuro.compile(net, seed=3)
    lazy.run(50.0)
    lazy.save(tmp_path / "state.h5")
    other = neuro.compile(net, seed=3)
    other.restore(tmp_path / "state.h5")
    for sim in (lazy, other):
        sim.run(50.0)
    assert paths(other) == [0, 0]
    for name in ("within", "across"):
        assert np.array_equal(other.weights(name)[2], lazy.weights(name)[2])
    other.reset()
    assert paths(other) == [1, 1]


def test_memory_of_a_synapse():
    """Weight, weight sent last, target, and the place and the source in the list of its target."""
    sim = neuro.compile(balanced(1.5), seed=1)
    synapses = sum(p.size for p in sim.program.projections if p.synapse.learns)
    lists = 2 * 41 * 8 + 2 * 41 * 8  # where rows and lists end
    assert sim.memory()["synapses"] <= 28 * synapses + lists + 1000
