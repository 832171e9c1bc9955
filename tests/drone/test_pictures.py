"""Pictures of flights and weights show what they say."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from drones import SHORT
from neuro_drone.evaluate import Start, try_out
from neuro_drone.paths import FlightCourse
from neuro_drone.report import density, training, weight_maps, weights
from neuro_drone.scenario import load
from neuro_drone.train import train
from neuro_drone.watch import fly, page, watch
from players import tracks_of
from refused import refused


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
    lengths, rewards, below = training(lms).axes
    for axes, values in ((lengths, lms.history["lengths"]), (rewards, lms.history["returns"] / lms.history["lengths"])):
        dots, crosses, medians = axes.lines[-3:]
        assert len(dots.get_xdata()) + len(crosses.get_xdata()) == len(lms.history["steps"])
        assert medians.get_xdata().tolist() == lms.history["steps"].tolist()
        assert medians.get_ydata()[0] == values[0]
    assert (below.lines[0].get_xdata().tolist(), below.get_ylabel()) == (lms.curve["steps"].tolist(), "error, px")
    assert below.lines[0].get_ydata() == pytest.approx(lms.curve["error_px"])
    odd = replace(lms, scenario=replace(SHORT, name="$\\x_{^%$"))
    for picture in (density(odd, try_out(odd, starts=[Start((30.0, 0.0))])), training(odd), weights(odd)):
        picture.savefig(tmp_path / "a.png", dpi=20)


START = (20.0, -15.0)


@pytest.fixture(scope="module")
def model():
    return train(SHORT, "static")


@pytest.fixture(scope="module")
def flight(model):
    return fly(model, Start(START))


def test_all_is_in_step(model, flight):
    tried = try_out(model, starts=[Start(START)])
    assert (flight.errors[1:].mean(), flight.lap) == (pytest.approx(tried.error_px), bool(tried.laps))
    n = len(flight.errors)
    assert n == 501
    assert {
        len(getattr(flight, name)) for name in ("poses", "footprints", "balls", "targets", "actions", "counts")
    } == {n}
    assert flight.events.sum() == len(flight.x) == flight.counts.sum()
    cells, motors = flight.spikes
    assert (cells.name, cells.size, motors.name, motors.size) == ("cells", 64, "motors", 4)
    assert 0 < cells.times[0] < cells.times[-1] <= 500 * 20
    first = motors.ids[motors.times <= 3 * 20]
    fired = np.bincount(first[motors.times[: len(first)] > 2 * 20], minlength=4)
    assert np.array_equal(np.sign(fired[0::2] - fired[1::2]), np.sign(flight.actions[3]))
    low = fly(train(load(SHORT, **{"camera.tilt": 20, "task.ball.radius": 0.3}), "nothing"), Start((0.0, 0.0)))
    corners = low.footprints[0] - low.poses[0, :2]
    assert 5.0 < np.hypot(*corners[:2].mean(0)) <= 6.0
    assert corners[0, 1] > 0 > corners[1, 1]  # far left, far right


def test_a_flight_in_the_wind_that_climbs():
    changes = {"task.ball.lap": 0.6, "task.ball.speed": 0.06, "load.mass": 0.05, "load.since": 5.0}
    flight = fly(
        train(load("B60-height", wind={"speed": 3, "since": 2.5}, **changes), "static"), Start((0.0, 0.0, 8.0))
    )
    data = tracks_of(page(flight))
    world, talls = data["world"], data["camera"]["talls"]
    winds, loads = world["winds"], world["loads"]
    assert (winds[: 2 * 51] == 0.0).all()
    assert winds[2 * 51 + 1 :: 2] == pytest.approx(3.0)
    assert (loads[:101] == 0.0).all()
    assert (loads[101:], talls[0]) == (pytest.approx(0.05), pytest.approx(48.0))
    assert world["heights"] == pytest.approx(flight.heights, abs=1e-5)
    assert np.ptp(flight.heights) > 0.1
    assert flight.actions.shape == (201, 3)
    assert data["stick"]["motors"] == ["right", "left", "backwards", "forward", "up", "down"]
    assert [s["size"] for s in data["raster"]["strips"]] == [64, 6]


def test_the_page_holds_it(flight, monkeypatch, model, tmp_path):
    text = page(flight)
    data = tracks_of(text)
    events, first = data["camera"]["place"], data["camera"]["first"]
    assert np.array_equal(events >> 1 & 127, flight.x)
    assert np.array_equal(events >> 8, flight.y)
    assert np.array_equal(events & 1, flight.p)
    assert np.array_equal(np.diff(first.astype(int)), flight.events)
    assert np.allclose(data["world"]["poses"].reshape(-1, 3), flight.poses, atol=1e-5)
    assert (len(data["lap"]["lanes"][0]["lines"][0]["y"]), data["world"]["step"], data["world"]["ball"]) == (
        501,
        20.0,
        0.17,
    )
    assert [s["name"] for s in data["raster"]["strips"]] == ["cells", "motors"]
    assert "static, which does not learn · weights frozen, no dopamine · the fixed path · 10.0 s, mean error" in text
    assert "network on" not in text
    assert "network on loihi" in page(replace(flight, backend="loihi"))
    assert "http" not in text.replace("http-equiv", "")
    monkeypatch.setattr("neuro_drone.watch.MOST", len(flight.x) // 4 + 1)
    text = page(flight)
    camera = tracks_of(text)["camera"]
    assert np.array_equal(camera["place"] >> 1 & 127, flight.x[::4])
    assert camera["first"][-1] == len(flight.x[::4])
    assert "one of every 4 events is shown" in text
    assert "training" not in tracks_of(page(flight))
    taught = train(SHORT, "lms", steps=2100)
    above, below = tracks_of(page(replace(flight, model=taught)))["training"]["lanes"]
    (frozen, lost), (episodes,) = above["lines"], below["lines"]
    assert np.array_equal(episodes["x"], taught.history["steps"])
    assert episodes["y"] == pytest.approx(taught.history["returns"] / taught.history["lengths"])
    assert np.array_equal(frozen["x"], taught.curve["steps"])
    assert frozen["y"] == pytest.approx(taught.curve["error_px"])
    assert np.array_equal(lost["x"], taught.curve["steps"][np.asarray(taught.curve["lost"]) > 0])
    refused(lambda: watch(model, tmp_path / "lap.html", (100.0, 0.0)))
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def chromium(chromium):
    return partial(chromium, "--window-size=1280,1100", "--blink-settings=preferredColorScheme=1")


STEPS = Path(__file__).with_name("steps.html").read_text("utf-8")


def test_a_browser_draws_it_moves_in_time_and_plays(flight, tmp_path, chromium):
    file = tmp_path / "lap.html"
    file.write_text(page(flight).replace("</body>", STEPS), "utf-8")
    title = re.search("<title>(.*?)</title>", chromium("--dump-dom", f"file://{file}"))[1]
    told = title.split("|")
    assert told[:4] == ["3.00 of 10.00 s", "5.00 of 10.00 s", f"{flight.errors[250]:.1f} px", "10.00 of 10.00 s"]
    assert told[4:8] == ["Pause", "0", "Play", "0.02 of 10.00 s"]
    names = ("world", "camera", "fields", "stick", "raster", "actions", "lap")
    assert told[8:] == [f"{name} drawn" for name in names]


def test_a_controller_without_neurons_on_a_line(tmp_path, chromium):
    quick = load("line", **{"task": {"line": {"side": 3.0, "speed": 0.3, "direction": 1}}})
    told = watch(train(quick, "oracle"), tmp_path / "lap.html", (5.0, 0.0), course=FlightCourse("fixed"))
    assert re.fullmatch(r"\d\d\.\d s, mean error \d\.\d\d px, a lap that counts", told)
    chromium(f"--screenshot={tmp_path / 'lap.png'}", f"file://{tmp_path / 'lap.html'}")
    pixels = imread(tmp_path / "lap.png")[..., :3]
    blue = pixels[..., 2] - pixels[..., 0] > 0.4
    assert 500 < blue.sum() < 100_000
