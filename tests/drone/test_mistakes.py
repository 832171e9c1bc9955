"""What is said of mistakes: of calls and commands that tests/messages.yaml has, and of what is not installed."""

import sys
from pathlib import Path

import numpy as np  # noqa: F401
import pytest

import neuro
import neuro_models
from drones import SHORT  # noqa: F401
from neuro.core import hdf5
from neuro.core.extras import install
from neuro_drone.controllers import make  # noqa: F401  (named in messages.yaml, as all of these)
from neuro_drone.energy import compute_bills  # noqa: F401
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import grid  # noqa: F401
from neuro_drone.model import Model  # noqa: F401
from neuro_drone.parts import Drone  # noqa: F401
from neuro_drone.paths import FlightCourse  # noqa: F401
from neuro_drone.scenario import load
from neuro_drone.train import train, untrained
from refused import mistakes_of, refusals_of, refused

MODELS = Path(neuro_models.__file__).parent


def flown(words, step=None, **reset):
    """Make an environment, begin an episode, and take a step."""
    env = DroneEnv(**words)
    env.reset(**({"options": reset["reset"]} if "reset" in reset else {}))
    return env.step(step)


def own(cells, motors):
    """A network with some cells and motors, or without."""
    net = neuro.Network("own", resolution=0.3)
    if cells is not None:
        model = neuro.parrot_neuron() if cells == "parrots" else neuro.poisson_generator()
        net.population("cells", 64 if cells == "parrots" else cells, model)
    if motors is not None:
        net.population("motors", motors, neuro.iaf_psc_exp(t_ref=3.0))
    return net


def joined(controller, world, network="drone", **settings):
    """A network in the loop with its world."""
    model = untrained(load(world), controller, 0, None, settings | {"network": network})
    model.loop(DroneEnv(world)).test(1, most=1)


def test_calls(tmp_path, messages):
    def loaded(text):
        (tmp_path / "text.yaml").write_text(text)
        return load(tmp_path / "text.yaml")

    env, begun, nan, inf = DroneEnv("B60", render_mode="rgb_array"), DroneEnv("B60"), float("nan"), float("inf")
    begun.reset()
    older = tmp_path / "older.h5"
    with hdf5.writing(older, "neuro drone model 1") as file:
        file.attrs["controller"] = "snn"
    messages(refusals_of(messages.cases, globals() | locals(), tmp_path=tmp_path, models=MODELS))


def test_commands(drone, tmp_path, messages):
    (tmp_path / "bad.yaml").write_text("task: ball\ncamera: {tlt: 60}\n")
    assert drone("train", "--controller", "oracle", "--scenario", "short.yaml", "--out", "oracle.h5")[0] == 0
    (tmp_path / "model.h5").touch()
    messages(mistakes_of(drone, messages.cases, models=MODELS))


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
