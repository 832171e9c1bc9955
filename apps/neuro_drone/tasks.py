"""Tasks, a ball and a line: each sets a start, moves the target, and judges by geometry, never by the picture."""

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
"""Largest error that is still in the picture, px: from the aim to the right or the lower border."""

LARGEST_ERROR = 20.0
"""Mean distance of a target from the aim with which a lap still counts, px."""

NEARER = 0.75
"""What a lap needs at most of the mean error that is to be had without following, as a share of it."""


def border(error: tuple[float, ...]) -> tuple[float, float]:
    """Column and row just out of the picture on the side where a target was, px; for one that no pixel looks at."""
    u, v = error[:2]
    return AIM + copysign(FARTHEST, u), AIM + copysign(FARTHEST, v)


class Judged(NamedTuple):
    """How the drone stands at one moment.

    Attributes:
        target: column and row of the target, px; of one that no pixel can look at, at the border on its last side.
        error: signed, on each axis: ball px and px, and of three axes px by which it is too tall; line px and degrees.
        scaled: the error as a share of the largest, on each axis; of the third of what is wanted.
        error_px: ball: distance of the target from the aim; line: distance to the side, px.
        reward: 1 - e / e_max, 0 to 1.
        progress: share of the lap, 0 to 1.
        lost: the target is out of the picture.
        done: the lap is over.
        lap: it counts.
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
    """What is followed.

    Attributes:
        forward: speed that the drone has whatever the action, m/s, in this episode.
        turns: the second action turns the drone; else it moves it backwards.
        path: along which the target is in this episode.
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
            rng: of what is not given.
            start: error on each axis at the beginning, in the units of `Judged.error`; None draws one.
            direction: 1 anticlockwise, -1 clockwise, 0 as the scenario says.
            varied: how the path differs from the scenario's.

        Returns:
            Where the drone is, level.

        Raises:
            ModelError: no place of the drone gives this start.
        """

    def scene(self) -> WorldScene:
        """What there is to be seen now."""

    def advance(self, seconds: float) -> WorldScene:
        """Let time pass; returns what there is to be seen then."""

    def judge(self, view: CameraView, pose: Pose) -> Judged:
        """Judge the drone at `pose`, whose camera is `view`; once after each `advance`."""


PIECES = 100
NEAR = 0.05
WINDOW = 10
COVERED = 0.8
SPREAD = 50.0
TRIES = 1000
FARTHEST_START = 10.0
TALL_SPREAD = 0.4
TALLEST = 2.0
TALL_ERROR = 0.15
E_MAX = hypot(FARTHEST, FARTHEST)


class BallTask:
    """A ball on the star, and a drone that moves in x and y, and of three axes in z.

    A lap counts when

    - the ball went once round without leaving the picture,
    - the mean error after the first tenth is at most 20 px,
    - at least 80 of 100 equal pieces of the path were covered: the aim (the point at the ball's height at which the
      camera aims) came within 5 % of the lap's length of the piece while the ball was within 10 pieces of it,
    - after the first tenth the aim was, on average, at most 3/4 as far from the ball as that of a camera that stands
      over the middle of the star,
    - of three axes: the ball's picture was, after the first tenth, on average at most 15 % taller or less tall than
      wanted. It is also lost where it is twice as tall, or half; the reward is the mean of that of the place and that
      of the size.

    So a camera that stands still does not score, wherever it is (the third), nor does one that flies at a pace of its
    own: on average over the ball's places it is never nearer than one in the middle (the last). On the fixed path what
    keeps the ball's time scores though it sees nothing, if it starts near the ball: hence the variation of a test.

    Args:
        ball: path, speed and size.
        view: of the drone's camera.
        height: of the drone, m.

    Source: thesis, section 7.3.1.3 and equation 130.
    """

    forward = 0.0
    turns = False

    def __init__(self, ball: Ball, view: CameraView, height: float) -> None:
        self.ball, self.view, self.height = ball, view, height
        self._begin(FIXED)

    def _begin(self, varied: Variation) -> None:
        self.path, self._pieces, self._standing = _way(self.ball.lap, varied)
        self._speed, self._first = self.ball.speed * varied.speed, varied.begin * self.path.length
        self.way, self._sum, self._away, self._off, self._count = 0.0, 0.0, 0.0, 0.0, 0
        self._last = (0.0, 0.0)
        self._time = 0.0
        self._set()
        self._aims: list[tuple[float, float, float]] = []

    def _set(self) -> None:
        """Put the ball where it is at this time."""
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
        offset = self._drawn(rng) if start is None else self._offset(*start)
        if offset is None:
            place = ", ".join(f"{one:g}" for one in start or ())
            half = " and a ball from half to twice as tall as it shall be" if self.ball.axes == 3 else ""
            raise ModelError(f"start [{place}] px: expected a place of the picture below the horizon{half}")
        return Pose(self._place[0] - offset[0], self._place[1] - offset[1], offset[2])

    def _drawn(self, rng: np.random.Generator) -> tuple[float, float, float]:
        """A start within 50 px on both axes, the first that is drawn which is not near the horizon or above it.

        Of three axes the ball is also up to 40 % too tall or too small.
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
        """From where the ball has an error: its x and y seen from the drone, and the drone's height, m."""
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
        far = self.view.depth_of(v, ball.radius, tall)
        return far * dx, far * dy, ball.radius - far * dz

    def _right_size(self, tall: float) -> bool:
        return self.ball.tall / TALLEST < tall < self.ball.tall * TALLEST

    def scene(self) -> WorldScene:
        """See `Task`."""
        return WorldScene(self._place)

    def advance(self, seconds: float) -> WorldScene:
        """See `Task`."""
        self.way += self._speed * seconds
        self._time += seconds
        self._set()
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
            tall, wanted = view.tall(*self._place), self.ball.tall
            off = min(tall, TALLEST * wanted) - wanted
            errors, scaled = (du, dv, off), (*scaled, off / wanted)
            reward = 0.5 * (reward + 1.0 - abs(off) / wanted)
            lost = lost or not self._right_size(tall)
        if progress > 0.1:
            self._sum += error
            self._away += hypot(aim[0] - x, aim[1] - y)
            self._off += abs(scaled[-1])
            self._count += 1
        done = progress >= 1.0 - 1e-9
        lap = done and not lost and self._follows()
        if lost:
            reward = 0.0
        return Judged((u, v), errors, scaled, error, reward, min(progress, 1.0), lost, done, lap)

    def _follows(self) -> bool:
        near = self._away <= NEARER * self._standing * self._count
        tall = self.ball.axes == 2 or self._off <= TALL_ERROR * self._count
        return near and tall and self._sum <= LARGEST_ERROR * self._count and self.coverage() >= COVERED

    def coverage(self) -> float:
        """Share of the path's pieces that were covered up to now."""
        if not self._aims:
            return 0.0
        aims = np.array(self._aims)
        piece = np.rint(aims[:, 0] * (PIECES / self.path.length)).astype(int)
        window = (piece[:, None] + np.arange(-WINDOW, WINDOW + 1)) % PIECES
        away = np.hypot(*(self._pieces[window] - aims[:, None, 1:]).transpose(2, 0, 1))
        return len(np.unique(window[away <= NEAR * self.path.length])) / PIECES


@lru_cache(maxsize=8)  # a training flies the same few paths all the time
def _way(lap: float, varied: Variation) -> tuple[Path, npt.NDArray[Any], float]:
    """The ball's path, where its pieces begin (from where the ball does), and their mean distance from its middle."""
    path = star(lap).varied(varied)
    ends = np.arange(PIECES) * (path.length / PIECES)
    pieces = np.array([path.at(varied.begin * path.length + s) for s in ends])
    return path, pieces, float(np.hypot(*pieces.T).mean())


def hop(ball: Ball, time: float) -> tuple[float, float]:
    """Height of a ball's middle and its radius, m.

    A slow rise is half a wave of a cosine; jumps are parabolas, one after the other, as of a ball that loses nothing.

    Args:
        ball: of the scenario.
        time: since the start of the episode, s; the ball then lies on the ground and has its own radius.
    """
    radius = up = ball.radius
    if ball.swell:
        radius = up = ball.radius * (1.0 + ball.swell * sin(2.0 * pi * time / ball.swell_time))
    if ball.rise:
        up += 0.5 * ball.rise * (1.0 - cos(2.0 * pi * time / ball.rise_time))
    if ball.bounce:
        share = time / sqrt(8.0 * ball.bounce / GRAVITY) % 1.0
        up += 4.0 * ball.bounce * share * (1.0 - share)
    return up, radius


SPREAD_PX = 35.0
SPREAD_DEGREES = 15.0
ALONG = radians(45.0)
SLOWEST = 1.5
SIDES = 6
EVENLY = radians(15.0)
"""How far a heading that turns evenly is off those of the sides, on average: 30 degrees at the corners, 0 half way.

A quarter of the mean turn at a corner; of a hexagon that is stretched it is more.
"""


class LineTask:
    """A hexagon on the ground, and a drone that flies forward, moves sideways and turns.

    Where a side crosses row 63 of the picture its column and its lean (to the right of upright, in the picture) give
    the error; of several sides the one nearest to column 63 counts. The line is lost when none crosses the row in the
    picture. e = (|u - 63| / 64.5 + |lean| / 90) / 2 and e_max = 1.

    Progress is that of the point of the hexagon nearest to where the camera aims: ways back are taken off, ways
    forward are added once the heading is within 45 degrees of the side's direction of travel, if that takes no more
    than half a side. A lap counts when

    - the progress is the whole hexagon, and the line was never lost,
    - the heading is 360 degrees, 45 more or less, beyond that of the first side, in the direction of travel,
    - after the first tenth the line was, on average, at most 20 px beside the middle,
    - and the heading at most 11.25 degrees off that of the nearest side: 3/4 of the 15 degrees of one that turns
      evenly.

    So one action all the time does not score, though its circle may stay within 5 px of the line (the last).
    After 1.5 times the time that a lap takes along the line the episode ends without one.

    Args:
        line: path, speed and width.
        view: of the drone's camera.
        height: of the drone, m.

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
        self._sum, self._off, self._count = 0.0, 0.0, 0

    def reset(
        self,
        rng: np.random.Generator,
        start: tuple[float, ...] | None = None,
        direction: int = 0,
        varied: Variation = FIXED,
    ) -> Pose:
        """See `Task`; the start is in px and degrees, at the middle of the first side unless that is varied."""
        drawn = (int(rng.integers(2)) * 2 - 1, *rng.uniform(-1.0, 1.0, 2).tolist())
        direction = direction or self.line.direction or drawn[0]
        du, lean = (drawn[1] * SPREAD_PX, drawn[2] * SPREAD_DEGREES) if start is None else start[:2]
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
                raise ModelError(f"start [{du:g} px, {lean:g} degrees]: there another side of the hexagon is nearer")
        return pose

    def _start(self, u: float, lean: float) -> tuple[float, float, float] | None:
        """The pose whose picture of the start on the first side crosses row 63 at `u` with a lean."""
        view = self.view
        view.look(Pose(0.0, 0.0, self.height))
        here = view.ground(u, AIM) if view.sees(u, AIM) else None
        there = view.ground(u + 0.5 * tan(lean), AIM - 0.5)
        if here is None or there is None:
            return None
        yaw = self._headings[0] - atan2(there[1] - here[1], there[0] - here[0])
        x0, y0, x1, y1 = self._sides[0]
        c, s = cos(yaw), sin(yaw)
        share, rest = self._first, 1.0 - self._first
        x = rest * x0 + share * x1 - (here[0] * c - here[1] * s)
        y = rest * y0 + share * y1 - (here[0] * s + here[1] * c)
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
        off = self._go(view, pose.yaw)
        progress = max(0.0, min(1.0, self.way / SIDES))
        du, _ = self._last = (u - AIM, lean)
        if progress > 0.1:
            self._sum += abs(du)
            self._off += abs(off)
            self._count += 1
        turned = (pose.yaw - self._headings[0]) * self.direction
        whole = self.way >= SIDES
        lap = whole and not lost and abs(turned - 2.0 * pi) <= ALONG and self._follows()
        done = whole or self.time > SLOWEST * self.path.length / self.forward
        reward = 0.0 if lost else 1.0 - 0.5 * (abs(du) / FARTHEST + abs(lean) / 90.0)
        scaled = (max(-1.0, min(1.0, du / 64.0)), lean / 90.0)
        return Judged((u, AIM), (du, lean), scaled, abs(du), reward, progress, lost, done, lap)

    def _crossing(self, view: CameraView) -> tuple[float, float]:
        """Column at which a side crosses row 63, nearest to column 63, and its lean, degrees; infinite for none."""
        # A point of the ground is on the row where its dot product with `n` is 0; n is normal to all rays of the row.
        best, lean = inf, 0.0
        n, (px, py, pz) = view.row(AIM), view.place()
        base = n[0] * px + n[1] * py + n[2] * pz
        for x0, y0, x1, y1 in self._sides:
            a, b = n[0] * x0 + n[1] * y0 - base, n[0] * x1 + n[1] * y1 - base
            if (a > 0.0) == (b > 0.0):
                continue
            s = a / (a - b)
            x, y = x0 + s * (x1 - x0), y0 + s * (y1 - y0)
            u, v, depth = view.project(x, y, 0.0)
            if depth > 0.0 and abs(u - AIM) < abs(best - AIM):
                u1, v1, _ = view.project(x + 1e-3 * (x1 - x0), y + 1e-3 * (y1 - y0), 0.0)
                up = 1.0 if v1 < v else -1.0
                best, lean = u, degrees(atan2(up * (u1 - u), up * (v - v1)))
        return best, lean

    def _follows(self) -> bool:
        return self._sum <= LARGEST_ERROR * self._count and self._off <= NEARER * EVENLY * self._count

    def _go(self, view: CameraView, yaw: float) -> float:
        """Take account of the way made since the last moment; how far the heading is off the nearest side's."""
        aim = view.ground(AIM, AIM)
        if aim is None:
            return pi
        place, side = self._nearest(*aim)
        off = (yaw - self._headings[side] + pi) % (2.0 * pi) - pi
        if self._place is None:
            self._place = place
        way = (place - self._place + 0.5 * SIDES) % SIDES - 0.5 * SIDES
        leap = way > 0.5
        if way <= 0.0 or abs(off) <= ALONG or leap:  # else it counts when the heading is right again
            self.way += 0.0 if leap else way
            self._place = place
        return off

    def _nearest(self, x: float, y: float) -> tuple[float, int]:
        """Where on the hexagon the point nearest to a place is: sides from the first corner, and the side it is on."""
        best, place, side = inf, 0.0, 0
        for k, (x0, y0, x1, y1) in enumerate(self._sides):
            dx, dy = x1 - x0, y1 - y0
            s = ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy)
            s = 0.0 if s < 0.0 else 1.0 if s > 1.0 else s
            away = hypot(x - x0 - s * dx, y - y0 - s * dy)
            if away < best:
                best, place, side = away, k + s, k
        return place, side
