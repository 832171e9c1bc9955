"""The trained network on emulated chips, and training on Loihi."""

import warnings

import numpy as np
import pytest

from neuro_drone.evaluate import grid, try_out
from neuro_drone.scenario import load
from neuro_drone.train import train

SHORT = load("B60", **{"task": {"ball": {"lap": 3.0}}})  # a lap of 800 steps
pytestmark = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")


@pytest.fixture(scope="module")
def model():
    return train(load("B60"), "snn", steps=3000, seed=1)


@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
def test_a_trained_network_flies_on_chips_as_well(model, backend):
    starts = grid(SHORT, 2)
    event, chip = (try_out(model, scenario=SHORT, starts=starts, backend=name) for name in ("event", backend))
    assert event.laps == chip.laps == 4
    assert chip.error_px == pytest.approx(event.error_px, rel=0.15)


@pytest.mark.slow
def test_training_on_loihi_goes_on_after_a_kill_and_learns(tmp_path, monkeypatch):
    monkeypatch.setattr("neuro_drone.train.KEEP", 200)

    class Killed(Exception):
        pass

    def kill(progress):
        if progress.step >= 700:
            raise Killed

    whole = train(SHORT, "snn-loihi", steps=1000, seed=2)
    with pytest.raises(Killed):
        train(SHORT, "snn-loihi", steps=1000, seed=2, out=tmp_path / "model.h5", report=kill)
    again = train(SHORT, "snn-loihi", steps=1000, seed=2, out=tmp_path / "model.h5")
    assert (again.learnt["cells_motors"] == whole.learnt["cells_motors"]).all()
    step = 3000 / 255  # pA of a weight on the chip
    assert np.unique(np.round(whole.learnt["cells_motors"] / step, 6) % 1).tolist() == [0]
    starts = grid(SHORT, 1)
    assert try_out(whole, starts=starts, backend="loihi").laps == 1
    with warnings.catch_warnings(action="error"):
        whole.frozen()  # what the chip approximates in learning is not said again
    assert try_out(train(SHORT, "snn-eta0", steps=1), starts=starts).laps == 0
