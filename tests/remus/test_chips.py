"""ReMuS on emulated chips: the same file, the same weights, nearly the same decisions; and learning with 8 bits."""

import numpy as np
import pytest

import neuro
from neuro_remus.decide import decide, present
from neuro_remus.train import train

CHIPS = ("loihi", "spinnaker")
approximates = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")


@pytest.fixture(scope="module")
def model(letters, small):
    return train(letters, small.changed({"per_class": 3, "rescue": True, "order": "frames", "epochs": 6}), seed=1)


@approximates
@pytest.mark.parametrize("chip", CHIPS)
def test_chips_decide_alike(letters, model, chip):
    event, there = (present(model.simulation(backend), letters) for backend in ("event", chip))
    assert np.mean(there.label == event.label) >= 0.98
    same = (there.step == event.step) & (there.winner == event.winner)
    assert np.mean(same) >= 0.9
    np.testing.assert_allclose(
        there.potential[same], event.potential[same], rtol=0, atol=0.15
    )  # 34 spikes x half a step
    one, other = (decide(model.simulation(backend), letters) for backend in ("event", chip))
    assert np.mean(one.majority == other.majority) >= 0.96
    assert np.mean(one.potentials == other.potentials) >= 0.96
    assert np.count_nonzero(event.label >= 0) > 60


@approximates
@pytest.mark.parametrize("chip", CHIPS)
def test_a_chip_learns(letters, small, chip):
    learning = small.changed({"rescue": True, "order": "frames", "epochs": 6})
    model = train(letters, learning, seed=1, backend=chip)
    assert model.history[-1] > model.history[0]
    decided = decide(model.simulation(chip), letters)
    assert np.mean(decided.potentials[:24] == letters.labels[:24]) >= 0.9
    assert not np.array_equal(model.kernels, train(letters, learning, seed=1).kernels)
    assert np.array_equal(model.kernels, train(letters, learning, seed=1, backend=chip).kernels)


def test_loihi_learns_with_8_bits(letters, small):
    """What is learnt are mantissas, so the network for the same chip has them without any loss."""
    model = train(letters, small, seed=1, backend="loihi")
    values = np.unique(model.kernels)
    step = np.diff(values).min()
    assert 20 < len(values) <= 256
    np.testing.assert_allclose(values / step, np.rint(values / step), atol=1e-9)
    assert values.min() >= 0.0
    assert values.max() <= 1.0
    assert np.array_equal(model.simulation("loihi").weights("c1_s2"), model.kernels)


class Stop(Exception):
    pass


def test_a_training_on_loihi_goes_on(letters, small, tmp_path):
    """Rounding draws and mantissas go on where they were, to the same bits."""

    def stop(progress):
        if progress.epoch == 1:
            raise Stop

    with pytest.raises(Stop):
        train(letters, small, seed=2, backend="loihi", out=tmp_path / "model.h5", report=stop)
    epochs = []
    ended = train(
        letters, small, seed=2, backend="loihi", out=tmp_path / "model.h5", report=lambda p: epochs.append(p.epoch)
    )
    assert set(epochs) == {1, 2}
    assert np.array_equal(ended.kernels, train(letters, small, seed=2, backend="loihi").kernels)


def test_what_is_approximated_names_no_file(model):
    """A model's network came from a text, so there is no file in which to look."""
    with pytest.warns(neuro.ApproximationWarning) as told:
        model.simulation("spinnaker")
    texts = [str(entry.message) for entry in told]
    assert texts[0] == (
        "backend 'spinnaker': population 's2': iaf_psc_delta: no released SpiNNaker binary has it: "
        "it is emulated in the same arithmetic, slots added to v"
    )
