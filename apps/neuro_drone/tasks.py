"""The tasks: to follow a ball or a line. A task sets the start, moves the target, and judges the drone by geometry."""

from __future__ import annotations

from functools import lru_cache
from math import atan2, copysign, cos, degrees, hypot, inf, pi, radians, sin, sqrt, tan
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_drone.geometry import AIM, CameraView, Pose, WorldScene
from neuro_drone.parts import GRAVITY, Ball, Line
from neuro_drone.paths import FIXED, Path, Variation, hexagon, star

FARTHEST = 64.5
"""Largest error inside the picture, px: from the aim to the right or the lower border."""

LARGEST_ERROR = 20.0
"""Largest mean distance of the target from the aim in a lap that counts, px."""

NEARER = 0.75
"""Largest mean error of a lap that counts, as a share of the mean error of a drone that does not follow."""


def border(error: tuple[float, ...]) -> tuple[float, float]:
    """Return a column and a row just outside the picture, px, for a target behind the camera, which has no projection.

    Args:
        error: the last error, px. Its signs choose the side of the picture.
    """
    u, v = error[:2]
    return AIM + copysign(FARTHEST, u), AIM + copysign(FARTHEST, v)


class Judged(NamedTuple):
    """The judgement of a drone: the state of the task after a step.

    Attributes:
        target: column and row of the target, px; for a target behind the camera, the border on its last side.
        error: signed error on each axis. Ball: px and px, with three axes also the excess height of its picture, px.
            Line: px and degrees.
        scaled: error on each axis as a share of the largest error. The third axis is a share of the target height.
        error_px: Ball: distance of the target from the aim, px. Line: horizontal distance to the line, px.
        reward: 1 - e / e_max, 0 to 1.
        progress: share of the lap, 0 to 1.
        lost: True if the target is outside the picture.
        done: True if the lap is over.
        lap: True if the lap is over and counts.
    """

    target: tuple[float, float]
    error: tuple[float, ...]
    scaled: tuple[float, ...]
    error_px: float
    reward: float
    progress: float
    lost: bool
    done: bool
    lap: bool


class Task(Protocol):
    """A target to follow.

    Attributes:
        forward: constant forward speed of the drone in this episode, m/s.
        turns: True if the second action turns the drone, False if it moves the drone backwards.
        path: path of the target in this episode.
    """

    forward: float
    turns: bool
    path: Path

    def reset(
        self,
        rng: np.random.Generator,
        start: tuple[float, ...] | None = None,
        direction: int = 0,
        varied: Variation = FIXED,
    ) -> Pose:
        """Begin an episode.

        Args:
            rng: random generator of the start and the direction.
            start: initial error on each axis, in the units of `Judged.error`; None draws one.
            direction: 1 anticlockwise, -1 clockwise, 0 uses the scenario's.
            varied: variation of the scenario's path in this episode.

        Returns:
            The level pose of the drone.

        Raises:
            ModelError: no pose of the drone has this initial error.
        """

    def scene(self) -> WorldScene:
        """Return the current objects on the ground."""

    def advance(self, seconds: float) -> WorldScene:
        """Advance the target in time and return the objects on the ground."""

    def judge(self, view: CameraView, pose: Pose) -> Judged:
        """Judge the drone. Call once after each `advance`.

        Args:
            view: the camera.
            pose: pose of the drone.
        """


# Constants of `BallTask`.
PIECES = 100
"""Number of pieces of the path."""
NEAR = 0.05
"""Largest distance of the aim from a covered piece, as a share of the lap's length."""
WINDOW = 10
"""Pieces before and behind the ball that can be covered."""
COVERED = 0.8
"""Least share of covered pieces."""
SPREAD = 50.0
"""Largest initial error on each axis, px."""
TRIES = 1000
"""Largest number of draws of a start."""
FARTHEST_START = 10.0
"""Largest horizontal distance between ball and drone at the start, in heights of the drone."""
TALL_SPREAD = 0.4
"""Largest initial error of the picture's height, as a share of the target height."""
TALLEST = 2.0
"""Factor on the target height at which the ball is lost. At its inverse, the ball is lost, too."""
TALL_ERROR = 0.15
"""Largest mean error of the picture's height in a lap that counts, as a share of the target height."""
E_MAX = hypot(FARTHEST, FARTHEST)
"""Error with reward 0, px."""


class BallTask:
    """A ball on the star, and a drone that moves in x and y, with three axes also in z.

    A lap counts if

    - the ball completes the path without leaving the picture,
    - the mean error after the first tenth is at most 20 px,
    - at least 80 of 100 equal pieces of the path are covered. The aim is the point at the ball's height where the
      camera looks. A piece is covered if the distance of the aim from the piece is at most 5 % of the lap's length
      while the ball is at most 10 pieces away,
    - after the first tenth, the mean distance of the aim from the ball is at most 3/4 of the distance for a camera that
      hovers over the centre of the star,
    - with three axes: after the first tenth, the height of the ball's picture differs from the target height by at most
      15 % on average. The ball is also lost if its picture has half or twice the target height. The reward is the mean
      of the rewards for position and for size.

    A camera that hovers anywhere fails the third condition. A camera that flies independently of the ball fails the
    fourth condition: averaged over the ball's positions, a camera over the centre is nearest. On the fixed path, a
    replayed flight that starts near the ball counts without the camera, so tests vary the path.

    Args:
        ball: path, speed and size of the ball.
        view: the drone's camera.
        height: height of the drone, m.

    Source: thesis, section 7.3.1.3 and equation 130.
    """

    forward = 0.0
    turns = False

    def __init__(self, ball: Ball, view: CameraView, height: float) -> None:
        self.ball, self.view, self.height = ball, view, height
        self._begin(FIXED)

    def _begin(self, varied: Variation) -> None:
        self.path, self._pieces, self._hover_distance = _ball_path(self.ball.lap, varied)
        self._speed, self._first = self.ball.speed * varied.speed, varied.begin * self.path.length
        self.way, self._error_sum, self._distance_sum, self._deviation_sum, self._count = 0.0, 0.0, 0.0, 0.0, 0
        self._last = (0.0, 0.0)
        self._time = 0.0
        self._place_ball()
        self._aims: list[tuple[float, float, float]] = []

    def _place_ball(self) -> None:
        """Update the ball's position and radius."""
        (x, y), (z, radius) = self.path.at(self._first + self.way), hop(self.ball, self._time)
        self._place = x, y, z, radius

    def reset(
        self,
        rng: np.random.Generator,
        start: tuple[float, ...] | None = None,
        direction: int = 0,
        varied: Variation = FIXED,
    ) -> Pose:
        """See `Task`; the start is in px, the heading is 0."""
        self._begin(varied)
        self.view.look(Pose(0.0, 0.0, self.height))
        offset = self._draw_start(rng) if start is None else self._offset(*start)
        if offset is None:
            place = ", ".join(f"{number:g}" for number in start or ())
            sizes = " and a ball from half to twice its target height" if self.ball.axes == 3 else ""
            raise ModelError(f"start [{place}] px: expected a point of the picture below the horizon{sizes}")
        return Pose(self._place[0] - offset[0], self._place[1] - offset[1], offset[2])

    def _draw_start(self, rng: np.random.Generator) -> tuple[float, float, float]:
        """Draw errors within 50 px on both axes until the ball is well below the horizon, and return the offset.

        With three axes, the height of the ball's picture is also up to 40 % too large or too small.
        """
        for _ in range(TRIES):
            error = rng.uniform(-SPREAD, SPREAD, 2).tolist()
            if self.ball.axes == 3:
                error.append(self.ball.tall * rng.uniform(-TALL_SPREAD, TALL_SPREAD))
            offset = self._offset(*error)
            if offset is not None and hypot(*offset[:2]) <= FARTHEST_START * self.height:
                return offset
        raise ModelError("camera: all starts within 50 px are near the horizon", hint="tilt it further down")

    def _offset(self, du: float, dv: float, tall: float = 0.0) -> tuple[float, float, float] | None:
        """Return the ball's x and y relative to the drone, and the drone's height, m; None if no pose has the error.

        Args:
            du: error in columns, px.
            dv: error in rows, px.
            tall: error of the height of the ball's picture, px.
        """
        u, v, ball = AIM + du, AIM + dv, self.ball
        if not self.view.sees(u, v):
            return None
        if ball.axes == 2:
            place = self.view.ground(u, v, ball.radius)
            return None if place is None else (*place, self.height)
        dx, dy, dz = self.view.ray(u, v)
        tall += ball.tall
        if dz >= 0.0 or not self._right_size(tall):
            return None
        depth = self.view.depth_of(v, ball.radius, tall)
        return depth * dx, depth * dy, ball.radius - depth * dz

    def _right_size(self, tall: float) -> bool:
        return self.ball.tall / TALLEST < tall < self.ball.tall * TALLEST

    def scene(self) -> WorldScene:
        """See `Task`."""
        return WorldScene(self._place)

    def advance(self, seconds: float) -> WorldScene:
        """See `Task`."""
        self.way += self._speed * seconds
        self._time += seconds
        self._place_ball()
        return self.scene()

    def judge(self, view: CameraView, pose: Pose) -> Judged:
        """See `Task`."""
        x, y, z, _ = self._place
        u, v, depth = view.project(x, y, z)
        if depth <= 0.0:
            u, v = border(self._last)
        du, dv = self._last = (u - AIM, v - AIM)
        error, progress = hypot(du, dv), self.way / self.path.length
        lost = not view.sees(u, v)
        aim = view.ground(AIM, AIM, z)
        if aim is None:
            aim = inf, inf
        self._aims.append((self.way, *aim))
        errors: tuple[float, ...] = (du, dv)
        scaled: tuple[float, ...] = (max(-1.0, min(1.0, du / 64.0)), max(-1.0, min(1.0, dv / 64.0)))
        reward = 1.0 - error / E_MAX
        if self.ball.axes == 3:
            tall, target = view.tall(*self._place), self.ball.tall
            excess = min(tall, TALLEST * target) - target
            errors, scaled = (du, dv, excess), (*scaled, excess / target)
            reward = 0.5 * (reward + 1.0 - abs(excess) / target)
            lost = lost or not self._right_size(tall)
        if progress > 0.1:
            self._error_sum += error
            self._distance_sum += hypot(aim[0] - x, aim[1] - y)
            self._deviation_sum += abs(scaled[-1])
            self._count += 1
        is_complete = progress >= 1.0 - 1e-9
        lap = is_complete and not lost and self._follows()
        if lost:
            reward = 0.0
        return Judged((u, v), errors, scaled, error, reward, min(progress, 1.0), lost, is_complete, lap)

    def _follows(self) -> bool:
        is_near = self._distance_sum <= NEARER * self._hover_distance * self._count
        has_size = self.ball.axes == 2 or self._deviation_sum <= TALL_ERROR * self._count
        return is_near and has_size and self._error_sum <= LARGEST_ERROR * self._count and self.coverage() >= COVERED

    def coverage(self) -> float:
        """Return the share of the path's pieces that are covered so far."""
        if not self._aims:
            return 0.0
        aims = np.array(self._aims)
        piece = np.rint(aims[:, 0] * (PIECES / self.path.length)).astype(int)
        window = (piece[:, None] + np.arange(-WINDOW, WINDOW + 1)) % PIECES
        distances = np.hypot(*(self._pieces[window] - aims[:, None, 1:]).transpose(2, 0, 1))
        return len(np.unique(window[distances <= NEAR * self.path.length])) / PIECES


@lru_cache(maxsize=8)  # a training flies the same few paths all the time
def _ball_path(lap: float, varied: Variation) -> tuple[Path, npt.NDArray[Any], float]:
    """Return the ball's path, the points between pieces, (PIECES, 2), and the points' mean distance to the centre, m.

    Args:
        lap: length of the path without variation, m.
        varied: variation of the path.
    """
    path = star(lap).varied(varied)
    ends = np.arange(PIECES) * (path.length / PIECES)
    pieces = np.array([path.at(varied.begin * path.length + s) for s in ends])
    return path, pieces, float(np.hypot(*pieces.T).mean())


def hop(ball: Ball, time: float) -> tuple[float, float]:
    """Return the height of a ball's centre and its radius, m.

    The slow rise follows a cosine. Jumps are parabolas without loss of energy.

    Args:
        ball: the scenario's ball.
        time: time since the start of the episode, s. At 0 the ball lies on the ground and has the scenario's radius.
    """
    radius = height = ball.radius
    if ball.swell:
        radius = height = ball.radius * (1.0 + ball.swell * sin(2.0 * pi * time / ball.swell_time))
    if ball.rise:
        height += 0.5 * ball.rise * (1.0 - cos(2.0 * pi * time / ball.rise_time))
    if ball.bounce:
        share = time / sqrt(8.0 * ball.bounce / GRAVITY) % 1.0
        height += 4.0 * ball.bounce * share * (1.0 - share)
    return height, radius


SPREAD_PX = 35.0
SPREAD_DEGREES = 15.0
"""Largest initial errors at a line, px and degrees."""
ALONG = radians(45.0)
"""Largest deviation from a side's direction that counts as flight along the side, rad."""
SLOWEST = 1.5
"""Largest time of a lap, as a multiple of the time along the line."""
SIDES = 6
EVENLY = radians(15.0)
"""Mean deviation of the heading from the sides' directions if the heading turns at a constant rate, rad.

The deviation is 30 degrees at a corner and 0 in the middle of a side. The mean is therefore 15 degrees, a quarter of
the turn of 60 degrees at a corner. A stretched hexagon has a larger mean.
"""


class LineTask:
    """A hexagon on the ground, and a drone that flies forward, moves sideways and turns.

    The error is the column u where a side crosses row 63 of the picture, and the lean of the side there (clockwise from
    upright, in the picture). If several sides cross the row, the crossing nearest to column 63 counts. The line is lost
    if no side crosses the row inside the picture. e = (|u - 63| / 64.5 + |lean| / 90) / 2 and e_max = 1.

    Progress follows the point of the hexagon that is nearest to the camera's aim. Backward motion of this point is
    subtracted. Forward motion is added once the heading is within 45 degrees of the side's direction of travel, unless
    the point has moved by more than half a side in the meantime. A lap counts if

    - the progress is the whole hexagon, and the line was never lost,
    - the heading has turned by 360 +- 45 degrees from the first side, in the direction of travel,
    - after the first tenth, the line is on average at most 20 px from the middle,
    - after the first tenth, the heading deviates from the nearest side on average by at most 11.25 degrees. This is 3/4
      of 15 degrees, the deviation of a heading that turns at a constant rate.

    The lap of a constant action therefore does not count: its circle may stay within 5 px of the line, but fails the
    last condition. An episode ends without a lap after 1.5 times the time of a lap along the line.

    Args:
        line: path, speed and width of the line.
        view: the drone's camera.
        height: height of the drone, m.

    Source: thesis, sections 7.3.1.3 and 7.3.7.
    """

    turns = True

    def __init__(self, line: Line, view: CameraView, height: float) -> None:
        self.line, self.view, self.height = line, view, height
        self._begin(1, FIXED)

    def _begin(self, direction: int, varied: Variation) -> None:
        self.direction, self.forward = direction, self.line.speed * varied.speed
        self.path = hexagon(self.line.side, direction).varied(varied)
        self._scene = WorldScene(line=self.path.segments())
        self._first = 0.5 + varied.begin
        self._sides: list[list[float]] = self.path.segments().tolist()
        self._headings = [atan2(y1 - y0, x1 - x0) for x0, y0, x1, y1 in self._sides]
        self._place: float | None = None
        self._last = (0.0, 0.0)
        self.way = self.time = 0.0
        self._error_sum, self._deviation_sum, self._count = 0.0, 0.0, 0

    def reset(
        self,
        rng: np.random.Generator,
        start: tuple[float, ...] | None = None,
        direction: int = 0,
        varied: Variation = FIXED,
    ) -> Pose:
        """See `Task`; the start is in px and degrees, at the middle of the first side unless `varied` shifts it."""
        random_direction = int(rng.integers(2)) * 2 - 1
        shift, turn = rng.uniform(-1.0, 1.0, 2).tolist()
        direction = direction or self.line.direction or random_direction
        du, lean = (shift * SPREAD_PX, turn * SPREAD_DEGREES) if start is None else start[:2]
        self._begin(direction, varied)
        place = self._start(AIM + du, radians(lean)) if abs(lean) < 90.0 else None
        if place is None:
            raise ModelError(
                f"start [{du:g} px, {lean:g} degrees]: expected a column of the picture and a lean within 90 degrees"
            )
        x, y, yaw = place
        pose = Pose(x, y, self.height, yaw)
        if start is not None:
            self.view.look(pose)
            if abs(self._crossing(self.view)[0] - AIM - du) > 1e-3:
                raise ModelError(f"start [{du:g} px, {lean:g} degrees]: another side of the hexagon is nearer there")
        return pose

    def _start(self, u: float, lean: float) -> tuple[float, float, float] | None:
        """Return x, y and yaw at which the first side crosses row 63 at a column with a lean; None if no pose does.

        Args:
            u: the column, px.
            lean: the lean, rad.
        """
        view = self.view
        view.look(Pose(0.0, 0.0, self.height))
        point = view.ground(u, AIM) if view.sees(u, AIM) else None
        next_point = view.ground(u + 0.5 * tan(lean), AIM - 0.5)
        if point is None or next_point is None:
            return None
        yaw = self._headings[0] - atan2(next_point[1] - point[1], next_point[0] - point[0])
        x0, y0, x1, y1 = self._sides[0]
        c, s = cos(yaw), sin(yaw)
        share, remaining_share = self._first, 1.0 - self._first
        x = remaining_share * x0 + share * x1 - (point[0] * c - point[1] * s)
        y = remaining_share * y0 + share * y1 - (point[0] * s + point[1] * c)
        return x, y, yaw

    def scene(self) -> WorldScene:
        """See `Task`."""
        return self._scene

    def advance(self, seconds: float) -> WorldScene:
        """See `Task`; the line stays where it is."""
        self.time += seconds
        return self._scene

    def judge(self, view: CameraView, pose: Pose) -> Judged:
        """See `Task`."""
        u, lean = self._crossing(view)
        if u == inf:
            (u, _), lean = border(self._last), self._last[1]
        lost = not view.sees(u, AIM)
        deviation = self._update_progress(view, pose.yaw)
        progress = max(0.0, min(1.0, self.way / SIDES))
        du, _ = self._last = (u - AIM, lean)
        if progress > 0.1:
            self._error_sum += abs(du)
            self._deviation_sum += abs(deviation)
            self._count += 1
        rotation = (pose.yaw - self._headings[0]) * self.direction
        is_complete = self.way >= SIDES
        lap = is_complete and not lost and abs(rotation - 2.0 * pi) <= ALONG and self._follows()
        done = is_complete or self.time > SLOWEST * self.path.length / self.forward
        reward = 0.0 if lost else 1.0 - 0.5 * (abs(du) / FARTHEST + abs(lean) / 90.0)
        scaled = (max(-1.0, min(1.0, du / 64.0)), lean / 90.0)
        return Judged((u, AIM), (du, lean), scaled, abs(du), reward, progress, lost, done, lap)

    def _crossing(self, view: CameraView) -> tuple[float, float]:
        """Return the column nearest to 63 where a side crosses row 63, px, and the side's lean, degrees.

        The column is infinite if no side crosses the row.
        """
        # n is normal to all rays of the row, so the row contains the ground points whose dot product with n is 0.
        column, lean = inf, 0.0
        n, (px, py, pz) = view.row(AIM), view.place()
        base = n[0] * px + n[1] * py + n[2] * pz
        for x0, y0, x1, y1 in self._sides:
            a, b = n[0] * x0 + n[1] * y0 - base, n[0] * x1 + n[1] * y1 - base
            if (a > 0.0) == (b > 0.0):
                continue
            s = a / (a - b)
            x, y = x0 + s * (x1 - x0), y0 + s * (y1 - y0)
            u, v, depth = view.project(x, y, 0.0)
            if depth > 0.0 and abs(u - AIM) < abs(column - AIM):
                u1, v1, _ = view.project(x + 1e-3 * (x1 - x0), y + 1e-3 * (y1 - y0), 0.0)
                up = 1.0 if v1 < v else -1.0
                column, lean = u, degrees(atan2(up * (u1 - u), up * (v - v1)))
        return column, lean

    def _follows(self) -> bool:
        return self._error_sum <= LARGEST_ERROR * self._count and self._deviation_sum <= NEARER * EVENLY * self._count

    def _update_progress(self, view: CameraView, yaw: float) -> float:
        """Update the progress, and return the deviation of the heading from the nearest side's direction, rad."""
        aim = view.ground(AIM, AIM)
        if aim is None:
            return pi
        place, side = self._nearest(*aim)
        deviation = (yaw - self._headings[side] + pi) % (2.0 * pi) - pi
        if self._place is None:
            self._place = place
        change = (place - self._place + 0.5 * SIDES) % SIDES - 0.5 * SIDES
        leap = change > 0.5
        if change <= 0.0 or abs(deviation) <= ALONG or leap:  # else it is added once the heading is right again
            self.way += 0.0 if leap else change
            self._place = place
        return deviation

    def _nearest(self, x: float, y: float) -> tuple[float, int]:
        """Return the position on the hexagon nearest to x, y, in sides from the first corner, and the side's index.

        E.g. 2.5 and 2 for the middle of the third side.
        """
        smallest, place, side = inf, 0.0, 0
        for k, (x0, y0, x1, y1) in enumerate(self._sides):
            dx, dy = x1 - x0, y1 - y0
            s = ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy)
            s = 0.0 if s < 0.0 else 1.0 if s > 1.0 else s
            distance = hypot(x - x0 - s * dx, y - y0 - s * dy)
            if distance < smallest:
                smallest, place, side = distance, k + s, k
        return place, side
