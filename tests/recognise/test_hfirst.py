"""HFirst: the network beside the rules of its authors event by event, its templates, readings, and the method."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import neuro
import neuro_models
from neuro.apps import evaluate
from neuro.chips import cells
from neuro.events import Events, recordings
from neuro_recognise.compare import MethodComparison, compare, contestants, show as show_compared
from neuro_recognise.energy import bills, counted, show as show_energy
from neuro_recognise.method import choose
from neuro_recognise.methods import hfirst
from neuro_recognise.methods.hfirst import HFirstSettings, LayerResponse, LayerSpikes, decide, decisive, network, scores
from neuro_recognise.recogniser import learn, method_of
from neuro_recognise.shown import Features
from neuro_recognise.telling.report import Tried
from refused import refused

SMALL = HFirstSettings(size=(14, 11))


def bar(n=700, seed=4, settings=SMALL):
    """Events of both polarities round a bar that moves and turns, one at a time, at whole steps of the network."""
    rng = np.random.default_rng(seed)
    width, height = settings.size
    steps = np.cumsum(rng.integers(1, 4, n))
    angle, along, across = 0.5 + steps / steps[-1] * 2.0, rng.uniform(-5.0, 5.0, n), rng.normal(0.0, 0.6, n)
    x = np.clip(width / 2 + along * np.cos(angle) - across * np.sin(angle), 0, width - 1)
    y = np.clip(height / 2 + along * np.sin(angle) + across * np.cos(angle), 0, height - 1)
    t = np.rint(steps * settings.resolution * 1000.0).astype(np.int64)
    return Events(t, x.astype(np.int64), y.astype(np.int64), (across > 0.0).astype(np.int64), settings.size)


class Sheet:
    """Neurons at places of which the first to fire resets all others at its place: S1, or S2 as a single place."""

    def __init__(self, shape, threshold, leak, t_ref):
        self.v, self.threshold, self.leak, self.t_ref = np.zeros(shape), threshold, leak, t_ref
        self.updated, self.fired = np.zeros(shape[1:]), np.full(shape[1:], -np.inf)

    def add(self, t, where, weights):
        """Add weights (neurons of a place, *places) at the places `where`; return the winners (neuron, *place)."""
        free, leaked = t - self.fired[where] > self.t_ref + 1e-9, self.leak * (t - self.updated[where])
        v = self.v[:, *where]
        v = np.where(free, np.sign(v) * np.maximum(np.abs(v) - leaked, 0.0) + weights, v)
        self.updated[where] = np.where(free, t, self.updated[where])
        reached = free & (v.max(axis=0) >= self.threshold)
        found = [(int(v[:, *place].argmax()), *place) for place in np.argwhere(reached)]
        self.v[:, *where] = np.where(reached, 0.0, v)
        self.fired[where] = np.where(reached, t, self.fired[where])
        return found


def c1_by_events(settings, events):
    """C1 spikes, event by event: times in ms since the first event, and neurons."""
    width, height = settings.size
    half, shape = settings.field // 2, settings.shape
    before = [max(0, n * settings.pool - length) // 2 for n, length in zip(shape[1:], (height, width), strict=True)]
    sheet = (shape[0], height, width), settings.s1_threshold, settings.s1_leak, settings.t_ref
    layers = {polarity: Sheet(*sheet) for polarity in (0, 1)}
    heard, times, ids = np.full(shape, -np.inf), [], []
    for event in events.records():
        t, x, y = (event["t"] - events.t[0]) / 1000.0, int(event["x"]), int(event["y"])
        rows = slice(max(0, y - half), min(height, y + half + 1))
        columns, i = slice(max(0, x - half), min(width, x + half + 1)), half + y - np.arange(rows.start, rows.stop)
        j = half + x - np.arange(columns.start, columns.stop)
        fired = layers[int(event["p"])].add(t, (rows, columns), settings.gabors[:, i[:, None], j])
        for kernel, r, c in sorted(fired):
            place = (np.array((rows.start + r, columns.start + c)) + before) // settings.pool
            cell = (kernel, *place)
            if t - heard[cell] > settings.t_ref + 1e-9:
                heard[cell] = t
                times.append(t)
                ids.append(np.ravel_multi_index(cell, shape))
    return np.array(times), np.array(ids)


RESETS = replace(SMALL, c1_resets=True)


@cache
def compiled(settings, layer="whole"):
    return neuro.compile(hfirst.c1_alone(settings) if layer == "c1" else network(settings, 3))


@pytest.fixture(scope="module")
def sim():
    return compiled(SMALL)


def whole(sim, settings, recording):
    """C1 spikes of the whole network."""
    hfirst.show(sim, settings, hfirst.input_spikes(settings, recording))
    return LayerSpikes(*sim.spikes("c1"))


@pytest.fixture(scope="module")
def of_bars(sim):
    """C1 spikes of some recordings."""
    return [whole(sim, SMALL, bar(seed=seed)) for seed in range(4)]


def in_order(times, ids):
    order = np.lexsort((ids, np.rint(times * 1e6)))
    return times[order], ids[order]


def test_c1_spikes_are_those_of_the_rules_event_by_event(sim):
    recording = bar()
    found = whole(sim, SMALL, recording)
    times, ids = in_order(*c1_by_events(SMALL, hfirst._without_noise(recording, SMALL)))
    assert ids.size > 30
    np.testing.assert_array_equal(found.ids, ids)
    np.testing.assert_allclose(found.times, times + 3 * SMALL.resolution, atol=1e-9)
    first = whole(sim, SMALL, bar())
    whole(sim, SMALL, bar(seed=9))
    again = whole(sim, SMALL, bar())
    np.testing.assert_array_equal(first.times, again.times)
    np.testing.assert_array_equal(first.ids, again.ids)
    nothing = whole(sim, SMALL, bar(n=1))
    assert nothing.times.size == nothing.ids.size == 0
    s1 = hfirst.s1_spikes(SMALL, hfirst.input_spikes(SMALL, bar(n=1)))
    assert [spikes.ids.size for spikes in s1.values()] == [0, 0]
    assert hfirst.c1_spikes(compiled(SMALL, "c1"), SMALL, s1).ids.size == 0


@pytest.mark.parametrize("settings", [SMALL, RESETS], ids=["", "resets"])
@pytest.mark.parametrize("seed", range(3))
def test_layer_by_layer_spikes_are_those_of_the_network(seed, settings):
    """S1 event by event, C1 alone: all spikes at the steps of the whole network, also where C1 draws ties."""
    inputs, sim = hfirst.input_spikes(settings, bar(seed=seed)), compiled(settings)
    s1 = hfirst.s1_spikes(settings, inputs)
    c1 = hfirst.c1_spikes(compiled(settings, "c1"), settings, s1)
    hfirst.show(sim, settings, inputs)
    for name, (times, ids) in {**s1, "c1": c1}.items():
        expected = sim.spikes(name)
        for one, other in zip(in_order(times, ids), expected, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-9)
        assert ids.size > 20, name


def test_layers_alone_and_events_outside():
    """A chip that refuses them names the network's file, not the code that took them out."""
    for net in (hfirst.c1_alone(SMALL), hfirst.s2_alone(SMALL, np.ones((3, np.prod(SMALL.shape))))):
        with pytest.raises(
            neuro.ModelError, match=r"hfirst\.yaml:\d+:3: population '\w+': iaf_linear_leak: loihi has no"
        ):
            neuro.compile(net, backend="loihi")
    message = refused(hfirst.input_spikes, SMALL, bar(settings=replace(SMALL, size=(30, 11))))
    assert message.startswith("an event at (")
    assert message.endswith("expected a sensor of at most 14 x 11 px\n  hint: set size")


@pytest.fixture(scope="module")
def learnt(of_bars):
    return hfirst.templates(SMALL, hfirst.c1_counts(SMALL, of_bars), [0, 1, 2, 0], 3) + np.arange(3.0)[:, None]


def test_s2_does_what_the_rules_say(learnt, of_bars):
    sim = neuro.compile(network(SMALL, 3, learnt))
    c1 = whole(sim, SMALL, bar())
    times, ids = sim.spikes("s2")
    heard = hfirst.s2_heard(neuro.compile(hfirst.s2_alone(SMALL, learnt)), SMALL, c1)
    assert ids.size > 3
    np.testing.assert_array_equal(heard.spikes.ids, ids)
    np.testing.assert_allclose(heard.spikes.times, times, atol=1e-9)
    heard = hfirst.s2_heard(neuro.compile(hfirst.s2_alone(SMALL, learnt)), SMALL, of_bars[1])
    place, fired = Sheet((3, 1), SMALL.s2_threshold, SMALL.s2_leak, SMALL.t_ref), []
    moments, moment_of = np.unique(np.rint(of_bars[1].times * 1e6), return_inverse=True)
    for k, moment in enumerate(moments):
        came = learnt[:, of_bars[1].ids[moment_of == k]].sum(axis=1)
        fired += [winner for winner, _ in place.add(moment / 1e6, (slice(0, 1),), came[:, None])]
        np.testing.assert_allclose(heard.potentials[np.flatnonzero(moment_of == k)[0]], place.v[:, 0], atol=1e-9)
    assert len(fired) > 3
    assert fired == heard.spikes.ids.tolist()
    nothing = LayerSpikes(np.zeros(0), np.zeros(0, dtype=np.int64))
    heard = hfirst.s2_heard(neuro.compile(hfirst.s2_alone(SMALL, np.ones((3, np.prod(SMALL.shape))))), SMALL, nothing)
    assert heard.potentials.shape == (0, 3)
    assert all(np.isnan(decisive(heard, reading)).all() for reading in hfirst.READINGS)
    assert decide(heard, "potentials") == decide(heard) == -1


def test_orientations_of_a_cell_may_reset_each_other(of_bars):
    fewer = whole(compiled(RESETS), RESETS, bar(seed=0))
    assert 0 < fewer.ids.size < of_bars[0].ids.size
    cells = fewer.ids % np.prod(RESETS.shape[1:])
    assert all(np.all(np.diff(fewer.times[cells == cell]) > RESETS.t_ref) for cell in np.unique(cells))


def test_templates_are_counts_at_a_norm_of_100():
    settings = HFirstSettings(size=(4, 4), orientations=4)
    counts = np.array([[300, 0, 1, 400], [0, 0, 0, 0], [0, 2, 0, 0], [0, 2, 0, 0]])
    found = hfirst.templates(settings, counts, [0, 1, 2, 2], 4)
    np.testing.assert_allclose(found[0], [60.0, -1.0, -1.0, 80.0], atol=1e-3)
    np.testing.assert_array_equal(found[[1, 3]], -1.0)
    np.testing.assert_array_equal(found[2], [-1.0, 100.0, -1.0, -1.0])


def test_readings():
    heard = LayerResponse(
        LayerSpikes(np.arange(4.0), np.array([2, 1, 2, 0])), np.array([[1.0, 9.0, 3.0], [0.0, 5.0, 2.0]])
    )
    np.testing.assert_array_equal(scores(heard, "hard"), [1, 1, 2])
    np.testing.assert_array_equal(scores(heard, "soft"), [0.25, 0.25, 0.5])
    np.testing.assert_array_equal(scores(heard, "potentials"), [1.0, 14.0, 5.0])
    assert [decide(heard, reading) for reading in ("hard", "soft", "potentials")] == [2, 2, 1]
    even = heard._replace(spikes=LayerSpikes(np.arange(2.0), np.array([0, 2])))
    assert [decide(even, reading) for reading in ("hard", "soft", "potentials")] == [2, 2, 1]
    silent = heard._replace(spikes=LayerSpikes(np.zeros(0), np.zeros(0, dtype=np.int64)))
    assert [decide(silent, reading) for reading in ("hard", "soft", "potentials")] == [1, 1, 1]
    assert refused(decide, heard, "loud") == "reading = 'loud': expected one of hard, soft, potentials"
    heard = LayerResponse(
        LayerSpikes(np.arange(3.0), np.array([1, 2, 2])), np.array([[9.0, 1.0, 0.0], [0.0, 5.0, 2.0]])
    )
    np.testing.assert_allclose(decisive(heard, "hard"), [2 / 3, 1 + 1 / 3, 2.0])
    np.testing.assert_allclose(decisive(heard, "soft"), [2 / 9, 4 / 9, 2 / 3])
    np.testing.assert_array_equal(decisive(heard, "potentials"), [9.0, 6.0, 2.0])
    without = heard._replace(spikes=LayerSpikes(np.zeros(0), np.zeros(0, np.int64)))
    np.testing.assert_allclose(decisive(without, "soft"), [2 / 3, 1 / 3, 0.0])


def test_the_network_has_the_values_of_the_settings_and_what_was_learnt():
    ours, theirs = network(HFirstSettings(), 10), neuro.load(neuro_models.path("hfirst"))
    for name in ("on_s1", "off_s1"):
        kernels = ours.projections.pop(name).weight, theirs.projections.pop(name).weight
        np.testing.assert_allclose(*kernels, atol=0.0005)
    assert ours == theirs
    learnt = {"templates": np.arange(3.0 * 2 * 2 * 2).reshape(3, -1)}
    net = method_of("hfirst", values={"size": [8, 8], "orientations": 2}).network(learnt)
    assert net.populations["s1_on"].shape == (2, "auto", "auto")
    *_, weights = neuro.compile(net).weights("c1_s2")
    np.testing.assert_array_equal(weights.reshape(8, 3), learnt["templates"].T)


def test_pips_are_told_apart(shared):
    """Upright pips of POKER-DVS, every third to test; 90 % in five folds."""
    settings = HFirstSettings(size=(35, 35))
    found = [r for r in recordings(shared / "data" / "poker_dvs" / "poker_dvs_shared_aedat2.zip") if "i." not in r.name]
    sim = neuro.compile(hfirst.c1_alone(settings))
    inputs = [hfirst.input_spikes(settings, one.load()) for one in found]
    c1 = [hfirst.c1_spikes(sim, settings, hfirst.s1_spikes(settings, each)) for each in inputs]
    labels, train = np.array([one.label for one in found]), np.arange(len(found)) % 3 != 0
    learnt = hfirst.templates(settings, hfirst.c1_counts(settings, c1)[train], labels[train], 4)
    s2 = neuro.compile(hfirst.s2_alone(settings, learnt))
    right = [decide(hfirst.s2_heard(s2, settings, c1[k]), "potentials") == labels[k] for k in np.flatnonzero(~train)]
    assert np.mean(right) >= 0.75


REFUSED = (
    "population 's1_on': iaf_linear_leak: loihi has no such neuron: it has iaf_psc_exp, iaf_psc_delta and parrot_neuron"
)


def test_what_is_observed_does_not_depend_on_s2():
    first = method_of("hfirst").observing()
    assert method_of("hfirst", values={"s2_threshold": 90.0, "s2_leak": 2.0, "below": 0.5}).observing() == first
    assert method_of("hfirst", values={"unseen": -2.0, "reading": "soft"}).observing() == first
    assert method_of("hfirst", values={"s1_leak": 50.0}).observing() != first
    assert method_of("hfirst", "poker").observing() != first


@pytest.fixture(scope="module")
def bars():
    """What upright and lying bars show."""
    method, events = method_of("hfirst", values={"size": [12, 12], "orientations": 4}), []
    for k in range(8):
        rng = np.random.default_rng(k)
        along, across = rng.integers(2, 11, 300), 3 + np.arange(300) // 50 + rng.integers(0, 2, 300)
        x, y = (along, across) if k % 2 else (across, along)
        events.append(Events(np.arange(300) * 60, x, y, rng.integers(0, 2, 300), (12, 12)))
    labels = np.arange(8) % 2
    shown = Features([method.observe(one) for one in events], labels, tuple("abcdefgh"), ("upright", "lying"))
    return learn(method, shown, "bars"), shown


def test_the_whole_network_decides_as_its_layers_do_on_each_backend(bars):
    """The spikes of S2, of all recordings together, are those of the bill's run."""
    model, shown = bars
    assert (choose(model.method.answer(model.learnt, shown).scores) == shown.labels).all()
    shown = shown.take([0, 1])
    one, other = (model.method.answer(model.learnt, shown, backend) for backend in ("event", "reference"))
    for vote, found in one.votes.items():
        np.testing.assert_allclose(found, other.votes[vote], rtol=0, atol=1e-9)
    (_, took), (sim, again) = one.run(), other.run()
    assert sim.backend == "reference"
    heard = sum(np.floor(one.votes["hard"] + 1e-9).sum(axis=1))
    for taken in (took, again):
        assert taken.counts.populations["s2"].spikes == heard > 0
        assert taken.counts.populations["c1"].spikes == sum(len(part["ids"]) for part in shown.evidence)
    assert took.counts == again.counts


def test_its_bill_and_the_chips_that_refuse_it(bars, capsys):
    model, shown = bars
    answer = model.method.answer(model.learnt, shown)
    tried = Tried(evaluate(choose(answer.scores), shown.labels, shown.classes), {}, answer)
    told = bills(tried, ["loihi", "spinnaker", "spinnaker2", "cpu"])
    assert list(told.bills) == ["spinnaker2", "cpu"]
    assert told.refused == {"loihi": REFUSED, "spinnaker": REFUSED.replace("loihi", "spinnaker")}
    counts = counted(told)
    assert "frames" not in counts
    macs = 2 * 4 * 72 * 72 + 2 * 4 * 9 * 16 + 4 * 9 * 2  # a field of 7 covers 7 * 12 - 12 places along a side of 12
    assert counts["steps"] * 8 == told.run[1].counts.steps
    assert told.bills["cpu"].by_cost()["mac"] == pytest.approx(counts["steps"] * macs * 8.6e-9)
    show_energy(model, tried, told)
    text = capsys.readouterr().out
    assert f"- loihi refuses the network: {REFUSED}\n" in text
    (row,) = [line for line in text.splitlines() if line.strip().startswith("loihi ")]
    assert row.split() == ["loihi", "refused", *["-"] * 4]


def test_a_comparison_says_who_refuses_it(capsys, learning, tmp_path):
    """Trained on two folds, priced by the whole network."""
    plan = MethodComparison(contestants(["hfirst"]), 2, (0,), ("loihi", "spinnaker2"), tmp_path, jobs=1)
    found = compare(learning.take([0, 1, 2, 8, 9, 10]), plan, lambda progress: None)
    show_compared([*found], plan)
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == f"- loihi refuses hfirst: {REFUSED}"
    (row,) = [line for line in lines if line.strip().startswith("hfirst") and "refused" in line]
    assert row.split() == ["hfirst", "loihi", "refused", *["-"] * 4]
    (row,) = [line for line in lines if line.strip().startswith("hfirst") and "spinnaker2" in line]
    bill = found[0].bills["spinnaker2"]
    dynamic, *_, time, _ = cells(bill)
    assert row.split()[2:4] == dynamic.split()
    assert " ".join(row.split()).endswith(f"{time} 1")
    assert bill["late"], "steps of 0.1 ms"
