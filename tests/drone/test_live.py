"""Laps in real time: the world in another process, events over the loopback."""

import json
from importlib.util import find_spec
from pathlib import Path

import pytest

from neuro_drone.evaluate import grid
from neuro_drone.live import fly_live
from neuro_drone.train import pilot, train
from refused import refused

LAP = ("--controller", "centroid", "--scenario", "short.yaml", "--speed", "2")


def test_a_lap_in_real_time_beside_the_same_offline(drone):
    code, out, _ = drone("live", *LAP, "--json", "--set", "task.ball.lap=0.5")
    assert code == 0
    found = json.loads(out)
    assert found["starts"] == 1
    assert found["flown"] == found["per_start"][0]["steps"] > 50
    assert found["error_px"] == pytest.approx(found["offline"]["error_px"], abs=20.0)
    if not found["missed"] and not found["events_lost"]:
        assert found["error_px"] == found["offline"]["error_px"]
    assert 0.0 < found["latency_ms"]["p50"] < found["latency_ms"]["p99"]
    code, _, err = drone("live", "--controller", "oracle", "--scenario", "short.yaml")
    assert code == 2
    assert "controller 'oracle' sees the true error, which no camera sends" in err
    model = pilot(None, "A60", "centroid", [])
    start = grid(model.scenario, 1)[0]
    assert "the world's process failed: ModelError: " in refused(fly_live, model, [type(start)((1000.0, 0.0))])


@pytest.mark.skipif(find_spec("websockets") is None, reason="websockets is not installed: pip install '.[live]'")
def test_a_lap_is_shown_on_a_page(drone):
    train("short.yaml", steps=1, out=Path("model.h5"))
    code, out, err = drone("live", "model.h5", "--speed", 10, "--json", "--page", "--no-browser")
    assert code == 0, err
    assert "page: http://127.0.0.1:" in err
    assert json.loads(out)["flown"] > 0
    code, _, err = drone("live", *LAP, "--page", "--no-browser")
    assert code == 2
    assert "the controller is no network" in err
