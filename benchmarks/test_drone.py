"""The drone on one core: looks of its eye, and control steps with environment, network and learning."""

import time

import numpy as np
import pytest

from neuro_drone.controllers import make
from neuro_drone.env import DroneEnv
from neuro_drone.eye import Eye
from neuro_drone.geometry import Pose, WorldScene
from neuro_drone.parts import Ball, Camera, Ground, Line
from neuro_drone.scenario import Scenario, load
from neuro_drone.train import train

FRAMES = 2000
STEP = 50_000
NOISE = {"leak_rate_hz": 0.1, "shot_noise_rate_hz": 1.0}
TIME = 0.02 * np.arange(FRAMES)
HEXAGON = 3.0 * np.stack([np.cos(np.arange(7) * np.pi / 3), np.sin(np.arange(7) * np.pi / 3)], axis=1)
LINE = WorldScene(line=np.concatenate([HEXAGON[:-1], HEXAGON[1:]], axis=1))


def after_a_ball(tilt):
    """Return poses, scenes and ball of a drone that sways around a ball on a circle."""
    radius = 0.27 if tilt < 45 else 0.17
    away = 2.4 / np.tan(np.radians(tilt))
    balls = [(away + 0.3 * np.cos(0.3 * t), 0.3 * np.sin(0.3 * t), radius, radius) for t in TIME]
    poses = [Pose(0.1 * np.sin(t), 0.1 * np.cos(t), 2.4) for t in TIME]
    return poses, [WorldScene(ball=ball) for ball in balls], Ball(radius=radius)


def along_a_line(tilt):
    """Return poses, scenes and line of a drone that flies around a hexagon and weaves."""
    turn = 0.05 * TIME
    sway = turn + np.pi / 2 + 0.1 * np.sin(TIME)
    poses = [Pose(2.5 * np.cos(a), 2.5 * np.sin(a), 2.4, b) for a, b in zip(turn, sway, strict=True)]
    return poses, [LINE] * FRAMES, Line()


def cost(eye, poses, scenes):
    """Return the process time of a look in s, and the number of events in a look."""
    eye.reset(0)
    events = 0
    for k, (pose, scene) in enumerate(zip(poses, scenes, strict=True)):
        if k == 3:
            began, events = time.process_time(), 0
        events += len(eye.see(pose, scene, STEP * k))
    return (time.process_time() - began) / (FRAMES - 3), events / (FRAMES - 3)


CASES = {
    "ball, tilt 60": (after_a_ball, 60.0, {}, Ground(), "at least 20,000"),
    "ball, tilt 30": (after_a_ball, 30.0, {}, Ground(), "at least 20,000"),
    "ball, leak and shot noise": (after_a_ball, 60.0, NOISE, Ground(), ""),
    "ball, shake 0.3 degrees": (after_a_ball, 60.0, {"shake": 0.3}, Ground(), "at least 20,000"),
    "line, tilt 60": (along_a_line, 60.0, {}, Ground(), ""),
    "line, leak and shot noise": (along_a_line, 60.0, NOISE, Ground(), ""),
    "ball, textured ground": (after_a_ball, 60.0, {}, Ground(texture=0.3), "at least 3,000"),
    "ball, textured ground, tilt 30": (after_a_ball, 30.0, {}, Ground(texture=0.3), "at least 3,000"),
    "line, textured ground": (along_a_line, 60.0, {}, Ground(texture=0.3), "at least 3,000"),
}


@pytest.mark.parametrize("name", CASES)
def test_looks(figure, name):
    flight, tilt, camera, ground, aim = CASES[name]
    poses, scenes, task = flight(tilt)
    eye = Eye(Scenario(camera=Camera(tilt=tilt, **camera), ground=ground, task=task))
    took, events = min(cost(eye, poses, scenes) for _ in range(3))
    figure(f"eye with DVS: {name} ({events:.0f} events a look)", 1 / took, "looks/s", aim)
    assert events > 1


def test_a_new_pattern(figure):
    eye = Eye(Scenario(ground=Ground(texture=0.3, redraw=True)))
    began = time.process_time()
    for seed in range(20):
        eye.reset(seed)
    figure("a new pattern on the ground", 1e3 * (time.process_time() - began) / 20, "ms")


STEPS = 20_000
RATES = {1.0: "at least 8,000", 0.1: "at least 4,000"}


@pytest.mark.parametrize("resolution", RATES)
def test_training(benchmark, least_cpu, figure, resolution):
    settings = {"resolution": resolution}
    train("B60", steps=200, settings=settings)
    rate = STEPS / least_cpu(lambda: train("B60", steps=STEPS, settings=settings), 3)
    benchmark.extra_info["steps_per_s"] = rate
    figure(f"a drone that learns, network at {resolution:g} ms", rate, "steps/s of one core", RATES[resolution])
    if resolution == 1.0:
        figure("60,000 steps of learning", 60_000 / rate, "s of one core", "less than 10")


@pytest.mark.parametrize("name", ["oracle", "centroid", "lms"])
def test_flying(least_cpu, figure, name):
    scenario = load("B60")
    env, controller = DroneEnv(scenario), make(name, scenario)

    def flown():
        _, info = env.reset(seed=1)
        controller.begin()
        for _ in range(2000):
            info = env.step(controller.act(info["counts"], info))[4]
            controller.learn(info)

    rate = 2000 / least_cpu(flown, 4, warmup_rounds=1)
    figure(f"the environment with {name}", rate, "steps/s of one core", "at least 20,000")
