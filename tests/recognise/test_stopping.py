"""When to stop: bounds from held-out decisions, rules for an allowed error, learning them, and their place in files."""

import html
from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
import scipy.stats as stats
from hypothesis import given, settings
from typer.testing import CliRunner

import neuro
from neuro.events import Events, recordings, save
from neuro_recognise.cli import app
from neuro_recognise.deciding import Held, least_allowed, margins, outcome, stopped, stopping_rule, upper_bound
from neuro_recognise.early import Beginnings, learn_early, moments
from neuro_recognise.method import Course
from neuro_recognise.methods.descriptor import Boe
from neuro_recognise.observations import observed
from neuro_recognise.recogniser import Recogniser, fit, method_of
from neuro_recognise.telling.report import predict_files
from refused import refusals_of, refused

N, K = 30, 4
SAME = "an allowed error holds for recordings drawn like those that 'early' learnt from, with the same mix of classes"
DECIDING = "deciding on held-out recordings"
NAN = float("nan")


def held_of(rows):
    """Held-out decisions of rows of (margin, right) for each moment."""
    table = np.array(rows, float)
    return Held(1000 * np.arange(1, table.shape[1] + 1), table[..., 0], table[..., 1] > 0)


HELD = st.lists(
    st.lists(st.tuples(st.integers(0, 9) | st.just(NAN), st.integers(0, 1)), min_size=K, max_size=K),
    min_size=1,
    max_size=N,
).map(held_of)


def test_margins_and_their_errors():
    scores = np.array([[1.0, 4.0, 2.5], [NAN, NAN, NAN], [NAN, 2.0, 1.0], [-1.0, -1.0, -3.0]])
    assert np.array_equal(margins(scores), [1.5, NAN, 1.0, 0.0], equal_nan=True)
    assert np.array_equal(margins(scores[:2, :1] + 2), [0.0, NAN], equal_nan=True)
    held = held_of([[(m, right)] for m, right in [(1, 0), (2, 1), (3, 0), (4, 1), (4, 1), (5, 1), (NAN, 0)]])
    assert [held.error(1000, m) for m in (1, 2, 3, 4, 5, 9)] == [3 / 8, 2 / 7, 2 / 7, 1 / 5, 1 / 5, 1 / 5]
    assert [held.error(1500, m) for m in (0.5, 1.5)] == [3 / 8, 3 / 8]
    assert np.isnan([held.error(999, 5), held.error(1000, NAN)]).all()
    rng = np.random.default_rng(3)
    held = Held(np.array([1000, 2000]), rng.random((37, 2)), rng.random((37, 2)) < 0.7)
    for k in range(37):
        assert np.array_equal(held.crossed[k], held.take(np.arange(37) % 10 != k % 10).errors(held.margins[[k]])[0])
    assert sorted(np.concatenate([own for own, _ in held.parts])) == list(range(37))


def test_the_worst_class_is_the_most_that_another_mix_can_make_of_the_error():
    rng = np.random.default_rng(3)
    labels = rng.choice(3, 300, p=[0.6, 0.3, 0.1])
    right = rng.random((300, 1)) > np.array([0.02, 0.1, 0.4])[labels][:, None]
    found = outcome(Held(np.array([1000]), rng.random((300, 1)), right, labels), 0.15, 0.5)
    each = [float((~right[labels == label]).mean()) for label in range(3)]
    assert (found.worst, found.worst_error) == (2, max(each))
    assert found.worst_interval[0] < found.worst_error < found.worst_interval[1]
    assert found.error == pytest.approx(np.bincount(labels) @ each / 300)
    assert outcome(held_of([[(1, 1)]] * 9), 0.3, 0.5).worst is None  # older files have no classes


@given(HELD)
@settings(max_examples=50, deadline=None)
def test_errors_fall_with_the_margin_and_are_those_of_each_decision(held):
    errors = held.errors(held.margins)
    for k, time in enumerate(held.times_us):
        order = np.argsort(held.margins[:, k])
        assert np.array_equal([held.error(time, m) for m in held.margins[:, k]], errors[:, k], equal_nan=True)
        assert (np.diff(errors[order, k][~np.isnan(held.margins[order, k])]) <= 0).all()


@given(st.integers(0, 40), st.integers(1, 40), st.sampled_from([0.5, 0.8, 0.9, 0.975]))
def test_the_bound_is_that_of_clopper_and_pearson(wrong, n, assurance):
    wrong = min(wrong, n)
    exact = stats.binomtest(wrong, n, alternative="less").proportion_ci(assurance, method="exact")
    assert upper_bound(wrong, n, assurance) == pytest.approx(exact.high, abs=1e-12)


@given(HELD, st.sampled_from([0.05, 0.2, 0.5, 0.9]), st.sampled_from([0.5, 0.9]))
@settings(max_examples=20, deadline=None)
def test_a_rule_has_the_last_level_before_the_first_that_is_not_assured(held, allowed, assurance):
    def assured(level):
        at = stopped(held.crossed, level)
        return upper_bound(int((~held.right[np.arange(len(at)), at]).sum()), len(at), assurance) <= allowed

    if not assured(-1.0):
        assert "even at their end" in refused(stopping_rule, held, allowed, assurance)
        assert least_allowed(held, assurance) > allowed
        return
    rule, levels = stopping_rule(held, allowed, assurance), [-1.0, *np.linspace(0, 3 * allowed, 61)]
    place = levels.index(rule.level)
    assert all(assured(level) for level in levels[: place + 1])
    assert place + 1 == len(levels) or not assured(levels[place + 1])


@given(HELD, st.sampled_from([0.2, 0.5]))
@settings(max_examples=8, deadline=None)
def test_an_outcome_is_of_recordings_that_had_no_say(held, allowed):
    found, wrong, ms = outcome(held, allowed, 0.5), 0, []
    for own, others in held.parts:
        try:
            level = stopping_rule(others, allowed, 0.5).level
        except neuro.ModelError:
            level = -1.0
        at = stopped(others.errors(held.margins[own]), level)
        wrong += int((~held.right[own, at]).sum())
        ms += (held.times_us[at] / 1000).tolist()
    assert (found.error, found.mean_ms) == (wrong / len(held), pytest.approx(np.mean(ms)))
    exact = stats.binomtest(wrong, len(held)).proportion_ci(0.95, method="exact")
    assert found.interval == pytest.approx((exact.low, exact.high), abs=1e-12)


def weak(seed, n):
    """Decisions whose margins tell little of whether they are right; 5 % are wrong at the end."""
    rng, moments = np.random.default_rng(seed), np.arange(8)
    hard = np.sqrt(0.6) * rng.normal(size=(n, 1)) + np.sqrt(0.4) * rng.normal(size=(n, 8))
    wrong = hard > stats.norm.ppf(0.95 - 0.7 * np.exp(-moments / 2))
    return Held(1000 * (moments + 1), np.exp(0.5 * (rng.normal(size=(n, 8)) - hard)), ~wrong)


@pytest.mark.parametrize(("assurance", "least"), [(0.9, 0.0), (0.5, 0.2)])
def test_rules_of_few_recordings_are_wrong_no_more_often_than_is_assured(assurance, least):
    fresh, draws, more = weak(0, 2000), 40, 0
    for seed in range(draws):
        held = weak(1 + seed, 100)
        try:
            rule = stopping_rule(held, 0.15, assurance)
        except neuro.ModelError:
            continue
        at = stopped(held.errors(fresh.margins), rule.level)
        more += 1 - fresh.right[np.arange(len(at)), at].mean() > 0.15
    assert least <= more / draws <= 1 - assurance


def test_what_a_rule_refuses(messages):
    held = held_of([[(1, k > 2)] for k in range(30)])
    assert stopping_rule(held, 0.21).level >= -1
    messages(refusals_of(messages.cases, globals() | locals()))


def bar(label, seed):
    """A bar that stands or lies, with more noise at the beginning."""
    rng = np.random.default_rng([seed, label])
    t = np.sort(rng.integers(0, 20_000 + 200 * seed, 300))
    along, across = rng.integers(0, 34, 300), 15 + rng.integers(0, 3, 300)
    x, y = (across, along) if label else (along, across)
    noise = rng.random(300) < 0.9 - t / 25_000
    return Events(t, np.where(noise, along, x), np.where(noise, rng.integers(0, 34, 300), y), t % 2, (34, 34))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("bars")
    for label, name in enumerate(("lying", "standing")):
        (made / name).mkdir()
        for seed in range(12):
            save(bar(label, seed), made / name / f"{seed:02d}.bin")
    return made


@pytest.fixture(scope="module")
def data(folder):
    return recordings(folder)


METHODS = {"hats": {"readout": "ridge", "radius": 1}, "boe": {"threshold": 40.0}}


@pytest.fixture(scope="module", params=METHODS)
def early(request, data, tmp_path_factory):
    cache, method = tmp_path_factory.mktemp("cache"), method_of(request.param, values=METHODS[request.param])
    return learn_early(fit(data, method, cache=cache), data, every_ms=2.0, folds=3, cache=cache)


def test_what_learning_holds_out_keeps_and_refuses(early, data, tmp_path, folder, messages):
    held = early.early.held
    assert held.times_us.tolist() == list(range(2000, 26_000, 2000))
    assert held.margins.shape == held.right.shape == (24, 12)
    assert held.right[:, -1].mean() > 0.85 > held.right[:, 0].mean()
    assert len(early.early.learnt) == (12 if early.method.by_moment else 0)
    method, held, chosen = early.method, early.early.held, 5
    others = next(train for train, test in data.folds(3, seed=0) if chosen in test)
    moment, until = 4 if method.by_moment else 10, [item.load() for item in data]
    if method.by_moment:
        until = [one[: np.searchsorted(one.t, one.t[0] + held.times_us[moment], "right")] for one in until]
    shown = replace(observed(method, until, data.classes), labels=data.labels)
    scores = method.answer(method.fit(shown.take(others), Course(0)), shown.take([chosen])).scores
    assert margins(scores)[0] == pytest.approx(held.margins[chosen, moment], rel=1e-9)
    early.save(tmp_path / "m.h5")
    there = Recogniser.load(tmp_path / "m.h5")
    for name in ("times_us", "margins", "right"):
        assert np.array_equal(getattr(there.early.held, name), getattr(early.early.held, name), equal_nan=True)
    times = [1.0, 5.0, 12.0, 30.0]
    assert np.array_equal(there.scores_at(bar(0, 3), times), early.scores_at(bar(0, 3), times), equal_nan=True)
    assert len(there.early.learnt) == len(early.early.learnt)
    rule, said = stopping_rule(early.early.held, 0.2), early.session(every_ms=2.0, allow=0.2).feed(data[3].load())
    wrong = [early.early.held.error(one.at_us - said[0].at_us + 2000, one.margin) for one in said]
    met = np.cumsum([rule.met(one) for one in wrong]) > 0
    assert met.any()
    assert [one.settled for one in said] == met.tolist()
    assert [one.confidence for one in said] == pytest.approx([1 - one for one in wrong], nan_ok=True)
    messages(refusals_of(messages.cases, globals() | locals(), method=early.method.called()))
    assert len(moments(data, 0.2)) <= 200
    files = sorted(folder.glob("*/*.bin"))
    (wholes, wrong), (soon, _) = predict_files(early, files), predict_files(early, files, allow=0.2)
    assert not wrong
    assert not any(one.settled for one in wholes)
    for file, whole in zip(files, wholes, strict=True):
        events = neuro.events.load(file)
        assert whole.label == early.predict(events)[0]
        learnt = early.early.held.times_us / 1000
        after = learnt[(learnt >= whole.decided_ms) & (learnt < whole.length_ms)].tolist()
        assert (early.scores_at(events, after).argmax(1) == whole.label).all()
    assert sum(one.settled for one in soon) > 12
    assert np.mean([one.decided_ms for one in soon]) < np.mean([one.length_ms for one in soon])
    assert all(one.decided_ms in early.early.held.times_us / 1000 for one in soon if one.settled)
    right = [(one.label == 1) == ("standing" in one.path) for one in soon]
    assert np.mean(right) >= 0.8


def test_after_a_kill_it_goes_on_to_the_same_bits(early, data, tmp_path):
    def kill(progress):
        if progress.what == DECIDING and progress.done == 2:
            raise KeyboardInterrupt

    asked = {"every_ms": 2.0, "folds": 3, "out": tmp_path / "m.h5", "cache": tmp_path / "cache"}
    with pytest.raises(KeyboardInterrupt):
        learn_early(early, data, **asked, report=kill)
    done = []
    again = learn_early(early, data, **asked, report=lambda progress: done.append((progress.what, progress.done)))
    assert next(k for what, k in done if what == DECIDING) == 2
    assert [one.name for one in tmp_path.iterdir() if one.name != "cache"] == ["m.h5"]
    again = Recogniser.load(tmp_path / "m.h5")
    assert np.array_equal(again.early.held.margins, early.early.held.margins, equal_nan=True)
    assert np.array_equal(again.early.held.right, early.early.held.right)
    for one, other in zip(again.early.learnt, early.early.learnt, strict=True):
        assert one.keys() == other.keys()
        assert all(np.array_equal(one[name], other[name]) for name in one)


def test_a_fold_is_not_learnt_again_after_a_kill(data, tmp_path, monkeypatch):
    method, cache = method_of("boe", values=METHODS["boe"]), tmp_path / "cache"
    made, fitted = fit(data, method, cache=cache), []
    monkeypatch.setattr("neuro_recognise.early.AT_ONCE", 3)
    monkeypatch.setattr(Boe, "fit", lambda self, *args, fit=Boe.fit: fitted.append(0) or fit(self, *args))

    def kill(progress):
        if progress.what == DECIDING and progress.done == 4:
            raise KeyboardInterrupt

    asked = {"every_ms": 2.0, "folds": 3, "out": tmp_path / "m.h5", "cache": cache}
    with pytest.raises(KeyboardInterrupt):
        learn_early(made, data, **asked, report=kill)
    assert len(fitted) == 2
    learn_early(made, data, **asked)
    assert len(fitted) == 3


def test_beginnings_are_looked_at_once(data, tmp_path, monkeypatch):
    method = method_of("hats", values=METHODS["hats"]).fitting((34, 34))
    times, folder = np.array([3000, 9000, 40_000]), tmp_path / "seen"
    seen = Beginnings(method, data, times, folder)
    assert list(seen.look()) == [24]
    monkeypatch.setattr(type(method), "observer", None)
    assert list(Beginnings(method, data, times, folder).look()) == [24]
    monkeypatch.undo()
    for k, time in enumerate(times):
        shown = seen.at(k)
        assert np.array_equal(shown.labels, data.labels)
        for item, one in zip(data, shown.evidence, strict=True):
            events = item.load()
            expected = method.observe(events[: np.searchsorted(events.t, events.t[0] + time, "right")])
            assert one["vector"].dtype == expected["vector"].dtype
            assert np.array_equal(one["vector"], expected["vector"])
    seen.remove()
    assert not folder.exists()


def test_commands(data, folder, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    model = tmp_path / "m.h5"
    fit(data, method_of("hats", values=METHODS["hats"]), out=model, cache=tmp_path / "c")
    run, file = CliRunner(), str(folder / "lying" / "03.bin")
    refused = run.invoke(app, ["predict", str(model), file, "--allow", "0.2"])
    assert str(refused.exception).startswith("the recogniser has not learnt when it may stop")
    learnt = run.invoke(app, ["early", str(model), "--data", str(folder), "--every", "4", "--folds", "3"])
    assert learnt.exit_code == 0, learnt.output
    assert "24 recordings, each held out once" in learnt.output
    assert "with an assurance of 0.9 they support an allowed error of 9.2% or more" in learnt.output
    assert f"{SAME}; with another mix the error may rise to that of the worst class" in " ".join(learnt.output.split())
    assert "with an assurance of 0.9 they support" in run.invoke(app, ["show", str(model)]).output
    assert sorted(one.name for one in tmp_path.iterdir() if one.is_file()) == ["m.h5"]
    told = run.invoke(app, ["predict", str(model), file, "--allow", "0.2", "--json"])
    assert all(word in told.output for word in ('"class": "lying"', '"settled": true'))
    assert SAME not in told.output
    told = run.invoke(app, ["predict", str(model), file, "--allow", "0.2"])
    assert SAME in " ".join(told.output.split())
    page = tmp_path / "page.html"
    assert run.invoke(app, ["watch", str(model), file, "--allow", "0.2", "--out", str(page)]).exit_code == 0
    assert SAME in html.unescape(page.read_text())
