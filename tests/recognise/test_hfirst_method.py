"""The method `hfirst`: its scores, what its evidence depends on, its network, and its bill."""

import numpy as np
import pytest

import neuro
from neuro.chips import cells
from neuro.events import Events
from neuro_recognise import Recogniser
from neuro_recognise.compare import MethodComparison, compare, contestants
from neuro_recognise.evaluate import evaluate
from neuro_recognise.hfirst import LayerResponse, LayerSpikes, decisive
from neuro_recognise.method import choose
from neuro_recognise.recogniser import learn, method_of
from neuro_recognise.shown import Features
from neuro_recognise.telling.compare_report import show
from neuro_recognise.telling.energy import bills, counted, show as show_energy
from neuro_recognise.telling.tried import Tried

REFUSED = (
    "population 's1_on': iaf_linear_leak: loihi has no such neuron: it has iaf_psc_exp, iaf_psc_delta and parrot_neuron"
)
SMALL = {"size": [8, 8], "orientations": 2}


@pytest.fixture
def made():
    method = method_of("hfirst", values=SMALL)
    return Recogniser(method, ("a", "b", "c"), {"templates": np.arange(3.0 * 2 * 2 * 2).reshape(3, -1)})


def test_equal_spikes_are_decided_by_potentials_which_weigh_less_than_a_spike():
    heard = LayerResponse(
        LayerSpikes(np.arange(3.0), np.array([1, 2, 2])), np.array([[9.0, 1.0, 0.0], [0.0, 5.0, 2.0]])
    )
    np.testing.assert_allclose(decisive(heard, "hard"), [2 / 3, 1 + 1 / 3, 2.0])
    np.testing.assert_allclose(decisive(heard, "soft"), [2 / 9, 4 / 9, 2 / 3])
    np.testing.assert_array_equal(decisive(heard, "potentials"), [9.0, 6.0, 2.0])
    without = heard._replace(spikes=LayerSpikes(np.zeros(0), np.zeros(0, np.int64)))
    np.testing.assert_allclose(decisive(without, "soft"), [2 / 3, 1 / 3, 0.0])


@pytest.mark.parametrize("reading", ["hard", "soft", "potentials"])
def test_where_nothing_was_heard_all_are_silent(reading):
    heard = LayerResponse(LayerSpikes(np.zeros(0), np.zeros(0, np.int64)), np.zeros((0, 3)))
    assert np.isnan(decisive(heard, reading)).all()


def test_what_is_observed_does_not_depend_on_s2():
    first = method_of("hfirst").observing()
    assert method_of("hfirst", values={"s2_threshold": 90.0, "s2_leak": 2.0, "below": 0.5}).observing() == first
    assert method_of("hfirst", values={"unseen": -2.0, "reading": "soft"}).observing() == first
    assert method_of("hfirst", values={"s1_leak": 50.0}).observing() != first
    assert method_of("hfirst", "poker").observing() != first


def test_the_network_has_what_was_learnt(made):
    net = made.network()
    assert net.populations["s1_on"].shape == (2, "auto", "auto")
    *_, weights = neuro.compile(net).weights("c1_s2")
    np.testing.assert_array_equal(weights.reshape(8, 3), made.learnt["templates"].T)


@pytest.fixture(scope="module")
def bars():
    """What upright and lying bars show."""
    method = method_of("hfirst", values={"size": [12, 12], "orientations": 4})
    events = []
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
    for vote, scores in one.votes.items():
        np.testing.assert_allclose(scores, other.votes[vote], rtol=0, atol=1e-9)
    (_, took), (sim, again) = one.run(), other.run()
    assert sim.backend == "reference"
    heard = sum(np.floor(one.votes["hard"] + 1e-9).sum(axis=1))
    for taken in (took, again):
        assert taken.counts.populations["s2"].spikes == heard > 0
        assert taken.counts.populations["c1"].spikes == sum(len(part["ids"]) for part in shown.evidence)
    assert took.counts == again.counts


def test_its_bill_and_the_chips_that_refuse_it(bars, capsys):
    model, shown = bars
    told = priced(bars)
    assert list(told.bills) == ["spinnaker2", "cpu"]
    assert told.refused == {"loihi": REFUSED, "spinnaker": REFUSED.replace("loihi", "spinnaker")}
    counts = counted(told)
    assert "frames" not in counts
    macs = 2 * 4 * 72 * 72 + 2 * 4 * 9 * 16 + 4 * 9 * 2  # a field of 7 covers 7 * 12 - 12 places along a side of 12
    assert counts["steps"] * 8 == told.run[1].counts.steps
    per_mac = told.bills["cpu"].items[0].joules_each
    assert told.bills["cpu"].total_j == pytest.approx(counts["steps"] * macs * per_mac)
    show_energy(model, Tried(evaluate(shown.labels, shown.labels, shown.classes), {}, None), told)
    text = capsys.readouterr().out
    assert f"- loihi refuses the network: {REFUSED}\n" in text
    (row,) = [line for line in text.splitlines() if line.strip().startswith("loihi ")]
    assert row.split() == ["loihi", "refused", *["-"] * 4]


def priced(bars):
    model, shown = bars
    answer = model.method.answer(model.learnt, shown)
    tried = Tried(evaluate(choose(answer.scores), shown.labels, shown.classes), {}, answer)
    return bills(tried, ["loihi", "spinnaker", "spinnaker2", "cpu"])


def test_a_comparison_tells_who_refuses_it(capsys, learning, tmp_path):
    """Trained on two folds, priced by the whole network."""
    plan = MethodComparison(contestants(["hfirst"]), 2, (0,), ("loihi", "spinnaker2"), tmp_path)
    found = compare(learning.take([0, 1, 2, 8, 9, 10]), plan, lambda progress: None)
    show([*found], plan)
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
