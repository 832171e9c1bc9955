"""Asking often: a network is compiled once, recordings are shown in batches, and neither changes a bit."""

import pickle

import numpy as np
import pytest

import neuro
from neuro_recognise.evaluate import evaluate
from neuro_recognise.method import choose
from neuro_recognise.recogniser import AT_MOST, Ready, Recogniser, learn, method_of
from neuro_recognise.telling.energy import bills
from neuro_recognise.telling.tried import Tried


@pytest.fixture(scope="module")
def model(letters, small, train):
    return train(letters, small, seed=1)


def same(one, other):
    assert one.votes.keys() == other.votes.keys()
    return all(np.array_equal(one.votes[name], other.votes[name], equal_nan=True) for name in one.votes)


@pytest.mark.parametrize("backend", ["event", "loihi", "spinnaker"])
@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")
def test_what_was_asked_before_changes_nothing(letters, model, backend):
    ask = model.method.asker(model.learnt, backend)
    for part in (letters, letters.take([3]), letters.take([24, 7]), letters, letters.take([])):
        told, alone = ask(part), model.method.answer(model.learnt, part, backend)
        assert same(told, alone)
        assert told.scores.shape == (len(part), 3)
        (sim, taken), (_, once) = told.run(), alone.run()
        assert taken.counts == once.counts
        assert sim.energy("loihi", of=taken) == sim.energy("loihi", of=once)


@pytest.mark.parametrize("name", ["remus", "must"])
def test_batches_change_nothing(letters, name, monkeypatch):
    size = {"remus": {"field": 7, "theta": 16.0, "per_class": 2}, "must": {"neurons": 30, "theta": 8.0, "total": 100.0}}
    method = method_of(name, values={"size": [16, 16], "window": 10.0, "epochs": 1, **size[name]})
    whole = learn(method, letters, "letters")
    answer = method.answer(whole.learnt, letters)
    monkeypatch.setattr("neuro_recognise.methods.framewise.AT_ONCE", 5)
    parts = learn(method, letters, "letters")
    for word in whole.learnt:
        np.testing.assert_array_equal(parts.learnt[word], whole.learnt[word])
    in_batches = method.answer(whole.learnt, letters)
    assert same(in_batches, answer)
    assert len(in_batches.run()[1]) == len(answer.run()[1]) == 72
    told = [Tried(evaluate(choose(a.scores), letters.labels, letters.classes), {}, a) for a in (answer, in_batches)]
    assert bills(told[0], ["loihi", "gpu"]).bills == bills(told[1], ["loihi", "gpu"]).bills


def test_a_network_is_compiled_once(letters, model, monkeypatch):
    compiled = []
    compile_ = neuro.compile
    monkeypatch.setattr(neuro, "compile", lambda *args, **words: compiled.append(1) or compile_(*args, **words))
    again = Recogniser(model.method, model.classes, model.learnt)
    ask = [
        again._ready.asker(again.method, again.learnt, backend) for backend in ("event", "event", "reference", "event")
    ]
    assert ask[0] is ask[1] is ask[3]
    assert len(compiled) == 2
    assert same(ask[0](letters), model.method.answer(model.learnt, letters))


def test_few_are_kept_and_copies_begin_anew(model):
    ready = Ready()
    learnt = [dict(model.learnt) for _ in range(AT_MOST + 1)]
    made = [ready.asker(model.method, one, "event") for one in learnt]
    assert all(ready.asker(model.method, one, "event") is ask for one, ask in zip(learnt[1:], made[1:], strict=True))
    assert ready.asker(model.method, learnt[0], "event") is not made[0]
    model._ready.asker(model.method, model.learnt, "event")
    assert pickle.loads(pickle.dumps(model)).classes == model.classes
