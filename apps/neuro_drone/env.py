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
    """A drone with an event camera that shall keep a target at the middle of its picture.

    Args:
        scenario: a `Scenario`, the name of one, or a YAML file.
        observation: counts (events in 8 x 8 cells), binary (whether there were any), frame (128 x 128 x 1, each
            pixel's last event: 255 brighter, 0 darker, 128 none), or normalised (a vector of 64 floats from 0 to 1: the
            events of each cell, row by row, as a share of those of the cell with most).
        actions: continuous (two numbers in [-1, 1], three where the drone climbs) or discrete (one of nine, see
            `neuro_drone.env.ACTIONS`, or of the eleven of `SPACE`).
        render_mode: rgb_array or None.
        **changes: of the scenario, see `neuro_drone.scenario.load`.

    Actions are in the directions of the picture. Ball: right and down the picture (backwards), times v_max, and of
    three axes up, times climb_max. Line: right, times v_max, and turn right, times yaw_max, while the drone flies
    forward. Values beyond 1 are taken for 1.

    ``reset(options={"start": (a, b), "direction": 1})`` sets the error at the beginning, in the units of
    ``info["error"]``, and the direction of the line; what is not given is drawn. "path" is a
    `neuro_drone.paths.Variation` by which the path differs from the scenario's.

    ``info`` holds: events (`neuro.events.Events` of the step), counts ((8, 8) int64), target (column, row, px), error
    (signed, a number an axis: px and px, then px of the ball's height in the picture; line px and degrees), error_px
    (of the first two), supervised_error ((axes,) float64, the error as a share of the largest: a supervised signal,
    not the reward), reward and lost (as `step` returns them), progress (0 to 1), lap (True where a lap ended that
    counts).

    A camera that shakes is judged by where it would look without.

    The reward is 1 - e / e_max, 0 where the target is lost, which also terminates the episode; the end of the path
    truncates it.

    Raises:
        ModelError: the scenario, an option or an action cannot be.
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
        # what is judged is where the camera would look without its shake
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
        """Begin an episode; see the class for `options`."""
        if seed is None and self._np_random is None:
            seed = self.scenario.seed
        super().reset(seed=seed)
        start, direction, varied = _wishes(options or {}, self.task, self.scenario.axes)
        pose = self.task.reset(self.np_random, start or self.scenario.start, direction, varied)
        self.body.reset(pose.x, pose.y, pose.yaw, forward=self.task.forward, z=pose.z)
        noise = int(self.np_random.integers(2**31))
        self.eye.reset(noise)
        self.weather.reset(noise)
        self._t_us, self._running = 0, True
        observation, info, _ = self._look(self.task.scene())
        return observation, info

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """One step of control; see the class."""
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
        seen, info, judged = self._look(task.advance(self._seconds))
        terminated, truncated = judged.lost, judged.done and not judged.lost
        self._running = not (terminated or truncated)
        return seen, judged.reward, terminated, truncated, info

    def _look(self, scene: WorldScene) -> tuple[npt.NDArray[Any], dict[str, Any], Judged]:
        """What the camera and the judge see now."""
        pose = self.body.pose
        self._events = events = self.eye.see(pose, scene, self._t_us)
        if self._shakes:
            self.view.look(pose)
        judged = self.task.judge(self.view, pose)
        counts = np.zeros((CELLS, CELLS), np.int64)
        if len(events.x):
            self._count(events.x, events.y, 4, counts)
        info = {
            "events": events,
            "counts": counts,
            "target": judged.target,
            "error": judged.error,
            "error_px": judged.error_px,
            "supervised_error": np.array(judged.scaled),
            "reward": judged.reward,
            "lost": judged.lost,
            "progress": judged.progress,
            "lap": judged.lap,
        }
        return self._observed(counts, events), info, judged

    def _observed(self, counts: npt.NDArray[np.int64], events: Events) -> npt.NDArray[Any]:
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
        """The camera's picture with the step's events, (128, 128, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._events is None:
            raise ModelError("render: nothing was seen yet: call reset first")
        grey = np.clip(255.0 * self.eye.image, 0, 255).astype(np.uint8)
        picture = np.repeat(grey[:, :, None], 3, 2)
        e = self._events
        picture[e.y, e.x] = np.where(e.p[:, None] == 1, (0, 200, 0), (220, 0, 0))
        return picture

    def close(self) -> None:
        """Give back what the physics holds of the machine; `reset` begins again."""
        self._running = False
        self.body.close()


def _wishes(options: Mapping[str, Any], task: Task, axes: int) -> tuple[tuple[float, ...] | None, int, Variation]:
    """Start, direction and path that a reset asks for."""
    known = ("start", "direction", "path") if task.turns else ("start", "path")
    for word in options:
        if word not in known:
            raise unknown("option of reset", word, known)
    direction = options.get("direction", 0)
    if direction not in (-1, 0, 1):
        raise ModelError(f"option direction = {direction!r}: expected 1, -1 or 0")
    start, varied = options.get("start"), options.get("path", FIXED)
    if not isinstance(varied, Variation):
        raise ModelError(f"option path = {varied!r}: expected a neuro_drone.paths.Variation")
    return None if start is None else errors("option start", start, axes), int(direction), varied


def _one_of(name: str, value: object, known: tuple[object, ...]) -> None:
    if value not in known:
        raise ModelError(f"{name} = {value!r}: expected {' or '.join(str(one) for one in known)}")


@kernel
def count(x: npt.NDArray[Any], y: npt.NDArray[Any], shift: int, out: npt.NDArray[np.int64]) -> None:
    """Add the events at x, y (uint16, px) to out[y >> shift, x >> shift] (int64)."""
    for k in range(x.shape[0]):
        out[y[k] >> shift, x[k] >> shift] += 1


ACTIONS = (
    (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (0.0, 0.0),
)  # fmt: skip
"""Left, right, forward, backwards, northeast, northwest, southeast, southwest, nothing; forward is up the picture.

For the line "forward" (north) is turn left and "backwards" (south) turn right. Source: thesis, section 7.3.5.
"""

SPACE = (*((a, b, 0.0) for a, b in ACTIONS), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
"""The same of three axes, and then up and down."""

COUNTS = {2: "two", 3: "three"}
Commands = tuple[float, ...]


def continuous(action: Any, axes: int = 2) -> Commands:
    """A number an axis; what is beyond [-1, 1] is taken for the nearest of its ends, as a motor does.

    Raises:
        ModelError: not so many finite numbers.
    """
    try:
        said = [float(one) for one in (action.tolist() if isinstance(action, np.ndarray) else action)]
    except (TypeError, ValueError):
        said = []
    if len(said) != axes or not all(map(isfinite, said)):
        shown = f"[{', '.join(f'{one:g}' for one in said)}]" if len(said) == axes else _shown(action)
        raise ModelError(f"action {shown}: expected {COUNTS[axes]} numbers in [-1, 1]")
    return tuple([max(-1.0, min(1.0, one)) for one in said])


def discrete(action: Any, axes: int = 2) -> Commands:
    """One of the nine, of three axes of eleven.

    Raises:
        ModelError: not a whole number from 0 to 8, or 10.
    """
    known: Sequence[Commands] = ACTIONS if axes == 2 else SPACE
    try:
        number = index(action)
    except TypeError:
        number = -1
    if not 0 <= number < len(known):
        raise ModelError(f"action {_shown(action)}: expected a whole number from 0 to {len(known) - 1}")
    return known[number]


def model(kind: str, axes: int = 2) -> tuple[gymnasium.Space[Any], Callable[[Any], Commands]]:
    """The space of actions of a kind, continuous or discrete, and what turns one into commands.

    Args:
        kind: continuous or discrete.
        axes: 2, or 3 of a drone that also climbs.
    """
    if kind == "continuous":
        return gymnasium.spaces.Box(-1.0, 1.0, (axes,), np.float32), partial(continuous, axes=axes)
    return gymnasium.spaces.Discrete(len(ACTIONS if axes == 2 else SPACE)), partial(discrete, axes=axes)


def _shown(action: Any) -> str:
    shape = getattr(action, "shape", ())
    return f"of shape {list(shape)}" if shape else repr(action)


ROUNDING = 1e-6
"""s; a sum of steps may be a little less than the time that is meant."""


class Weather:
    """Wind with gusts, and a load that is taken up.

    Gusts on each axis are an Ornstein-Uhlenbeck process, solved exactly, so that their spread does not depend on how
    time is cut.

    Args:
        wind: of the scenario.
        load: of the scenario.

    Attributes:
        still: whether nothing ever changes.
        wind: x and y in the world, m/s, of the step that was begun last.
        load: kg, of that step.
    """

    def __init__(self, wind: Wind, load: Load) -> None:
        self._wind, self._load = wind, load
        self.still = not (wind.speed or wind.gust or load.mass)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """An episode begins.

        Args:
            seed: of the gusts.
        """
        self._rng = np.random.default_rng([seed, 3])
        self._time = 0.0
        self._gust = (0.0, 0.0)
        self.wind, self.load = (0.0, 0.0), 0.0

    def step(self, seconds: float) -> None:
        """Let time pass: `wind` and `load` are then those of this time, as at its beginning."""
        wind, load = self._wind, self._load
        now = self._time + ROUNDING
        self.load = load.mass if now >= load.since else 0.0
        if (wind.speed or wind.gust) and now >= wind.since:
            self._blow(seconds)
        self._time += seconds

    def _blow(self, seconds: float) -> None:
        wind, (x, y) = self._wind, self._gust
        if wind.gust:
            kept = exp(-seconds / wind.gust_time)
            fresh = self._rng.normal(0.0, wind.gust * sqrt(1.0 - kept * kept), 2).tolist()
            x, y = self._gust = (kept * x + fresh[0], kept * y + fresh[1])
        way = radians(wind.towards + wind.turning * (self._time - wind.since))
        self.wind = (wind.speed * cos(way) + x, wind.speed * sin(way) + y)
