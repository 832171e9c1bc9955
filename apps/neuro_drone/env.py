"""The drone, its camera and its task as a gymnasium environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import cos, exp, inf, isfinite, radians, sin, sqrt
from operator import index
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import kernel, unknown
from neuro_drone.body import Body, body_of
from neuro_drone.eye import Eye
from neuro_drone.geometry import CameraView, WorldScene
from neuro_drone.parts import Ball, Load, Motors, Wind
from neuro_drone.paths import FIXED, Variation
from neuro_drone.scenario import Scenario, errors, load
from neuro_drone.tasks import BallTask, Judged, LineTask, Task
from neuro_events import Events

CELLS = 8
OBSERVATIONS = ("counts", "binary", "frame", "normalised")
MOST_EVENTS = 2**20


class DroneEnv(gymnasium.Env[npt.NDArray[Any], Any]):
    """A drone with an event camera that keeps a target in the middle of its picture.

    Args:
        scenario: a `Scenario`, its name, or a YAML file.
        observation: counts (events in 8 x 8 cells), binary (1 for a cell with events), frame (128 x 128 x 1, each
            pixel's last event: 255 brighter, 0 darker, 128 none), or normalised (64 floats from 0 to 1: the events of
            each cell, row by row, divided by the largest number of events in a cell).
        actions: continuous (two numbers in [-1, 1], three if the drone climbs) or discrete (a number from 0 to 8, an
            index of `neuro_drone.env.ACTIONS`; from 0 to 10, an index of `SPACE`, if the drone climbs).
        render_mode: rgb_array or None.
        **changes: changes of the scenario, see `neuro_drone.scenario.load`.

    Actions follow the directions of the picture. Ball: right and down the picture (backwards), in units of v_max; with
    three axes also up, in units of climb_max. Line: right, in units of v_max, and turn right, in units of yaw_max; the
    drone flies forward at a constant speed. Actions are clipped to [-1, 1].

    ``reset(options={"start": (a, b), "direction": 1})`` sets the initial error, in the units of ``info["error"]``, and
    the direction of the line. Missing options are drawn. The option "path" is a `neuro_drone.paths.Variation` of the
    scenario's path.

    ``info`` holds:

    - events: `neuro.events.Events` of the step; counts: (8, 8) int64, the events in each cell.
    - target: column and row of the target, px.
    - error: signed, one number per axis. Ball: px, px, and px of its height in the picture. Line: px and degrees.
    - error_px: distance over the first two axes, for a line over the first, px.
    - supervised_error: (axes,) float64, the error as a share of the largest error: a supervised signal, not the reward.
    - reward and lost, as `step` returns them; progress of the lap, 0 to 1; lap, True if a lap that counts has ended.

    If the camera shakes, the errors are those of a camera without shake.

    The reward is 1 - e / e_max. A lost target has reward 0 and terminates the episode. The end of the path truncates
    the episode.

    Raises:
        ModelError: the scenario, an option or an action is invalid.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(
        self,
        scenario: Scenario | str | Path = "B60",
        *,
        observation: str = "counts",
        actions: str = "continuous",
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        self.scenario = scenario = load(scenario, **changes)
        _one_of("observation", observation, OBSERVATIONS)
        _one_of("actions", actions, ("continuous", "discrete"))
        _one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        self.observation, self.render_mode = observation, render_mode
        self.metadata = {**self.metadata, "render_fps": round(1000.0 / scenario.step)}
        bounds: dict[str, tuple[Any, ...]] = {
            "counts": (0, MOST_EVENTS, (CELLS, CELLS), np.int64),
            "binary": (0, 1, (CELLS, CELLS), np.uint8),
            "frame": (0, 255, (128, 128, 1), np.uint8),
            "normalised": (0.0, 1.0, (CELLS * CELLS,), np.float32),
        }
        self.observation_space = gymnasium.spaces.Box(*bounds[observation])
        self.action_space, self._commands = model(actions, scenario.axes)
        camera, drone = scenario.camera, scenario.drone
        level = CameraView(fov=camera.fov, tilt=camera.tilt, roll=camera.roll)
        self.task: Task
        if isinstance(scenario.task, Ball):
            self.task = BallTask(scenario.task, level, drone.height)
        else:
            self.task = LineTask(scenario.task, level, drone.height)
        self.body: Body = body_of(drone)
        self.weather = Weather(scenario.wind, scenario.load)
        self.eye = Eye(scenario, seed=0)
        # errors are measured with a camera that does not shake
        self._shakes = camera.shake > 0.0
        self.view = (
            CameraView(fov=camera.fov, tilt=camera.tilt, fixed=camera.mount == "body", roll=camera.roll)
            if self._shakes
            else self.eye.view
        )
        self._step_us, self._seconds = round(scenario.step * 1000.0), scenario.step / 1000.0
        self._t_us = 0
        self._motors_from_us = inf if scenario.motors == Motors() else round(scenario.motors.since * 1e6)
        self._running = False
        self._events: Events | None = None

        self._count = count

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[npt.NDArray[Any], dict[str, Any]]:
        """Begin an episode; the class describes `options`."""
        if seed is None and self._np_random is None:
            seed = self.scenario.seed
        super().reset(seed=seed)
        start, direction, variation = _reset_options(options or {}, self.task, self.scenario.axes)
        pose = self.task.reset(self.np_random, start or self.scenario.start, direction, variation)
        self.body.reset(pose.x, pose.y, pose.yaw, forward=self.task.forward, z=pose.z)
        noise = int(self.np_random.integers(2**31))
        self.eye.reset(noise)
        self.weather.reset(noise)
        self._t_us, self._running = 0, True
        observation, info, _ = self._look(self.task.scene())
        return observation, info

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Apply an action for one control step; the class describes actions and `info`."""
        if not self._running:
            raise ModelError("step: no episode is under way: call reset first")
        a, b, *up = self._commands(action)
        drone, task, weather = self.scenario.drone, self.task, self.weather
        if self._t_us >= self._motors_from_us:
            a, b = self.scenario.motors.flown(a, b)
        if not weather.still:
            weather.step(self._seconds)
            self.body.feel(weather.wind, weather.load)
        if task.turns:
            self.body.step(a * drone.v_max, task.forward, b * drone.yaw_max, self._seconds)
        else:
            climb = up[0] * drone.climb_max if up else None
            self.body.step(a * drone.v_max, -b * drone.v_max, -drone.spin, self._seconds, climb)
        self._t_us += self._step_us
        observation, info, state = self._look(task.advance(self._seconds))
        terminated, truncated = state.lost, state.done and not state.lost
        self._running = not (terminated or truncated)
        return observation, state.reward, terminated, truncated, info

    def _look(self, scene: WorldScene) -> tuple[npt.NDArray[Any], dict[str, Any], Judged]:
        """Take a picture and judge the drone. Return the observation, info and the state of the task."""
        pose = self.body.pose
        self._events = events = self.eye.see(pose, scene, self._t_us)
        if self._shakes:
            self.view.look(pose)
        state = self.task.judge(self.view, pose)
        counts = np.zeros((CELLS, CELLS), np.int64)
        if len(events.x):
            self._count(events.x, events.y, 4, counts)
        info = {
            "events": events,
            "counts": counts,
            "target": state.target,
            "error": state.error,
            "error_px": state.error_px,
            "supervised_error": np.array(state.scaled),
            "reward": state.reward,
            "lost": state.lost,
            "progress": state.progress,
            "lap": state.lap,
        }
        return self._observation(counts, events), info, state

    def _observation(self, counts: npt.NDArray[np.int64], events: Events) -> npt.NDArray[Any]:
        if self.observation == "counts":
            return counts.copy()
        if self.observation == "binary":
            return (counts > 0).astype(np.uint8)
        if self.observation == "normalised":
            return (counts / max(1, int(counts.max()))).astype(np.float32).ravel()
        frame = np.full((128, 128, 1), 128, np.uint8)
        frame[events.y, events.x, 0] = np.where(events.p, 255, 0)
        return frame

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return the camera's picture with the step's events, (128, 128, 3) uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        if self._events is None:
            raise ModelError("render: there is no picture yet: call reset first")
        grey = np.clip(255.0 * self.eye.image, 0, 255).astype(np.uint8)
        picture = np.repeat(grey[:, :, None], 3, 2)
        e = self._events
        picture[e.y, e.x] = np.where(e.p[:, None] == 1, (0, 200, 0), (220, 0, 0))
        return picture

    def close(self) -> None:
        """Release the physics engine; `reset` connects it again."""
        self._running = False
        self.body.close()


def _reset_options(
    options: Mapping[str, Any], task: Task, axes: int
) -> tuple[tuple[float, ...] | None, int, Variation]:
    """Check the options of a reset and return start, direction and path."""
    names = ("start", "direction", "path") if task.turns else ("start", "path")
    for name in options:
        if name not in names:
            raise unknown("option of reset", name, names)
    direction = options.get("direction", 0)
    if direction not in (-1, 0, 1):
        raise ModelError(f"option direction = {direction!r}: expected 1, -1 or 0")
    start, variation = options.get("start"), options.get("path", FIXED)
    if not isinstance(variation, Variation):
        raise ModelError(f"option path = {variation!r}: expected a neuro_drone.paths.Variation")
    return None if start is None else errors("option start", start, axes), int(direction), variation


def _one_of(name: str, value: object, choices: tuple[object, ...]) -> None:
    if value not in choices:
        raise ModelError(f"{name} = {value!r}: expected {' or '.join(map(str, choices))}")


@kernel
def count(x: npt.NDArray[Any], y: npt.NDArray[Any], shift: int, out: npt.NDArray[np.int64]) -> None:
    """Count the events at x, y (uint16, px) in cells of 2^shift px: out[y >> shift, x >> shift] (int64)."""
    for k in range(x.shape[0]):
        out[y[k] >> shift, x[k] >> shift] += 1


ACTIONS = (
    (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (0.0, 0.0),
)  # fmt: skip
"""Discrete actions: left, right, forward, backwards, northeast, northwest, southeast, southwest, none.

Forward is up the picture. Along a line, forward (north) turns left and backwards (south) turns right. Source: thesis,
section 7.3.5.
"""

SPACE = (*((a, b, 0.0) for a, b in ACTIONS), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
"""Discrete actions on three axes: those of `ACTIONS`, then up and down."""

COUNTS = {2: "two", 3: "three"}
Commands = tuple[float, ...]


def continuous(action: Any, axes: int = 2) -> Commands:
    """Return the commands of a continuous action, one number per axis, clipped to [-1, 1].

    Raises:
        ModelError: the action does not have `axes` finite numbers.
    """
    try:
        values = [float(number) for number in (action.tolist() if isinstance(action, np.ndarray) else action)]
    except (TypeError, ValueError):
        values = []
    if len(values) != axes or not all(map(isfinite, values)):
        text = f"[{', '.join(f'{number:g}' for number in values)}]" if len(values) == axes else _describe(action)
        raise ModelError(f"action {text}: expected {COUNTS[axes]} numbers in [-1, 1]")
    return tuple([max(-1.0, min(1.0, number)) for number in values])


def discrete(action: Any, axes: int = 2) -> Commands:
    """Return the commands of a discrete action.

    Raises:
        ModelError: the action is no whole number from 0 to 8, or to 10 with three axes.
    """
    commands: Sequence[Commands] = ACTIONS if axes == 2 else SPACE
    try:
        number = index(action)
    except TypeError:
        number = -1
    if not 0 <= number < len(commands):
        raise ModelError(f"action {_describe(action)}: expected a whole number from 0 to {len(commands) - 1}")
    return commands[number]


def model(kind: str, axes: int = 2) -> tuple[gymnasium.Space[Any], Callable[[Any], Commands]]:
    """Return the model of actions: the action space, and the function from an action to commands.

    Args:
        kind: continuous or discrete.
        axes: 2, or 3 for a drone that climbs.
    """
    if kind == "continuous":
        return gymnasium.spaces.Box(-1.0, 1.0, (axes,), np.float32), partial(continuous, axes=axes)
    return gymnasium.spaces.Discrete(len(ACTIONS if axes == 2 else SPACE)), partial(discrete, axes=axes)


def _describe(action: Any) -> str:
    shape = getattr(action, "shape", ())
    return f"of shape {list(shape)}" if shape else repr(action)


ROUNDING = 1e-6
"""Tolerance of times, s. A sum of steps may be slightly less than the exact time."""


class Weather:
    """Wind with gusts, and the load, which changes once in an episode.

    Gusts on each axis are an Ornstein-Uhlenbeck process. The solution is exact, so the standard deviation of the gusts
    does not depend on the step.

    Args:
        wind: the scenario's wind.
        load: the scenario's load.

    Attributes:
        still: True if there is neither wind nor a load.
        wind: x and y in the world during the current step, m/s.
        load: mass of the load during the current step, kg.
    """

    def __init__(self, wind: Wind, load: Load) -> None:
        self._wind, self._load = wind, load
        self.still = not (wind.speed or wind.gust or load.mass)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Begin an episode.

        Args:
            seed: seed of the gusts.
        """
        self._rng = np.random.default_rng([seed, 3])
        self._time = 0.0
        self._gust = (0.0, 0.0)
        self.wind, self.load = (0.0, 0.0), 0.0

    def step(self, seconds: float) -> None:
        """Set `wind` and `load` to their values at the beginning of a step, and advance the time by the step."""
        wind, load = self._wind, self._load
        deadline = self._time + ROUNDING
        self.load = load.mass if deadline >= load.since else 0.0
        if (wind.speed or wind.gust) and deadline >= wind.since:
            self._blow(seconds)
        self._time += seconds

    def _blow(self, seconds: float) -> None:
        wind, (x, y) = self._wind, self._gust
        if wind.gust:
            decay = exp(-seconds / wind.gust_time)
            noise = self._rng.normal(0.0, wind.gust * sqrt(1.0 - decay * decay), 2).tolist()
            x, y = self._gust = (decay * x + noise[0], decay * y + noise[1])
        direction = radians(wind.towards + wind.turning * (self._time - wind.since))
        self.wind = (wind.speed * cos(direction) + x, wind.speed * sin(direction) + y)
