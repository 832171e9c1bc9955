"""Testing: a lap from each of many starts, with frozen weights and without dopamine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_drone.controllers import Controller
from neuro_drone.env import DroneEnv
from neuro_drone.model import Model
from neuro_drone.parts import Ball, Line, check_whole
from neuro_drone.paths import FIXED, TESTS, VARIED, FlightCourse, Variation
from neuro_drone.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Start:
    """Where a lap begins.

    Attributes:
        error: on each axis: ball px and px, and px of its height in the picture; line px and degrees.
        direction: of the line, 1 anticlockwise or -1 clockwise; 0 for a ball.
        path: how it differs from the scenario's.
    """

    error: tuple[float, ...]
    direction: int = 0
    path: Variation = FIXED

    def options(self) -> dict[str, Any]:
        """For the environment's reset."""
        return {"start": self.error, "path": self.path} | ({"direction": self.direction} if self.direction else {})


@dataclass(frozen=True, slots=True, eq=False)
class Lap:
    """What came of a start.

    Attributes:
        start: of it.
        steps: that were flown.
        error_px: mean distance of the ball from the aim (thesis, eq. 130), or of the line from the middle.
        signed: mean error on each axis, as the thesis prints it: errors of both signs cancel.
        absolute: mean absolute error on each axis.
        lap: whether a lap was completed that counts.
        lost: whether the target was lost.
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
        """As plain data, without the track."""
        start = {"start": list(self.start.error), "direction": self.start.direction, "path": asdict(self.start.path)}
        figures = {name: getattr(self, name) for name in ("steps", "error_px", "lap", "lost")}
        return start | figures | {"signed": list(self.signed), "absolute": list(self.absolute)}


@dataclass(frozen=True, slots=True, eq=False)
class FlightTest:
    """What came of all starts; means are over starts.

    Attributes:
        each: by start.
        learning: whether the controller went on learning from the supervised error.
    """

    each: tuple[Lap, ...]
    learning: bool = False

    @property
    def starts(self) -> int:
        """How many there were."""
        return len(self.each)

    @property
    def laps(self) -> int:
        """How many laps were completed that count."""
        return sum(one.lap for one in self.each)

    @property
    def error_px(self) -> float:
        """Mean error."""
        return float(np.mean([one.error_px for one in self.each]))

    @property
    def signed(self) -> tuple[float, ...]:
        """Mean signed error on each axis."""
        return _means([one.signed for one in self.each])

    @property
    def absolute(self) -> tuple[float, ...]:
        """Mean absolute error on each axis."""
        return _means([one.absolute for one in self.each])

    def as_words(self) -> dict[str, Any]:
        """As plain data, for JSON."""
        figures = {name: getattr(self, name) for name in ("error_px", "laps", "starts", "learning")}
        axes = {"signed": list(self.signed), "absolute": list(self.absolute)}
        return figures | axes | {"each": [one.as_words() for one in self.each]}


def grid(
    scenario: Scenario,
    n: int = 5,
    spread: float | tuple[float, float] | None = None,
    course: FlightCourse = VARIED,
) -> tuple[Start, ...]:
    """Starts on a grid round the aim; those of a line alternate in direction.

    Where the drone climbs, the ball is in turn 30 % too small, as tall as wanted and 30 % too tall.

    Args:
        scenario: of a ball or a line.
        n: starts on a side.
        spread: largest error at the start, on both axes or on each; if not given 35 px, of a line 20 px and 10 degrees.
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
    ways = [course.lap(i, line) for i in range(n * n)]
    directions = [(1 - 2 * (i % 2)) if line else 0 for i in range(n * n)]
    return tuple(map(Start, errors, directions, ways))


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
        model: what was learnt.
        starts: the 5 x 5 grid with varied paths if not given.
        scenario: another one than that of the training.
        backend: what runs the controller's network.
        learning: go on learning from the supervised error. Dopamine then steers by itself: this figure is not what
            was learnt, and stands apart.
        report: called after each lap.

    Raises:
        ModelError: a start cannot be, or the backend refuses the network.
    """
    world = scenario or model.scenario
    controller = model.learner(scenario) if learning else model.frozen(scenario, backend)
    env = DroneEnv(world)
    each = []
    for index, start in enumerate(grid(world) if starts is None else starts):
        each.append(fly_lap(env, controller, start, index))
        if report is not None:
            report(each[-1])
    env.close()
    return FlightTest(tuple(each), learning)


def begin(env: DroneEnv, start: Start, index: int = 0) -> dict[str, Any]:
    """Begin a lap whose noise is that of the test with this index; gives the environment's info."""
    seed = int(np.random.default_rng((TESTS, index)).integers(2**31))
    return env.reset(seed=seed, options=start.options())[1]


def fly_lap(env: DroneEnv, controller: Controller, start: Start, index: int = 0) -> Lap:
    """Fly one lap.

    Args:
        env: the world.
        controller: what flies; it hears the supervised error, and learns if it can.
        start: where.
        index: of the noise, see `begin`.
    """
    track, far = [], 0.0
    for info in flown(env, controller, begin(env, start, index)):
        track.append(info["error"])
        far += info["error_px"]
    errors, lap, lost = np.array(track), bool(info["lap"]), bool(info["lost"])
    return Lap(start, len(track), far / len(track), _means(errors), _means(np.abs(errors)), lap, lost, errors)


def flown(env: DroneEnv, controller: Controller, info: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """What the environment tells after each step of an episode that has begun, to its end.

    Args:
        env: the world.
        controller: what flies; it hears of each step, and learns if it can.
        info: what `reset` gave.
    """
    controller.begin()
    over = False
    while not over:
        _, _, lost, end, info = env.step(controller.act(info["counts"], info))
        controller.learn(info)
        over = lost or end
        yield info


def _means(values: Any) -> tuple[float, ...]:
    return tuple(np.mean(values, axis=0).tolist())
