"""The ball task: keep a ball that rolls round a star at the aim."""

from __future__ import annotations

from math import hypot, inf

import numpy as np

from neuro import ModelError
from neuro_drone.geometry import AIM, Pose, View
from neuro_drone.paths import FIXED, Variation, star
from neuro_drone.scenario import Ball
from neuro_drone.scene import Scene
from neuro_drone.tasks import FARTHEST, Judged, border

__all__ = ["BallTask"]

PIECES = 100
NEAR = 0.05
WINDOW = 10
COVERED = 0.8
LARGEST_ERROR = 20.0
NEARER = 0.75
SPREAD = 50.0
TRIES = 1000
FARTHEST_START = 10.0
E_MAX = hypot(FARTHEST, FARTHEST)


class BallTask:
    """A ball on the star, and a drone that moves in x and y only.

    A lap counts when

    - the ball went once round without leaving the picture,
    - the mean error after the first tenth is at most 20 px,
    - at least 80 of 100 equal pieces of the path were covered: the aim (the point at the ball's height at which the
      camera aims) came within 5 % of the lap's length of the piece while the ball was within 10 pieces of it,
    - after the first tenth the aim was, on average, at most 3/4 as far from the ball as that of a camera that stands
      over the middle of the star.

    So a camera that stands still does not score, wherever it is (the third), nor does one that flies at a pace of its
    own: on average over the ball's places it is never nearer than one in the middle (the last). What keeps the ball's
    time scores though it sees nothing, if it starts near the ball: a lap always begins at the same place of the path.

    Args:
        ball: path, speed and size.
        view: of the drone's camera.
        height: of the drone, m.

    Source: thesis, section 7.3.1.3 and equation 130.
    """

    forward = 0.0
    turns = False

    def __init__(self, ball: Ball, view: View, height: float) -> None:
        self.ball, self.view, self.height = ball, view, height
        self._star = star(ball.lap)
        self._begin(FIXED)

    def _begin(self, varied: Variation) -> None:
        self.path, self._speed = self._star.varied(varied), self.ball.speed * varied.speed
        self._first = varied.begin * self.path.length
        ends = np.arange(PIECES) * (self.path.length / PIECES)
        self._pieces = np.array([self.path.at(self._first + s) for s in ends])
        self._standing = float(np.hypot(*self._pieces.T).mean())
        self.way, self._sum, self._away, self._count = 0.0, 0.0, 0.0, 0
        self._last = (0.0, 0.0)
        self._place = self.path.at(self._first)
        self._aims: list[tuple[float, float, float]] = []

    def reset(
        self,
        rng: np.random.Generator,
        start: tuple[float, float] | None = None,
        direction: int = 0,
        varied: Variation = FIXED,
    ) -> tuple[float, float, float]:
        """See `Task`; the start is in px and px, the heading is 0."""
        self._begin(varied)
        self.view.look(Pose(0.0, 0.0, self.height))
        offset = self._drawn(rng) if start is None else self._offset(*start)
        if offset is None:
            du, dv = start or (0.0, 0.0)
            raise ModelError(f"start [{du:g}, {dv:g}] px: expected a place of the picture below the horizon")
        return self._place[0] - offset[0], self._place[1] - offset[1], 0.0

    def _drawn(self, rng: np.random.Generator) -> tuple[float, float]:
        """A start within 50 px on both axes, the first that is drawn which is not near the horizon or above it."""
        for _ in range(TRIES):
            offset = self._offset(*rng.uniform(-SPREAD, SPREAD, 2).tolist())
            if offset is not None and hypot(*offset) <= FARTHEST_START * self.height:
                return offset
        raise ModelError("camera: all starts within 50 px are near the horizon", hint="tilt it further down")

    def _offset(self, du: float, dv: float) -> tuple[float, float] | None:
        """Where from a drone at the origin the ball has an error, m; None where the picture has no such place."""
        u, v = AIM + du, AIM + dv
        return self.view.ground(u, v, self.ball.radius) if self.view.sees(u, v) else None

    def scene(self) -> Scene:
        """See `Task`."""
        radius = self.ball.radius
        return Scene((*self._place, radius, radius))

    def advance(self, seconds: float) -> Scene:
        """See `Task`."""
        self.way += self._speed * seconds
        self._place = self.path.at(self._first + self.way)
        return self.scene()

    def judge(self, view: View, pose: Pose) -> Judged:
        """See `Task`."""
        radius, (x, y) = self.ball.radius, self._place
        u, v, depth = view.project(x, y, radius)
        if depth <= 0.0:
            u, v = border(self._last)
        du, dv = self._last = (u - AIM, v - AIM)
        error, progress = hypot(du, dv), self.way / self.path.length
        lost = not view.sees(u, v)
        aim = view.ground(AIM, AIM, radius)
        if aim is None:
            aim = inf, inf
        self._aims.append((self.way, *aim))
        if progress > 0.1:
            self._sum += error
            self._away += hypot(aim[0] - x, aim[1] - y)
            self._count += 1
        done = progress >= 1.0 - 1e-9
        lap = done and not lost and self._follows()
        reward = 0.0 if lost else 1.0 - error / E_MAX
        scaled = (max(-1.0, min(1.0, du / 64.0)), max(-1.0, min(1.0, dv / 64.0)))
        return Judged((u, v), (du, dv), scaled, error, reward, min(progress, 1.0), lost, done, lap)

    def _follows(self) -> bool:
        near = self._away <= NEARER * self._standing * self._count
        return near and self._sum <= LARGEST_ERROR * self._count and self.coverage() >= COVERED

    def coverage(self) -> float:
        """Share of the path's pieces that were covered up to now."""
        if not self._aims:
            return 0.0
        aims = np.array(self._aims)
        piece = np.rint(aims[:, 0] * (PIECES / self.path.length)).astype(int)
        window = (piece[:, None] + np.arange(-WINDOW, WINDOW + 1)) % PIECES
        away = np.hypot(*(self._pieces[window] - aims[:, None, 1:]).transpose(2, 0, 1))
        return len(np.unique(window[away <= NEAR * self.path.length])) / PIECES
