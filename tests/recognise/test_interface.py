"""What holds of every method."""

import contextlib
import itertools
import json
import re
import subprocess
import sys
from functools import cache

import h5py
import numpy as np
import pytest

import neuro as snn
from neuro.events import Events, recordings
from neuro_models import path
from neuro_recognise import Recogniser, fit
from neuro_recognise.energy import price
from neuro_recognise.method import METHODS
from neuro_recognise.methods.gradients import _scores
from neuro_recognise.recogniser import method_of
from refused import refusals_of, refused


def full_ones(data):
    """Which recordings have events; the labels."""
    return np.array([len(item.load()) > 0 for item in data]), np.array([item.label for item in data])


GRADIENTS = ("dense", "conv", "recurrent", "learnt_delays")
FEW = {"masquelier_thorpe": {"A_plus": 0.05, "epochs": 5}, "must": {"neurons": 60, "epochs": 10}}
"""What learns without labels needs thousands of frames, or larger steps; the bars make about a hundred."""
FEW |= {"edhmax_tempotron": {"epochs": 4}}
FEW |= {"layered": {"features.maps": 12, "features.A_plus": 0.05, "layer.theta": 25.0, "per_class": 2, "epochs": 4}}
for _name in GRADIENTS:  # few recordings are few batches, of which these take more
    FEW[_name] = {"scale": 2, "epochs": 12, "batch": 6, **({"maps": 4} if _name == "conv" else {"hidden": 12})}


@pytest.fixture(scope="session")
def trained_by(learning, tmp_path_factory):
    """A method by its name, trained once on the bars, and its file."""

    @cache
    def trained(name):
        if METHODS[name].needs == "torch":
            pytest.importorskip("torch", reason="PyTorch is not installed")
        out = tmp_path_factory.mktemp(name) / "model.h5"
        made = fit(learning, method_of(name, values=FEW.get(name)), seed=3, out=out, cache=out.parent / "cache")
        return made, out

    return trained


@pytest.fixture(params=list(METHODS))
def trained(request, trained_by):
    """Each method, and its file."""
    return trained_by(request.param)


def test_what_holds_of_every_method(trained, unseen, learning, tmp_path, monkeypatch):
    made, _ = trained
    full, labels = full_ones(unseen)
    decided = made.predict(unseen)
    assert np.mean(decided[full] == labels[full]) >= 7 / 8, "of the recordings with events"
    assert decided[~full].tolist() == [-1], "an empty recording is silent"
    assert np.isnan(made.scores(unseen)[~full]).all()
    made, out = trained
    again = Recogniser.load(out)
    assert (again.classes, again.training, again.method) == (made.classes, made.training, made.method)
    np.testing.assert_array_equal(again.scores(unseen), made.scores(unseen))
    assert not list(out.parent.glob("*.training"))
    made, _ = trained
    events = [item.load() for item in unseen]
    np.testing.assert_allclose(made.scores(events), made.scores(unseen), rtol=1e-9)
    np.testing.assert_allclose(made.scores(events[0]), made.scores(unseen)[:1], rtol=1e-9)
    events = unseen[0].load()
    length = (events.t[-1] - events.t[0]) / 1000
    at = made.scores_at(events, [0.0, length / 2, length, 10 * length])
    np.testing.assert_allclose(at[2], made.scores(events)[0], rtol=1e-9)
    np.testing.assert_array_equal(at[2], at[3])
    half = events[events.t <= events.t[0] + round(500 * length)]
    np.testing.assert_allclose(at[1], made.scores_at(half, [length / 2])[0], rtol=1e-9)
    later = Events(events.t + 10**9, events.x, events.y, events.p, events.sensor_size)
    np.testing.assert_allclose(made.scores(later), made.scores(events), rtol=1e-9)
    wide = Events(events.t, events.x, events.y, events.p, (64, 48))
    np.testing.assert_array_equal(made.scores(wide), made.scores(events))
    shifted = Events(events.t, events.x + 30, events.y, events.p, (80, 48))
    assert "events lie outside of the 34x34 field" in refused(made.scores, shifted)
    monkeypatch.setattr("neuro_recognise.observations.AT_ONCE", 5)
    out, cache = tmp_path / "model.h5", tmp_path / "cache"
    for reports in (3, 9, 25):
        with contextlib.suppress(KeyboardInterrupt):
            fit(learning, made.method, seed=3, out=out, cache=cache, report=interrupting(reports))
    again = fit(learning, made.method, seed=3, out=out, cache=cache)
    assert set(again.learnt) == set(made.learnt)
    for name, part in made.learnt.items():
        np.testing.assert_array_equal(again.learnt[name], part)
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == ["model.h5"]


def test_what_cannot_be_learnt_from_or_written_to(learning, unseen, tmp_path, folder):
    two = learning.take([0, len(learning) - 1])
    assert set(fit(two, "hats").predict(unseen).tolist()) <= {*two.labels.tolist(), -1}
    one = recordings(folder / "Train", classes=learning.classes)
    only = one.take(np.flatnonzero(one.labels == 0))
    assert "has only the class 'lying': expected recordings of at least two classes" in refused(fit, only, "hats")
    nothing = one.take(np.array([], int))
    assert "has no recordings with a class: expected recordings of at least two" in refused(fit, nothing, "hats")
    other = tmp_path / "model.h5"
    other.write_text("notes")
    assert "model.h5" in refused(fit, learning, "hats", out=other)
    assert other.read_text() == "notes"
    assert "not a neuro recogniser 1" in refused(Recogniser.load, other)
    made = tmp_path / "made.h5"
    fit(learning, "hats", out=made)
    with h5py.File(made, "r+") as file:
        del file["classes"]
    assert "damaged neuro recogniser 1" in refused(Recogniser.load, made)
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert len(fit(learning, "hats", cache=blocked).classes) == 3


def test_times_run_forwards_from_the_first_event(of_hats, unseen, messages):
    made, events = Recogniser.load(of_hats), unseen[0].load()
    messages(refusals_of(messages.cases, locals()))


def test_what_was_learnt_is_read_without_scikit_learn(learning, unseen, tmp_path, monkeypatch):
    made = {}
    full, labels = full_ones(unseen)
    for readout in ("svm", "rbf", "nearest"):
        made[readout] = tmp_path / f"{readout}.h5"
        fit(learning, method_of("tar_hats", values={"readout": readout}), out=made[readout])
    monkeypatch.setitem(__import__("sys").modules, "sklearn", None)
    for readout, file in made.items():
        assert np.mean(Recogniser.load(file).predict(unseen)[full] == labels[full]) >= 7 / 8, readout
    assert "by scikit-learn, which is not installed\n  hint: pip install" in refused(fit, learning, "boe")


def interrupting(after):
    """A report that interrupts the training when it is called for the nth time."""
    calls = itertools.count(1)

    def report(progress):
        if next(calls) == after:
            raise KeyboardInterrupt

    return report


by_gradients = pytest.mark.parametrize("name", GRADIENTS)
WITHOUT_TORCH = """
import sys
sys.modules["torch"] = None
from pathlib import Path
from neuro.events import recordings
from neuro_recognise import Recogniser
made = Recogniser.load(Path(sys.argv[1]))
print(made.predict(recordings(Path(sys.argv[2]), classes=made.classes)).tolist())
"""


@by_gradients
@pytest.mark.filterwarnings("ignore:backend 'loihi'")  # what rounding loses
def test_what_was_learnt_by_gradients_is_that_of_the_trainer_also_on_loihi(trained_by, name, unseen, learning, folder):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    import neuro_torch

    made, _ = trained_by(name)
    learns = made.method.learns or dict.fromkeys(made.network().projections, ("weight",))
    module = neuro_torch.Module(made.network(), learns, outputs=["out"], dtype=torch.float64).eval()
    with torch.no_grad():
        spikes = module(made.method._batch_data(made.shown(unseen)).events).spikes["out"]
    np.testing.assert_array_equal(neuro_torch.losses.decisions(spikes).numpy(), made.predict(unseen))
    method, net, before = made.method, made.network(), made.method.before(len(made.classes))
    assert net.populations.keys() == snn.load(path(method.file)).populations.keys()
    assert all(part.model == before.populations[word].model for word, part in net.populations.items())
    for word, part in net.projections.items():
        assert np.isfinite(part.weight).all()
        assert type(part.rule) is type(before.projections[word].rule)
    if name == "learnt_delays":
        delays = net.projections["hidden_out"].delay
        assert (delays.shape, set(np.unique(delays) % method.step)) == ((12, 3), {0.0})
        assert len(np.unique(delays)) > 3
        other = fit(learning, method.changed({"rate": 0.5}), seed=3)
        assert not np.array_equal(other.learnt["delay.hidden_out"], made.learnt["delay.hidden_out"]), "delays learn"
    made, file = trained_by(name)
    expected, answer = made.predict(unseen), Recogniser.load(file).answer(unseen)
    spread = price(answer.run(), len(unseen), ["loihi"], 8).bills["loihi"]
    packed = price(answer.run(), len(unseen), ["loihi"]).bills["loihi"]
    assert answer.neurons_per_core == {"conv": 16}.get(name, 8)
    assert spread.dynamic_j > 0
    assert spread.chip_time_s != packed.chip_time_s, "other cores have another time"
    np.testing.assert_array_equal(made.predict(unseen, "loihi"), expected)
    if name == "learnt_delays":  # all are read without torch by the same code
        words = [sys.executable, "-c", WITHOUT_TORCH, file, folder / "Test"]
        told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        assert json.loads(told) == expected.tolist()


def test_gradients_without_torch_or_with_a_duration_that_is_no_whole_step(learning, monkeypatch):
    assert "duration" in refused(fit, learning, method_of("dense", values={"duration": 101.0}))
    monkeypatch.setattr("neuro_recognise.methods.gradients.find_spec", lambda name: None)
    told = r"method 'dense' learns by PyTorch, which is not installed\n  hint: pip install .*torch"
    assert re.match(told, refused(fit, learning, "dense"))


def test_most_spikes_win_and_of_as_many_the_first():
    scores = _scores(np.array([10.0, 5.0, 15.0, 20.0, 25.0]), np.array([0, 1, 1, 0, 2]), 4, 100.0)
    assert (scores.argsort()[::-1].tolist(), scores[3]) == ([1, 0, 2, 3], 0.0)
    late = _scores(np.array([100.0, 5.0]), np.array([0, 1]), 3, 100.0)
    assert late[0] == 1.0
    assert 1.0 < late[1] < 1.5
    assert np.isnan(_scores(np.zeros(0), np.zeros(0, int), 3, 100.0)).all()
