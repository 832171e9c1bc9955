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


NONE = Events([], [], [], [], (12, 9))


RECORDING = Events([1000, 3000], [0, 1], [0, 1], [0, 1], (2, 2))


def test_mistakes(messages, walk, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save(NONE, "none.dat")
    save(RECORDING, "walk.aedat4")

    def camera(shape="auto", **words):
        neuro.compile(network(neuro.event_camera(**{"events": walk} | words), shape))

    messages.calls(globals() | locals())
    camera(events=RECORDING, offset=2)
    camera(events=RECORDING, origin=3000)


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


def test_what_is_known_late(messages, walk):
    sim = neuro.compile(network(neuro.event_camera(events=iter([walk])), (2, 5, 12)))
    net = network(neuro.event_camera(events=walk))
    net.group("first", neuro.winner_take_all(of="cells"))
    net.trials(input="camera", duration=5.0)
    records = walk.records()
    messages({
        "out of the shape": refusal(sim.run, 10.0), "trials": refusal(neuro.compile, net),
        "array": refused(neuro.event_camera(events=records)),
        "arrays": refused(neuro.event_camera(events=[records[:5], records[5:]])),
    })  # fmt: skip


def test_arrays_need_a_sensor_or_a_shape(walk):
    records = walk.records()
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
    assert "expected it within the shape" in refusal(beyond.run, 70.0)
