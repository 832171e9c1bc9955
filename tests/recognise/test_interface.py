"""What holds of every method."""

import contextlib
import itertools

import h5py
import numpy as np
import pytest

from neuro import ModelError
from neuro.events import EventFileError, Events, recordings
from neuro_recognise import Recogniser, fit
from neuro_recognise.method import METHODS
from neuro_recognise.recogniser import method_of


def full_ones(data):
    """Which recordings have events; the labels."""
    return np.array([len(item.load()) > 0 for item in data]), np.array([item.label for item in data])


FEW_FRAMES = {"masquelier_thorpe": {"A_plus": 0.05, "epochs": 5}, "must": {"neurons": 60, "epochs": 10}}
"""What learns without labels needs thousands of frames, or larger steps; the bars make about a hundred."""
GRADIENTS = {name: {"scale": 2, "epochs": 12, "batch": 6} for name in ("dense", "conv", "recurrent", "learnt_delays")}
"""Few recordings are few batches, of which these take more."""


@pytest.fixture(scope="session", params=list(METHODS))
def trained(request, learning, tmp_path_factory):
    """Each method, trained on the bars, and its file."""
    if METHODS[request.param].needs == "torch":
        pytest.importorskip("torch", reason="PyTorch is not installed")
    out = tmp_path_factory.mktemp(request.param) / "model.h5"
    method = method_of(request.param, values=(FEW_FRAMES | GRADIENTS).get(request.param))
    return fit(learning, method, seed=3, out=out, cache=out.parent / "cache"), out


def test_bars_are_told_apart(trained, unseen):
    made, _ = trained
    full, labels = full_ones(unseen)
    decided = made.predict(unseen)
    assert np.mean(decided[full] == labels[full]) >= 7 / 8, "of the recordings with events"
    assert decided[~full].tolist() == [-1], "an empty recording is silent"
    assert np.isnan(made.scores(unseen)[~full]).all()


def test_a_file_recognises_as_what_was_trained(trained, unseen):
    made, out = trained
    again = Recogniser.load(out)
    assert (again.classes, again.training, again.method) == (made.classes, made.training, made.method)
    np.testing.assert_array_equal(again.scores(unseen), made.scores(unseen))
    assert not list(out.parent.glob("*.training"))


def test_training_again_gives_the_same(trained, learning, tmp_path):
    made, _ = trained
    again = fit(learning, made.method, seed=3, out=tmp_path / "again.h5", cache=tmp_path / "cache")
    assert set(again.learnt) == set(made.learnt)
    for name, part in made.learnt.items():
        np.testing.assert_array_equal(again.learnt[name], part)


def test_single_recordings_score_as_a_data_set(trained, unseen):
    made, _ = trained
    events = [item.load() for item in unseen]
    np.testing.assert_allclose(made.scores(events), made.scores(unseen), rtol=1e-9)
    np.testing.assert_allclose(made.scores(events[0]), made.scores(unseen)[:1], rtol=1e-9)


def test_beginnings_know_nothing_of_what_follows(trained, unseen):
    made, _ = trained
    events = unseen[0].load()
    length = (events.t[-1] - events.t[0]) / 1000
    at = made.scores_at(events, [0.0, length / 2, length, 10 * length])
    np.testing.assert_allclose(at[2], made.scores(events)[0], rtol=1e-9)
    np.testing.assert_array_equal(at[2], at[3])
    half = events[events.t <= events.t[0] + round(500 * length)]
    np.testing.assert_allclose(at[1], made.scores_at(half, [length / 2])[0], rtol=1e-9)


def test_shifted_times_change_nothing(trained, unseen):
    made, _ = trained
    events = unseen[0].load()
    later = Events(events.t + 10**9, events.x, events.y, events.p, events.sensor_size)
    np.testing.assert_allclose(made.scores(later), made.scores(events), rtol=1e-9)


def test_a_larger_sensor_is_looked_at_where_it_was_learnt(trained, unseen):
    made, _ = trained
    events = unseen[0].load()
    wide = Events(events.t, events.x, events.y, events.p, (64, 48))
    np.testing.assert_array_equal(made.scores(wide), made.scores(events))
    shifted = Events(events.t, events.x + 30, events.y, events.p, (80, 48))
    with pytest.raises(
        ModelError, match="events lie outside of the 34x34 field that is looked at, expected at most 5%"
    ):
        made.scores(shifted)


def test_two_recordings_suffice(learning, unseen, tmp_path):
    two = learning.take([0, len(learning) - 1])
    made = fit(two, "hats")
    assert set(made.predict(unseen).tolist()) <= {*two.labels.tolist(), -1}


def test_what_cannot_be_learnt_from_is_told(folder, learning, tmp_path):
    one = recordings(folder / "Train", classes=learning.classes)
    only = one.take(np.flatnonzero(one.labels == 0))
    with pytest.raises(EventFileError, match="has only the class 'lying': expected recordings of at least two classes"):
        fit(only, "hats")
    nothing = one.take(np.array([], int))
    with pytest.raises(
        EventFileError, match="has no recordings with a class: expected recordings of at least two classes"
    ):
        fit(nothing, "hats")


def test_a_damaged_recording_is_named(tmp_path, folder):
    for k, name in enumerate(("a", "b")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "0.bin").write_bytes((folder / "Train" / ("upright", "lying")[k] / f"{k}.bin").read_bytes())
    (tmp_path / "b" / "1.npz").write_bytes(b"PK damaged")
    with pytest.raises(EventFileError, match=r"b/1\.npz"):
        fit(recordings(tmp_path), "hats")


def test_times_run_forwards(trained, unseen):
    made, _ = trained
    with pytest.raises(ModelError, match=r"times_ms = \[2.0, 1.0\]: expected times >= 0 in ascending order, ms"):
        made.scores_at(unseen[0].load(), [2.0, 1.0])


def test_other_files_are_refused_and_kept(learning, tmp_path):
    other = tmp_path / "model.h5"
    other.write_text("notes")
    with pytest.raises(ModelError, match=r"model.h5"):
        fit(learning, "hats", out=other)
    assert other.read_text() == "notes"
    with pytest.raises(ModelError, match="not a neuro recogniser 1"):
        Recogniser.load(other)
    made = tmp_path / "made.h5"
    fit(learning, "hats", out=made)
    with h5py.File(made, "r+") as file:
        del file["classes"]
    with pytest.raises(ModelError, match="damaged neuro recogniser 1"):
        Recogniser.load(made)


def test_evidence_is_kept_and_what_is_damaged_made_anew(learning, tmp_path):
    cache = tmp_path / "kept"
    first = fit(learning, "hats", cache=cache)
    (file,) = cache.glob("*/*.h5")
    before = file.stat().st_mtime_ns
    fit(learning, method_of("hats", values={"readout": "nearest"}), cache=cache)
    assert file.stat().st_mtime_ns == before, "another readout looks at the same"
    file.write_bytes(b"damaged")
    again = fit(learning, "hats", cache=cache)
    np.testing.assert_array_equal(again.learnt["weights"], first.learnt["weights"])


def test_a_folder_that_cannot_be_written_is_no_fault(learning, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    made = fit(learning, "hats", cache=blocked)
    assert len(made.classes) == 3


def test_readouts_are_exchanged(learning, unseen):
    full, labels = full_ones(unseen)
    for readout in ("svm", "rbf", "nearest"):
        made = fit(learning, method_of("tar_hats", values={"readout": readout}))
        assert np.mean(made.predict(unseen)[full] == labels[full]) >= 7 / 8, readout


def test_what_was_learnt_is_read_without_scikit_learn(learning, unseen, tmp_path, monkeypatch):
    made = {}
    for readout in ("svm", "rbf"):
        made[readout] = tmp_path / f"{readout}.h5"
        fit(learning, method_of("hats", values={"readout": readout}), out=made[readout])
    monkeypatch.setitem(__import__("sys").modules, "sklearn", None)
    for file in made.values():
        assert (Recogniser.load(file).predict(unseen)[full_ones(unseen)[0]] >= 0).all()
    with pytest.raises(
        ModelError, match="this readout is trained by scikit-learn, which is not installed\n  hint: pip install"
    ):
        fit(learning, "boe")


def interrupting(after):
    """A report that interrupts the training when it is called for the nth time."""
    calls = itertools.count(1)

    def report(progress):
        if next(calls) == after:
            raise KeyboardInterrupt

    return report


def test_a_training_stopped_five_times_ends_the_same(trained, learning, tmp_path, monkeypatch):
    made, _ = trained
    monkeypatch.setattr("neuro_recognise.observations.AT_ONCE", 5)
    out, cache = tmp_path / "model.h5", tmp_path / "cache"
    for reports in (3, 9, 14, 25, 31):
        with contextlib.suppress(KeyboardInterrupt):
            fit(learning, made.method, seed=3, out=out, cache=cache, report=interrupting(reports))
    again = fit(learning, made.method, seed=3, out=out, cache=cache)
    for name, part in made.learnt.items():
        np.testing.assert_array_equal(again.learnt[name], part)
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == ["model.h5"]
