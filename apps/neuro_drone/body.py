"""Bodies of the drone, kinematic and in PyBullet: their response to velocity commands."""

from __future__ import annotations

import sys
from math import asin, atan, atan2, ceil, copysign, cos, exp, hypot, pi, sin, sqrt
from typing import Any, Protocol
from weakref import finalize

from neuro import ModelError
from neuro.apps import install
from neuro_drone.geometry import Pose
from neuro_drone.parts import GRAVITY, MASS, Drone

CALM = (0.0, 0.0)
"""Wind speed on both axes without wind, m/s."""


class Body(Protocol):
    """A quadrotor with a velocity controller.

    Attributes:
        pose: current pose; each step changes the same object.
        velocity: x and y in the world, m/s.
    """

    pose: Pose
    velocity: tuple[float, float]

    def reset(
        self, x: float, y: float, yaw: float, right: float = 0.0, forward: float = 0.0, z: float | None = None
    ) -> None:
        """Put the level body at a position and heading, without wind and load.

        Args:
            x: position, m.
            y: position, m.
            yaw: heading, rad.
            right: velocity to the right of the heading, m/s.
            forward: velocity along the heading, m/s.
            z: height, m; None uses the drone's own height.
        """

    def step(self, right: float, forward: float, turn: float, seconds: float, climb: float | None = None) -> None:
        """Follow a velocity command for some time.

        Args:
            right: velocity to the right of the heading, m/s.
            forward: velocity along the heading, m/s.
            turn: rate of turning clockwise seen from above, rad/s.
            seconds: duration, s.
            climb: velocity upwards, m/s; None holds the height.
        """

    def feel(self, wind: tuple[float, float], load: float) -> None:
        """Set the wind and the load until the next call or reset.

        Args:
            wind: x and y in the world, m/s.
            load: mass of the load, kg.
        """

    def close(self) -> None:
        """Release the resources of the physics engine."""


class Kinematic:
    """A body whose velocity approaches the command with a lag and a largest acceleration.

    dv/dt = (command - v) / lag, at most a_max; the rate of turning has the same lag. Straight flight is solved exactly,
    so the result does not depend on the step. While the drone turns, the command is rotated to the heading in the
    middle of the step, an error of second order. The body leans as the thrust for its acceleration requires.

    Wind accelerates the body by drag times the wind's speed. The velocity controller has no integral term, so the
    velocity approaches the command plus lag times drag times the wind; a_max limits the sum of both accelerations. The
    drag of the body's own flight is part of the lag. A load reduces the effect of the thrust: the lag grows and a_max
    falls in proportion to the mass. Under a climb command, the load adds a sinking speed, at which the controller's
    extra thrust carries the extra weight: lag times g times load / mass. A body that holds its height is not affected.

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
        decay = exp(-seconds / lag)
        if climb is not None:
            target = climb - self.sink
            error = target - self.climb
            remaining, integral = _approach(abs(error), a_max, lag, seconds, decay)
            self.climb = target - copysign(remaining, error)
            pose.z += target * seconds - copysign(integral, error)
        middle_heading = pose.yaw
        if turn or self.rate:
            rate_error = self.rate + turn  # the rate is counter-clockwise, the command clockwise
            half_decay = exp(-0.5 * seconds / lag)
            middle_heading += -turn * 0.5 * seconds + rate_error * lag * (1.0 - half_decay)
            pose.yaw += -turn * seconds + rate_error * lag * (1.0 - decay)
            self.rate = rate_error * decay - turn
        c, s = cos(middle_heading), sin(middle_heading)
        wx, wy = forward * c + right * s + self.drift[0], forward * s - right * c + self.drift[1]
        vx, vy = self.velocity
        ex, ey = wx - vx, wy - vy
        size = hypot(ex, ey)
        if size == 0.0:
            pose.x, pose.y = pose.x + vx * seconds, pose.y + vy * seconds
            self._lean(0.0, 0.0, 0.0)
            return
        remaining, integral = _approach(size, a_max, lag, seconds, decay)
        share, distance_per_error = remaining / size, integral / size
        self.velocity = (wx - ex * share, wy - ey * share)
        pose.x += wx * seconds - ex * distance_per_error
        pose.y += wy * seconds - ey * distance_per_error
        self._lean(min(remaining / lag, a_max) / (size * GRAVITY), ex, ey)

    def _lean(self, a: float, ex: float, ey: float) -> None:
        """Set pitch and roll so that thrust and wind accelerate the body by a * (ex, ey), in units of gravity."""
        pose, lean_per_wind = self.pose, 1.0 / (self.lag * self.heavier * GRAVITY)
        bx, by = self.drift[0] * lean_per_wind, self.drift[1] * lean_per_wind
        c, s = cos(pose.yaw), sin(pose.yaw)
        pose.pitch = atan(a * (ex * c + ey * s) - (bx * c + by * s))
        pose.roll = atan(a * (ex * s - ey * c) - (bx * s - by * c))

    def close(self) -> None:
        """See `Body`."""


def _approach(size: float, a_max: float, lag: float, seconds: float, decay: float) -> tuple[float, float]:
    """Return the velocity error after some time, m/s, and its integral over that time, m.

    The error falls linearly by a_max until it is a_max * lag, and exponentially from there.

    Args:
        size: velocity error at the beginning, m/s.
        a_max: largest acceleration, m/s^2.
        lag: time constant, s.
        seconds: duration, s.
        decay: exp(-seconds / lag).
    """
    knee = a_max * lag
    if size <= knee:
        return size * decay, size * lag * (1.0 - decay)
    linear_time = (size - knee) / a_max
    if seconds <= linear_time:
        return size - a_max * seconds, (size - 0.5 * a_max * seconds) * seconds
    decay = exp(-(seconds - linear_time) / lag)
    return knee * decay, 0.5 * (size + knee) * linear_time + knee * lag * (1.0 - decay)


Vector = tuple[float, float, float]

INERTIA = (0.007, 0.007, 0.012)
"""Moments of inertia about front, left and up, kg m^2."""
ARM = 0.17
"""Distance of a rotor from the centre, m."""
DRAG_TO_THRUST = 0.016
"""Torque of a rotor per thrust, m."""
MOST_THRUST = 8.54858e-06 * 838.0**2
"""Largest thrust of a rotor, N.

These four values are those of an AscTec Hummingbird, as is `neuro_drone.parts.MASS`. Source: rotors_simulator,
rotors_description/urdf/hummingbird.xacro (a body with a rotor in front, left, behind and right of its centre; the front
and the rear rotor turn clockwise).
"""

SUBSTEP = 0.004
"""Longest step of the physics engine, s."""
ATTITUDE = (30.0, 30.0, 12.0)
"""Natural frequencies of the attitude controller about front, left and up, rad/s."""
SPEED_GAIN = 0.5
"""Acceleration per speed error, 1/s."""
HEIGHT_GAINS = (16.0, 8.0)
"""Acceleration per height error, 1/s^2, and per vertical speed error, 1/s.

The gains are tuned so that the response to a step of speed matches that of `Kinematic`.
"""


class Bullet:
    """A rigid quadrotor whose only actuators are its four rotors.

    A `Kinematic` body is the reference. The target acceleration is the reference's acceleration plus `SPEED_GAIN` times
    the speed error, at most a_max. An attitude controller of second order with critical damping turns the thrust to
    this acceleration, and each rotor is limited to 0 to `MOST_THRUST`. The height follows the reference.

    Wind is a force on the body, and a load is a mass at its centre; the controller compensates neither. The reference
    drifts in the wind like a body under a proportional velocity controller, and the thrust does not oppose this drift.
    The height controller is proportional too, so the body sinks with a load until the thrust is sufficient.

    Args:
        drone: height, lag, largest acceleration and drag.

    Raises:
        ModelError: PyBullet is not installed.

    Source: for the controller: Lee, Leok, McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)",
        CDC 2010, equations 15 and 16.
    """

    def __init__(self, drone: Drone) -> None:
        self._p = _pybullet()
        self.a_max = drone.a_max
        self._drag, self._load = MASS * drone.drag, 0.0
        self.reference = Kinematic(drone)
        self.pose = Pose(0.0, 0.0, drone.height)
        self.velocity = (0.0, 0.0)
        self._connect()
        self.reset(0.0, 0.0, 0.0)

    def _connect(self) -> None:
        """Create a PyBullet world that contains the drone."""
        p = self._p
        self._client = p.connect(p.DIRECT)
        self._finalizer = finalize(self, _disconnect, p, self._client)
        self._world = world = {"physicsClientId": self._client}
        p.setGravity(0.0, 0.0, -GRAVITY, **world)
        self._body = p.createMultiBody(baseMass=MASS, **world)
        p.changeDynamics(
            self._body, -1, localInertiaDiagonal=INERTIA, linearDamping=0.0, angularDamping=0.0,
            activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING, **world,
        )  # fmt: skip
        self._substep = 0.0

    def reset(
        self, x: float, y: float, yaw: float, right: float = 0.0, forward: float = 0.0, z: float | None = None
    ) -> None:
        """See `Body`; connects a closed body again."""
        if not self._finalizer.alive:
            self._connect()
        self.reference.reset(x, y, yaw, right, forward, z)
        self.feel(CALM, 0.0)
        level = (0.0, 0.0, sin(0.5 * yaw), cos(0.5 * yaw))
        self.pose.yaw = yaw
        self._put((x, y, self.reference.pose.z), level, (*self.reference.velocity, 0.0), (0.0, 0.0, 0.0))

    def feel(self, wind: tuple[float, float], load: float) -> None:
        """See `Body`."""
        self.reference.feel(wind, load)
        self._force = (self._drag * wind[0], self._drag * wind[1], 0.0)
        if load != self._load:
            self._load = load
            self._weigh()

    def _weigh(self) -> None:
        """Set the mass of the body with its load."""
        self._p.changeDynamics(self._body, -1, mass=MASS + self._load, localInertiaDiagonal=INERTIA, **self._world)

    def _put(self, position: Vector, attitude: tuple[float, ...], velocity: Vector, spin: Vector) -> None:
        """Set position, attitude (a quaternion), velocity and angular velocity of the body."""
        self._p.resetBasePositionAndOrientation(self._body, position, attitude, **self._world)
        self._p.resetBaseVelocity(self._body, velocity, spin, **self._world)
        self._read()

    def step(self, right: float, forward: float, turn: float, seconds: float, climb: float | None = None) -> None:
        """See `Body`."""
        p, client = self._p, self._client
        n = ceil(seconds / SUBSTEP - 1e-9)
        substep = seconds / n
        if substep != self._substep:
            p.setTimeStep(substep, physicsClientId=client)
            self._substep = substep
        heavier, (fx, fy, _) = self.reference.heavier, self._force
        for _ in range(n):
            old_velocity, rate, rising = self.reference.velocity, self.reference.rate, self.reference.climb
            self.reference.step(right, forward, turn, substep, climb)
            new_velocity = self.reference.velocity
            # The reference's acceleration without the wind's part, scaled to a body without load.
            ax = (new_velocity[0] - old_velocity[0]) / substep * heavier - fx / MASS
            ay = (new_velocity[1] - old_velocity[1]) / substep * heavier - fy / MASS
            az = (self.reference.climb - rising) / substep * heavier + GRAVITY * (heavier - 1.0)
            az = 0.0 if climb is None else az
            thrust, torque = self._control(ax, ay, az, (self.reference.rate - rate) / substep, old_velocity)
            p.applyExternalForce(self._body, -1, (0.0, 0.0, thrust), (0.0, 0.0, 0.0), p.LINK_FRAME, client)
            p.applyExternalTorque(self._body, -1, torque, p.LINK_FRAME, client)
            p.applyExternalForce(self._body, -1, self._force, self._place, p.WORLD_FRAME, client)
            p.stepSimulation(client)
            self._read()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for copies and other processes. PyBullet cannot copy a world, so a copy makes its own."""
        state = (self._place, self._attitude, (*self.velocity, self._climb), self._spin)
        names = ("a_max", "reference", "pose", "velocity", "_drag", "_force", "_load")
        attributes = {name: getattr(self, name) for name in names}
        return attributes | {"_there": state, "_open": self._finalizer.alive}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._p = _pybullet()
        for name, value in state.items():
            if name not in ("_there", "_open"):
                setattr(self, name, value)
        self._connect()
        self._weigh()
        place, attitude, velocity, spin = state["_there"]
        self._put(place, attitude, velocity, spin)
        if not state["_open"]:
            self.close()

    def close(self) -> None:
        """See `Body`; a reset connects again."""
        self._finalizer()

    def _read(self) -> None:
        """Read position, attitude and speeds from PyBullet."""
        p, pose = self._p, self.pose
        self._place, self._attitude = p.getBasePositionAndOrientation(self._body, self._client)
        pose.x, pose.y, pose.z = self._place
        (vx, vy, self._climb), self._spin = p.getBaseVelocity(self._body, self._client)
        self.velocity = (vx, vy)
        x, y, z, w = self._attitude
        self._front = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
        self._left = (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w))
        self._up = (2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y))
        pose.pitch = asin(max(-1.0, min(1.0, -self._front[2])))
        pose.roll = atan2(self._left[2], self._up[2])
        yaw = atan2(self._front[1], self._front[0])
        pose.yaw += (yaw - pose.yaw + pi) % (2.0 * pi) - pi

    def _control(
        self, ax: float, ay: float, az: float, spin_up: float, speed: tuple[float, float]
    ) -> tuple[float, Vector]:
        """Return thrust, N, and torque in the body's frame, N m, for target accelerations, speed and heading."""
        yaw = self.reference.pose.yaw
        ax += SPEED_GAIN * (speed[0] - self.velocity[0])
        ay += SPEED_GAIN * (speed[1] - self.velocity[1])
        size = hypot(ax, ay)
        if size > self.a_max:
            ax, ay = ax * self.a_max / size, ay * self.a_max / size
        stiff, damped = HEIGHT_GAINS
        reference = self.reference
        az += GRAVITY + stiff * (reference.pose.z - self.pose.z) - damped * (self._climb - reference.climb)
        thrust = MASS * _dot((ax, ay, az), self._up)
        size = sqrt(ax * ax + ay * ay + az * az)
        up = (ax / size, ay / size, az / size)
        left = _cross(up, (cos(yaw), sin(yaw), 0.0))
        size = sqrt(_dot(left, left))
        left = (left[0] / size, left[1] / size, left[2] / size)
        front = _cross(left, up)
        # half of vee(Rd' R - R' Rd), Lee et al. (10)
        lean = (
            0.5 * (_dot(up, self._left) - _dot(left, self._up)),
            0.5 * (_dot(front, self._up) - _dot(up, self._front)),
            0.5 * (_dot(left, self._front) - _dot(front, self._left)),
        )
        spin = self._spin
        rates = (_dot(spin, self._front), _dot(spin, self._left), _dot(spin, self._up) - self.reference.rate)
        torques = [
            -inertia * (stiff * stiff * e + 2.0 * stiff * w)
            for inertia, stiff, e, w in zip(INERTIA, ATTITUDE, lean, rates, strict=True)
        ]
        return _rotors(thrust, torques[0], torques[1], torques[2] + INERTIA[2] * spin_up)


def _rotors(thrust: float, roll: float, pitch: float, yaw: float) -> tuple[float, Vector]:
    """Return the thrust, N, and torques, N m, of four limited rotors for a target thrust and target torques.

    If a rotor reaches a limit, the torques are reduced, not the thrust. The yaw torque uses at most two fifths of the
    margin between a rotor's mean thrust and its nearest limit.
    """
    share = max(0.0, min(MOST_THRUST, 0.25 * thrust))
    margin = min(share, MOST_THRUST - share)
    z = _within(0.25 * yaw / DRAG_TO_THRUST, 0.4 * margin)
    x, y = (_within(0.5 * torque / ARM, margin - abs(z)) for torque in (roll, pitch))
    return 4.0 * share, (2.0 * ARM * x, 2.0 * ARM * y, 4.0 * DRAG_TO_THRUST * z)


def _within(value: float, most: float) -> float:
    return max(-most, min(most, value))


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _pybullet() -> Any:
    try:
        import pybullet
    except ImportError:
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        raise ModelError(
            "drone.physics = 'bullet': the package pybullet is not installed",
            hint=f"{install('bullet')}; pybullet has wheels for Python 3.11 only, and this is {version}",
        ) from None
    return pybullet


def _disconnect(p: Any, client: int) -> None:
    if p.isConnected(client):
        p.disconnect(client)


def body_of(drone: Drone) -> Body:
    """Return the body for a drone's physics.

    Raises:
        ModelError: PyBullet is not installed.
    """
    if drone.physics == "kinematic":
        return Kinematic(drone)
    return Bullet(drone)
