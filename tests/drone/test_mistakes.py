"""What is said of mistakes: the message of each input in mistakes.yaml, and of those that YAML cannot hold."""

import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from drones import SHORT
from neuro.core.extras import install
from neuro_drone.controllers import make
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import grid
from neuro_drone.model import Model
from neuro_drone.parts import Drone
from neuro_drone.paths import FlightCourse
from neuro_drone.scenario import load
from neuro_drone.train import train
from refused import refused

SAID = yaml.safe_load((Path(__file__).parent / "mistakes.yaml").read_text("utf-8"))


@pytest.mark.parametrize(("text", "message"), SAID["files"].items())
def test_files(tmp_path, text, message):
    (tmp_path / "x.yaml").write_text(text)
    assert refused(lambda: load(tmp_path / "x.yaml")) == f"{tmp_path / 'x.yaml'}{message}"


@pytest.mark.parametrize(("scenario", "changes", "message"), SAID["scenarios"])
def test_scenarios(scenario, changes, message):
    assert refused(lambda: load(scenario, **changes)) == message


@pytest.mark.parametrize("said", SAID["controllers"], ids=lambda said: said[2])
def test_controllers(said):
    name, settings, message, *scenario = said
    assert refused(lambda: make(name, load(*scenario or ["B60"]), 0, settings)) == message


@pytest.mark.parametrize(("words", "message"), SAID["trainings"])
def test_trainings(words, message):
    assert refused(lambda: train("B60", **words)) == message


@pytest.mark.parametrize("words", SAID["commands"])
def test_commands(drone, tmp_path, words):
    (tmp_path / "bad.yaml").write_text("task: ball\ncamera: {tlt: 60}\n")
    if "oracle.h5" in words:
        assert drone("train", "--controller", "oracle", "--scenario", "short.yaml", "--out", "oracle.h5")[0] == 0
    assert drone(*shlex.split(words)) == (2, "", f"error: {SAID['commands'][words]}\n")


@pytest.mark.parametrize(("words", "what", "given", "message"), SAID["environments"])
def test_environments(words, what, given, message):
    def call():
        env = DroneEnv(**words)
        env.reset(**({"options": given} if what == "reset" else {}))
        return env.step(given)

    assert refused(call) == message


def test_what_yaml_does_not_hold(tmp_path):
    env = DroneEnv("B60", render_mode="rgb_array")
    assert refused(env.render) == "render: nothing was seen yet: call reset first"
    assert refused(lambda: env.step(np.zeros(2))) == "step: no episode is under way: call reset first"
    env.reset()
    assert refused(lambda: env.step(np.zeros(3))) == "action of shape [3]: expected two numbers in [-1, 1]"
    assert refused(lambda: load(tmp_path / "x.yaml")) == f"{tmp_path}/x.yaml: no such file"
    assert refused(lambda: load("B60", camera=30)).startswith("found 30: expected the words of camera: tilt, fov")
    assert refused(lambda: Drone(v_max=10**400)).startswith("drone.v_max = 1e400 or more: ")
    assert "unknown parameter 'tau_d'\n  hint: " in refused(lambda: make("snn", SHORT, 0, {"tau_d": 1.0}))


def test_grids_and_courses():
    assert refused(lambda: FlightCourse("variable")) == "unknown path 'variable'\n  hint: did you mean 'varied'?"
    for seed in (-1, 2**63, True, 1.0):
        told = f"seed of the paths = {seed!r}: expected a whole number >= 0 and < 2^63"
        assert refused(lambda seed=seed: FlightCourse(seed=seed)) == told
    assert refused(lambda: grid(SHORT, 0)) == "grid = 0: expected a whole number >= 1"
    assert refused(lambda: grid(SHORT, 5, -1.0)) == "spread = -1.0: expected numbers >= 0"


def test_models(tmp_path):
    file = tmp_path / "model.h5"
    assert refused(lambda: Model.load(file)) == f"{file}: no such file: expected a neuro drone model 1"
    file.write_text("no")
    assert refused(lambda: Model.load(file)) == f"{file}: not a neuro drone model 1"
    told = f"{tmp_path}: is a folder, expected the name of a file"
    assert refused(lambda: train("B60", steps=100, out=tmp_path)) == told


@pytest.mark.parametrize(
    ("cells", "motors", "message"),
    [
        (None, 4, "expected a population 'cells' of 64, one a field of the picture: found none"),
        ((4, 4), 4, "expected a population 'cells' of 64, one a field of the picture: found one of shape [4, 4]"),
        (64, None, "expected a population 'motors' of 4, two an axis: found none"),
        (64, 2, "expected a population 'motors' of 4, two an axis: found one of shape [2]"),
        ("parrots", 4, "expected 'cells' to be a poisson_generator, whose rate is set"),
        (64, 4, "resolution = 0.3 ms: expected a whole part of the step of 50 ms"),
    ],
)
def test_networks_that_do_not_fit(cells, motors, message):
    net = neuro.Network("own", resolution=0.3)
    if cells == "parrots":
        net.population("cells", 64, neuro.parrot_neuron())
    elif cells is not None:
        net.population("cells", cells, neuro.poisson_generator())
    if motors is not None:
        net.population("motors", motors, neuro.iaf_psc_exp(t_ref=3.0))
    assert refused(lambda: make("snn", load("B60"), 0, {"network": net})) == f"network 'own': {message}"
    if (cells, motors) == (64, 4):
        assert refused(lambda: make("static", load("B60"), 0, {"network": net})) == (
            "start = sign: expected a projection 'cells_motors' of all cells to all motors\n"
            "  hint: start = equal takes the network's own weights"
        )


@pytest.mark.parametrize("name", ["dqn", "ddpg", "ppo"])
def test_without_an_extra(drone, name, monkeypatch):
    """What is missing is said before any work."""
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    told = f"controller '{name}': stable-baselines3 is not installed\n  hint: {install('rl')}"
    assert refused(lambda: train("B60", name, steps=10)) == told
    assert drone("compare", "--scenario", "short.yaml", "--also", name) == (2, "", f"error: {told}\n")


def test_without_pybullet(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert refused(lambda: DroneEnv("B60", **{"drone.physics": "bullet"})) == (
        "drone.physics = 'bullet': the package pybullet is not installed\n"
        f"  hint: {install('bullet')}; pybullet has wheels for Python 3.11 only, and this is {version}"
    )
