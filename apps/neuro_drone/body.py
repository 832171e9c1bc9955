"""How the drone follows commands of velocity."""

from __future__ import annotations

from math import atan, copysign, cos, exp, hypot, sin
from typing import Protocol

from neuro_drone.geometry import Pose
from neuro_drone.parts import GRAVITY, MASS, Drone

__all__ = ["GRAVITY", "MASS", "Body", "Kinematic"]

CALM = (0.0, 0.0)


class Body(Protocol):
    """A quadrotor with a controller of its velocity.

    Attributes:
        pose: where it is; the same object all the time, changed by each step.
        velocity: x and y in the world, m/s.
    """

    pose: Pose
    velocity: tuple[float, float]

    def reset(
        self, x: float, y: float, yaw: float, right: float = 0.0, forward: float = 0.0, z: float | None = None
    ) -> None:
        """Be at a place, m, with a heading, rad, level and with a velocity in the frame of the heading, m/s.

        Without z it is at the drone's own height. There is no wind and no load.
        """

    def step(self, right: float, forward: float, turn: float, seconds: float, climb: float | None = None) -> None:
        """Follow a command for some time.

        Args:
            right: velocity to the right of the heading, m/s.
            forward: velocity along the heading, m/s.
            turn: rate of turning clockwise seen from above, rad/s.
            seconds: how long.
            climb: velocity upwards, m/s; None holds the height.
        """

    def feel(self, wind: tuple[float, float], load: float) -> None:
        """What acts on the body until the next call or a reset.

        Args:
            wind: x and y in the world, m/s.
            load: that it carries, kg.
        """

    def close(self) -> None:
        """Give back what the body holds of the machine."""


class Kinematic:
    """A body whose velocity goes to the commanded one with a lag and a largest acceleration.

    dv/dt = (command - v) / lag, but never more than a_max; the rate of turning has the same lag. A step is solved
    exactly for straight flight, so that it does not matter how time is cut; while the drone turns, the command is that
    of the heading halfway, an error of second order. The body leans as thrust must for the acceleration.

    Wind accelerates it by drag times its speed. Nothing in the controller of velocity makes up for that (it has no
    integral term), so that the velocity goes to the command plus lag times drag times the wind; the largest
    acceleration is that of both together. The drag of the body's own flight is part of the lag. With a load the same
    thrust does less: lag grows, and the largest acceleration falls, as the mass; and a body that is commanded to climb
    sinks at the speed at which the controller's thrust makes up for the weight. One that holds its height holds it.

    Args:
        drone: height, lag, largest acceleration and drag.
    """

    def __init__(self, drone: Drone) -> None:
        self.lag, self.a_max, self.height = drone.lag, drone.a_max, drone.height
        self._drift = drone.lag * drone.drag
        self.pose = Pose(0.0, 0.0, drone.height)
        self.velocity = (0.0, 0.0)
        self.rate = self.climb = 0.0
        self.feel(CALM, 0.0)

    def reset(
        self, x: float, y: float, yaw: float, right: float = 0.0, forward: float = 0.0, z: float | None = None
    ) -> None:
        """See `Body`."""
        pose, c, s = self.pose, cos(yaw), sin(yaw)
        pose.x, pose.y, pose.z, pose.yaw, pose.pitch, pose.roll = x, y, self.height, yaw, 0.0, 0.0
        if z is not None:
            pose.z = z
        self.velocity = (forward * c + right * s, forward * s - right * c)
        self.rate = self.climb = 0.0
        self.feel(CALM, 0.0)

    def feel(self, wind: tuple[float, float], load: float) -> None:
        """See `Body`."""
        self.heavier = 1.0 + load / MASS
        self.drift = self._drift * wind[0], self._drift * wind[1]
        self.sink = self.lag * GRAVITY * (self.heavier - 1.0)

    def step(self, right: float, forward: float, turn: float, seconds: float, climb: float | None = None) -> None:
        """See `Body`."""
        pose, lag, a_max = self.pose, self.lag * self.heavier, self.a_max / self.heavier
        fall = exp(-seconds / lag)
        if climb is not None:
            wanted = climb - self.sink
            off = wanted - self.climb
            left, gap = _towards(abs(off), a_max, lag, seconds, fall)
            self.climb = wanted - copysign(left, off)
            pose.z += wanted * seconds - copysign(gap, off)
        middle = pose.yaw
        if turn or self.rate:
            behind = self.rate + turn  # the rate is counter-clockwise, the command clockwise
            half = exp(-0.5 * seconds / lag)
            middle += -turn * 0.5 * seconds + behind * lag * (1.0 - half)
            pose.yaw += -turn * seconds + behind * lag * (1.0 - fall)
            self.rate = behind * fall - turn
        c, s = cos(middle), sin(middle)
        wx, wy = forward * c + right * s + self.drift[0], forward * s - right * c + self.drift[1]
        vx, vy = self.velocity
        ex, ey = wx - vx, wy - vy
        size = hypot(ex, ey)
        if size == 0.0:
            pose.x, pose.y = pose.x + vx * seconds, pose.y + vy * seconds
            self._lean(0.0, 0.0, 0.0)
            return
        left, gap = _towards(size, a_max, lag, seconds, fall)
        share, way = left / size, gap / size
        self.velocity = (wx - ex * share, wy - ey * share)
        pose.x += wx * seconds - ex * way
        pose.y += wy * seconds - ey * way
        self._lean(min(left / lag, a_max) / (size * GRAVITY), ex, ey)

    def _lean(self, a: float, ex: float, ey: float) -> None:
        """Take up the attitude in which thrust makes a times (ex, ey), in units of gravity, but for the wind's part."""
        pose, blown = self.pose, 1.0 / (self.lag * self.heavier * GRAVITY)
        bx, by = self.drift[0] * blown, self.drift[1] * blown
        c, s = cos(pose.yaw), sin(pose.yaw)
        pose.pitch = atan(a * (ex * c + ey * s) - (bx * c + by * s))
        pose.roll = atan(a * (ex * s - ey * c) - (bx * s - by * c))

    def close(self) -> None:
        """See `Body`."""


def _towards(size: float, a_max: float, lag: float, seconds: float, fall: float) -> tuple[float, float]:
    """What is left after some time of a difference to the command, m/s, and its integral, m."""
    knee = a_max * lag
    if size <= knee:
        return size * fall, size * lag * (1.0 - fall)
    limited = (size - knee) / a_max
    if seconds <= limited:
        return size - a_max * seconds, (size - 0.5 * a_max * seconds) * seconds
    fall = exp(-(seconds - limited) / lag)
    return knee * fall, 0.5 * (size + knee) * limited + knee * lag * (1.0 - fall)
