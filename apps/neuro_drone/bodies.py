"""Which body flies for which physics."""

from __future__ import annotations

from neuro_drone.body import Body, Kinematic
from neuro_drone.bullet import Bullet
from neuro_drone.scenario import Drone

__all__ = ["body_of"]


def body_of(drone: Drone) -> Body:
    """The body for the physics that a drone asks for.

    Raises:
        ModelError: it needs a package that is not installed.
    """
    if drone.physics == "kinematic":
        return Kinematic(drone)
    return Bullet(drone)
