"""What a task is: it sets a start, moves the target, and judges by geometry, never by the picture."""

from __future__ import annotations

from math import copysign
from typing import NamedTuple, Protocol

import numpy as np

from neuro_drone.geometry import AIM, CameraView, Pose, WorldScene
from neuro_drone.paths import FIXED, Path, Variation

__all__ = ["FARTHEST", "LARGEST_ERROR", "NEARER", "Judged", "Task", "border"]

FARTHEST = 64.5
"""Largest error that is still in the picture, px: from the aim to the right or the lower border."""

LARGEST_ERROR = 20.0
"""Mean distance of a target from the aim with which a lap still counts, px."""

NEARER = 0.75
"""What a lap needs at most of the mean error that is to be had without following, as a share of it."""


def border(error: tuple[float, ...]) -> tuple[float, float]:
    """Column and row just out of the picture on the side where a target was, px; for one that no pixel looks at."""
    u, v = error[:2]
    return AIM + copysign(FARTHEST, u), AIM + copysign(FARTHEST, v)


class Judged(NamedTuple):
    """How the drone stands at one moment.

    Attributes:
        target: column and row of the target, px; of one that no pixel can look at, at the border on its last side.
        error: signed, on each axis: ball px and px, and of three axes px by which it is too tall; line px and degrees.
        scaled: the error as a share of the largest, on each axis; of the third of what is wanted.
        error_px: ball: distance of the target from the aim; line: distance to the side, px.
        reward: 1 - e / e_max, 0 to 1.
        progress: share of the lap, 0 to 1.
        lost: the target is out of the picture.
        done: the lap is over.
        lap: it counts.
    """

    target: tuple[float, float]
    error: tuple[float, ...]
    scaled: tuple[float, ...]
    error_px: float
    reward: float
    progress: float
    lost: bool
    done: bool
    lap: bool


class Task(Protocol):
    """What is followed.

    Attributes:
        forward: speed that the drone has whatever the action, m/s, in this episode.
        turns: the second action turns the drone; else it moves it backwards.
        path: along which the target is in this episode.
    """

    forward: float
    turns: bool
    path: Path

    def reset(
        self,
        rng: np.random.Generator,
        start: tuple[float, ...] | None = None,
        direction: int = 0,
        varied: Variation = FIXED,
    ) -> Pose:
        """Begin an episode.

        Args:
            rng: of what is not given.
            start: error on each axis at the beginning, in the units of `Judged.error`; None draws one.
            direction: 1 anticlockwise, -1 clockwise, 0 as the scenario says.
            varied: how the path differs from the scenario's.

        Returns:
            Where the drone is, level.

        Raises:
            ModelError: no place of the drone gives this start.
        """

    def scene(self) -> WorldScene:
        """What there is to be seen now."""

    def advance(self, seconds: float) -> WorldScene:
        """Let time pass; returns what there is to be seen then."""

    def judge(self, view: CameraView, pose: Pose) -> Judged:
        """Judge the drone at `pose`, whose camera is `view`; once after each `advance`."""
