"""The drone: steps of control with environment, network and learning on one core."""

import time

import pytest

from neuro_drone.controllers import make
from neuro_drone.env import DroneEnv
from neuro_drone.scenario import load
from neuro_drone.train import train

STEPS = 20_000
RATES = {1.0: "at least 8,000", 0.1: "at least 4,000"}


@pytest.mark.parametrize("resolution", RATES)
def test_training(benchmark, figure, resolution):
    settings, cpu = {"resolution": resolution}, []
    train("B60", steps=200, settings=settings)

    def work():
        began = time.process_time()
        train("B60", steps=STEPS, settings=settings)
        cpu.append(time.process_time() - began)

    benchmark.pedantic(work, rounds=3)
    rate = STEPS / min(cpu)
    benchmark.extra_info["steps_per_s"] = rate
    figure(f"a drone that learns, network at {resolution:g} ms", rate, "steps/s of one core", RATES[resolution])
    if resolution == 1.0:
        figure("60,000 steps of learning", 60_000 / rate, "s of one core", "less than 10")


@pytest.mark.parametrize("name", ["oracle", "centroid", "lms"])
def test_flying(benchmark, figure, name):
    scenario, cpu = load("B60"), []
    env, controller = DroneEnv(scenario), make(name, scenario)

    def work():
        began = time.process_time()
        _, info = env.reset(seed=1)
        controller.begin()
        for _ in range(2000):
            info = env.step(controller.act(info["counts"], info))[4]
            controller.learn(info)
        cpu.append(time.process_time() - began)

    benchmark.pedantic(work, rounds=4, warmup_rounds=1)
    figure(f"the environment with {name}", 2000 / min(cpu), "steps/s of one core", "at least 20,000")
