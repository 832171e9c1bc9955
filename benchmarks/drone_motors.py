"""Controllers that follow the ball with motors that are mirrored, turned and of unknown gain.

    python benchmarks/drone_motors.py [--motors 25] [--first 101] [--steps 60000] [--only NAME ...] [--roll] [--change]
        [--json FILE]

Motors are drawn for each number from --first on: mirrored or not, turned by any angle, with a gain of 0.5 to 2. With
--roll the camera is turned by any angle, too. Controllers that learn get the same number of control steps for all
motors. Then all controllers fly the same 9 laps with frozen weights, from the starts and on the paths of the test. With
--change the gain doubles or halves in the middle of each lap. The spiking agent and its twin see the mean place of the
events, as `centroid` does, and their last commands. The figure is the mean distance of the ball from the middle, px. A
lap in which the ball is lost counts as LOST px.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from neuro_agent import ActorCritic, LinearTwin
from neuro_drone.controllers.pilot import loop_of
from neuro_drone.controllers.simple import centroid
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Flights, Start, fly_lap, grid, reset_arguments
from neuro_drone.model import Model
from neuro_drone.scenario import Scenario, load
from neuro_drone.train import train

Floats = npt.NDArray[np.float64]
LOST, BOUND = 64.0, 2.5
AGENT = {
    "levels": 2,
    "circuits": 8,
    "fields": 8,
    "discount": 0.9,
    "decay": 0.8,
    "reward_scale": 0.3,
    "actor_rate": 4.0,
    "sharpness": 2.0,
}
"""Settings of the spiking agent and its twin, chosen on motors 1 to 12."""
EPISODE = 100
"""Largest number of control steps of an episode of training, as in `neuro_drone.train`.

With short episodes, many episodes begin far from the middle.
"""
KEPT = 0.6
"""Share of a command that is left in the next control step. The drone keeps about the same share of its speed."""
HALF = 1000
"""Number of control steps of half a lap."""


class Pid:
    """A PID controller on the mean place of the events. Its gains were chosen by hand with unchanged motors."""

    def __init__(self, p: float = 3.0, i: float = 0.05, d: float = 0.0) -> None:
        self._gains = p, i, d

    def begin(self) -> None:
        """Forget the last lap."""
        self._sum, self._last = np.zeros(2), np.zeros(2)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the command of a control step."""
        p, i, d = self._gains
        error = centroid(counts)
        self._sum, change = np.clip(self._sum + error, -1.0, 1.0), error - self._last
        self._last = error
        return np.clip(p * error + i * self._sum + d * change, -1.0, 1.0)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Do nothing, because the controller does not learn."""


class Calibrated:
    """Adaptive control by the inverse of a 2 x 2 matrix, which says how commands move the events.

    The matrix is fitted by least squares, without reward or supervised error.
    """

    def __init__(self, rate: float = 0.1, held: int = 5) -> None:
        self._rate, self._held = rate, held

    def calibrate(self, world: Scenario, seed: int, steps: int) -> Calibrated:
        """Give random commands, each for some control steps, and fit the matrix to the moves of the events."""
        env, rng, over = DroneEnv(world), np.random.default_rng([seed, 8]), True
        commands, moves = [], []
        for k in range(steps // self._held):
            if over or k % (EPISODE // self._held) == 0:
                _, info = env.reset(seed=int(rng.integers(2**31)))
                seen, command = centroid(info["counts"]), np.zeros(2)
            before, last, command, over = seen, command, rng.uniform(-1.0, 1.0, 2), False
            for _ in range(self._held):
                if not over:
                    _, _, ended, cut, info = env.step(command)
                    over, seen = ended or cut, centroid(info["counts"]) if info["counts"].any() else seen
            if not over:
                commands.append(np.concatenate([command, last]))
                moves.append(seen - before)
        moved = np.linalg.lstsq(np.array(commands), np.array(moves), rcond=None)[0]
        self._steers = -self._rate * np.linalg.inv((moved[:2] + moved[2:]).T / self._held)
        return self

    def begin(self) -> None:
        """Do nothing, because the controller stores nothing about a lap."""

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the command that moves the events towards the middle by a share of their distance in each step."""
        return np.clip(self._steers @ centroid(counts), -1.0, 1.0)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Do nothing, because the controller is frozen."""


class Senses:
    """The observation of the agent: place of the events, finer near the middle, and mean of its last commands."""

    def __init__(self) -> None:
        self.place, self.commands = np.zeros(2), np.zeros(2)

    def see(self, counts: npt.NDArray[Any], command: Floats) -> Floats:
        """Return the observation of a control step. Without events the last place stays."""
        at = centroid(counts)
        self.place = np.sign(at) * np.sqrt(np.abs(at)) if counts.any() else self.place
        self.commands = KEPT * self.commands + (1.0 - KEPT) * command
        return np.clip(np.concatenate([self.place, self.commands]), -1.0, 1.0)


class Seen(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The drone's environment as the agent sees it. The reward is the decrease of the root of the distance."""

    def __init__(self, env: DroneEnv) -> None:
        super().__init__(env)
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        _, info = self.env.reset(seed=seed, options=options)
        self._senses, self._root, self._steps = Senses(), root(info), 0
        return self._senses.see(info["counts"], np.zeros(2)), info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make a control step."""
        _, _, ended, cut, info = self.env.step(action)
        before, self._root = self._root, root(info)
        self._steps += 1
        seen = self._senses.see(info["counts"], action)
        return seen, before - self._root, ended, cut or self._steps == EPISODE, info


def root(info: Mapping[str, Any]) -> float:
    """Return the root of the distance of the ball, which is 1 at LOST px."""
    return float(np.sqrt(min(1.0, info["error_px"] / LOST)))


class Flies:
    """A controller of the drone by a frozen agent."""

    def __init__(self, agent: ActorCritic) -> None:
        self._agent, self._frozen = agent, agent.frozen(1)

    def begin(self) -> None:
        """Forget the last lap."""
        self._senses, self._command = Senses(), np.zeros(2)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the command of a control step."""
        seen = self._senses.see(counts, self._command)
        self._command = self._agent.actions.of(self._frozen.decide(seen[None]))[0]
        return self._command

    def learn(self, info: Mapping[str, Any]) -> None:
        """Do nothing, because the controller is frozen."""


def motors(number: int) -> dict[str, Any]:
    """Return the motors of a number, as settings of a scenario."""
    rng = np.random.default_rng([number, 7])
    mirror, angle, gain = bool(rng.integers(2)), float(rng.uniform(-180.0, 180.0)), float(2.0 ** rng.uniform(-1.0, 1.0))
    return {"mirror": mirror, "angle": round(angle, 1), "gain": round(gain, 3)}


def turned(number: int) -> float:
    """Return the angle in degrees by which the camera of a number is turned."""
    return round(float(np.random.default_rng([number, 9]).uniform(-180.0, 180.0)), 1)


class Changing(Flights):
    """Laps in which the gain of the motors changes by a factor in the middle."""

    def __init__(self, world: Scenario, factor: float, starts: Sequence[Start]) -> None:
        super().__init__(world, [reset_arguments(start, index) for index, start in enumerate(starts)])
        self._before, self._after = world, load(world, motors={"gain": world.motors.gain * factor})

    def reset(self, **words: Any) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        self.scenario, self._flown = self._before, 0
        return super().reset(**words)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make a control step."""
        self._flown += 1
        if self._flown == HALF:
            self.scenario = self._after
        return super().step(action)


def controller(name: str, world: Scenario, seed: int, steps: int) -> Any:
    """Return a controller or a model. If it learns, it has learnt for a number of steps."""
    if name == "pid":
        return Pid()
    if name == "calibrated":
        return Calibrated().calibrate(world, seed, steps)
    if name in ("agent", "twin"):
        env = Seen(DroneEnv(world))
        kind = ActorCritic if name == "agent" else LinearTwin
        agent = kind(env.observation_space, env.action_space, seed=seed, **AGENT)
        agent.train(env, steps=steps)
        return Flies(agent)
    return train(world, name, steps=steps, seed=seed)


def error_px(name: str, world: Scenario, seed: int, steps: int, change: bool) -> float:
    """Return the mean distance of the ball from the middle in the laps of the test, px."""
    flies = controller(name, world, seed, steps)
    starts = grid(world, 3)
    env = Changing(world, (2.0 if seed % 2 else 0.5) if change else 1.0, starts)
    loop = flies.loop(env) if isinstance(flies, Model) else loop_of(flies, env)
    laps = [fly_lap(loop, env, start) for start in starts]
    return float(np.mean([LOST if lap.lost else lap.error_px for lap in laps]))


def main() -> None:
    """Fly all controllers. Print a line for each number of motors, then a line for each controller, the best first."""
    names = ("centroid", "pid", "lms", "snn", "agent", "twin", "random-search", "calibrated")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motors", type=int, default=25)
    parser.add_argument("--first", type=int, default=101)
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--only", nargs="+", choices=names, default=list(names))
    parser.add_argument("--roll", action="store_true")
    parser.add_argument("--change", action="store_true")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    found: dict[str, list[float]] = {name: [] for name in given.only}
    for number in range(given.first, given.first + given.motors):
        world = load("B60", motors=motors(number), camera={"roll": turned(number) if given.roll else 0.0})
        for name, each in found.items():
            each.append(error_px(name, world, number, given.steps, given.change))
        print(number, motors(number), {name: round(each[-1], 2) for name, each in found.items()}, flush=True)
        if given.json:
            given.json.write_text(json.dumps(found, indent=1))
    for name, each in sorted(found.items(), key=lambda one: float(np.mean(one[1]))):
        good = sum(px <= BOUND for px in each)
        print(f"{name}: mean {np.mean(each):.2f} px, worst {max(each):.2f}, at most {BOUND} px {good} of {len(each)}")


if __name__ == "__main__":
    main()
