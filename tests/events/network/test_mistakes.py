"""Cameras that cannot be: each refused in one message."""

import re

import numpy as np
import pytest

import neuro
from event_tests import refusal
from neuro.events import Events, save
from seen import STEP, network, same_run


def refused(model, shape="auto"):
    told = refusal(lambda: neuro.compile(network(model() if callable(model) else model, shape)))
    return re.sub(r"^\w+\.py:\d+: ", "", told)


NUMBERS = "\n  hint: write the numbers: [2, height, width], or [height, width] unless the polarities are split"
AUTO = "\n  hint: 'shape: auto' takes it from the recording"
AS_SENSOR = f"as the sensor is 12x9 px{AUTO}"
CROP = "crop.x = [3, 40]: expected within [0, 12], the sensor is 12x9 px"
WORDS = "expected one of split, merge, on, off\n  hint: known: merge, off, on, split"
EVENTS = "expected Events, or an array with the fields t, x, y and p, or an iterator of such\n  hint: write file="
ALONE = "population 'camera': shape [9]"
NONE = Events([], [], [], [], (12, 9))


@pytest.mark.parametrize(("words", "shape", "message"), [
    ({"polarity": "both"}, "auto", f"event_camera.polarity = 'both': {WORDS}"),
    ({"crop": {"x": [3, 40]}}, "auto", f"population 'camera': {CROP}"),
    ({"crop": {"y": [5, 5]}}, "auto", "crop.y = [5, 5]: expected [first, the one after the last]"),
    ({"scale": 0.5}, "auto", "event_camera.scale = 0.5: expected a whole number >= 1"),
    ({"offset": 5e-4}, "auto", "event_camera.offset = 0.0005 ms: expected whole us, as the times of events are"),
    ({}, (2, 12, 9), f"population 'camera': shape [2, 12, 9]: expected [2, 9, 12], {AS_SENSOR}"),
    ({"polarity": "on"}, (2, "auto"), f"population 'camera': shape [2, auto]: expected [9, 12], {AS_SENSOR}"),
    ({"file": "walk.dat"}, "auto", "event_camera: found both 'file' and 'events': expected one of them"),
    ({"events": None}, "auto", f"population 'camera': shape auto: no sensor is known before it is played{NUMBERS}"),
    ({"events": None, "polarity": "on"}, 9,
    "population 'camera': shape [9]: expected [height, width] with polarity: on"),
    ({"events": "walk.dat"}, "auto", f"event_camera: events: found 'walk.dat': {EVENTS}"),
    ({"events": NONE}, "auto", "population 'camera': its recording has no events: expected at least one")
])  # fmt: skip
def test_mistakes(walk, words, shape, message):
    assert refused(lambda: neuro.event_camera(**{"events": walk, **words}), shape) == message


def test_a_file_that_is_none(tmp_path):
    path = tmp_path / "walk.dat"
    assert refused(neuro.event_camera(file=path)) == f"{path}: no such file"
    save(Events([], [], [], [], (12, 9)), path)
    assert refused(neuro.event_camera(file=path)) == f"{path}: has no events"


def test_damage_stops_the_run_before_it(tmp_path, walk, monkeypatch):
    """What was simulated stays, and who goes on is told again."""
    path = tmp_path / "walk.es"
    save(walk, path)
    path.write_bytes(path.read_bytes()[:-1])
    sim = neuro.compile(network(neuro.event_camera(file=path)))
    for _ in range(2):
        assert refusal(sim.run, 100.0).startswith(f"{path}: byte ")
        assert sim.time == pytest.approx((walk.t[-2] - walk.t[0]) // 100 * STEP)
    times, _ = sim.spikes("camera")
    assert times.size > 3900
    assert times.size == np.count_nonzero((walk.t - walk.t[0]) // 100 * STEP + STEP < sim.time + STEP / 2)


def test_events_out_of_the_shape_of_an_iterator(walk):
    sim = neuro.compile(network(neuro.event_camera(events=iter([walk])), (2, 5, 12)))
    k = int((walk.y >= 5).argmax())
    assert refusal(sim.run, 10.0).endswith(
        f"population 'camera': event at x = {walk.x[k]}, y = {walk.y[k]}, {walk.t[k]} us: "
        "expected within its shape [2, 5, 12]"
    )


def test_networks_with_trials_have_none(walk):
    net = network(neuro.event_camera(events=walk))
    net.group("first", neuro.winner_take_all(of="cells"))
    net.trials(input="camera", duration=5.0)
    expected = "an event_camera in a network with trials, which show what they are given"
    assert expected in refusal(neuro.compile, net)


def test_arrays_need_a_sensor_or_a_shape(walk):
    records = walk.records()
    way_out = NUMBERS.replace("write", "neuro.events.Events(t, x, y, p, (width, height)) tells it; or write")
    message = f"population 'camera': shape auto: its events are an array, which has no sensor{way_out}"
    assert refused(neuro.event_camera(events=records)) == message
    assert refused(neuro.event_camera(events=[records[:5], records[5:]])) == message
    sized = neuro.compile(network(neuro.event_camera(events=[records[:5], walk[5:]])))
    assert sized.program.populations[0].shape == (2, 9, 12)
    few, crop = walk[(walk.x < 8) & (walk.y < 6)], {"x": [2, 12], "y": [0, 8]}
    for words, shape in (
        ({"scale": 2}, (2, 5, 6)), ({"crop": crop}, (2, 8, 10)), ({"crop": crop, "scale": 4}, (2, 2, 3))
    ):  # fmt: skip
        sims = [neuro.compile(network(neuro.event_camera(events=e, **words), shape)) for e in (few, few.records())]
        for sim in sims:
            sim.run(70.0)
        same_run(*sims)
    beyond = neuro.compile(network(neuro.event_camera(events=records), (2, 9, 11)))
    assert "expected within its shape" in refusal(beyond.run, 70.0)
