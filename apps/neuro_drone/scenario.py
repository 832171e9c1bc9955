"""A scenario: world, camera, drone and task, as frozen parts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

__all__ = ["Ball", "Camera", "Drone", "Ground", "Line", "NAMES", "Scenario", "load"]


@dataclass(frozen=True, slots=True)
class Ball:
    """A ball that rolls round a closed Bezier curve through a star of four branches; the drone moves in x and y only.

    Attributes:
        lap: length of the curve, m.
        speed: of the ball, m/s.
        radius: m.
        brightness: share of full scale.

    Source: thesis, figure 63 (0.075 m/s) and section 7.3.7 (13 px in the picture, which sets the radius).
    """

    lap: float = 7.5
    speed: float = 0.075
    radius: float = 0.17
    brightness: float = 0.2


@dataclass(frozen=True, slots=True)
class Line:
    """A hexagon painted on the ground; the drone flies forward, moves sideways and turns.

    Attributes:
        side: of the hexagon, m.
        width: of the line, m.
        speed: forward, m/s.
        brightness: share of full scale.
        direction: 1 anticlockwise seen from above, -1 clockwise, 0 drawn for each episode.

    Source: thesis, figure 65 (0.075 m/s); sides long enough that one is seen at a time.
    """

    side: float = 3.0
    width: float = 0.12
    speed: float = 0.075
    brightness: float = 0.2
    direction: int = 0


@dataclass(frozen=True, slots=True)
class Ground:
    """The ground.

    Attributes:
        brightness: share of full scale, on average.
        texture: contrast of a pattern on it, as a share of the brightness; 0 for plain.
        grain: size of the pattern's largest spots, m.
        redraw: a new pattern for each episode.
    """

    brightness: float = 0.6
    texture: float = 0.0
    grain: float = 0.2
    redraw: bool = False


@dataclass(frozen=True, slots=True)
class Camera:
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

    tilt: float = 60.0
    fov: float = 65.0
    mount: str = "gimbal"
    shake: float = 0.0
    pos_thres: float = 0.15
    neg_thres: float = 0.15
    sigma_thres: float = 0.0
    leak_rate_hz: float = 0.0
    shot_noise_rate_hz: float = 0.0
    refractory_period_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Drone:
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

    physics: str = "kinematic"
    height: float = 2.4
    v_max: float = 2.0
    yaw_max: float = 0.8
    lag: float = 0.2
    a_max: float = 3.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """All that an episode is told.

    Attributes:
        name: what it is called.
        step: between two actions, ms.
        task: what is followed.
        camera, ground, drone: of the world.
        light: factor on all brightness.
    """

    name: str = "B60"
    step: float = 50.0
    task: Ball | Line = field(default_factory=Ball)
    camera: Camera = field(default_factory=Camera)
    ground: Ground = field(default_factory=Ground)
    drone: Drone = field(default_factory=Drone)
    light: float = 1.0


SCENARIOS = {
    "A30": Scenario("A30", 20.0, Ball(lap=3.0, radius=0.27), Camera(tilt=30.0)),
    "A60": Scenario("A60", 20.0, Ball(lap=3.0)),
    "B30": Scenario("B30", 50.0, Ball(radius=0.27), Camera(tilt=30.0)),
    "B60": Scenario("B60"),
    "C60": Scenario("C60", 20.0, Ball(lap=15.0, speed=0.375)),
    "line": Scenario("line", 50.0, Line()),
    "B60-texture": Scenario("B60-texture", ground=Ground(texture=0.3)),
}
NAMES = tuple(SCENARIOS)


def load(name: Scenario | str | Path, **changes: Any) -> Scenario:
    """A scenario by its name or from a YAML file, with some values changed."""
    scenario = name if isinstance(name, Scenario) else SCENARIOS[str(name)]
    for path, value in changes.items():
        part, dot, word = path.partition(".")
        if dot:
            scenario = replace(scenario, **{part: replace(getattr(scenario, part), **{word: value})})
        elif isinstance(value, dict):
            scenario = replace(scenario, **{part: replace(getattr(scenario, part), **value)})
        else:
            scenario = replace(scenario, **{part: value})
    return scenario
