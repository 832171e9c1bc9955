"""Signals whose values are described: what sets them, when, and what is refused."""

from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
import neuro_models
from alike import alike, same
from neuro.extend import Source, quantity
from neuro.model.signals import SOURCES
from refused import refused

COUNTED = "count(motors[0]) - 2 * count(motors[1:]) + after(motors[0], motors[1], 5) + trace(rate(input), 30)"
LATE = {"delay": neuro.uniform(low=5.0, high=90.0), "tau": 40.0, "scale": [0.001, -0.001]}
EXPRESSIONS = {
    "count(motors)": lambda spikes: spikes.sum((1, 2)),
    "count(motors[1]) ^ 2 / 3 - 1": lambda spikes: spikes[:, :, 1].sum(1) ** 2 / 3 - 1,
    "rate(motors)": lambda spikes: spikes.sum((1, 2)) / 2 / 0.02,
    "where(count(motors[0]) > count(motors[1]), 1, -1)": lambda spikes: np.where(
        spikes[:, :, 0].sum(1) > spikes[:, :, 1].sum(1), 1.0, -1.0
    ),
    "(count(motors[0]) >= 1) + exp(-count(motors[1]))": lambda spikes: (
        (spikes[:, :, 0].sum(1) >= 1) + np.exp(-spikes[:, :, 1].sum(1))
    ),
    "mean(count(motors))": lambda spikes: spikes.sum((1, 2)).cumsum() / np.arange(1, len(spikes) + 1),
    "mean(count(motors), 50)": lambda spikes: filtered(spikes.sum((1, 2)), 1 - np.exp(-20 / 50), np.exp(-20 / 50)),
    "trace(count(motors), 50 ms)": lambda spikes: filtered(np.r_[0, spikes.sum((1, 2))], 1.0, np.exp(-20 / 50))[1:],
    "after(motors[0], motors[1])": lambda spikes: coincidences(spikes, 20),
    "after(motors[0], motors[1], within=3)": lambda spikes: coincidences(spikes, 3),
    "after(motors, motors, 4)": lambda spikes: coincidences(spikes.sum(2, keepdims=True), 4),
}


def filtered(values, new, left):
    found = [float(values[0])]
    for value in values[1:]:
        found.append(left * found[-1] + new * value)
    return np.array(found)


def coincidences(spikes, within):
    """Spikes of the last neuron that come at most so many steps after one of the first, by period."""
    first, last = (spikes[:, :, k].ravel() for k in (0, -1))
    near = [last[t] * (first[max(0, t - within) : t] > 0).any() for t in range(last.size)]
    return np.array(near).reshape(len(spikes), -1).sum(1)


def net(values=None, rule=None, **signals):
    net = neuro.Network("loop", resolution=1.0)
    net.population("input", 16, neuro.poisson_generator(rate=40.0))
    motors = net.population("motors", 2, neuro.iaf_psc_exp(tau_m=10.0))
    rule = rule or neuro.stdp_dopa(A_minus=0.5, tau_c=200.0, Wmax=1200.0, signal="reward")
    weight = neuro.uniform(low=300.0, high=800.0)
    net.connect("input", motors, neuro.all_to_all(), rule, weight=weight, delay=1.0, name="learnt")
    net.signal("reward", to=motors, values=values)
    for name, others in signals.items():
        net.signal(name, to=motors, values=others)
    return net


def held(values, **signals):
    """A network whose rule holds what a signal is set to."""
    return net(values, neuro.mstdpet(signal="reward", Wmax=1200.0), **signals)


def heard(net, periods, every=20.0):
    """What the signal was set to at the end of each period, and the spikes, (periods, steps, neurons)."""
    sim = neuro.compile(net, seed=3)
    values = []
    for _ in range(periods):
        sim.run(every)
        values.append(sim.get("learnt", "n")[:2])
    steps, ids, counts = sim.train("motors")
    spikes = np.zeros((int(periods * every) + 1, 2))
    spikes[steps, ids] = counts
    return np.array(values), spikes[1:].reshape(periods, -1, 2)


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_expressions_are_what_numpy_computes(expression):
    values, spikes = heard(held(neuro.computed(expression, every=20.0)), 40)
    assert spikes.sum() > 100
    assert np.ptp(values[:, 0]) > 0
    np.testing.assert_allclose(values[:, 0], EXPRESSIONS[expression](spikes), rtol=1e-12, atol=1e-14)
    assert np.array_equal(values[:, 0], values[:, 1])


def test_constants_schedules_and_likes():
    assert heard(held(0.5), 2)[0].tolist() == [[0.5, 0.5]] * 2
    assert heard(held([0.5, -1.0]), 2)[0].tolist() == [[0.5, -1.0]] * 2
    listed = neuro.schedule(times=[20.0, 40.0, 70.0], values=[[1.0, -1.0], [2.0, 0.0], [3.0, 4.0]])
    assert heard(held(listed), 4)[0].tolist() == [[1.0, -1.0], [2.0, 0.0], [2.0, 0.0], [3.0, 4.0]]
    copied, middle = (neuro.like("middle", scale=[2.0, 1.0]), neuro.like("first", scale=-1.0))
    values, _ = heard(held(copied, middle=middle, first=neuro.schedule([20.0, 40.0], [1.0, 2.0])), 2)
    assert values.tolist() == [[-2.0, -1.0], [-4.0, -2.0]]


def test_a_population_is_a_trace_of_its_spikes():
    values, spikes = heard(held(neuro.population("motors", tau=50.0, baseline=0.5, scale=2.0, every=20.0)), 20)
    trace = filtered(np.r_[0, spikes.sum((1, 2)) / 2], 1.0, np.exp(-20 / 50))[1:]
    np.testing.assert_allclose(values[:, 0], 2.0 * (trace - 0.5), rtol=1e-12)


def test_a_bill_has_the_operations_of_expressions():
    works = {}
    for name, text, words in (
        ("count", "count(motors)", {}),
        ("scaled", "count(motors)", {"scale": [1.0, -1.0]}),
        ("traced", "trace(count(motors[0]), 50)", {}),
        ("after", "after(motors[0], motors[1])", {}),
    ):
        sim = neuro.compile(net(neuro.computed(text, every=20.0, **words)), seed=1)
        (row,) = sim.host_work
        works[name] = (row.steps, row.work and row.work.macs)
    # a sum of two, the difference from the last sum, and factors; a difference, a trace, a factor
    assert works == {"count": (20, 3), "scaled": (20, 4), "traced": (20, 3), "after": (20, None)}
    assert neuro.compile(net(0.5), seed=1).host_work == []


def test_delayed_values_are_set_late_and_doses_add_up():
    values, spikes = heard(held(neuro.computed("count(motors)", every=20.0, delay=60.0)), 10)
    assert values[:, 0].tolist() == [0.0] * 3 + spikes.sum((1, 2))[:-3].tolist()
    values, spikes = heard(held(neuro.computed("count(motors)", every=20.0, delay=40.0, tau=30.0)), 10)
    level = filtered(np.r_[0, spikes.sum((1, 2))], 1.0, np.exp(-20 / 30))[1:]
    assert spikes[:7].sum((1, 2)).all()
    np.testing.assert_allclose(values[:, 0], np.r_[0, 0, level[:-2]], rtol=1e-12)


def test_delays_are_drawn_for_each_value():
    numbered = neuro.computed("trace(1, 1e12)", every=100.0, delay=neuro.uniform(low=5.0, high=90.0))
    values, _ = heard(held(numbered), 2000, every=1.0)
    late = [np.argmax(values[:, 0] > k - 0.5) + 1 - 100 * k for k in range(1, 19)]
    assert 5 <= min(late) < 30 < 60 < max(late) <= 90


@settings(max_examples=15)
@given(st.lists(st.integers(0, 60), min_size=1, max_size=6), st.sampled_from(["reference", "event"]))
def test_a_run_in_parts_forgotten_saved_and_restored_has_the_same_bits(tmp_path_factory, cuts, backend):
    described = net(neuro.computed(COUNTED, every=20.0, **LATE))
    whole, parts = (neuro.compile(described, backend, seed=1) for _ in range(2))
    whole.run(sum(cuts) + 100.0)
    path = tmp_path_factory.mktemp("state") / "state.h5"
    for number, cut in enumerate(cuts):
        with parts.record_to(path.with_name("out.h5")) if number % 2 else nullcontext():
            parts.run(cut)
        parts.forget(before=parts.time - 3.0)
    parts.save(path)
    restored = neuro.compile(described, backend, seed=1)
    restored.restore(path)
    for each in (parts, restored):
        each.run(100.0)
        for word in ("weight", "n", "c"):
            assert np.array_equal(each.get("learnt", word), whole.get("learnt", word))
    whole.reset(weights=True)
    whole.run(sum(cuts) + 100.0)
    assert np.array_equal(whole.get("learnt", "weight"), parts.get("learnt", "weight"))


def test_backends_agree():
    described = net(neuro.computed(COUNTED, every=20.0, **LATE))
    sims = alike(described, 400.0)
    for word in ("n", "weight"):
        assert np.array_equal(*(sim.get("learnt", word) for sim in sims))
    assert np.ptp(sims[0].get("learnt", "weight")) > 100.0
    copies = neuro.compile(described, copies=2, seed=1)
    copies.run(400.0)
    same(sims[1], copies[0])


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_a_chip_has_the_largest_value_of_lists_and_asks_for_that_of_expressions(messages):
    listed = neuro.schedule([20.0, 40.0], [[0.01, -0.02]] * 2)
    known = neuro.computed("1", every=20.0, largest=1.0, scale=[0.01, -0.02])
    told = neuro.compile(net(), "loihi", seed=1, signals={"learnt": 0.02})
    for ms in (20.0, 20.0, 19.0):
        told.run(ms)
        told.signal("reward", [0.01, -0.02])
    for values in (listed, known):
        chip = neuro.compile(net(values), "loihi", seed=1)
        chip.run(59.0)
        assert np.array_equal(chip.get("learnt", "weight"), told.get("learnt", "weight"))
        assert chip.get("learnt", "n").min() < -0.01
    messages({"computed": refused(neuro.compile, net(neuro.computed("count(motors)")), "loihi")})


def test_a_frozen_network_keeps_what_was_learnt():
    sim = neuro.compile(net(neuro.computed(COUNTED, **LATE)), seed=1)
    sim.run(400.0)
    frozen = sim.network(frozen=True)
    assert not frozen.signals
    assert frozen.projections["learnt"].synapse == neuro.static()
    again = neuro.compile(frozen, "torch")
    assert np.array_equal(again.get("learnt", "weight"), sim.get("learnt", "weight"))
    tuned = net()
    tuned.connect("motors", "motors", neuro.one_to_one(), neuro.tsodyks2(), weight=1.0, delay=1.0, name="short")
    tuned.probe("c", "learnt", "c", every=10.0)
    kept = tuned.frozen()
    assert (kept.projections["short"].synapse, kept.probes) == (neuro.tsodyks2(), {})


def test_the_rewarded_pair_of_a_small_network_grows():
    ends = {}
    sizes = {"excitatory": 80, "inhibitory": 20, "to_excitatory": 16, "to_inhibitory": 4, "from_inhibitory": 20}
    for dose in (0.0, 0.5):
        sim = neuro.compile(neuro.load(neuro_models.path("conditioning"), {**sizes, "dose": dose}), seed=5)
        sim.run(300_000.0)
        ends[dose] = [sim.get(name, "weight").mean() for name in ("pair", "learning")]
    assert ends[0.5][0] > 2.0 * ends[0.5][1] > 0.5
    assert ends[0.0][0] < 0.1


def test_the_doctor_runs_what_sets_a_signal():
    found = [{finding.name for finding in neuro.doctor(net(values)).findings} for values in (None, 0.01)]
    assert ["signal-not-set" in each for each in found] == [True, False]


def test_a_source_of_ones_own(tmp_path, monkeypatch):
    for each in ("_parts", "_registered"):
        monkeypatch.setattr(SOURCES, each, dict(getattr(SOURCES, each)))
    monkeypatch.setattr(SOURCES, "_closed_by", "")

    @neuro.register
    @dataclass(frozen=True, eq=False)
    class twice(Source):
        """Twice a number."""

        of: float = quantity(1.0, "", "the number")

        def stands_for(self):
            return 2.0 * self.of

    held(twice(0.25)).save(tmp_path / "net.yaml")
    assert heard(neuro.load(tmp_path / "net.yaml"), 1)[0].tolist() == [[0.5, 0.5]]

    @dataclass(frozen=True, eq=False)
    class nothing(Source):
        """Nothing."""

    told = refused(neuro.compile, held(nothing()))
    assert "source 'nothing' has no method 'stands_for', which returns an equivalent source" in told


def test_what_is_refused(messages):
    sim = neuro.compile(net(1.0), "reference")

    def signal(values, **others):
        return neuro.compile(net(values, **others), "reference")

    messages.calls(globals() | {"sim": sim, "signal": signal, "computed": neuro.computed})


def test_the_line_of_a_mistake(tmp_path, messages):
    def said(values):
        path = tmp_path / "net.yaml"
        path.unlink(missing_ok=True)
        net(1.0).save(path)
        path.write_text(path.read_text("utf-8").replace("values: 1.0", f"values: {values}"))
        return refused(lambda: neuro.compile(neuro.load(path), "reference")).replace(str(path), "net.yaml")

    messages.of(said)
