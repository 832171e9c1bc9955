"""What is said of mistakes: the message of each input in mistakes.yaml, and of those that YAML cannot hold."""

import sys
from pathlib import Path

import pytest
import yaml

import neuro
from neuro.core.extras import install
from neuro_drone.env import DroneEnv
from neuro_drone.train import train
from refused import mistakes_of, refusals_of, refused

SAID = yaml.safe_load((Path(__file__).parent / "mistakes.yaml").read_text("utf-8"))


def flown(words, step=None, **reset):
    """Make an environment, begin an episode, and take a step."""
    env = DroneEnv(**words)
    env.reset(**({"options": reset["reset"]} if "reset" in reset else {}))
    return env.step(step)


def test_calls_and_files(tmp_path, messages):
    calls, files = list(SAID["calls"]), [tmp_path / f"{k}.yaml" for k in range(len(SAID["files"]))]
    for k, text in enumerate(SAID["files"]):
        files[k].write_text(text)
        calls.append(f"load(files[{k}])")
    env, begun = DroneEnv("B60", render_mode="rgb_array"), DroneEnv("B60")
    begun.reset()
    calls += [f"FlightCourse(seed={seed!r})" for seed in (-1, 2**63, True, 1.0)]
    calls += """env.render()
        env.step(np.zeros(2))
        begun.step(np.zeros(3))
        load(tmp_path / "x.yaml")
        load("B60", camera=30)
        Drone(v_max=10**400)
        make("snn", SHORT, 0, {"tau_d": 1.0})
        FlightCourse("variable")
        grid(SHORT, 0)
        grid(SHORT, 5, -1.0)
        Model.load(tmp_path / "model.h5")
        train("B60", steps=100, out=tmp_path)
        priced(train(SHORT, "centroid"), ("loihi",))
        priced(train(SHORT, "static"), ("lohi",))""".splitlines()
    names = globals() | locals() | {"nan": float("nan"), "inf": float("inf")}
    messages(refusals_of("\n".join(calls), names, tmp_path=tmp_path))


def test_commands(drone, tmp_path, messages):
    (tmp_path / "bad.yaml").write_text("task: ball\ncamera: {tlt: 60}\n")
    assert drone("train", "--controller", "oracle", "--scenario", "short.yaml", "--out", "oracle.h5")[0] == 0
    messages(mistakes_of(drone, "\n".join(SAID["commands"])))


def test_networks_that_do_not_fit(messages):
    def own(cells, motors):
        net = neuro.Network("own", resolution=0.3)
        if cells is not None:
            model = neuro.parrot_neuron() if cells == "parrots" else neuro.poisson_generator()
            net.population("cells", 64 if cells == "parrots" else cells, model)
        if motors is not None:
            net.population("motors", motors, neuro.iaf_psc_exp(t_ref=3.0))
        return net

    nets = [(None, 4), ((4, 4), 4), (64, None), (64, 2), ("parrots", 4), (64, 4)]
    calls = [f"make('snn', load('B60'), 0, {{'network': own{net}}})" for net in nets]
    calls.append("make('static', load('B60'), 0, {'network': own(64, 4)})")
    messages(refusals_of("\n".join(calls), globals() | locals()))


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
