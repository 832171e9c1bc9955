"""Closed paths on the ground: the ball's star and the painted hexagon."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, sin

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import unknown
from neuro_drone.parts import check_whole

Floats = npt.NDArray[np.float64]

INNER = 0.5
"""Radius of the star's inner points as a share of the radius of its tips, read off the figure in the thesis."""

HANDLE = 0.25
"""Distance of a Bezier curve's inner control points from its ends, as a share of the chord. A larger share rounds the
tips more."""

PIECES = 4096
"""Straight pieces of the ball's path."""


@dataclass(frozen=True, slots=True)
class Variation:
    """Changes of an episode's path relative to the scenario's path.

    Attributes:
        scale: factor on the size of the path.
        turn: rotation of the path about its centre, degrees anticlockwise.
        stretch: for a line, factor along x. Along y the factor is 1 / stretch. The path is turned first.
        speed: factor on the speed of the ball, or of the drone along a line.
        begin: shift of the beginning along the path: for a ball as a share of the path, for a line as a share of the
            first side.
    """

    scale: float = 1.0
    turn: float = 0.0
    stretch: float = 1.0
    speed: float = 1.0
    begin: float = 0.0

    def __str__(self) -> str:
        """Describe the path, e.g. "a path scaled by 1.10, turned by 30 degrees, 0.90 times as fast"."""
        if self == FIXED:
            return "the fixed path"
        shape = f"scaled by {self.scale:.2f}" + (f", stretched by {self.stretch:.2f}" if self.stretch != 1.0 else "")
        return f"a path {shape}, turned by {self.turn:.0f} degrees, {self.speed:.2f} times as fast"


FIXED = Variation()
"""The scenario's path without changes."""


def draw_variation(rng: np.random.Generator, line: bool) -> Variation:
    """Draw a variation: factors uniformly in their logarithm, angles and shifts uniformly.

    The ranges are so wide that a controller without the camera, e.g. a replayed flight, loses the target.

    Args:
        rng: random generator.
        line: True for a line, False for a ball.
    """

    def factor(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    turn = float(rng.uniform(-180.0, 180.0))
    if line:
        return Variation(
            factor(0.8, 2.5), turn, factor(1 / 1.2, 1.2), factor(1 / 1.4, 1.4), float(rng.uniform(-0.3, 0.3))
        )
    return Variation(factor(1 / 1.4, 1.4), turn, 1.0, factor(1 / 1.4, 1.4), float(rng.uniform()))


PATHS = ("varied", "fixed")
"""Names of the paths of a test's laps."""

TESTS = 1_000_000
"""Seed of the paths and noise of tests, so that a test differs from the training."""


@dataclass(frozen=True, slots=True)
class FlightCourse:
    """The paths of a test's laps.

    Attributes:
        path: "varied" draws a path for each lap, see `draw_variation`; "fixed" is the scenario's path, as in the
            thesis. A replayed flight can complete the fixed path without the camera.
        seed: seed of the varied paths.

    Raises:
        ModelError: there is no such path, the seed is no whole number >= 0, or a seed is given for the fixed path.
    """

    path: str = "varied"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.path not in PATHS:
            raise unknown("path", self.path, PATHS)
        check_whole("seed of the paths", self.seed, below="2^63")
        if self.seed and self.path == "fixed":
            raise ModelError(f"seed of the paths = {self.seed}: the fixed path has none: expected path varied")

    def __str__(self) -> str:
        """Describe the paths, e.g. "varied paths, seed 0"."""
        return f"varied paths, seed {self.seed}" if self.path == "varied" else "the fixed path"

    def lap(self, index: int, line: bool) -> Variation:
        """Return the path of a lap.

        Args:
            index: number of the lap, from 0.
            line: True for a line, False for a ball.
        """
        return FIXED if self.path == "fixed" else draw_variation(np.random.default_rng((TESTS, self.seed, index)), line)


VARIED = FlightCourse()
"""The default paths of a test."""


class Path:
    """A closed path of straight pieces.

    Args:
        points: (n, 2), corners, m. The last corner is joined to the first.

    Attributes:
        points: the corners.
        length: length of the whole path, m.
    """

    def __init__(self, points: Floats) -> None:
        self.points = points
        self.length = float(np.hypot(*(np.roll(points, -1, 0) - points).T).sum())
        self._xs: list[float] = [*points[:, 0].tolist(), float(points[0, 0])]
        self._ys: list[float] = [*points[:, 1].tolist(), float(points[0, 1])]
        self._per_metre = len(points) / self.length

    def at(self, s: float) -> tuple[float, float]:
        """Return the position `s` metres after the first point. All pieces must have equal lengths; `s` wraps round."""
        share = s * self._per_metre
        piece = int(share // 1.0)
        share -= piece
        piece %= len(self._xs) - 1
        xs, ys = self._xs, self._ys
        return xs[piece] + share * (xs[piece + 1] - xs[piece]), ys[piece] + share * (ys[piece + 1] - ys[piece])

    def varied(self, by: Variation) -> Path:
        """Return this path scaled, turned and stretched.

        Args:
            by: the variation; its speed and begin are ignored.
        """
        if by == FIXED:
            return self
        c, s = cos(radians(by.turn)), sin(radians(by.turn))
        turned = self.points @ np.array([[c, s], [-s, c]])
        return Path(turned * (by.scale * by.stretch, by.scale / by.stretch))

    def segments(self) -> Floats:
        """Return all pieces, (n, 4): from x, y to x, y, m."""
        return np.hstack([self.points, np.roll(self.points, -1, 0)])


def star(lap: float) -> Path:
    """Return the closed Bezier curve through the eight points of a star of four branches, around the origin.

    Each piece between two points is a cubic. Its tangent at a point is parallel to the chord between the two neighbours
    of this point, so the curve is smooth everywhere. The curve is then cut into pieces of equal length.

    Args:
        lap: length of the curve, m.

    Source: thesis, figures 62 and 63 ("a Bezier curve defined by 8 control points, positioned in a four-branch star
    shape").
    """
    angle = np.arange(8) * (pi / 4)
    radius = np.where(np.arange(8) % 2 == 0, 1.0, INNER)
    starts = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
    ends = np.roll(starts, -1, 0)
    chord = ends - np.roll(starts, 1, 0)
    side = np.hypot(*(ends - starts).T)[0]
    tangent = HANDLE * side * chord / np.hypot(*chord.T)[:, None]
    t = np.linspace(0.0, 1.0, 2 * PIECES, endpoint=False)[:, None, None]
    u = 1.0 - t
    # cubic Bezier curves between all pairs of neighbours at once, (samples, 8, 2)
    curve = (
        u**3 * starts
        + 3 * u**2 * t * (starts + tangent)
        + 3 * u * t**2 * (ends - np.roll(tangent, -1, 0))
        + t**3 * ends
    )
    samples = curve.transpose(1, 0, 2).reshape(-1, 2)
    samples = np.vstack([samples, samples[:1]])
    lengths = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(samples, axis=0).T))))
    even_lengths = np.arange(PIECES) * (lengths[-1] / PIECES)
    points = np.stack([np.interp(even_lengths, lengths, samples[:, k]) for k in range(2)], 1)
    return Path(points * (lap / Path(points).length))


def hexagon(side: float, direction: int = 1) -> Path:
    """Return a regular hexagon around the origin.

    Args:
        side: length of a side, m.
        direction: 1 anticlockwise seen from above, -1 clockwise.

    Source: thesis, figures 64 and 65.
    """
    corners = [(side * cos(k * pi / 3), side * sin(k * direction * pi / 3)) for k in range(6)]
    return Path(np.array(corners))
