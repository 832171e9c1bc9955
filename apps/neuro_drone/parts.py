"""The parts of a scenario and what their values may be."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import Any

from neuro import ModelError
from neuro.apps import check_fields, setting

GRAVITY = 9.81
"""m/s^2."""

MASS = 0.716
"""Of the drone without a load, kg. Source: rotors_simulator, see `neuro_drone.body`."""


def check_whole(name: str, value: Any, least: int = 0, below: str = "") -> None:
    """Refuse what is no whole number of at least `least`; with `below` "2^63", also what does not fit into 64 bits."""
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
    """A ball that goes round a closed Bezier curve through a star of four branches; on the ground unless it rises.

    Attributes:
        lap: length of the curve, m.
        speed: of the ball, m/s.
        radius: m.
        brightness: share of full scale.
        axes: 2, the drone moves in x and y only; or 3, it also climbs and sinks, to see the ball as tall as `tall`.
        tall: of three axes: how tall the ball's picture shall be, px.
        rise: how far it goes up slowly and comes down again, m.
        rise_time: that takes so long, s.
        bounce: how high it jumps, m; how long a jump takes follows from gravity.
        swell: its radius grows and shrinks by this share.
        swell_time: that takes so long, s.

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
        side: of the hexagon, m.
        width: of the line, m.
        speed: forward, m/s.
        brightness: share of full scale.
        direction: 1 anticlockwise seen from above, -1 clockwise, 0 drawn for each episode.

    Source: thesis, figure 65 (0.075 m/s); sides long enough that one is seen at a time.
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
        brightness: share of full scale, on average.
        texture: contrast of a pattern on it, as a share of the brightness; 0 for plain.
        grain: size of the pattern's largest spots, m.
        redraw: a new pattern for each episode.
    """

    _place = "ground"

    brightness: float = setting(0.6, at_least=0.0, at_most=1.0)
    texture: float = setting(0.0, at_least=0.0, at_most=1.0)
    grain: float = setting(0.2, "m", at_least=0.01, at_most=100.0)
    redraw: bool = setting(False)


@dataclass(frozen=True, slots=True)
class Camera(WorldPart):
    """The event camera; its pixels are those of `neuro.events.DVSParameters`.

    Attributes:
        tilt: below the horizontal, degrees.
        fov: over the whole width, degrees.
        mount: gimbal (stays level) or body (rolls and pitches with the drone).
        roll: by which it is turned about its axis, clockwise seen from behind, degrees; the picture, and with it all
            errors, turn the other way.
        shake: standard deviation of a small random turn in each step, degrees; a still picture makes no events.
        pos_thres, neg_thres: contrast thresholds, log units.
        sigma_thres: their standard deviation from pixel to pixel.
        leak_rate_hz, shot_noise_rate_hz: noise of a pixel, Hz.
        refractory_period_s: s.
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
        height: above the ground, m.
        v_max: speed that an action of 1 asks for, m/s.
        climb_max: speed upwards that an action of 1 asks for, m/s.
        yaw_max: rate of turning that an action of 1 asks for, rad/s.
        spin: over a ball, rate at which it is turned anticlockwise whatever the actions, rad/s.
        lag: time constant of the speed, s.
        a_max: largest acceleration, m/s^2.
        drag: acceleration by a wind of 1 m/s, 1/s.

    Source: thesis, figure 63 (2.4 m); drag: Faessler, Franchi, Scaramuzza, "Differential flatness of quadrotor
        dynamics subject to rotor drag", IEEE RA-L 3(2), 2018 (about 0.5 forward and 0.4 sideways); the others are
        measured choices, see docs/how-to/drone.md.
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
        speed: m/s, without gusts.
        towards: where it blows to, degrees counter-clockwise from x.
        turning: by how much that changes in a second, degrees/s, once it blows.
        gust: standard deviation of what gusts add on each axis, m/s.
        gust_time: time constant of the gusts, s.
        since: when it begins to blow, s after the start of an episode.

    Source: gusts are noise through a filter of first order, as the longitudinal ones of the Dryden spectra of
        MIL-F-8785C, section 3.7, which for 3 m, the lowest height that it covers, and 5 m/s has 0.2 times the speed and
        4.6 s.
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
    """What the drone takes up, or drops, in flight; its controller goes on as if it had not.

    Attributes:
        mass: taken up, kg; negative where it is dropped. The drone has 0.716 kg.
        since: when, s after the start of an episode.

    Source: Ascending Technologies' data sheet of the Hummingbird has a largest load of 0.2 kg.
    """

    _place = "load"

    mass: float = setting(0.0, "kg", at_least=-0.5, at_most=1.0)
    since: float = setting(0.0, "s", at_least=0.0, at_most=100_000.0)


@dataclass(frozen=True, slots=True)
class Motors(WorldPart):
    """Motors that do not do what is commanded, in the plane of the ground; no controller is informed of it.

    Attributes:
        mirror: right is taken for left, and left for right.
        angle: by which the flight is then turned, anticlockwise seen from above, degrees.
        gain: how many times as fast as commanded the drone flies.
        since: when this begins, s after the start of an episode; before, the motors do what is commanded.
    """

    _place = "motors"

    mirror: bool = setting(False)
    angle: float = setting(0.0, "degrees", at_least=-360.0, at_most=360.0)
    gain: float = setting(1.0, above=0.0, at_most=10.0)
    since: float = setting(0.0, "s", at_least=0.0, at_most=100_000.0)

    def flown(self, right: float, down: float) -> tuple[float, float]:
        """What the drone does at a command to fly to the right and down the picture, as shares of v_max."""
        right = -right if self.mirror else right
        c, s = self.gain * cos(radians(self.angle)), self.gain * sin(radians(self.angle))
        return right * c + down * s, down * c - right * s
