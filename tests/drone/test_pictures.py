"""Pictures of flights and weights show what they say."""

from dataclasses import replace

import numpy as np
import pytest

from drones import SHORT
from neuro_drone.evaluate import Start, try_out
from neuro_drone.report import density, training, weight_maps, weights
from neuro_drone.scenario import load
from neuro_drone.train import train


@pytest.fixture(scope="module")
def lms():
    return train(SHORT, "lms", steps=2100)


def test_maps(lms):
    maps = weight_maps(train(SHORT, "static"))
    assert list(maps) == ["right", "left", "backwards", "forward"]
    assert maps["right"][:, 4:].min() > maps["right"][:, :4].max()
    assert maps["left"][:, :4].min() > maps["left"][:, 4:].max()
    assert maps["backwards"][4:].min() > maps["backwards"][:4].max()
    assert (maps["forward"] + maps["backwards"] == 3000.0).all()
    maps = weight_maps(train("line", "static"))
    assert list(maps) == ["right", "left", "turn right", "turn left"]
    assert maps["turn right"][:4, 4:].min() > maps["turn right"][:4, :4].max()  # leans to the right: turn right
    maps = weight_maps(lms)
    assert list(maps) == ["right", "backwards"]
    assert maps["right"][:, 4:].mean() > maps["right"][:, :4].mean()
    assert maps["backwards"][4:].mean() > maps["backwards"][:4].mean()
    assert [axes.get_title() for axes in weights(lms).axes[:2]] == ["right", "backwards"]
    assert weight_maps(train(SHORT, "oracle")) == {}


def test_density():
    model = train(SHORT, "oracle")
    tried = try_out(model, starts=[Start((30.0, 0.0)), Start((0.0, -30.0))])
    main, above, right = density(model, tried).axes
    share = main.collections[0].get_array()
    assert share.sum() == pytest.approx(1.0)
    row, column = np.unravel_index(np.ma.filled(share, 0.0).argmax(), share.shape)
    assert (abs(row - 63) <= 1, abs(column - 63) <= 1) == (True, True)
    assert main.get_ylim()[0] > main.get_ylim()[1]  # rows grow downwards
    assert above.patches[0].get_data().values.sum() == right.patches[0].get_data().values.sum() == 1000
    quick = load("line", **{"task": {"line": {"side": 1.5, "speed": 0.3}}})
    model = train(quick, "oracle")
    main = density(model, try_out(model, starts=[Start((5.0, 5.0), 1)])).axes[0]
    assert main.get_ylabel() == "angle, degrees"
    row, _ = np.unravel_index(np.ma.filled(main.collections[0].get_array(), 0.0).argmax(), (120, 128))
    assert abs(1.5 * row - 90) < 15


def test_training_shows_each_episode_and_the_error_of_frozen_weights(lms, tmp_path):
    above, below = training(lms).axes
    assert len(below.lines[0].get_xdata()) + len(below.lines[1].get_xdata()) == len(lms.history["steps"])
    assert (above.get_ylabel(), below.lines[2].get_ydata()[0]) == ("steps", lms.history["error_px"][0])
    [frozen] = [line for line in below.lines if line.get_label() == "weights frozen, short flights"]
    assert frozen.get_ydata() == pytest.approx(lms.curve["error_px"])
    ends = np.cumsum(lms.history["steps"])
    assert [ends[int(k) - 1] for k in frozen.get_xdata()] == lms.curve["steps"].tolist()
    odd = replace(lms, scenario=replace(SHORT, name="$\\x_{^%$"))
    for picture in (density(odd, try_out(odd, starts=[Start((30.0, 0.0))])), training(odd), weights(odd)):
        picture.savefig(tmp_path / "a.png", dpi=20)
