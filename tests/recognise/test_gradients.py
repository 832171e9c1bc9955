"""Recognisers that learn by gradients: with torch they learn, without it they recognise, and each has a bill."""

import json
import subprocess
import sys

import numpy as np
import pytest

import neuro as snn
from neuro import ModelError
from neuro_models import path
from neuro_recognise import Recogniser, fit
from neuro_recognise.methods.gradients import _scores
from neuro_recognise.priced import price
from neuro_recognise.recogniser import method_of

WITHOUT_TORCH = """
import sys
sys.modules["torch"] = None
from pathlib import Path
from neuro.events import recordings
from neuro_recognise import Recogniser
made = Recogniser.load(Path(sys.argv[1]))
print(made.predict(recordings(Path(sys.argv[2]), classes=made.classes)).tolist())
"""
NAMES = ("dense", "conv", "recurrent", "learnt_delays")
SMALL = {"scale": 2, "epochs": 12, "batch": 6}
LAYERS = {name: {"maps": 4} if name == "conv" else {"hidden": 12} for name in NAMES}
pytestmark = pytest.mark.filterwarnings("ignore:backend 'loihi'")  # what rounding loses


@pytest.fixture(scope="module", params=NAMES)
def made(request, learning, tmp_path_factory):
    """Each, trained on the bars."""
    pytest.importorskip("torch", reason="PyTorch is not installed")
    folder = tmp_path_factory.mktemp(request.param)
    method = method_of(request.param, values=SMALL | LAYERS[request.param])
    return fit(learning, method, seed=1, out=folder / "m.h5", cache=folder / "cache"), folder / "m.h5"


def test_what_was_learnt_recognises_without_torch_and_has_a_bill(made, unseen, folder):
    trained, file = made
    expected = trained.predict(unseen)
    words = [sys.executable, "-c", WITHOUT_TORCH, file, folder / "Test"]
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert json.loads(told) == expected.tolist()
    again = Recogniser.load(file)
    answer = again.answer(unseen)
    full = np.array([len(item.load()) > 0 for item in unseen])
    assert np.isnan(answer.scores[~full]).all(), "an empty recording is silent"
    spread = price(answer.run(), len(unseen), ["loihi"], 8).bills["loihi"]
    packed = price(answer.run(), len(unseen), ["loihi"]).bills["loihi"]
    assert answer.neurons_per_core == {"conv": 16}.get(trained.method.called(), 8)
    assert spread.dynamic_j > 0
    assert spread.chip_time_s != packed.chip_time_s, "other cores have another time"
    np.testing.assert_array_equal(again.predict(unseen, "loihi"), expected)


def test_the_network_is_the_file_with_what_was_learnt(made):
    trained, _ = made
    method, net = trained.method, trained.network()
    before = method.before(len(trained.classes))
    assert net.populations.keys() == snn.load(path(method.file)).populations.keys()
    models = [{name: part.model for name, part in each.populations.items()} for each in (net, before)]
    assert models[0] == models[1]
    for name, part in net.projections.items():
        assert isinstance(part.weight, np.ndarray), name
        assert np.isfinite(part.weight).all()
        assert type(part.rule) is type(before.projections[name].rule)
    if method.called() == "learnt_delays":
        delays = net.projections["hidden_out"].delay
        assert delays.shape == (12, 3)
        assert set(np.unique(delays) % method.step) == {0.0}
        assert len(np.unique(delays)) > 3


def test_delays_learn(learning):
    pytest.importorskip("torch", reason="PyTorch is not installed")
    found = []
    for epochs in (1, 12):
        words = SMALL | {"hidden": 12, "epochs": epochs, "rate": 0.5}
        learnt = fit(learning, method_of("learnt_delays", values=words), seed=1).learnt
        found.append(learnt["delay.hidden_out"])
    assert not np.array_equal(*found)


def test_without_torch_one_error_tells_how_to_get_it(learning, monkeypatch):
    monkeypatch.setattr("neuro_recognise.methods.gradients.find_spec", lambda name: None)
    told = "method 'dense' learns by PyTorch, which is not installed\n  hint: pip install .*torch"
    with pytest.raises(ModelError, match=told):
        fit(learning, "dense")


def test_most_spikes_win_and_of_as_many_the_first():
    scores = _scores(np.array([10.0, 5.0, 15.0, 20.0, 25.0]), np.array([0, 1, 1, 0, 2]), 4, 100.0)
    assert scores.argsort()[::-1].tolist() == [1, 0, 2, 3]
    assert scores[3] == 0.0
    late = _scores(np.array([100.0, 5.0]), np.array([0, 1]), 3, 100.0)
    assert late[0] == 1.0
    assert 1.0 < late[1] < 1.5
    assert np.isnan(_scores(np.zeros(0), np.zeros(0, int), 3, 100.0)).all()


def test_scores_decide_as_the_trainer_does(made, unseen):
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    import neuro_torch

    trained, _ = made
    method, shown = trained.method, trained.shown(unseen)
    learns = method.learns or dict.fromkeys(trained.network().projections, ("weight",))
    module = neuro_torch.Module(trained.network(), learns, outputs=["out"], dtype=torch.float64).eval()
    with torch.no_grad():
        spikes = module(method._taught(shown).events).spikes["out"]
    np.testing.assert_array_equal(neuro_torch.losses.decisions(spikes).numpy(), trained.predict(unseen))


def test_a_duration_that_is_no_whole_step_is_told(learning):
    with pytest.raises(ModelError, match="duration"):
        fit(learning, method_of("dense", values={"duration": 101.0}))
