"""Where the drone is, what there is to be seen, and where its camera sees it.

World: x, y on the ground, z up, m. Heading: counter-clockwise from x, so that a drone of heading 0 looks along x and
has y on its left. Picture: x to the right, y downwards, px; centres of pixels are whole numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, radians, sin, sqrt, tan

import numpy as np
import numpy.typing as npt

AIM = 63.0
"""Row and column of the picture at which a target shall be, px. Source: thesis, section 7.3.7 (63 x 63 px)."""


@dataclass(slots=True)
class Pose:
    """Place and attitude of a drone.

    Attributes:
        x, y, z: m.
        yaw: heading, rad.
        pitch: nose down, rad.
        roll: right side down, rad.
    """

    x: float
    y: float
    z: float
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class WorldScene:
    """Objects on the ground; how bright they are is the scenario's.

    Attributes:
        ball: x, y, z of the middle and the radius, m; None for no ball.
        line: (n, 4) float64, segments from x, y to x, y on the ground, m; None for no line.
    """

    ball: tuple[float, float, float, float] | None = None
    line: npt.NDArray[np.float64] | None = None


class CameraView:
    """A pinhole camera below a drone.

    Args:
        size: pixels of a side.
        fov: angle of view over the whole width, degrees.
        tilt: of the optical axis below the horizontal, degrees; 90 looks straight down.
        fixed: to the body, so that it rolls and pitches with it; else a gimbal keeps it level.
        roll: by which it is turned about its axis, clockwise seen from behind, degrees.

    Attributes:
        matrix: (4, 3), the camera's axes right, down and forward in the world, and its place (m).
        focal: focal length, px.
        middle: where the optical axis meets the picture, px, on both axes.

    Source: thesis, figure 66 (128 x 128 pixels, 65 degrees) and section 7.3.2 (tilted by 30 degrees, without a
        word on the reference; here always below the horizontal).
    """

    def __init__(
        self, size: int = 128, fov: float = 65.0, tilt: float = 60.0, fixed: bool = False, roll: float = 0.0
    ) -> None:
        self.size, self.tilt, self.fixed, self.roll = size, radians(tilt), fixed, radians(roll)
        self.focal = 0.5 * size / tan(radians(0.5 * fov))
        self.middle = 0.5 * (size - 1)
        self.matrix: npt.NDArray[np.float64] = np.zeros((4, 3))
        self.look(Pose(0.0, 0.0, 1.0))

    def look(self, pose: Pose, shake: tuple[float, float] = (0.0, 0.0)) -> None:
        """Take up a pose.

        Args:
            pose: of the drone.
            shake: by how much the camera is turned right and down beside it, rad.
        """
        tilt, pan = self.tilt + shake[1], shake[0]
        ct, st, cp, sp = cos(tilt), sin(tilt), cos(pan), sin(pan)
        right, down = (-sp, -cp, 0.0), (-st * cp, st * sp, -ct)
        if self.roll:
            c, s = cos(self.roll), sin(self.roll)
            pairs = tuple(zip(right, down, strict=True))
            (r1, r2, r3), (d1, d2, d3) = (c * a + s * b for a, b in pairs), (c * b - s * a for a, b in pairs)
            right, down = (r1, r2, r3), (d1, d2, d3)
        axes = (right, down, (ct * cp, -ct * sp, -st))
        cy, sy = cos(pose.yaw), sin(pose.yaw)
        m = self.matrix
        if self.fixed:
            # front, left and up of the body in the world
            c1, s1, c2, s2 = cos(pose.pitch), sin(pose.pitch), cos(pose.roll), sin(pose.roll)
            front = (cy * c1, sy * c1, -s1)
            left = (cy * s1 * s2 - sy * c2, sy * s1 * s2 + cy * c2, c1 * s2)
            up = (cy * s1 * c2 + sy * s2, sy * s1 * c2 - cy * s2, c1 * c2)
            for i, (a, b, c) in enumerate(axes):
                for k in range(3):
                    m[i, k] = a * front[k] + b * left[k] + c * up[k]
        else:
            for i, (a, b, c) in enumerate(axes):
                m[i, 0], m[i, 1], m[i, 2] = a * cy - b * sy, a * sy + b * cy, c
        m[3, 0], m[3, 1], m[3, 2] = pose.x, pose.y, pose.z
        self._rows: list[list[float]] = m.tolist()

    def project(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Where a point of the world is in the picture.

        Returns:
            Column and row, px, and depth along the optical axis, m; what is behind the camera has a depth of at most
            0, and column and row are then infinite.
        """
        right, down, forward, (px, py, pz) = self._rows
        x, y, z = x - px, y - py, z - pz
        depth = x * forward[0] + y * forward[1] + z * forward[2]
        if depth <= 0.0:
            return inf, inf, depth
        f = self.focal / depth
        u = self.middle + f * (x * right[0] + y * right[1] + z * right[2])
        v = self.middle + f * (x * down[0] + y * down[1] + z * down[2])
        return u, v, depth

    def tall(self, x: float, y: float, z: float, radius: float) -> float:
        """How tall a ball's picture is, px: from its highest to its lowest row.

        Returns:
            The height; infinite where the ball is not wholly in front of the camera.
        """
        _, down, forward, (px, py, pz) = self._rows
        x, y, z = x - px, y - py, z - pz
        depth = x * forward[0] + y * forward[1] + z * forward[2]
        if depth <= radius:
            return inf
        b = x * down[0] + y * down[1] + z * down[2]
        # The planes through the camera that touch the ball and hold the direction to the right meet the picture there.
        return 2.0 * self.focal * radius * sqrt(b * b + depth * depth - radius * radius) / (depth**2 - radius**2)

    def depth_of(self, v: float, radius: float, tall: float) -> float:
        """How far along the optical axis a ball is whose middle is in a row and whose picture is so tall, m.

        Args:
            v: row, px.
            radius: m.
            tall: see there, px.
        """
        slant, wide = ((v - self.middle) / self.focal) ** 2 + 1.0, 2.0 * self.focal * radius / tall
        half = radius**2 + 0.5 * wide**2 * slant
        return sqrt(half + sqrt(half * half - radius**4 - (wide * radius) ** 2))

    def ray(self, u: float, v: float) -> tuple[float, float, float]:
        """Direction in the world of what a pixel sees, of length 1 along the optical axis."""
        right, down, forward, _ = self._rows
        a, b = (u - self.middle) / self.focal, (v - self.middle) / self.focal
        return (
            a * right[0] + b * down[0] + forward[0],
            a * right[1] + b * down[1] + forward[1],
            a * right[2] + b * down[2] + forward[2],
        )

    def row(self, v: float) -> tuple[float, float, float]:
        """A vector at right angles to all that a row of the picture sees; it points upwards in the picture."""
        _, down, forward, _ = self._rows
        b = (v - self.middle) / self.focal
        return b * forward[0] - down[0], b * forward[1] - down[1], b * forward[2] - down[2]

    def place(self) -> tuple[float, float, float]:
        """Where the camera is, m."""
        x, y, z = self._rows[3]
        return x, y, z

    def ground(self, u: float, v: float, height: float = 0.0) -> tuple[float, float] | None:
        """Where on a level plane a pixel looks.

        Args:
            u: column, px.
            v: row, px.
            height: of the plane above the ground, m.

        Returns:
            x and y, m; None where the pixel looks at the sky.
        """
        dx, dy, dz = self.ray(u, v)
        px, py, pz = self._rows[3]
        if dz >= 0.0:
            return None
        s = (height - pz) / dz
        return px + s * dx, py + s * dy

    def sees(self, u: float, v: float) -> bool:
        """Whether a place is on the picture."""
        return -0.5 <= u < self.size - 0.5 and -0.5 <= v < self.size - 0.5
