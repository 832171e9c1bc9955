"""Scenarios: by name, from files and words, changed, and refused with the place of the mistake."""

import json
from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from neuro import ModelError
from neuro_drone.scenario import NAMES, Ball, Camera, Drone, Ground, Line, Scenario, load


def told(make):
    with pytest.raises(ModelError) as error:
        make()
    return str(error.value)


def test_the_scenarios_that_come_along():
    variants = [f"B60-{what}" for what in ("bounce", "height", "rise", "shake", "spin", "texture", "wind")]
    assert ("A30", "A60", "B30", "B60", *variants, "C60", "line") == NAMES
    assert load("B60") == Scenario()
    assert load("A30") == Scenario("A30", 20.0, Ball(lap=3.0, radius=0.27), Camera(tilt=30.0))
    assert load("C60").task == Ball(lap=15.0, speed=0.375)
    assert load("line").task == Line(width=0.05)
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


def test_a_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("step: 20\ntask: {ball: {lap: 3}}\ncamera: {tilt: 45, mount: body}\nstart: [5, 6]\nseed: 3\n")
    wanted = Scenario("mine", 20.0, Ball(lap=3.0), Camera(tilt=45.0, mount="body"), start=(5.0, 6.0), seed=3)
    assert load(path) == load(str(path)) == wanted
    path.write_text("task: line\nname: other\n")
    assert load(path) == Scenario("other", task=Line())


def test_changes():
    changed = load("B60", camera={"tilt": 45}, **{"drone.v_max": 1, "task.ball.lap": 3}, step=20, seed=4)
    wanted = Scenario("B60", 20.0, Ball(lap=3.0), Camera(tilt=45.0), drone=Drone(v_max=1.0), seed=4)
    assert changed == wanted
    assert load(wanted) is wanted
    assert load(wanted, seed=None).seed is None
    assert load("A60", task="line").task == load("A60", task={"line": {}}).task == Line()
    assert load("A60", task=Line(side=2.0), ground=Ground(texture=0.1)).task.side == 2.0


@given(st.floats(1.0, 90.0), st.floats(0.001, 20.0), st.integers(1, 10_000))
def test_values_go_through_files_and_words_unchanged(tilt, v_max, step_us):
    changed = load("B60", **{"camera.tilt": tilt, "drone.v_max": v_max, "step": 0.1 + step_us / 1000.0})
    assert (changed.camera.tilt, changed.drone.v_max, changed.step) == (tilt, v_max, 0.1 + step_us / 1000.0)
    assert Scenario.from_words(changed.as_words()) == changed


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1:1: the file is empty: expected a scenario\n  hint: begin: task: {ball: {}}"),
        ("step: 20\ncamara: {tilt: 3}\n", ":2:1: unknown word of a scenario 'camara'\n  hint: did you mean 'camera'?"),
        ("task: {ball: {spead: 2}}\n", ":1:15: unknown word of ball 'spead'\n  hint: did you mean 'speed'?"),
        ("task: {bull: {}}\n", ":1:8: unknown task 'bull'\n  hint: did you mean 'ball'?"),
        ("task: {ball: {}, line: {}}\n", ":1:7: found 2 tasks: expected one of ball, line"),
        ("task: [ball]\n", ":1:7: found [ball]: expected the words of a task: ball, line"),
        ("task:\n  ball:\n", ":2:3: ball has no value\n  hint: write it after the ':'"),
        ("task: {ball: {lap: -3}}\n", ":1:20: task.ball.lap = -3: expected a number > 0 and <= 1000 m"),
        ("camera:\n  tilt: 95\n", ":2:9: camera.tilt = 95: expected a number >= 1 and <= 90 degrees"),
        (
            "camera:\n  mount: gimbel\n",
            ":2:10: camera.mount = 'gimbel': expected one of gimbal, body\n  hint: did you mean 'gimbal'?",
        ),
        ("camera: {tilt: true}\n", ":1:16: camera.tilt = true: expected a number >= 1 and <= 90 degrees"),
        ("ground: {redraw: 1}\n", ":1:18: ground.redraw = 1: expected true or false"),
        (
            "drone: {physics: ode}\n",
            ":1:18: drone.physics = 'ode': expected one of kinematic, bullet\n  hint: known: bullet, kinematic",
        ),
        ("step: .nan\n", ":1:7: step = .nan: expected a finite number >= 0.1 and <= 1000 ms"),
        ("step: 0.10005\n", ":1:7: step = 0.10005: expected whole microseconds"),
        ("seed: 1.5\n", ":1:7: seed = 1.5: expected a whole number >= 0"),
        ("name: 3\n", ":1:7: name = 3: expected a word"),
        ("start: [1]\n", ":1:8: start = [1]: expected two numbers, the error on both axes"),
        ("start: [1, x]\n", ":1:8: start = 'x': expected a number >= -180 and <= 180"),
        ("task: {line: {direction: 2}}\n", ":1:26: task.line.direction = 2: expected a whole number >= -1 and <= 1"),
        (
            "task:\n  ball: {lap: 1, speed: 1}\n",
            ":2:25: task.ball.speed = 1: 0.05 m in a step of 50 ms: expected at most a hundredth of the lap of 1 m",
        ),
        (
            "drone: {physics: bullet, a_max: 9}\n",
            ":1:33: drone.a_max = 9: expected at most 8 m/s^2 with physics bullet, whose rotors have no more to steer "
            "with",
        ),
        (
            "task:\n  ball: {radius: 1.2}\n",
            ":2:18: task.ball.radius = 1.2: expected a ball below the drone, whose height is 2.4 m",
        ),
    ],
)
def test_mistakes_in_files(tmp_path, text, message):
    path = tmp_path / "x.yaml"
    path.write_text(text)
    said = told(lambda: load(path))
    assert said == f"{path}{message}"


def test_mistakes_in_calls(tmp_path):
    assert told(lambda: load("B6")) == "unknown scenario 'B6'\n  hint: did you mean 'B60'?"
    assert told(lambda: load(tmp_path / "x.yaml")) == f"{tmp_path}/x.yaml: no such file"
    assert told(lambda: load("B60", camera=30)).startswith("found 30: expected the words of camera: tilt, fov")
    assert (
        told(lambda: load("B60", **{"camera.tilr": 3})) == "unknown word of camera 'tilr'\n  hint: did you mean 'tilt'?"
    )
    assert told(lambda: load("B60", **{"task.lap": 3})) == "unknown task 'lap'\n  hint: known: ball, line"
    assert told(lambda: Camera(tilt="30")) == (
        "camera.tilt = '30': expected a number >= 1 and <= 90 degrees\n  hint: write 30 without quotes"
    )
    assert told(lambda: Scenario(seed=-1)) == "seed = -1: expected a whole number >= 0"
    assert told(lambda: Drone(v_max=10**400)).startswith("drone.v_max = 1e400 or more: ")
    assert told(lambda: Ball(lap=float("inf"))) == "task.ball.lap = .inf: expected a finite number > 0 and <= 1000 m"
