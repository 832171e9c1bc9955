"""Testing: a lap from each of many starts, with frozen weights and without dopamine."""

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
"""Steps: a lap ends by itself."""


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


class Flights(DroneEnv):
    """Episodes that begin as they are told, one after the other, whatever the loop asks for.

    Args:
        scenario: of the world.
        begins: seed and options of each `reset`.

    Attributes:
        errors: of each episode after each step: the error on each axis, and its distance in px.
        last: what the environment said last in each episode.
    """

    def __init__(self, scenario: Scenario, begins: Iterable[tuple[int, dict[str, Any]]]) -> None:
        super().__init__(scenario)
        self._begins = iter(begins)
        self.errors: list[list[tuple[tuple[float, ...], float]]] = []
        self.last: list[dict[str, Any]] = []

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[npt.NDArray[Any], dict[str, Any]]:
        """Begin the next episode."""
        seed, options = next(self._begins)
        seen, info = super().reset(seed=seed, options=options)
        self.errors.append([])
        self.last.append(info)
        return seen, info

    def step(self, action: Any) -> tuple[npt.NDArray[Any], float, bool, bool, dict[str, Any]]:
        """See `DroneEnv`."""
        answer = super().step(action)
        self.last[-1] = info = answer[4]
        self.errors[-1].append((info["error"], info["error_px"]))
        return answer


def begun(start: Start, index: int = 0) -> tuple[int, dict[str, Any]]:
    """Seed and options with which a lap of the test begins whose noise has this index."""
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
    starts = grid(world) if starts is None else starts
    env = Flights(world, (begun(start, index) for index, start in enumerate(starts)))
    loop, each = model.loop(env, learns=learning, backend=backend, block=ENDLESS), []
    for start in starts:
        each.append(fly_lap(loop, env, start, learning))
        if report is not None:
            report(each[-1])
    env.close()
    return FlightTest(tuple(each), learning)


def fly_lap(loop: ClosedLoop, env: Flights, start: Start, learning: bool = False) -> Lap:
    """Fly the next lap of an environment, from time 0 of the controller.

    Args:
        loop: of the controller and the environment.
        env: that begins its next episode at `start`.
        start: for the record.
        learning: whether the loop learns.
    """
    if learning:
        loop.run(episodes=len(loop.log) + 1)
    else:
        loop.test(1, most=ENDLESS)
    errors, far = np.array([error for error, _ in env.errors[-1]]), [px for _, px in env.errors[-1]]
    lap, lost = bool(env.last[-1]["lap"]), bool(env.last[-1]["lost"])
    return Lap(start, len(far), float(np.mean(far)), _means(errors), _means(np.abs(errors)), lap, lost, errors)


def _means(values: Any) -> tuple[float, ...]:
    return tuple(np.mean(values, axis=0).tolist())
