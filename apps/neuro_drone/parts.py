"""The parts of a scenario and what their values may be."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from neuro.apps import Quantity, check_fields

__all__ = ["Ball", "Camera", "Drone", "Ground", "Line", "Part", "one_of", "range_of"]


def range_of(default: float, unit: str = "", **bounds: Any) -> Any:
    """A field that is a number within bounds, those of `Quantity`; a whole one where the default is."""
    kind = "integer" if isinstance(default, int) else "number"
    return field(default=default, metadata={"quantity": Quantity(unit=unit, kind=kind, **bounds)})


def one_of(default: str, *words: str) -> Any:
    """A field that is one of some words."""
    return field(default=default, metadata={"quantity": Quantity(kind="word", words=words)})


class Part:
    """A frozen dataclass whose fields are checked."""

    __slots__ = ()
    _place = ""

    def __post_init__(self) -> None:
        check_fields(self, self._place)


@dataclass(frozen=True, slots=True)
class Ball(Part):
    """A ball that rolls round a closed Bezier curve through a star of four branches; the drone moves in x and y only.

    Attributes:
        lap: length of the curve, m.
        speed: of the ball, m/s.
        radius: m.
        brightness: share of full scale.

    Source: thesis, figure 63 (0.075 m/s) and section 7.3.7 (13 px in the picture, which sets the radius).
    """

    _place = "task.ball"

    lap: float = range_of(7.5, above=0.0, at_most=1000.0, unit="m")
    speed: float = range_of(0.075, above=0.0, at_most=20.0, unit="m/s")
    radius: float = range_of(0.17, above=0.0, at_most=10.0, unit="m")
    brightness: float = range_of(0.2, at_least=0.0, at_most=1.0)


@dataclass(frozen=True, slots=True)
class Line(Part):
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

    side: float = range_of(3.0, above=0.0, at_most=1000.0, unit="m")
    width: float = range_of(0.12, above=0.0, at_most=10.0, unit="m")
    speed: float = range_of(0.075, above=0.0, at_most=20.0, unit="m/s")
    brightness: float = range_of(0.2, at_least=0.0, at_most=1.0)
    direction: int = range_of(0, at_least=-1, at_most=1)


@dataclass(frozen=True, slots=True)
class Ground(Part):
    """The ground.

    Attributes:
        brightness: share of full scale, on average.
        texture: contrast of a pattern on it, as a share of the brightness; 0 for plain.
        grain: size of the pattern's largest spots, m.
        redraw: a new pattern for each episode.
    """

    _place = "ground"

    brightness: float = range_of(0.6, at_least=0.0, at_most=1.0)
    texture: float = range_of(0.0, at_least=0.0, at_most=1.0)
    grain: float = range_of(0.2, at_least=0.01, at_most=100.0, unit="m")
    redraw: bool = field(default=False, metadata={"quantity": Quantity(kind="boolean")})


@dataclass(frozen=True, slots=True)
class Camera(Part):
    """The event camera; its pixels are those of `neuro.events.DVSParameters`.

    Attributes:
        tilt: below the horizontal, degrees.
        fov: over the whole width, degrees.
        mount: gimbal (stays level) or body (rolls and pitches with the drone).
        shake: standard deviation of a small random turn in each step, degrees; a still picture makes no events.
        pos_thres, neg_thres: contrast thresholds, log units.
        sigma_thres: their standard deviation from pixel to pixel.
        leak_rate_hz, shot_noise_rate_hz: noise of a pixel, Hz.
        refractory_period_s: s.
    """

    _place = "camera"

    tilt: float = range_of(60.0, at_least=1.0, at_most=90.0, unit="degrees")
    fov: float = range_of(65.0, at_least=10.0, at_most=150.0, unit="degrees")
    mount: str = one_of("gimbal", "gimbal", "body")
    shake: float = range_of(0.0, at_least=0.0, at_most=5.0, unit="degrees")
    pos_thres: float = range_of(0.15, at_least=0.01, at_most=10.0)
    neg_thres: float = range_of(0.15, at_least=0.01, at_most=10.0)
    sigma_thres: float = range_of(0.0, at_least=0.0, at_most=1.0)
    leak_rate_hz: float = range_of(0.0, at_least=0.0, at_most=1000.0, unit="Hz")
    shot_noise_rate_hz: float = range_of(0.0, at_least=0.0, at_most=1000.0, unit="Hz")
    refractory_period_s: float = range_of(0.0, at_least=0.0, at_most=1.0, unit="s")


@dataclass(frozen=True, slots=True)
class Drone(Part):
    """The quadrotor.

    Attributes:
        physics: kinematic or bullet.
        height: above the ground, m.
        v_max: speed that an action of 1 asks for, m/s.
        yaw_max: rate of turning that an action of 1 asks for, rad/s.
        lag: time constant of the speed, s.
        a_max: largest acceleration, m/s^2.

    Source: thesis, figure 63 (2.4 m); the others are measured choices, see docs/how-to/drone.md.
    """

    _place = "drone"

    physics: str = one_of("kinematic", "kinematic", "bullet")
    height: float = range_of(2.4, above=0.0, at_most=1000.0, unit="m")
    v_max: float = range_of(2.0, above=0.0, at_most=20.0, unit="m/s")
    yaw_max: float = range_of(0.8, above=0.0, at_most=10.0, unit="rad/s")
    lag: float = range_of(0.2, at_least=0.01, at_most=10.0, unit="s")
    a_max: float = range_of(3.0, above=0.0, at_most=30.0, unit="m/s^2")
