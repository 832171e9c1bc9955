"""The line task: fly along a painted hexagon, with the line in the middle and upright in the picture."""

from __future__ import annotations

from math import atan2, cos, degrees, hypot, inf, pi, radians, sin, tan

import numpy as np

from neuro import ModelError
from neuro_drone.geometry import AIM, CameraView, Pose, WorldScene
from neuro_drone.paths import FIXED, Variation, hexagon
from neuro_drone.scenario import Line
from neuro_drone.tasks import FARTHEST, LARGEST_ERROR, NEARER, Judged, border

__all__ = ["LineTask"]

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
