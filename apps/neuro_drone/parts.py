"""The parts of a scenario and the limits of their values."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Any

from neuro import ModelError
from neuro.apps import check_fields, setting

GRAVITY = 9.81
"""Acceleration of free fall, m/s^2."""

MASS = 0.716
"""Mass of the drone without a load, kg. Source: rotors_simulator, see `neuro_drone.body`."""


def check_whole(name: str, value: Any, least: int = 0, below: str = "") -> None:
    """Raise an error unless the value is a whole number >= `least`.

    Args:
        name: name of the value, for the message.
        value: the value.
        least: smallest allowed value.
        below: "2^63" also refuses values >= 2^63; "" sets no upper limit.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < least or (below and value >= 2**63):
        end = f" and < {below}" if below else ""
        raise ModelError(f"{name} = {value!r}: expected a whole number >= {least}{end}")


class WorldPart:
    """A frozen dataclass whose fields are checked."""

    __slots__ = ()
    _place = ""

    def __post_init__(self) -> None:
        check_fields(self, self._place)


@dataclass(frozen=True, slots=True)
class Ball(WorldPart):
    """A ball that follows a closed Bezier curve through a star of four branches.

    Attributes:
        lap: length of the curve, m.
        speed: speed of the ball, m/s.
        radius: radius of the ball, m.
        brightness: share of full scale.
        axes: 2 if the drone moves in x and y only. 3 if it also climbs and sinks, which keeps the ball's picture
            `tall` px high.
        tall: with three axes, target height of the ball's picture, px.
        rise: height of a slow rise and descent, m.
        rise_time: period of the rise and descent, s.
        bounce: height of a jump, m; gravity sets its duration.
        swell: share by which the radius grows and shrinks.
        swell_time: period of the growing and shrinking, s.

    Source: thesis, figure 63 (0.075 m/s) and section 7.3.7 (13 px in the picture, which sets the radius; "to avoid
    being too close or too far from the target").
    """

    _place = "task.ball"

    lap: float = setting(7.5, "m", above=0.0, at_most=1000.0)
    speed: float = setting(0.075, "m/s", above=0.0, at_most=20.0)
    radius: float = setting(0.17, "m", above=0.0, at_most=10.0)
    brightness: float = setting(0.2, at_least=0.0, at_most=1.0)
    axes: int = setting(2, at_least=2, at_most=3)
    tall: float = setting(13.0, "px", at_least=2.0, at_most=64.0)
    rise: float = setting(0.0, "m", at_least=0.0, at_most=100.0)
    rise_time: float = setting(20.0, "s", at_least=0.1, at_most=10_000.0)
    bounce: float = setting(0.0, "m", at_least=0.0, at_most=10.0)
    swell: float = setting(0.0, at_least=0.0, at_most=0.9)
    swell_time: float = setting(20.0, "s", at_least=0.1, at_most=10_000.0)


@dataclass(frozen=True, slots=True)
class Line(WorldPart):
    """A hexagon painted on the ground; the drone flies forward, moves sideways and turns.

    Attributes:
        side: length of a side of the hexagon, m.
        width: width of the line, m.
        speed: forward speed of the drone, m/s.
        brightness: share of full scale.
        direction: 1 anticlockwise seen from above, -1 clockwise, 0 drawn for each episode.

    Source: thesis, figure 65 (0.075 m/s). The sides are long enough that the camera sees one at a time.
    """

    _place = "task.line"

    side: float = setting(3.0, "m", above=0.0, at_most=1000.0)
    width: float = setting(0.12, "m", above=0.0, at_most=10.0)
    speed: float = setting(0.075, "m/s", above=0.0, at_most=20.0)
    brightness: float = setting(0.2, at_least=0.0, at_most=1.0)
    direction: int = setting(0, at_least=-1, at_most=1)


@dataclass(frozen=True, slots=True)
class Ground(WorldPart):
    """The ground.

    Attributes:
        brightness: mean share of full scale.
        texture: contrast of the ground's pattern as a share of the brightness; 0 for plain ground.
        grain: size of the pattern's largest spots, m.
        redraw: True draws a new pattern for each episode.
    """

    _place = "ground"

    brightness: float = setting(0.6, at_least=0.0, at_most=1.0)
    texture: float = setting(0.0, at_least=0.0, at_most=1.0)
    grain: float = setting(0.2, "m", at_least=0.01, at_most=100.0)
    redraw: bool = setting(False)


@dataclass(frozen=True, slots=True)
class Camera(WorldPart):
    """The event camera. Its pixels have the parameters of `neuro.events.DVSParameters`.

    Attributes:
        tilt: angle of the optical axis below the horizontal, degrees.
        fov: angle of view over the whole width, degrees.
        mount: gimbal (stays level) or body (rolls and pitches with the drone).
        roll: rotation about the optical axis, clockwise seen from behind, degrees. The picture turns the other way,
            and errors in the picture turn with it.
        shake: standard deviation of a small random rotation in each step, degrees. Without it, a picture in which
            nothing moves makes no events.
        pos_thres, neg_thres: contrast thresholds, log units.
        sigma_thres: standard deviation of the thresholds over the pixels.
        leak_rate_hz, shot_noise_rate_hz: noise rates of a pixel, Hz.
        refractory_period_s: refractory period of a pixel, s.
    """

    _place = "camera"

    tilt: float = setting(60.0, "degrees", at_least=1.0, at_most=90.0)
    fov: float = setting(65.0, "degrees", at_least=10.0, at_most=150.0)
    mount: str = setting("gimbal", words=("gimbal", "body"))
    roll: float = setting(0.0, "degrees", at_least=-180.0, at_most=180.0)
    shake: float = setting(0.0, "degrees", at_least=0.0, at_most=5.0)
    pos_thres: float = setting(0.15, at_least=0.01, at_most=10.0)
    neg_thres: float = setting(0.15, at_least=0.01, at_most=10.0)
    sigma_thres: float = setting(0.0, at_least=0.0, at_most=1.0)
    leak_rate_hz: float = setting(0.0, "Hz", at_least=0.0, at_most=1000.0)
    shot_noise_rate_hz: float = setting(0.0, "Hz", at_least=0.0, at_most=1000.0)
    refractory_period_s: float = setting(0.0, "s", at_least=0.0, at_most=1.0)


@dataclass(frozen=True, slots=True)
class Drone(WorldPart):
    """The quadrotor.

    Attributes:
        physics: kinematic or bullet.
        height: height above the ground, m.
        v_max: speed of an action of 1, m/s.
        climb_max: upward speed of an action of 1, m/s.
        yaw_max: rate of turning of an action of 1, rad/s.
        spin: over a ball, constant rate of turning anticlockwise that no action changes, rad/s.
        lag: time constant of the speed, s.
        a_max: largest acceleration, m/s^2.
        drag: acceleration by a wind of 1 m/s, 1/s.

    Source: thesis, figure 63 (2.4 m); drag: Faessler, Franchi, Scaramuzza, "Differential flatness of quadrotor
    dynamics subject to rotor drag", IEEE RA-L 3(2), 2018 (about 0.5 forward and 0.4 sideways); the other values are
    measured choices, see docs/reference/drone.md.
    """

    _place = "drone"

    physics: str = setting("kinematic", words=("kinematic", "bullet"))
    height: float = setting(2.4, "m", above=0.0, at_most=1000.0)
    v_max: float = setting(2.0, "m/s", above=0.0, at_most=20.0)
    climb_max: float = setting(1.0, "m/s", above=0.0, at_most=20.0)
    yaw_max: float = setting(0.8, "rad/s", above=0.0, at_most=10.0)
    spin: float = setting(0.0, "rad/s", at_least=-3.0, at_most=3.0)
    lag: float = setting(0.2, "s", at_least=0.01, at_most=10.0)
    a_max: float = setting(3.0, "m/s^2", above=0.0, at_most=30.0)
    drag: float = setting(0.4, "1/s", at_least=0.0, at_most=10.0)


@dataclass(frozen=True, slots=True)
class Wind(WorldPart):
    """Level wind, the same everywhere.

    Attributes:
        speed: mean speed without gusts, m/s.
        towards: direction in which the wind blows, degrees counter-clockwise from x.
        turning: rate at which the direction changes once the wind blows, degrees/s.
        gust: standard deviation of the gusts on each axis, m/s.
        gust_time: time constant of the gusts, s.
        since: start of the wind, s after the start of an episode.

    Source: gusts are noise that passes a first-order filter, like the longitudinal gusts of the Dryden spectra of
    MIL-F-8785C, section 3.7. At a wind of 5 m/s and a height of 3 m, the lowest of the standard, the standard deviation
    is 0.2 times the speed, and the time constant is 4.6 s.
    """

    _place = "wind"

    speed: float = setting(0.0, "m/s", at_least=0.0, at_most=20.0)
    towards: float = setting(90.0, "degrees", at_least=-360.0, at_most=360.0)
    turning: float = setting(0.0, "degrees/s", at_least=-180.0, at_most=180.0)
    gust: float = setting(0.0, "m/s", at_least=0.0, at_most=10.0)
    gust_time: float = setting(4.6, "s", at_least=0.01, at_most=1000.0)
    since: float = setting(0.0, "s", at_least=0.0, at_most=100_000.0)


@dataclass(frozen=True, slots=True)
class Load(WorldPart):
    """A load that the drone picks up or drops in flight. The controller does not know its mass.

    Attributes:
        mass: mass picked up, kg; negative if it is dropped. The drone has 0.716 kg.
        since: time of the change, s after the start of an episode.

    Source: Ascending Technologies' data sheet of the Hummingbird has a largest load of 0.2 kg.
    """

    _place = "load"

    mass: float = setting(0.0, "kg", at_least=-0.5, at_most=1.0)
    since: float = setting(0.0, "s", at_least=0.0, at_most=100_000.0)


@dataclass(frozen=True, slots=True)
class Motors(WorldPart):
    """A deviation of the flight from the command, in the plane of the ground. No controller knows it.

    Attributes:
        mirror: True swaps right and left.
        angle: rotation of the flight after the mirroring, anticlockwise seen from above, degrees.
        gain: factor on the commanded speed.
        since: start of the deviation, s after the start of an episode.
    """

    _place = "motors"

    mirror: bool = setting(False)
    angle: float = setting(0.0, "degrees", at_least=-360.0, at_most=360.0)
    gain: float = setting(1.0, above=0.0, at_most=10.0)
    since: float = setting(0.0, "s", at_least=0.0, at_most=100_000.0)

    def flown(self, right: float, down: float) -> tuple[float, float]:
        """Return the speed that results from a commanded speed, right and down in the picture, in units of v_max."""
        right = -right if self.mirror else right
        c, s = self.gain * cos(radians(self.angle)), self.gain * sin(radians(self.angle))
        return right * c + down * s, down * c - right * s
