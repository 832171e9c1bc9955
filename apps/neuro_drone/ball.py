"""The ball task: keep a ball that rolls round a star at the aim."""

from __future__ import annotations

from functools import lru_cache
from math import cos, hypot, inf, pi, sin, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_drone.geometry import AIM, CameraView, Pose, WorldScene
from neuro_drone.parts import GRAVITY, Ball
from neuro_drone.paths import FIXED, Path, Variation, star
from neuro_drone.tasks import FARTHEST, LARGEST_ERROR, NEARER, Judged, border

__all__ = ["BallTask", "hop"]

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
