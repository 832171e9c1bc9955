"""Closed paths on the ground: the star that the ball goes round, and the hexagon that is painted."""

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
"""Distance of the star's inner points from its middle, as a share of that of its tips; the thesis gives a picture."""

HANDLE = 0.25
"""Distance of a Bezier curve's second point from its first, as a share of that of its last; rounds the tips."""

PIECES = 4096


@dataclass(frozen=True, slots=True)
class Variation:
    """How the path of an episode differs from the scenario's.

    Attributes:
        scale: of the path, a factor.
        turn: of the path about its middle, degrees anticlockwise.
        stretch: of a line: factor along x, and its inverse along y, after the turn.
        speed: factor on that of the ball, or of the drone along a line.
        begin: of a ball: share of the path by which the beginning moves on; of a line: share of the first side.
    """

    scale: float = 1.0
    turn: float = 0.0
    stretch: float = 1.0
    speed: float = 1.0
    begin: float = 0.0

    def __str__(self) -> str:
        """In a few words."""
        if self == FIXED:
            return "the fixed path"
        size = f"scaled by {self.scale:.2f}" + (f", stretched by {self.stretch:.2f}" if self.stretch != 1.0 else "")
        return f"a path {size}, turned by {self.turn:.0f} degrees, {self.speed:.2f} times as fast"


FIXED = Variation()
"""The scenario's path as it is."""


def drawn(rng: np.random.Generator, line: bool) -> Variation:
    """A variation: factors are drawn evenly in their logarithm, all else evenly.

    The ranges are so wide that what flies without looking, as a recorded flight that is replayed, loses its target.

    Args:
        rng: draws it.
        line: of a line, else of a ball.
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
"""What the paths of a test's laps can be."""

TESTS = 1_000_000
"""Seed of what tests draw, paths and noise, so that it is not that of a training."""


@dataclass(frozen=True, slots=True)
class FlightCourse:
    """The paths of a test's laps.

    Attributes:
        path: varied (each lap has a path of its own, see `drawn`) or fixed (the scenario's, as in the thesis; a flight
            that was recorded can fly it blindly).
        seed: of the varied paths.

    Raises:
        ModelError: there is no such path, or the seed is no whole number >= 0 or would change nothing.
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
        """In a few words."""
        return f"varied paths, seed {self.seed}" if self.path == "varied" else "the fixed path"

    def lap(self, index: int, line: bool) -> Variation:
        """The path of a lap.

        Args:
            index: of the lap, from 0.
            line: of a line, else of a ball.
        """
        return FIXED if self.path == "fixed" else drawn(np.random.default_rng((TESTS, self.seed, index)), line)


VARIED = FlightCourse()
"""What is flown if nothing else is said."""


class Path:
    """A closed path along straight pieces.

    Args:
        points: (n, 2) corners, m; the last is joined to the first.

    Attributes:
        points: as given.
        length: once round, m.
    """

    def __init__(self, points: Floats) -> None:
        self.points = points
        self.length = float(np.hypot(*(np.roll(points, -1, 0) - points).T).sum())
        self._xs: list[float] = [*points[:, 0].tolist(), float(points[0, 0])]
        self._ys: list[float] = [*points[:, 1].tolist(), float(points[0, 1])]
        self._per_metre = len(points) / self.length

    def at(self, s: float) -> tuple[float, float]:
        """The place after `s` metres from the first point of a path whose pieces are equally long, round and round."""
        f = s * self._per_metre
        i = int(f // 1.0)
        f -= i
        i %= len(self._xs) - 1
        xs, ys = self._xs, self._ys
        return xs[i] + f * (xs[i + 1] - xs[i]), ys[i] + f * (ys[i + 1] - ys[i])

    def varied(self, by: Variation) -> Path:
        """This path scaled, turned and stretched.

        Args:
            by: how; speed and begin make no difference.
        """
        if by == FIXED:
            return self
        c, s = cos(radians(by.turn)), sin(radians(by.turn))
        turned = self.points @ np.array([[c, s], [-s, c]])
        return Path(turned * (by.scale * by.stretch, by.scale / by.stretch))

    def segments(self) -> Floats:
        """All pieces, (n, 4): from x, y to x, y, m."""
        return np.hstack([self.points, np.roll(self.points, -1, 0)])


def star(lap: float) -> Path:
    """The closed Bezier curve through the eight points of a star of four branches, around the origin.

    Between two points it is a cubic whose tangents are parallel to the chord of the neighbours, so that the curve is
    smooth all round; then it is cut into pieces of equal length.

    Args:
        lap: its length, m.

    Source: thesis, figures 62 and 63 ("a Bezier curve defined by 8 control points, positioned in a four-branch star
        shape").
    """
    angle = np.arange(8) * (pi / 4)
    radius = np.where(np.arange(8) % 2 == 0, 1.0, INNER)
    p = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
    q = np.roll(p, -1, 0)
    chord = q - np.roll(p, 1, 0)
    side = np.hypot(*(q - p).T)[0]
    tangent = HANDLE * side * chord / np.hypot(*chord.T)[:, None]
    t = np.linspace(0.0, 1.0, 2 * PIECES, endpoint=False)[:, None, None]
    u = 1.0 - t
    curve = u**3 * p + 3 * u**2 * t * (p + tangent) + 3 * u * t**2 * (q - np.roll(tangent, -1, 0)) + t**3 * q
    fine = curve.transpose(1, 0, 2).reshape(-1, 2)
    fine = np.vstack([fine, fine[:1]])
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(fine, axis=0).T))))
    even = np.arange(PIECES) * (along[-1] / PIECES)
    points = np.stack([np.interp(even, along, fine[:, k]) for k in range(2)], 1)
    return Path(points * (lap / Path(points).length))


def hexagon(side: float, direction: int = 1) -> Path:
    """A regular hexagon around the origin.

    Args:
        side: m.
        direction: 1 anticlockwise seen from above, -1 clockwise.

    Source: thesis, figures 64 and 65.
    """
    corners = [(side * cos(k * pi / 3), side * sin(k * direction * pi / 3)) for k in range(6)]
    return Path(np.array(corners))
