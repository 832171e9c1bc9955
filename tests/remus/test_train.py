import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from neuro.core.outputs import _HOST
from neuro_recognise.evaluate import evaluate
from neuro_remus.decide import decide
from neuro_remus.model import Model
from neuro_remus.settings import SETTINGS, Settings
from neuro_remus.train import train


def beside(model: Path) -> Path:
    """Where the checkpoint of a model lies."""
    return model.with_name(f"{model.name}.training")


def accuracy(model, spikes):
    decided = decide(model.simulation(), spikes)
    part = np.unique(spikes.sample)
    return [
        evaluate(by[part], spikes.labels[part], spikes.classes).accuracy
        for by in (decided.majority, decided.potentials)
    ]


def same(a, b):
    kernels = np.array_equal(a.kernels, b.kernels) and np.array_equal(a.history, b.history)
    return kernels and (a.network, a.classes, a.settings, a.training) == (b.network, b.classes, b.settings, b.training)


@pytest.mark.parametrize("order", ["recordings", "frames"])
@pytest.mark.parametrize("rescue", [False, True])
def test_it_learns(letters, small, order, rescue):
    model = train(letters, small.changed({"order": order, "rescue": rescue, "epochs": 6}), seed=1)
    assert model.kernels.shape == (6, 4, 7, 7)
    assert model.history[-1] > model.history[0]
    assert min(accuracy(model, letters)) >= 0.9


def test_event_equals_reference(letters, small):
    part = letters.take(range(6))
    models = [train(part, replace(small, epochs=2), seed=3, backend=backend) for backend in ("event", "reference")]
    np.testing.assert_allclose(models[0].kernels, models[1].kernels, rtol=0, atol=1e-9)
    assert np.array_equal(models[0].history, models[1].history)
    a, b = (decide(models[0].simulation(backend), part) for backend in ("event", "reference"))
    assert np.array_equal(a.counts, b.counts)
    np.testing.assert_allclose(a.sums, b.sums, rtol=0, atol=1e-9)


def test_seeds_and_batches(letters, small, monkeypatch):
    model = train(letters, small, seed=5)
    assert not same(train(letters, small, seed=6), model)
    reports = []
    monkeypatch.setattr("neuro_remus.train.BATCH", 10)
    assert same(train(letters, small, seed=5, report=reports.append), model)
    assert [(r.epoch, r.done, r.total) for r in reports[:2]] == [(0, 10, 72), (0, 20, 72)]
    assert reports[-1].done == 72
    assert reports[-1].correct / 72 == model.history[-1]


def test_rates_decay(letters, small):
    fixed, decayed = (train(letters, small.changed({"rate_decay": d}), seed=1) for d in (1.0, 0.1))
    assert not np.array_equal(fixed.kernels, decayed.kernels)
    assert fixed.history[0] == decayed.history[0]


class Stop(Exception):
    pass


@pytest.mark.parametrize("settings", [{}, {"order": "frames", "rescue": True, "rate_decay": 0.8}])
def test_a_training_goes_on(letters, small, tmp_path, settings):
    small = small.changed(settings)
    whole = train(letters, small, seed=2)
    out = tmp_path / "model.h5"

    def stop(progress):
        if progress.epoch == 2:
            raise Stop

    with pytest.raises(Stop):
        train(letters, small, seed=2, out=out, report=stop)
    assert [file.name for file in tmp_path.iterdir()] == ["model.h5.training"]
    epochs = []
    assert same(train(letters, small, seed=2, out=out, report=lambda p: epochs.append(p.epoch)), whole)
    assert set(epochs) == {2}
    assert [file.name for file in tmp_path.iterdir()] == ["model.h5"]
    assert same(Model.load(out), whole)
    assert same(train(letters, small, seed=2, out=out, report=pytest.fail), whole)


def test_a_training_is_not_mixed_with_another(letters, small, tmp_path):
    out = tmp_path / "model.h5"

    def stop(progress):
        if progress.epoch == 1:
            raise Stop

    with pytest.raises(Stop):
        train(letters, small, seed=2, out=out, report=stop)
    with pytest.raises(neuro.ModelError) as error:
        train(letters, small, seed=3, out=out)
    assert str(error.value) == (
        f"{out}.training: an unfinished training with seed = 2: found 3 now\n"
        "  hint: give the same options to continue it, or delete the file"
    )
    longer = train(letters, replace(small, epochs=4), seed=2, out=out)  # more epochs are the same training
    assert same(longer, train(letters, replace(small, epochs=4), seed=2))


KILLED = """
import sys, time, pickle, pathlib
from neuro_remus.train import train
spikes, settings, out = pickle.loads(pathlib.Path(sys.argv[1]).read_bytes())
def slowly(progress):
    print(progress.epoch, flush=True)
    time.sleep(0.3 if progress.epoch else 0.0)
train(spikes, settings, seed=4, out=out, report=slowly)
"""


def test_killed_at_any_time(letters, small, tmp_path):
    import pickle

    out, told = tmp_path / "model.h5", tmp_path / "told"
    told.write_bytes(pickle.dumps((letters, small, out)))
    for epoch in (b"1", b"2"):
        work = subprocess.Popen([sys.executable, "-c", KILLED, str(told)], stdout=subprocess.PIPE)
        with work:
            assert work.stdout is not None
            for line in work.stdout:
                if line.strip() == epoch:
                    time.sleep(0.1)
                    work.send_signal(signal.SIGKILL)
        assert work.returncode == -signal.SIGKILL
        assert beside(out).is_file()
    (tmp_path / f".model.h5.training.{_HOST}.{work.pid}.0.part").write_bytes(b"half")
    assert same(train(letters, small, seed=4, out=out), train(letters, small, seed=4))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["model.h5", "told"]


def test_model_file(letters, small, tmp_path):
    model = train(letters, small, seed=1)
    model.save(tmp_path / "model.h5")
    again = Model.load(tmp_path / "model.h5")
    assert same(model, again)
    assert again.settings.front.shape == (4, 8, 8)
    assert model.learnt() == again.learnt()
    with h5py.File(tmp_path / "model.h5") as file:
        assert file.attrs["neuro"] == neuro.__version__
        assert "winner_take_all" in file["network"].asstr()[()]
    a, b = (decide(m.simulation(), letters) for m in (model, again))
    assert np.array_equal(a.sums, b.sums)


def test_files_of_something_else(tmp_path):
    file = tmp_path / "model.h5"
    for content, message in ((None, "no such file: expected a"), (b"text", "not a")):
        if content:
            file.write_bytes(content)
        with pytest.raises(neuro.ModelError) as error:
            Model.load(file)
        assert str(error.value) == f"{file}: {message} neuro remus model 1"
    with h5py.File(file, "w") as f:
        f.attrs["format"], f.attrs["settings"] = "neuro remus model 1", "{}"
    with pytest.raises(neuro.ModelError) as error:
        Model.load(file)
    assert str(error.value) == f"{file}: damaged neuro remus model 1: 'front'"


def test_nothing_to_learn(letters, small):
    with pytest.raises(neuro.ModelError) as error:
        train(letters.take([24, 25]), small)
    assert str(error.value) == "no recording is long enough for a frame: expected some to learn from"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"order": "days"}, "order = 'days': expected recordings or frames"),
        ({"vote": "loudest"}, "vote = 'loudest': expected majority or potentials"),
        ({"epochs": 0}, "epochs = 0: expected a whole number >= 1"),
        ({"rate_decay": 2}, "rate_decay = 2: expected a number > 0 and <= 1"),
        ({"maps": 9}, "'maps' cannot be set: it follows from the classes and per_class"),
        ({"tau_msd": "long"}, "tau_msd = 'long': expected a number > 0"),
        ({"tau_msd": -1}, "tau_msd = -1: expected a number > 0"),
        ({"orientations": ["up"]}, "orientations = 'up': expected a number"),
        ({"size": 34}, "size = 34: expected a list of numbers"),
        ({"size": [34.5, 34]}, "size = 34.5: expected a whole number"),
        ({"size": [34]}, "size = [34]: expected width and height, at least 2 px each"),
        ({"sizes": [3, 5]}, "sizes, sigmas and wavelengths: expected as many of each, one a scale"),
        ({"sizes": [3, 5, 6, 9]}, "sizes: found 6: expected odd numbers, so that a filter has a middle"),
        ({"min_response": 1}, "min_response = 1: expected less than 1, a frame's largest response"),
        ({"literal_gabors": 1}, "literal_gabors = 1: expected true or false"),
    ],
)
def test_wrong_settings(values, message):
    with pytest.raises(neuro.ModelError) as error:
        Settings().changed(values)
    assert str(error.value) == message


def test_settings_survive_json():
    import json

    for settings in SETTINGS.values():
        assert Settings.from_words(json.loads(json.dumps(settings.as_words()))) == settings
