"""Tests: one lap from each of many starts, with frozen weights and without dopamine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ClosedLoop, ModelError
from neuro_drone.env import DroneEnv
from neuro_drone.model import Model
from neuro_drone.parts import Ball, Line, check_whole
from neuro_drone.paths import FIXED, TESTS, VARIED, FlightCourse, Variation
from neuro_drone.scenario import Scenario

ENDLESS = 10**9
"""Limit of steps that no lap reaches."""


@dataclass(frozen=True, slots=True)
class Start:
    """The start of a lap.

    Attributes:
        error: initial error on each axis. Ball: px on both axes of the picture, then px of the ball's height if the
            drone climbs. Line: px, then degrees.
        direction: direction of the line, 1 anticlockwise or -1 clockwise; 0 for a ball.
        path: variation of the scenario's path.
    """

    error: tuple[float, ...]
    direction: int = 0
    path: Variation = FIXED

    def options(self) -> dict[str, Any]:
        """Return the options of the environment's `reset`."""
        return {"start": self.error, "path": self.path} | ({"direction": self.direction} if self.direction else {})


@dataclass(frozen=True, slots=True, eq=False)
class Lap:
    """The result of one start.

    Attributes:
        start: the start.
        steps: control steps of the flight.
        error_px: mean distance of the ball from the aim (thesis, eq. 130), or of the line from the middle, px.
        signed: mean error on each axis, as in the thesis, in the units of `Start.error`. Opposite signs cancel.
        absolute: mean absolute error on each axis, in the same units.
        lap: True if the drone completed a lap that counts.
        lost: True if the target was lost.
        track: (steps, axes), error after each step, in the units of `Start.error`.
    """

    start: Start
    steps: int
    error_px: float
    signed: tuple[float, ...]
    absolute: tuple[float, ...]
    lap: bool
    lost: bool
    track: npt.NDArray[np.float64] = field(repr=False)

    def as_words(self) -> dict[str, Any]:
        """Return the result as plain data, without the track."""
        start = {"start": list(self.start.error), "direction": self.start.direction, "path": asdict(self.start.path)}
        figures = {name: getattr(self, name) for name in ("steps", "error_px", "lap", "lost")}
        return start | figures | {"signed": list(self.signed), "absolute": list(self.absolute)}


@dataclass(frozen=True, slots=True, eq=False)
class FlightTest:
    """The results of all starts. All means are over the starts.

    Attributes:
        each: the result of each start.
        learning: True if the controller kept learning from the supervised error.
    """

    each: tuple[Lap, ...]
    learning: bool = False

    @property
    def starts(self) -> int:
        """Number of starts."""
        return len(self.each)

    @property
    def laps(self) -> int:
        """Number of laps that count."""
        return sum(result.lap for result in self.each)

    @property
    def error_px(self) -> float:
        """Mean error, px."""
        return float(np.mean([result.error_px for result in self.each]))

    @property
    def signed(self) -> tuple[float, ...]:
        """Mean signed error on each axis."""
        return _means([result.signed for result in self.each])

    @property
    def absolute(self) -> tuple[float, ...]:
        """Mean absolute error on each axis."""
        return _means([result.absolute for result in self.each])

    def as_words(self) -> dict[str, Any]:
        """Return all results as plain data, for JSON."""
        figures = {name: getattr(self, name) for name in ("error_px", "laps", "starts", "learning")}
        axes = {"signed": list(self.signed), "absolute": list(self.absolute)}
        return figures | axes | {"each": [result.as_words() for result in self.each]}


def grid(
    scenario: Scenario,
    n: int = 5,
    spread: float | tuple[float, float] | None = None,
    course: FlightCourse = VARIED,
) -> tuple[Start, ...]:
    """Return starts on a grid around the aim. The direction alternates along a line.

    If the drone climbs, the initial height of the ball's picture is by turns 30 % too large, 30 % too small, and right.

    Args:
        scenario: the scenario.
        n: starts on a side of the grid.
        spread: largest initial error: one number for both axes, or one per axis. Default: 35 px on both axes; for a
            line 20 px and 10 degrees.
        course: paths of the laps.

    Raises:
        ModelError: n is not a whole number >= 1, or the spread is negative.
    """
    line = isinstance(scenario.task, Line)
    check_whole("grid", n, 1)
    a, b = np.broadcast_to((20.0, 10.0) if line and spread is None else 35.0 if spread is None else spread, 2).tolist()
    if not (0 <= a < np.inf and 0 <= b < np.inf):
        raise ModelError(f"spread = {spread}: expected numbers >= 0")
    places = np.linspace(-1.0, 1.0, n).tolist() if n > 1 else [0.0]
    errors: list[tuple[float, ...]] = [(a * x, b * y) for y in places for x in places]
    if isinstance(scenario.task, Ball) and scenario.task.axes == 3:
        tall = (0.3 * scenario.task.tall, -0.3 * scenario.task.tall, 0.0)
        errors = [(*error, tall[i % 3]) for i, error in enumerate(errors)]
    paths = [course.lap(i, line) for i in range(n * n)]
    directions = [(1 - 2 * (i % 2)) if line else 0 for i in range(n * n)]
    return tuple(map(Start, errors, directions, paths))


class Flights(DroneEnv):
    """An environment that overrides the seed and the options of each reset, and records errors.

    Args:
        scenario: the scenario.
        begins: seed and options of each `reset`, in order.

    Attributes:
        errors: per episode, a list with one pair per step: the error on each axis, and `error_px`.
        last: the last `info` of each episode.
    """

    def __init__(self, scenario: Scenario, begins: Iterable[tuple[int, dict[str, Any]]]) -> None:
        super().__init__(scenario)
        self._begins = iter(begins)
        self.errors: list[list[tuple[tuple[float, ...], float]]] = []
        self.last: list[dict[str, Any]] = []

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[npt.NDArray[Any], dict[str, Any]]:
        """Begin the next episode; the arguments are ignored."""
        seed, options = next(self._begins)
        observation, info = super().reset(seed=seed, options=options)
        self.errors.append([])
        self.last.append(info)
        return observation, info

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """See `DroneEnv`."""
        result = super().step(action)
        self.last[-1] = info = result[4]
        self.errors[-1].append((info["error"], info["error_px"]))
        return result


def reset_arguments(start: Start, index: int = 0) -> tuple[int, dict[str, Any]]:
    """Return seed and options of the `reset` that begins a lap of a test.

    Args:
        start: start of the lap.
        index: number of the lap in the test, from which the seed of the noise follows.
    """
    return int(np.random.default_rng((TESTS, index)).integers(2**31)), start.options()


def try_out(
    model: Model,
    *,
    starts: Sequence[Start] | None = None,
    scenario: Scenario | None = None,
    backend: str = "event",
    learning: bool = False,
    report: Callable[[Lap], None] | None = None,
) -> FlightTest:
    """Fly one lap from each start.

    Args:
        model: the trained model.
        starts: starts of the laps; default the 5 x 5 grid with varied paths.
        scenario: scenario of the test; default the scenario of the training.
        backend: backend of the controller's network.
        learning: True keeps learning from the supervised error. The dopamine then also steers the drone, so the error
            differs from the error of the learnt weights.
        report: called after each lap.

    Raises:
        ModelError: a start is impossible, or the backend refuses the network.
    """
    world = scenario or model.scenario
    starts = grid(world) if starts is None else starts
    env = Flights(world, (reset_arguments(start, index) for index, start in enumerate(starts)))
    loop, results = model.loop(env, learns=learning, backend=backend, block=ENDLESS), []
    for start in starts:
        results.append(fly_lap(loop, env, start, learning))
        if report is not None:
            report(results[-1])
    env.close()
    return FlightTest(tuple(results), learning)


def fly_lap(loop: ClosedLoop, env: Flights, start: Start, learning: bool = False) -> Lap:
    """Fly the next lap of an environment, from time 0 of the controller.

    Args:
        loop: closed loop of the controller and the environment.
        env: environment whose next episode begins at `start`.
        start: start of the lap, for the result.
        learning: True if the loop learns.
    """
    if learning:
        loop.run(episodes=len(loop.log) + 1)
    else:
        loop.test(1, most=ENDLESS)
    errors, distances = np.array([error for error, _ in env.errors[-1]]), [px for _, px in env.errors[-1]]
    lap, lost = bool(env.last[-1]["lap"]), bool(env.last[-1]["lost"])
    mean_px = float(np.mean(distances))
    return Lap(start, len(distances), mean_px, _means(errors), _means(np.abs(errors)), lap, lost, errors)


def _means(values: Any) -> tuple[float, ...]:
    return tuple(np.mean(values, axis=0).tolist())
