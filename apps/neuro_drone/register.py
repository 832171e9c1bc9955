"""Tells gymnasium of the environment; gymnasium calls this when it is imported."""

from __future__ import annotations

__all__ = ["register"]


def register() -> None:
    """Make ``gymnasium.make("neuro/Drone-v0")`` work; the name before the slash is the entry point's."""
    import gymnasium

    gymnasium.register(id="Drone-v0", entry_point="neuro_drone.env:DroneEnv")
