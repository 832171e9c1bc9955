"""ReMuS on emulated chips: the same file, the same weights, nearly the same decisions; and learning with 8 bits."""

import numpy as np
import pytest

import neuro
from neuro_recognise.method import choose

CHIPS = ("loihi", "spinnaker")


def kernels(model):
    return model.learnt["c1_s2"]


approximates = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")


@pytest.fixture(scope="module")
def model(letters, small, train):
    return train(letters, small.changed({"per_class": 3, "rescue": True, "order": "frames", "epochs": 6}), seed=1)


def answer(model, shown, backend):
    return model.method.answer(model.learnt, shown, backend)


def present(model, shown, backend):
    """How the trial of every frame ended."""
    sim = model.method.simulation(model.learnt, backend)
    return model.method.present(sim, model.learnt, shown)[0]


@approximates
@pytest.mark.parametrize("chip", CHIPS)
def test_chips_decide_alike(letters, model, chip):
    one, other = (answer(model, letters, backend) for backend in ("event", chip))
    event, there = (present(model, letters, backend) for backend in ("event", chip))
    assert np.mean(there.label == event.label) >= 0.98
    same = (there.step == event.step) & (there.winner == event.winner)
    assert np.mean(same) >= 0.9
    np.testing.assert_allclose(
        there.potential[same], event.potential[same], rtol=0, atol=0.15
    )  # 34 spikes x half a step
    for vote, scores in one.votes.items():
        assert np.mean(choose(scores) == choose(other.votes[vote])) >= 0.96
    assert np.count_nonzero(event.label >= 0) > 60


@approximates
@pytest.mark.parametrize("chip", CHIPS)
def test_a_chip_learns(letters, small, train, chip):
    learning = small.changed({"rescue": True, "order": "frames", "epochs": 6})
    model = train(letters, learning, seed=1, backend=chip)
    assert model.learnt["history"][-1] > model.learnt["history"][0]
    decided = choose(answer(model, letters, chip).votes["potentials"])
    assert np.mean(decided[:24] == letters.labels[:24]) >= 0.9
    assert not np.array_equal(kernels(model), kernels(train(letters, learning, seed=1)))
    assert np.array_equal(kernels(model), kernels(train(letters, learning, seed=1, backend=chip)))


def test_loihi_learns_with_8_bits(letters, small, train):
    """What is learnt are mantissas, so the network for the same chip has them without any loss."""
    model = train(letters, small, seed=1, backend="loihi")
    values = np.unique(kernels(model))
    step = np.diff(values).min()
    assert 20 < len(values) <= 256
    np.testing.assert_allclose(values / step, np.rint(values / step), atol=1e-9)
    assert values.min() >= 0.0
    assert values.max() <= 1.0
    assert np.array_equal(model.method.simulation(model.learnt, "loihi").weights("c1_s2"), kernels(model))


class Stop(Exception):
    pass


def test_a_training_on_loihi_goes_on(letters, small, train, tmp_path):
    """Rounding draws and mantissas go on where they were, to the same bits."""

    def stop(progress):
        if progress.what == "epoch 2 of 3":
            raise Stop

    with pytest.raises(Stop):
        train(letters, small, seed=2, backend="loihi", out=tmp_path / "model.h5", report=stop)
    epochs = []
    ended = train(
        letters, small, seed=2, backend="loihi", out=tmp_path / "model.h5", report=lambda p: epochs.append(p.what)
    )
    assert set(epochs) == {"epoch 2 of 3", "epoch 3 of 3"}
    assert np.array_equal(kernels(ended), kernels(train(letters, small, seed=2, backend="loihi")))


def test_what_is_approximated_names_no_file(model):
    """A model's network came from a text, so there is no file in which to look."""
    with pytest.warns(neuro.ApproximationWarning) as told:
        model.method.simulation(model.learnt, "spinnaker")
    texts = [str(entry.message) for entry in told]
    assert texts[0] == (
        "backend 'spinnaker': population 's2': iaf_psc_delta: no released SpiNNaker binary has it: "
        "it is emulated in the same arithmetic, slots added to v"
    )
