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
from neuro.core import hdf5
from neuro.core.outputs import _HOST
from neuro_recognise.evaluate import evaluate
from neuro_recognise.method import choose
from neuro_recognise.methods.remus import Remus
from neuro_recognise.recogniser import Recogniser


def beside(model: Path) -> Path:
    """Where the checkpoint of a model lies."""
    return model.with_name(f"{model.name}.training")


def accuracy(model, shown):
    part = shown.take(range(24))
    votes = model.method.answer(model.learnt, part).votes.values()
    return [evaluate(choose(scores), part.labels, part.classes).accuracy for scores in votes]


def same(a, b):
    arrays = all(np.array_equal(a.learnt[name], b.learnt[name]) for name in ("c1_s2", "history", "seed"))
    texts = a.learnt["network"] == b.learnt["network"] and a.learnt.keys() == b.learnt.keys()
    return arrays and texts and (a.method, a.classes, a.training) == (b.method, b.classes, b.training)


@pytest.mark.parametrize("order", ["recordings", "frames"])
@pytest.mark.parametrize("rescue", [False, True])
def test_it_learns(letters, small, train, order, rescue):
    model = train(letters, small.changed({"order": order, "rescue": rescue, "epochs": 6}), seed=1)
    assert model.learnt["c1_s2"].shape == (6, 4, 7, 7)
    assert model.learnt["history"][-1] > model.learnt["history"][0]
    assert min(accuracy(model, letters)) >= 0.9


def test_event_equals_reference(letters, small, train):
    part = letters.take(range(6))
    models = [train(part, replace(small, epochs=2), seed=3, backend=backend) for backend in ("event", "reference")]
    np.testing.assert_allclose(models[0].learnt["c1_s2"], models[1].learnt["c1_s2"], rtol=0, atol=1e-9)
    assert np.array_equal(models[0].learnt["history"], models[1].learnt["history"])
    a, b = (models[0].method.answer(models[0].learnt, part, backend).votes for backend in ("event", "reference"))
    assert np.array_equal(a["majority"], b["majority"])
    np.testing.assert_allclose(a["potentials"], b["potentials"], rtol=0, atol=1e-9)


def test_seeds_and_batches(letters, small, train, monkeypatch):
    model = train(letters, small, seed=5)
    assert not same(train(letters, small, seed=6), model)
    reports = []
    monkeypatch.setattr("neuro_recognise.parts.layers.Layer.batch", 10)
    assert same(train(letters, small, seed=5, report=reports.append), model)
    assert [(r.what, r.done, r.total) for r in reports[:2]] == [("epoch 1 of 3", n, 72) for n in (10, 20)]
    assert reports[-1].done == 72
    assert reports[-1].right == model.learnt["history"][-1]


def test_rates_decay(letters, small, train):
    fixed, decayed = (train(letters, small.changed({"rate_decay": d}), seed=1) for d in (1.0, 0.1))
    assert not np.array_equal(fixed.learnt["c1_s2"], decayed.learnt["c1_s2"])
    assert fixed.learnt["history"][0] == decayed.learnt["history"][0]


class Stop(Exception):
    pass


@pytest.mark.parametrize("settings", [{}, {"order": "frames", "rescue": True, "rate_decay": 0.8}])
def test_a_training_goes_on(letters, small, train, tmp_path, settings):
    small = small.changed(settings)
    whole = train(letters, small, seed=2)
    out = tmp_path / "model.h5"

    def stop(progress):
        if progress.what == "epoch 3 of 3":
            raise Stop

    with pytest.raises(Stop):
        train(letters, small, seed=2, out=out, report=stop)
    assert [file.name for file in tmp_path.iterdir()] == ["model.h5.training"]
    epochs = []
    assert same(train(letters, small, seed=2, out=out, report=lambda p: epochs.append(p.what)), whole)
    assert set(epochs) == {"epoch 3 of 3"}
    assert [file.name for file in tmp_path.iterdir()] == ["model.h5"]
    assert same(Recogniser.load(out), whole)
    assert same(train(letters, small, seed=2, out=out, report=pytest.fail), whole)


def test_a_training_is_not_mixed_with_another(letters, small, train, tmp_path):
    out = tmp_path / "model.h5"

    def stop(progress):
        if progress.what == "epoch 2 of 3":
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
from neuro_recognise.recogniser import learn
shown, method, out = pickle.loads(pathlib.Path(sys.argv[1]).read_bytes())
def slowly(progress):
    print(progress.what, flush=True)
    time.sleep(0.0 if progress.what == "epoch 1 of 3" else 0.3)
learn(method, shown, "letters", seed=4, out=out, report=slowly)
"""


@pytest.mark.slow
def test_killed_at_any_time(letters, small, train, tmp_path):
    import pickle

    out, told = tmp_path / "model.h5", tmp_path / "told"
    told.write_bytes(pickle.dumps((letters, small, out)))
    for epoch in (b"epoch 2 of 3", b"epoch 3 of 3"):
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


def test_model_file(letters, small, train, tmp_path):
    model = train(letters, small, seed=1)
    model.save(tmp_path / "model.h5")
    again = Recogniser.load(tmp_path / "model.h5")
    assert same(model, again)
    assert again.method.inputs.shape == (4, 8, 8)
    assert model.network() == again.network()
    with h5py.File(tmp_path / "model.h5") as file:
        assert file.attrs["neuro"] == neuro.__version__
        assert "winner_take_all" in file["learnt/network"].asstr()[()]
    a, b = (m.method.answer(m.learnt, letters).votes["potentials"] for m in (model, again))
    assert np.array_equal(a, b, equal_nan=True)


def test_files_of_something_else(tmp_path):
    file = tmp_path / "model.h5"
    for content, message in ((None, "no such file: expected a"), (b"text", "not a")):
        if content:
            file.write_bytes(content)
        with pytest.raises(neuro.ModelError) as error:
            Recogniser.load(file)
        assert str(error.value) == f"{file}: {message} neuro recogniser 1"
    with hdf5.writing(file, "neuro recogniser 1", replace=True) as f:
        f.attrs["method"], f.attrs["settings"] = "remus", "{}"
    with pytest.raises(neuro.ModelError) as error:
        Recogniser.load(file)
    assert str(error.value) == f"{file}: damaged neuro recogniser 1: 'size'"


def test_nothing_to_learn(letters, small, train):
    with pytest.raises(neuro.ModelError) as error:
        train(letters.take([24, 25]), small)
    assert str(error.value) == "no recording is long enough for a frame: expected some to learn from"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"order": "days"},
            "method 'remus': order = 'days': expected one of recordings, frames\n  hint: known: frames, recordings",
        ),
        (
            {"vote": "loudest"},
            "method 'remus': vote = 'loudest': expected one of majority, potentials\n"
            "  hint: known: majority, potentials",
        ),
        ({"epochs": 0}, "method 'remus': epochs = 0: expected a whole number >= 1"),
        ({"rate_decay": 2}, "network 'remus': rate_decay = 2: expected a number > 0 and <= 1"),
        ({"maps": 9}, "'maps' cannot be set: it follows from the classes and per_class"),
        ({"tau": "long"}, "segmenter 'msd': tau = 'long': expected a number > 0 s"),
        ({"tau": -1}, "segmenter 'msd': tau = -1: expected a number > 0 s"),
        ({"orientations": ["up"]}, "bank 'gabors': orientations[0] = 'up': expected a number degrees"),
        ({"size": 34}, "method 'remus': size = 34: expected a list, each of it a whole number >= 0"),
        ({"size": [34.5, 34]}, "method 'remus': size[0] = 34.5: expected a whole number >= 0"),
        ({"size": [34]}, "method 'remus': size = [34]: expected width and height"),
        ({"sizes": [3, 5]}, "sizes, sigmas and wavelengths: expected as many of each, one a scale"),
        ({"sizes": [3, 5, 6, 9]}, "sizes: found 6: expected odd numbers, so that a filter has a middle"),
        ({"min_response": 1}, "encoder 'log_latency': min_response = 1: expected a number > 0 and < 1"),
        ({"literal": 1}, "bank 'gabors': literal = 1: expected true or false"),
        ({"thet": 3}, "unknown setting of method 'remus' 'thet'\n  hint: did you mean 'theta'?"),
    ],
)
def test_wrong_settings(values, message):
    with pytest.raises(neuro.ModelError) as error:
        Remus().changed(values)
    assert str(error.value) == message


def test_a_field_that_is_smaller_than_a_cell():
    with pytest.raises(neuro.ModelError) as error:
        Remus().fitting((1, 34))
    assert str(error.value) == "size = [1, 34]: expected at least 2 px each, a cell"


def test_settings_survive_json():
    import json

    for preset in Remus.presets:
        method = Remus().preset(preset)
        assert Remus.from_words(json.loads(json.dumps(method.as_words()))) == method
