from dataclasses import replace

import numpy as np
import pytest

import neuro
from neuro import ModelError
from neuro_recognise.method import Course
from neuro_recognise.methods import method_of
from neuro_recognise.methods.framewise import Inputs, RemusLayer, Shares
from neuro_recognise.observations import observe
from neuro_recognise.relearn import Linear, Relearning, permuted, relearn, rules


def test_no_class_keeps_its_label():
    labels = np.arange(4).repeat(3)
    for seed in range(20):
        other = permuted(labels, 4, seed)
        assert not np.any(other == labels)
        assert sorted(other) == sorted(labels)


@pytest.mark.parametrize("name", ["remus", "linear"])
def test_learns_as_one_training_until_the_labels_change(name, learning, tmp_path):
    (one,) = rules([name], {"epochs": 2, "size": (34, 34)})
    plan = Relearning((one,), 2, 2, 2, (0,), tmp_path, jobs=1)
    (accuracies,) = relearn(learning, plan)[name]
    others, held = learning.folds(2, seed=0)[0]
    shown = observe(one.method, learning)
    learnt = one.method.fit(shown.take(others), Course())
    right = one.method.answer(learnt, shown.take(held)).scores.argmax(axis=1) == learning.labels[held]
    assert accuracies[1] == right.mean() > 0.8
    assert accuracies[2] < accuracies[1]  # labels of the held-out recordings are others, too
    (kept,) = tmp_path.glob("*.json")
    before = kept.stat().st_mtime_ns
    assert np.array_equal(relearn(learning, plan)[name], [accuracies])
    assert kept.stat().st_mtime_ns == before


def test_softmax_regression_goes_down_the_gradient(learning):
    """One step from zero weights: each input moves by rate x (label - 1/3)."""
    method = Linear(size=(34, 34), epochs=1, rate=0.3)
    shown = observe(method, learning)
    one = shown.take([0])
    first = replace(one, evidence=[{**one.evidence[0], "lengths": one.evidence[0]["lengths"][:1]}])
    spikes = int(first.evidence[0]["lengths"][0])
    codes, ids = (one.evidence[0][name][:spikes] for name in ("codes", "ids"))
    first = replace(first, evidence=[{**first.evidence[0], "codes": codes, "ids": ids}])
    weights = method.fit(first, Course())["weights"]
    x = 1.0 - codes / 64.0
    wanted = np.where(np.arange(3) == one.labels[0], 2 / 3, -1 / 3)
    assert np.allclose(weights[ids], 0.3 * np.outer(x, wanted))
    assert np.count_nonzero(weights.any(axis=1)) == np.count_nonzero(x)


def test_prints_and_draws(neuro, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = f"relearn --data {folder} --method linear --before 2 --after 2 --repeats 2 --folds 2 --workers 1".split()
    code, out, _ = neuro(*words)
    assert code == 0
    assert out.splitlines()[-1] == "relearnt/relearn.png"
    assert "linear" in out
    assert (tmp_path / "relearnt/relearn.png").stat().st_size > 10_000


def test_the_linear_machine_needs_frames(learning):
    method = Linear(size=(34, 34))
    with pytest.raises(ModelError, match="no recording is long enough for a frame"):
        method.fit(observe(method, learning).take([]), Course())


def test_methods_without_epochs_cannot_relearn():
    with pytest.raises(ModelError, match="method 'hats' does not learn from labels epoch by epoch"):
        rules(["hats"])
    with pytest.raises(ModelError, match="must"):
        rules(["must"])


def test_a_reward_for_mistakes_makes_labels_irrelevant(learning):
    method = method_of("remus", values={"wrong": 1.0, "rescue": False, "epsilon": 0.0, "epochs": 1, "size": (34, 34)})
    shown = observe(method, learning)
    one, other = (
        method.fit(replace(shown, labels=labels), Course())["c1_s2"]
        for labels in (shown.labels, permuted(shown.labels, 3, 0))
    )
    assert np.array_equal(one, other)


def test_rewards_follow_the_share_of_mistakes():
    class Told:
        def set(self, projection, **rates):
            self.rates = rates

    sim, layer = Told(), RemusLayer(least=0.1)
    layer.begin(sim, 0, None)
    assert (sim.rates["Ar_plus"], sim.rates["Ap_minus"]) == (layer.Ar_plus, layer.Ap_minus)
    layer.begin(sim, 1, Shares(right=0.8, wrong=0.2))
    assert sim.rates["Ar_plus"] == pytest.approx(0.28 * layer.Ar_plus)
    assert sim.rates["Ap_minus"] == layer.Ap_minus


def test_weights_begin_an_epoch_at_the_margin():
    net = RemusLayer(field=2).network(Inputs((1, 3, 3), 64.0, 1.0), 2)
    sim = neuro.compile(net)
    shape = sim.weights("c1_s2").shape
    drawn = np.random.default_rng(0).uniform(size=shape)
    for margin, low, high in ((0.0, 0.0, 1.0), (0.3, 0.3, 0.7)):
        sim.set_weights("c1_s2", drawn)
        RemusLayer(field=2, margin=margin).begin(sim, 1, Shares(right=0.5, wrong=0.5))
        assert np.array_equal(sim.weights("c1_s2"), np.clip(drawn, low, high))
