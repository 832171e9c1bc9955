"""The loop of trials and its rules: small cases by hand, backends beside each other, what they learn of new data."""

import os
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

import neuro
from beside import evaluated
from neuro.extend import Growth, Lesson, Synapse, TrialEnd
from neuro.testing import check_part
from refused import refused

REPEATED = int(os.environ.get("NEURO_REPEATED_SPIKES", "6"))
"""Random networks for each rule whose inputs spike again."""
BACKENDS = ("event", "reference")
GOOD = [[0.9, 0.2], [0.9, 0.2]]
FLOATS = pytest.mark.parametrize("backend", ["reference", "event"])
INF = float("inf")


def pair(rule: Synapse, weights: Any, backend: str = "reference", tau_m: float = INF, **words: Any) -> Any:
    """Two inputs onto two maps of one neuron each, which stand for two labels; threshold 0.8; delays of one tick."""
    net = neuro.Network("pair", resolution=0.5)
    net.population("input", 2, neuro.spike_generator())
    net.population("maps", (2, 1), neuro.iaf_psc_delta(tau_m=tau_m, E_L=0.0, V_reset=0.0, V_th=0.8))
    net.connect("input", "maps", neuro.all_to_all(), rule, weight=np.array(weights), delay=0.5, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(**{"input": "input", "duration": 10.0, "labels": {"of": "maps"}} | words)
    return neuro.compile(net, backend)


def taught(sim: Any, labels: Any) -> Any:
    """The weights after one trial, input 0 at 0 ms and input 1 at 5 ms."""
    sim.trials([0.0, 5.0], [0, 1], [0, 2], labels=labels, learn=True)
    return pytest.approx(sim.weights("w")[2].ravel(), abs=1e-14)


def bent(w: float, rate: float) -> float:
    return w + rate * w * (1.0 - w)


RATES = {"Ar_plus": 0.1, "Ar_minus": -0.05, "Ap_plus": 0.02, "Ap_minus": -0.04}
HITS = neuro.mozafari(**RATES, misses=0.5, hits=0.25)
PEAK = neuro.tempotron(lambda_=0.1, tau_m=20.0, tau_s=0.0)
EARLY = 0.1 * np.exp(-5.0 / 20.0)
"""What a lesson of 0.1 at the second arrival leaves for the first."""
SILENT, SILENT_PAIR = [0.3, 0.2, 0.3, 0.2], [[0.3, 0.3], [0.3, 0.3]]
GROWN, SHRUNK = 0.9 + 0.1 * 0.1, 0.4 - 0.05 * 0.4


def held(total: float) -> Synapse:
    return neuro.normalised_stdp(A_plus=0.1, A_minus=-0.05, total=total)


BY_HAND = evaluated(__file__, "BY_HAND", globals())


@FLOATS
@pytest.mark.parametrize("case", BY_HAND)
def test_what_is_taught_by_hand(backend, case):
    """Weights before, from input 0 onto both maps and from input 1, the label, and weights after."""
    rule, weights, label, expected, words = BY_HAND[case]
    sim = pair(rule, np.reshape(weights, (2, 2)), backend, **words)
    assert taught(sim, None if label is None else [label]) == expected
    assert (sim.counts().learning_updates > 0) == (expected != weights)


def test_results_of_a_trial():
    r = pair(neuro.r_stdp(**RATES), [[0.9, 0.2], [0.9, 0.2]]).trials([0.0, 5.0], [0, 1], [0, 2], labels=[0], learn=True)
    assert (r.winner.tolist(), r.label.tolist(), r.step.tolist(), r.ticks.tolist()) == ([0], [0], [1], [2])
    assert r.potential.tolist() == [[0.9, 0.2]]
    assert r.counts.learning_updates == 2
    r = pair(neuro.r_stdp(**RATES), [[0.3, 0.3], [0.3, 0.3]]).trials([0.0, 5.0], [0, 1], [0, 2], labels=[1], learn=True)
    assert (r.winner.tolist(), r.label.tolist(), r.step.tolist(), r.ticks.tolist()) == ([-1], [-1], [-1], [20])
    assert r.potential.tolist() == [[0.6, 0.6]]


@FLOATS
def test_shares_of_hits_and_misses_are_set(backend):
    sim = pair(HITS, [[0.9, 0.2], [0.7, 0.2]], backend)
    sim.set("w", misses=0.0)
    assert taught(sim, [0]) == [0.9, 0.2, 0.7, 0.2]


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
def test_a_sum_of_weights_is_held_in_words_of_a_chip(backend):
    net = neuro.Network("sums", resolution=1.0)
    net.population("input", 40, neuro.spike_generator())
    net.population("maps", (3, 1), neuro.iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=4.0))
    weight = neuro.uniform(low=0.2, high=0.6)
    net.connect("input", "maps", neuro.all_to_all(), neuro.normalised_stdp(total=10.0), weight=weight, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="input", duration=20.0)
    sim = neuro.compile(net, backend, seed=1)
    rng = np.random.default_rng(1)
    times, ids = rng.integers(0, 15, 400).astype(float), np.concatenate([rng.permutation(40)[:20] for _ in range(20)])
    winner = sim.trials(times, ids, np.arange(21) * 20, learn=True).winner
    sums = sim.weights("w")[2].reshape(40, 3).sum(axis=0)
    assert sums[np.unique(winner[winner >= 0])] == pytest.approx(10.0, abs=0.15)


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
def test_ties_count_on_chips_as_in_floats(backend):
    for after in (False, True):
        sim = pair(neuro.r_stdp(**RATES, ties_after=after), [[0.5, 0.2], [0.5, 0.2]], backend)
        before = sim.weights("w")[2].copy()
        early, _, tie, _ = taught(sim, [0]).expected - before
        assert early > 0.0
        assert tie < 0.0 if after else tie > 0.0


@FLOATS
def test_tempotrons_that_are_taught_alone(backend):
    """While nobody decides, each neuron on the wrong side of `alone` is taught at its own largest V_m."""
    rule = neuro.tempotron(lambda_=0.1, tau_m=20.0, tau_s=0.0, alone=0.5)
    for weight, label, sign, mistaken in ((0.4, 0, -1, 1), (0.2, 1, 1, 1), (0.4, 1, -1, 0), (0.2, 0, 1, 0)):
        sim = pair(rule, [[weight, weight], [weight, weight]], backend, tau_m=20.0)
        sim.set("maps", V_th=1e6)
        expected = np.full((2, 2), weight)
        expected[:, mistaken] += (sign * EARLY, sign * 0.1)
        assert taught(sim, [label]) == expected.ravel().tolist()
    decided = pair(rule, [[0.5, 0.2], [0.5, 0.9]], backend, tau_m=20.0)
    assert taught(decided, [0]) == [0.5 + EARLY, 0.2 - EARLY, 0.6, 0.8]  # as without


def test_the_kernel_of_the_tempotron_is_a_potential_whose_largest_value_is_1():
    rule = neuro.tempotron(lambda_=1.0, tau_m=15.0, tau_s=3.75)
    c = np.zeros(rule.width)
    rule.arithmetic.constants(rule.vector(), 1.0, c)
    largest = 5.0 * np.log(4.0)  # ms
    before, top, after = (rule.arithmetic.teach(0.0, largest + t, 1.0, c) for t in (-0.01, 0.0, 0.01))
    assert top == pytest.approx(1.0, abs=1e-14)
    assert max(before, after) < top
    assert rule.arithmetic.teach(0.0, 0.0, 1.0, c) == 0.0
    assert rule.arithmetic.teach(0.25, -1.0, 1.0, c) == 0.25
    assert rule.arithmetic.teach(0.25, -INF, 1.0, c) == 0.25
    still = neuro.tempotron(lambda_=1.0, tau_m=INF, tau_s=0.0)
    still.arithmetic.constants(still.vector(), 1.0, c)
    assert still.arithmetic.teach(0.0, 7.0, -1.0, c) == -1.0


@pytest.mark.parametrize(
    "rule",
    [neuro.mozafari(Ar_plus=0.1, hits=0.5), neuro.normalised_stdp(total=30.0), neuro.tempotron(lambda_=0.1)],
    ids=lambda rule: rule.name,
)
def test_backends_agree(rule):
    """Rules of trials that no case of `neuro.testing` learns by, and the one that is taught at the largest V_m."""
    check_part(rule)


# inputs that spike again


def sheet(seed: int, spikes: str, backend: str, rule: Synapse, stop: str = "full") -> Any:
    """Random trials of 30 inputs that spike up to four times each, some twice in a step, and what they teach."""
    rng = np.random.default_rng(seed)
    net = neuro.Network("sheet", resolution=1.0)
    net.population("input", (2, 4, 4), neuro.spike_generator())
    shared = seed % 2 == 0 and not rule.delays
    net.population("maps", (4, 2, 2), neuro.iaf_psc_delta(tau_m=20.0, E_L=0.0, V_reset=0.0, V_th=rng.uniform(0.5, 9)))
    how = neuro.grid(kernel=(3, 3)) if shared else neuro.fixed_indegree(n=20)
    weight = neuro.normal(mean=0.5, std=0.2, low=0.0, high=1.0)
    net.connect("input", "maps", how, rule, weight=weight, delay=2.0, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(
        input="input", duration=20.0, stop=stop, spikes=spikes, labels={"of": "maps", "maps_per_label": 2},
        dropout={"of": "maps", "p": 0.3},
    )  # fmt: skip
    sim = neuro.compile(net, backend, seed=seed)
    lengths = rng.integers(0, 60, 8)
    batch = rng.integers(0, 20, lengths.sum()), rng.integers(0, 32, lengths.sum()), np.cumsum([0, *lengths])
    labels = rng.integers(0, 2, 8)
    return sim, (batch[0].astype(float), *batch[1:]), labels


@pytest.mark.parametrize("spikes", ["first", "each"])
@pytest.mark.parametrize(
    "rule",
    [
        neuro.r_stdp(epsilon=0.01, rescue=True), neuro.normalised_stdp(total=8.0),
        neuro.tempotron(lambda_=0.1, Wmin=-2.0, Wmax=2.0), neuro.r_stddp(d_max=5.0),
    ],
    ids=lambda rule: rule.name,
)  # fmt: skip
def test_event_teaches_repeated_spikes_as_the_reference_does(rule, spikes):
    for seed in range(REPEATED):
        made = [sheet(seed, spikes, backend, rule, ("full", "at_decision")[seed // 2 % 2]) for backend in BACKENDS]
        results = [sim.trials(*batch, labels, learn=True) for sim, batch, labels in made]
        event, reference = (sim for sim, *_ in made)
        name = "delay" if rule.delays else "weight"
        assert np.array_equal(results[0].winner, results[1].winner)
        assert results[0].counts.learning_updates == results[1].counts.learning_updates
        assert np.allclose(event.get("w", name), reference.get("w", name), rtol=1e-13, atol=0.0)


def test_the_first_spike_teaches_as_if_it_had_been_the_only_one():
    """Where later spikes cannot change the decision: the neurons are out of reach, and silence rescues."""
    rule = neuro.r_stdp(**RATES, rescue=True)
    taught_by = {}
    for spikes in ("once", "first", "each"):
        sim = pair(rule, SILENT_PAIR, spikes=spikes)
        sim.set("maps", V_th=1e6)
        times, ids = ([0.0, 5.0], [0, 1]) if spikes == "once" else ([0.0, 4.0, 4.0, 5.0], [0, 0, 0, 1])
        sim.trials(times, ids, [0, len(ids)], labels=[0], learn=True)
        taught_by[spikes] = sim.weights("w")[2].reshape(2, 2)[:, 0].tolist()
    assert taught_by["first"] == taught_by["once"] == pytest.approx([bent(0.3, 0.1)] * 2)
    assert taught_by["each"] == pytest.approx([bent(bent(bent(0.3, 0.1), 0.1), 0.1), bent(0.3, 0.1)])


def test_an_input_that_spikes_before_and_after_the_decision_is_taught_by_both():
    """A right decision at 0.5 ms: the first spike of input 0 came before it, the second after it."""
    sim = pair(neuro.r_stdp(**RATES), GOOD, spikes="each", stop="full")
    sim.trials([0.0, 3.0], [0, 0], [0, 2], labels=[0], learn=True)
    expected = [bent(bent(0.9, 0.1), -0.05), 0.2, bent(0.9, -0.05), 0.2]
    assert sim.weights("w")[2].ravel().tolist() == pytest.approx(expected)


# a third-party rule


@dataclass(frozen=True, kw_only=True, eq=False)
class all_that_erred(neuro.r_stdp):
    """Teaches every output neuron: the one that decided by -1, all others by +1, from a moment 2 ticks later."""

    def lessons(self, end: TrialEnd) -> list[Lesson | Growth]:
        others = [k for k in range(len(end.best)) if k != end.winner]
        return [Lesson(end.winner, end.tick + 2, -1.0), *(Lesson(k, end.tick + 2, 1.0) for k in others)]


@FLOATS
def test_a_rule_says_whom_it_teaches_and_when(backend):
    rule = all_that_erred(Ar_plus=0.1, Ar_minus=-0.05, Ap_plus=0.02, Ap_minus=-0.04)
    sim = pair(rule, [[0.9, 0.2], [0.7, 0.2]], backend)
    sim.trials([0.0, 1.0], [0, 1], [0, 2], labels=[0], learn=True)
    # the decision is in tick 1, and ends the trial before input 1 emits
    assert sim.weights("w")[2].ravel() == pytest.approx(
        [bent(0.9, -0.04), bent(0.2, 0.1), bent(0.7, 0.02), bent(0.2, -0.05)]
    )
    sim = pair(rule, [[0.9, 0.2], [0.7, 0.2]], backend, stop="full")
    sim.trials([0.0, 1.0], [0, 1], [0, 2], labels=[0], learn=True)
    assert sim.weights("w")[2].ravel() == pytest.approx(
        [bent(0.9, -0.04), bent(0.2, 0.1), bent(0.7, -0.04), bent(0.2, 0.1)]
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class careless(neuro.r_stdp):
    """Teaches nobody in silence."""

    told: ClassVar[Any] = None

    def lessons(self, end: TrialEnd) -> list[Lesson | Growth]:
        return [self.told if self.told is not None else Lesson(end.winner, end.tick, 1.0)]


def test_lessons_for_nobody_are_refused(monkeypatch, messages):
    told = {}
    for case, wrong in (("a neuron", None), ("growth", Growth(np.array([1, 2])))):
        monkeypatch.setattr(careless, "told", wrong)
        told[case] = refused(taught, pair(careless(), SILENT_PAIR), [0])
    monkeypatch.setattr(neuro.mozafari, "lessons", lambda self, end: [Growth(end.maps)])
    messages(told | {"no encouragement": refused(taught, pair(neuro.mozafari(), SILENT_PAIR), [0])})


@FLOATS
def test_the_first_of_equal_neurons_of_a_map_is_taught(backend):
    net = neuro.Network("equal", resolution=1.0)
    net.population("input", 1, neuro.spike_generator())
    net.population("maps", (2, 3), neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=100.0))
    net.connect("input", "maps", neuro.all_to_all(), neuro.r_stdp(rescue=True), weight=0.5, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="input", duration=10.0, labels={"of": "maps"})
    sim = neuro.compile(net, backend)
    sim.trials([0.0], [0], [0, 1], labels=[1], learn=True)
    assert sim.weights("w")[2].ravel() == pytest.approx([0.5, 0.5, 0.5, bent(0.5, 0.075), 0.5, 0.5])


def test_maps_of_a_depthwise_grid_learn_from_their_channel():
    def taught(backend: str) -> Any:
        net = neuro.Network("sheets", resolution=1.0)
        net.population("input", (2, 4, 5), neuro.spike_generator())
        net.population("maps", (4, "auto", "auto"), neuro.iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=0.8))
        rule = neuro.grid(kernel=(2, 3), padding=1, column_padding=0, depthwise=True)
        net.connect("input", "maps", rule, HITS, weight=np.linspace(0.3, 0.7, 24), name="w")
        net.group("choice", neuro.winner_take_all(of="maps"))
        net.trials(input="input", duration=20.0, labels={"of": "maps"})
        sim = neuro.compile(net, backend, seed=1)
        ids = np.concatenate([np.arange(first, first + 20, 2) for first in (0, 21, 1, 20)])
        told = sim.trials(np.tile(np.arange(10.0), 4), ids, np.arange(0, 50, 10), labels=[0, 1, 2, 3], learn=True)
        return told.winner, sim.weights("w")

    (winner, weights), (expected, expected_weights) = taught("event"), taught("reference")
    assert winner.tolist() == expected.tolist()
    assert (expected // 15 >= 2).any()  # maps 2 and 3 see the second channel
    np.testing.assert_allclose(weights, expected_weights, rtol=0, atol=1e-14)


# labels


def test_neurons_are_assigned_what_they_answer_most():
    decided, labels = [0, 0, 0, 1, 1, 2, -1, 2], [0, 0, 1, 1, 1, 0, 2, 2]
    assigned = neuro.assign_labels(decided, labels, 4)
    assert assigned.tolist() == [0, 1, 2, -1]  # neuron 2: one trial of the three of label 0, one of the two of label 2
    assert neuro.read_labels([2, -1, 3, 0], assigned).tolist() == [2, -1, -1, 0]
    assert neuro.assign_labels([], [], 2).tolist() == [-1, -1]


def test_mistakes(messages):
    messages.calls(globals())


# learning


def latencies(seed: int, n: int, classes: int) -> Any:
    """Trials of 40 inputs whose order of spikes is the label's, jittered by 2 ms, a tenth of them missing."""
    templates = np.random.default_rng(0).integers(0, 30, (classes, 40))
    rng = np.random.default_rng(seed)
    labels = rng.integers(classes, size=n)
    times = np.clip(np.rint(templates[labels] + rng.normal(0.0, 2.0, (n, 40))), 0.0, 39.0)
    kept = rng.random((n, 40)) < 0.9
    ids = np.broadcast_to(np.arange(40), (n, 40))[kept]
    return times[kept], ids, np.concatenate(([0], np.cumsum(kept.sum(axis=1)))), labels


def task(
    rule: Synapse, classes: int, per_label: int, V_th: float, seed: int, backend: str = "event", **words: Any
) -> Any:
    net = neuro.Network("task", resolution=1.0)
    net.population("input", 40, neuro.spike_generator())
    model = neuro.iaf_psc_delta(tau_m=15.0, E_L=0.0, V_reset=0.0, V_th=V_th)
    net.population("maps", (classes * per_label, 1), model)
    weight = neuro.normal(mean=0.5, std=0.1, low=0.0, high=1.0)
    net.connect("input", "maps", neuro.all_to_all(), rule, weight=weight, delay=1.0, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="input", duration=45.0, labels={"of": "maps", "maps_per_label": per_label}, **words)
    return neuro.compile(net, backend, seed=seed)


def right(sim: Any, classes: int) -> float:
    """The share of new trials that are right."""
    times, ids, offsets, labels = latencies(99, 300, classes)
    return float(np.mean(sim.trials(times, ids, offsets).label == labels))


def test_the_tempotron_learns_an_order_of_spikes():
    sim = task(neuro.tempotron(lambda_=0.02, tau_m=15.0, tau_s=0.0), 3, 1, 6.0, seed=0)
    assert right(sim, 3) < 0.5
    for _ in range(8):
        sim.trials(*latencies(5, 200, 3), learn=True)
    assert right(sim, 3) > 0.95


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
def test_the_tempotron_learns_on_chips(backend):
    rule = neuro.tempotron(lambda_=0.02, tau_m=15.0, tau_s=0.0, Wmin=-1.0, Wmax=1.5)
    sim = task(rule, 3, 1, 6.0, 0, backend)
    for _ in range(5):
        sim.trials(*latencies(5, 200, 3), learn=True)
    assert right(sim, 3) > 0.9


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
def test_the_tempotron_is_taught_at_the_first_of_equal_potentials_on_chips(backend):
    """Without a leak the potential stays from the second arrival, at 5 ms, to the end of the trial."""
    rule = neuro.tempotron(lambda_=8.0, tau_m=8.0, tau_s=0.0, Wmin=-31.0, Wmax=31.0)
    net = neuro.Network("pair", resolution=1.0)
    net.population("input", 2, neuro.spike_generator())
    net.population("maps", (2, 1), neuro.iaf_psc_delta(tau_m=INF, E_L=0.0, V_reset=0.0, V_th=100.0, t_ref=0.0))
    net.connect("input", "maps", neuro.all_to_all(), rule, weight=16.0, name="w")
    net.group("choice", neuro.winner_take_all(of="maps"))
    net.trials(input="input", duration=20.0, labels={"of": "maps"})
    sim = neuro.compile(net, backend)
    sim.trials([0.0, 5.0], [0, 1], [0, 2], labels=[1], learn=True)
    expected = [16.0, 16.0 + 8.0 * np.exp(-5.0 / 8.0), 16.0, 24.0]
    assert sim.weights("w")[2].ravel() == pytest.approx(expected, abs=0.25)


def test_first_spikes_learn_patterns_that_are_named_afterwards():
    sim = task(neuro.first_spike_stdp(A_plus=0.1, A_minus=-0.075), 3, 2, 6.0, seed=0)
    times, ids, offsets, labels = latencies(5, 300, 3)
    test_times, test_ids, test_offsets, test_labels = latencies(99, 300, 3)

    def named() -> float:
        assigned = neuro.assign_labels(sim.trials(times, ids, offsets).winner, labels, 6)
        told = neuro.read_labels(sim.trials(test_times, test_ids, test_offsets).winner, assigned)
        return float(np.mean(told == test_labels))

    untaught = named()
    for _ in range(5):
        sim.trials(times, ids, offsets, learn=True)
    assert named() > max(0.9, untaught + 0.2)


def test_rates_that_follow_mistakes_learn():
    rule = neuro.mozafari(Ar_plus=0.04, Ar_minus=-0.03, Ap_plus=0.005, Ap_minus=-0.04)
    sim = task(rule, 2, 2, 4.0, seed=0, dropout={"of": "maps", "p": 0.3})
    assert right(sim, 2) < 0.5
    times, ids, offsets, labels = latencies(5, 300, 2)
    for epoch in range(10):
        told = sim.trials(times, ids, offsets, labels, learn=True, epoch=epoch)
        wrong = (told.label != labels) & (told.winner >= 0)
        sim.set("w", hits=np.mean(told.label == labels), misses=np.mean(wrong))
    assert right(sim, 2) > 0.75


def test_a_reset_keeps_the_numbers_of_rules_that_were_set():
    times, ids, offsets, labels = latencies(5, 60, 3)

    def learnt(backend: str) -> Any:
        sim = task(neuro.tempotron(lambda_=0.02, tau_m=15.0, tau_s=0.0), 3, 1, 6.0, 0, backend)
        sim.set("w", lambda_=0.1)
        sim.reset()
        sim.trials(times, ids, offsets, labels, learn=True)
        return sim.get("w", "weight")

    assert np.allclose(learnt("event"), learnt("reference"), rtol=1e-12)


# the loop of trials


@pytest.mark.parametrize(
    ("words", "batch"),
    [
        ({}, {"times": [0.0, 5.0], "ids": [0, 1], "offsets": [0, 2], "labels": [1]}),
        (
            {"reward": {"correct": 0, "wrong": 0}},
            {"times": [0.0, 0.0], "ids": [0, 0], "offsets": [0, 1, 2], "labels": [0, 1], "learn": True},
        ),
    ],
    ids=["testing", "rewards of 0"],
)
def test_what_teaches_nothing(words, batch):
    sim = pair(neuro.r_stdp(**RATES, epsilon=0.0), [[0.9, 0.2], [0.9, 0.2]], **words)
    before = sim.weights("w")[2].copy()
    sim.trials(**batch)
    assert np.array_equal(sim.weights("w")[2], before)


def test_dropout_is_a_draw_for_each_sample():
    sim = pair(neuro.r_stdp(), [[1.0, 1.0], [1.0, 1.0]], dropout={"of": "maps", "p": 0.5})
    n = 240
    batch = (np.zeros(n), np.zeros(n, dtype=int), np.arange(n + 1), np.zeros(n, dtype=int))
    r = sim.trials(*batch, learn=True, samples=np.arange(n) // 3)
    of_sample = (r.winner < 0).reshape(-1, 3)
    assert (of_sample.all(axis=1) == of_sample.any(axis=1)).all()
    assert 0.1 < of_sample[:, 0].mean() < 0.4
    tested = sim.trials(*batch[:3])
    assert (tested.winner >= 0).all()


def test_dropout_decays():
    sim = pair(neuro.r_stdp(), GOOD, dropout={"of": "maps", "p": 0.9, "decay": 0.1})
    n = 200
    batch = (np.zeros(n), np.zeros(n, dtype=int), np.arange(n + 1), np.zeros(n, dtype=int))
    silent = [(sim.trials(*batch, learn=True, epoch=epoch).winner < 0).mean() for epoch in (0, 3)]
    assert silent[0] > 0.7
    assert silent[1] < 0.05


ONE = ([1.0], [1], [0, 1])


def test_misuse(messages):
    messages.calls(lambda: {"sim": pair(neuro.r_stdp(), GOOD), "ONE": ONE})


def test_an_empty_batch_and_an_unsorted_one():
    r = pair(neuro.r_stdp(), GOOD).trials([], [], [0], labels=np.zeros(0, dtype=int), learn=True)
    assert (len(r), r.potential.shape, r.counts.steps) == (0, (0, 2), 0)
    x = pair(neuro.r_stdp(), GOOD).trials([5.0, 0.0, 1.0], [1, 0, 0], [0, 2, 3])
    y = pair(neuro.r_stdp(), GOOD).trials([0.0, 5.0, 1.0], [0, 1, 0], [0, 2, 3])
    assert np.array_equal(x.winner, y.winner)
    assert np.array_equal(x.step, y.step)
