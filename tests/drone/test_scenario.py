"""Scenarios: by name, from files and words, and changed."""

import json
from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from neuro_drone.parts import Ball, Camera, Drone, Ground, Line
from neuro_drone.scenario import NAMES, Scenario, load


def test_the_scenarios_that_come_along():
    variants = [f"B60-{what}" for what in ("bounce", "height", "rise", "shake", "spin", "texture", "wind")]
    assert (("A30", "A60", "B30", "B60", *variants, "C60", "line"), load("B60")) == (NAMES, Scenario())
    assert load("A30") == Scenario("A30", 20.0, Ball(lap=3.0, radius=0.27), Camera(tilt=30.0))
    assert (load("C60").task, load("line").task) == (Ball(lap=15.0, speed=0.375), Line(width=0.05))
    for name in NAMES:
        scenario = load(name)
        assert scenario.name == name
        if scenario.kind == "ball":
            assert scenario.task.lap / scenario.task.speed / (scenario.step / 1000.0) == pytest.approx(2000.0)


@pytest.mark.parametrize("name", NAMES)
def test_words_tell_the_whole_scenario(name):
    scenario = replace(load(name), start=(1.0, -2.5), seed=7)
    assert Scenario.from_words(json.loads(json.dumps(scenario.as_words()))) == scenario
    assert Scenario.from_words(load(name).as_words()) == load(name)


def test_files_and_changes(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("step: 20\ntask: {ball: {lap: 3}}\ncamera: {tilt: 45, mount: body}\nstart: [5, 6]\nseed: 3\n")
    wanted = Scenario("mine", 20.0, Ball(lap=3.0), Camera(tilt=45.0, mount="body"), start=(5.0, 6.0), seed=3)
    assert load(path) == load(str(path)) == wanted
    path.write_text("task: line\nname: other\n")
    assert load(path) == Scenario("other", task=Line())
    changed = load("B60", camera={"tilt": 45}, **{"drone.v_max": 1, "task.ball.lap": 3}, step=20, seed=4)
    wanted = Scenario("B60", 20.0, Ball(lap=3.0), Camera(tilt=45.0), drone=Drone(v_max=1.0), seed=4)
    assert changed == wanted
    assert load(wanted) is wanted
    assert load(wanted, seed=None).seed is None
    assert load("A60", task="line").task == load("A60", task={"line": {}}).task == Line()
    assert load("A60", task=Line(side=2.0), ground=Ground(texture=0.1)).task.side == 2.0
    assert load("B60", load={"mass": 0.5}).load.mass == 0.5  # it holds its height
    assert replace(load("B60"), task=load("B60-bounce").task).axes == 2


@given(st.floats(1.0, 90.0), st.floats(0.001, 20.0), st.integers(1, 10_000))
def test_values_go_through_files_and_words_unchanged(tilt, v_max, step_us):
    changed = load("B60", **{"camera.tilt": tilt, "drone.v_max": v_max, "step": 0.1 + step_us / 1000.0})
    assert (changed.camera.tilt, changed.drone.v_max, changed.step) == (tilt, v_max, 0.1 + step_us / 1000.0)
    assert Scenario.from_words(changed.as_words()) == changed
