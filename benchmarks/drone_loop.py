"""The drone's loop without a host, which learns by its own dopamine, and controls that must fail.

    python benchmarks/drone_loop.py [--steps 60000] [--seeds 0 1 2 3 4] [--starts 5] [--backend event]
        [--only NAME ...] [--curve STEPS] [--lesions NAME ...] [--repair 60000] [--chips NAME ...]
        [--set NAME=VALUE ...] [--links] [--json FILE]

The network is `neuro_models/loop.yaml`. After the training its weights are frozen and its babbling neurons are cut off.
Then it flies one lap of B60 from each of starts x starts places on varied paths, as `neuro drone test` does. The figure
is the mean distance of the ball from the middle, px. Controls:

- late dopamine: spikes of the dopaminergic neurons reach motors and critic 5 s late
- reward elsewhere: the reward neurons see the fields at one side instead of the middle
- no critic: the synapses of the critic onto the dopaminergic neurons have weight 0
- frozen: nothing is learnt
- exact error: the network is `neuro_models/drone.yaml`, which is taught by the signed error
- pid: the controller is `Pid` of `drone_motors.py`, which does not learn

`--lesions` damages a trained network: 20 % of the synapses onto the motors are cut for good (cut), one motor is
mirrored, or all motors are turned by 45 degrees, as if the camera had turned. The network flies at once (repair of 0
steps), and again after each --curve steps of further learning, up to --repair. Babbling is as in the training, or as
--set says. With --chips each row has the energy of a control step on these chips, with learning and in flight.

With --links each row also has the links from the error to dopamine in the 2,000 steps before.

A row of `loop.yaml` has two figures of the learnt weights onto the motors, pA, mean of both axes. Common is the mean of
all weights. Difference is half of what the right motor has above the wrong one, mean of the fields beside the middle.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
import yaml
from drone_motors import Pid

import neuro
import neuro_models
from neuro_drone.controllers.pilot import loop_of
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import ENDLESS, Flights, FlightTest, fly_lap, grid, reset_arguments
from neuro_drone.scenario import load

Weights = dict[str, Any]
Left = dict[str, npt.NDArray[np.bool_]]
"""Masks of the synapses that a lesion left, (sources, targets), by projection onto the motors."""
EXACT = "exact error"
PID = "pid"
CONTROLS = ("loop", "late dopamine", "reward elsewhere", "no critic", "frozen", EXACT, PID)
ONTO_MOTORS = {"columns_motors_x": (15, 2), "rows_motors_y": (15, 2), "cells_motors": (64, 4)}
"""Numbers of sources and targets of the projections that lesions cut, in both networks."""
EPISODE, STEP = 100, 50.0
"""Number of control steps of an episode of training, and duration of a control step in ms, as in both networks."""
BLOCK, EDGES = 2000, (0, 3, 6, 12, 24, 64)
"""Number of control steps that `links` reads at most, and bounds of distances from the middle, px."""
CUT = 0.2
LESIONS: dict[str, dict[str, Any]] = {
    "cut": {},
    "mirrored": {"motors": {"mirror": True}},
    "turned": {"motors": {"angle": 45}},
}
"""Settings of the world that each lesion changes. `cut` changes the network instead."""


def network(control: str = "loop", left: Left | None = None, **parameters: float) -> neuro.Network:
    """Return the network of a row of the table.

    Args:
        control: one of `CONTROLS`.
        left: synapses that a lesion left, or None for all.
        **parameters: parameters that replace those of the file.

    Raises:
        ModelError: the file has no such parameter.
    """
    text = Path(neuro_models.path("drone" if control == EXACT else "loop")).read_text("utf-8")
    if control == "late dopamine":
        described = yaml.safe_load(text)
        for signal in described["signals"].values():
            words = signal["values"]["population"]
            base = words["baseline"][1:]
            base = parameters.get(base, described["parameters"][base])
            expression = f"trace(0.01 * rate({words['population']}), 50.0) - {base}"
            late = {"expression": expression, "every": 10.0, "delay": 5000.0, "scale": words["scale"]}
            signal["values"] = {"computed": late}
        text = yaml.safe_dump(described, sort_keys=False)
    if control == "reward elsewhere":
        fields = {":, 6:9": ":, 0:3", ":, 4:11": ":, 0:7", ":, 2:13": ":, 0:11"}
        fields |= {"6:9, :": "12:15, :", "4:11, :": "8:15, :", "2:13, :": "4:15, :"}
        for middle, side in fields.items():
            assert text.count(f'"{middle}"') == 1
            text = text.replace(f'"{middle}"', f'"{side}"')
    if control == "no critic":
        parameters["expectation"] = 0.0
    if control == "frozen":
        parameters |= {"eta": 0.0, "eta_critic": 0.0}
    if left is not None:
        described = yaml.safe_load(text)
        for name, each in left.items():
            pre, post = (ids.tolist() for ids in np.nonzero(each))
            described["projections"][name]["rule"] = {"pairs": {"pre": pre, "post": post}}
        text = yaml.safe_dump(described, sort_keys=False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "loop.yaml"
        path.write_text(text, "utf-8")
        return neuro.load(path, parameters)


def joules(loop: neuro.ClosedLoop, chip: str) -> str:
    """Return the energy of a control step on a chip, as a mean since time 0 of the network."""
    bill = loop.sim.energy(chip).per(round(loop.sim.time / STEP), "control step")
    return f"{chip}: {' | '.join(bill.cells())}"


def fly(
    network: neuro.Network, weights: Weights, starts: int, chips: Sequence[str] = (), **change: Any
) -> tuple[FlightTest, list[str]]:
    """Fly a network with frozen weights, one lap from each of starts x starts places of a world with a change.

    Returns:
        the laps, and the energy of a control step of the last lap on each chip.
    """
    learnt = neuro.closed_loop(network)
    learnt.pilot.put({"learnt": weights})
    frozen = learnt.network(frozen=True)
    test, loop = fly_laps(partial(neuro.closed_loop, frozen, learns=False, block=ENDLESS), starts, **change)
    return test, [f"flight, {joules(loop, chip)}" for chip in chips]


def fly_laps(
    make: Callable[[Flights], neuro.ClosedLoop], starts: int, **change: Any
) -> tuple[FlightTest, neuro.ClosedLoop]:
    """Fly one lap from each of starts x starts places of a world with a change. Return the laps and the loop."""
    scenario = load("B60", **change)
    places = grid(scenario, starts)
    env = Flights(scenario, (reset_arguments(place, index) for index, place in enumerate(places)))
    loop = make(env)
    laps = tuple(fly_lap(loop, env, place) for place in places)
    env.close()
    return FlightTest(laps), loop


def damaged(lesion: str, control: str, weights: Weights, seed: int) -> tuple[Left | None, Weights]:
    """Return the synapses that a lesion leaves, or None for all, and their weights."""
    if lesion != "cut":
        return None, weights
    rng = np.random.default_rng([seed, 11])
    left = {name: rng.random(ONTO_MOTORS[name]) >= CUT for name in ONTO_MOTORS if name in weights}
    return left, weights | {name: weights[name][each.ravel()] for name, each in left.items()}


def common_and_difference(weights: Weights, left: Left | None) -> tuple[float, float]:
    """Return the mean of all weights of `loop.yaml` onto the motors, and half of right motor less wrong motor, pA."""
    common, difference = [], []
    for name in ("columns_motors_x", "rows_motors_y"):
        fields, motors = ONTO_MOTORS[name]
        if left is None:
            onto = weights[name].reshape(fields, -1, motors).mean(1)
        else:
            onto = np.full((fields, motors), np.nan)
            onto[left[name]] = weights[name]
        half, middle = (onto[:, 0] - onto[:, 1]) / 2.0, fields // 2
        common.append(np.nanmean(onto))
        difference.append((np.nanmean(half[middle + 1 :]) - np.nanmean(half[:middle])) / 2.0)
    return float(np.mean(common)), float(np.mean(difference))


class Noted(DroneEnv):
    """The world, which notes the time of the network, ms, and the error of the x axis, px, after each control step."""

    def __init__(self) -> None:
        super().__init__("B60")
        self.loop: neuro.ClosedLoop | None = None
        self.notes: list[tuple[float, float]] = []

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """See `DroneEnv`."""
        result = super().step(action)
        if self.loop is not None:
            self.notes.append((self.loop.sim.time, result[4]["error"][0]))
        return result


def links(env: Noted) -> str:
    """Return the links from the error to dopamine in the present block of steps: x axis, one value a control step.

    These are the mean rate of a reward neuron by distance of the ball, the correlation of the critic's rate with the
    reward's, and mean and spread of the dopaminergic neurons' rate.
    """
    assert env.loop is not None
    ends, errors = np.array(env.notes).T
    begin = np.flatnonzero(np.diff(ends, prepend=np.inf) < 0)[-1]  # time is that of the block, which begins anew
    ends, distance = ends[begin:], np.abs(errors[begin:])
    rates = []
    for name in ("reward_x", "critic_x", "snc_x"):
        times = np.sort(env.loop.sim.spikes(name)[0])
        counts = np.searchsorted(times, ends, "right") - np.searchsorted(times, ends - STEP, "right")
        rates.append(counts / 20 / STEP * 1000.0)
    reward, critic, snc = rates
    bins = [(low, high, reward[(low <= distance) & (distance < high)]) for low, high in itertools.pairwise(EDGES)]
    by_distance = ", ".join(f"{low} to {high} px {part.mean():.0f}" for low, high, part in bins if part.size)
    dopamine = f"snc {snc.mean():.1f} +- {snc.std():.1f} Hz"
    return (
        f"reward by distance, Hz: {by_distance}; critic with reward {np.corrcoef(critic, reward)[0, 1]:.2f}; {dopamine}"
    )


def main() -> None:
    """Train, fly and print a row for each control and seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--backend", default="event")
    parser.add_argument("--only", nargs="+", default=["loop"], choices=CONTROLS)
    parser.add_argument("--curve", type=int, default=None)
    parser.add_argument("--lesions", nargs="+", default=[], choices=LESIONS)
    parser.add_argument("--repair", type=int, default=60_000)
    parser.add_argument("--chips", nargs="+", default=[])
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE")
    parser.add_argument("--links", action="store_true")
    parser.add_argument("--json", type=Path, default=None)
    args = parser.parse_args()
    parameters = {name: float(value) for name, value in (one.split("=") for one in args.set)}
    rows = []

    def tell(loop: neuro.ClosedLoop, control: str, seed: int, lesion: str = "none", left: Left | None = None) -> None:
        quiet = parameters if control == EXACT else parameters | {"babble": 0.0}
        change = LESIONS.get(lesion, {})
        test, bills = fly(network(control, left, **quiet), loop.pilot.weights, args.starts, args.chips, **change)
        row = {"control": control, "seed": seed, "lesion": lesion, "steps": loop.steps}
        rows.append(row | {"px": test.error_px, "laps": test.laps})
        figures = f"{test.error_px:.2f} px, {test.laps} of {test.starts} laps"
        if control != EXACT:
            common, difference = common_and_difference(loop.pilot.weights, left)
            rows[-1] |= {"common": common, "difference": difference}
            figures += f", weights {common:.0f} common and {difference:.0f} difference"
        print(f"{control}, seed {seed}, lesion {lesion}, {loop.steps:,} steps: {figures}", flush=True)
        for bill in [*(f"learning, {joules(loop, chip)}" for chip in args.chips if loop.steps), *bills]:
            print(f"  {bill}", flush=True)
        if args.json is not None:
            args.json.write_text(json.dumps(rows, indent=1))

    for control in args.only:
        if control == PID:
            test, _ = fly_laps(partial(loop_of, Pid()), args.starts)
            print(f"pid: {test.error_px:.2f} px, {test.laps} of {test.starts} laps", flush=True)
            continue
        for seed in args.seeds:
            env = Noted()
            world = gymnasium.wrappers.TimeLimit(env, EPISODE) if args.links else None
            noting = {"record": True, "block": BLOCK} if args.links else {}
            net = network(control, **parameters)
            loop = env.loop = neuro.closed_loop(net, world, seed=seed, backend=args.backend, **noting)
            for steps in range(args.curve or args.steps, args.steps + 1, args.curve or args.steps):
                loop.run(steps=steps)
                tell(loop, control, seed)
                if args.links:
                    print(f"  {links(env)}", flush=True)
            for lesion in args.lesions:
                left, weights = damaged(lesion, control, loop.pilot.weights, seed)
                env = gymnasium.wrappers.TimeLimit(DroneEnv("B60", **LESIONS[lesion]), EPISODE)
                hurt = neuro.closed_loop(network(control, left, **parameters), env, seed=seed, backend=args.backend)
                hurt.pilot.put({"learnt": weights})
                tell(hurt, control, seed, lesion, left)
                for steps in range(args.curve or args.repair, args.repair + 1, args.curve or args.repair):
                    hurt.run(steps=steps)
                    tell(hurt, control, seed, lesion, left)


if __name__ == "__main__":
    main()
