"""Tells gymnasium of the environment."""

from __future__ import annotations

import gymnasium

__all__ = ["ID", "register"]

ID = "neuro/Drone-v0"


def register() -> None:
    """Make ``gymnasium.make("neuro/Drone-v0")`` work; gymnasium 1.0 and later look for no plug-ins of themselves."""
    if ID not in gymnasium.registry:
        gymnasium.register(id=ID, entry_point="neuro_drone.env:DroneEnv")
