"""Poses of the drone, objects of the world, and the projection of the world into the camera's picture.

World: x and y on the ground, z up, m. Heading: counter-clockwise from x, so a drone of heading 0 looks along x and has
y on its left. Picture: x to the right, y downwards, px; pixel centres are whole numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, radians, sin, sqrt, tan

import numpy as np
import numpy.typing as npt

AIM = 63.0
"""Row and column of the picture where the controller keeps the target, px. Source: thesis, section 7.3.7."""


@dataclass(slots=True)
class Pose:
    """Position and attitude of a drone.

    Attributes:
        x, y, z: position, m.
        yaw: heading, rad.
        pitch: rotation with the nose down, rad.
        roll: rotation with the right side down, rad.
    """

    x: float
    y: float
    z: float
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class WorldScene:
    """Objects on the ground. The scenario sets their brightness.

    Attributes:
        ball: x, y and z of the centre, and the radius, m; None for no ball.
        line: (n, 4) float64, segments from x, y to x, y on the ground, m; None for no line.
    """

    ball: tuple[float, float, float, float] | None = None
    line: npt.NDArray[np.float64] | None = None


class CameraView:
    """A pinhole camera below a drone.

    Args:
        size: width and height of the picture, px.
        fov: angle of view over the whole width, degrees.
        tilt: angle of the optical axis below the horizontal, degrees; 90 looks straight down.
        fixed: True mounts the camera on the body, so it rolls and pitches with the drone; False keeps it level by a
            gimbal.
        roll: rotation of the camera about its optical axis, clockwise seen from behind, degrees.

    Attributes:
        matrix: (4, 3), rows 0 to 2 are the camera's axes right, down and forward in the world; row 3 is its position,
            m.
        focal: focal length, px.
        middle: row and column where the optical axis meets the picture, px.

    Source: thesis, figure 66 (128 x 128 pixels, 65 degrees) and section 7.3.2 (tilted by 30 degrees). The thesis does
    not name the reference direction of the tilt.
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
        """Move the camera to the pose of the drone.

        Args:
            pose: pose of the drone.
            shake: extra rotations of the camera to the right and down, rad.
        """
        tilt, pan = self.tilt + shake[1], shake[0]
        ct, st, cp, sp = cos(tilt), sin(tilt), cos(pan), sin(pan)
        # axes of the camera as (front, left, up) of the body
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
            # front, left and up of the body in world coordinates
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
        """Project a point of the world into the picture.

        Returns:
            Column and row, px, and depth along the optical axis, m. A point behind the camera has a depth of at most 0
            and an infinite column and row.
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
        """Return the height of a ball's picture, highest to lowest row, px.

        The height is infinite if part of the ball is beside or behind the camera.
        """
        _, down, forward, (px, py, pz) = self._rows
        x, y, z = x - px, y - py, z - pz
        depth = x * forward[0] + y * forward[1] + z * forward[2]
        if depth <= radius:
            return inf
        b = x * down[0] + y * down[1] + z * down[2]
        # Two planes through the camera's right axis touch the ball and cut the picture at these rows.
        return 2.0 * self.focal * radius * sqrt(b * b + depth * depth - radius * radius) / (depth**2 - radius**2)

    def depth_of(self, v: float, radius: float, tall: float) -> float:
        """Return the depth of a ball, m, from the height of its picture; the inverse of `tall`.

        Args:
            v: row of the ball's centre, px.
            radius: radius of the ball, m.
            tall: height of the ball's picture, px.
        """
        slant, level_depth = ((v - self.middle) / self.focal) ** 2 + 1.0, 2.0 * self.focal * radius / tall
        half = radius**2 + 0.5 * level_depth**2 * slant
        return sqrt(half + sqrt(half * half - radius**4 - (level_depth * radius) ** 2))

    def ray(self, u: float, v: float) -> tuple[float, float, float]:
        """Return the direction in the world of the ray through a pixel, scaled to length 1 along the optical axis."""
        right, down, forward, _ = self._rows
        a, b = (u - self.middle) / self.focal, (v - self.middle) / self.focal
        return (
            a * right[0] + b * down[0] + forward[0],
            a * right[1] + b * down[1] + forward[1],
            a * right[2] + b * down[2] + forward[2],
        )

    def row(self, v: float) -> tuple[float, float, float]:
        """Return the normal of the plane that contains the rays of a picture row; it points upwards in the picture."""
        _, down, forward, _ = self._rows
        b = (v - self.middle) / self.focal
        return b * forward[0] - down[0], b * forward[1] - down[1], b * forward[2] - down[2]

    def place(self) -> tuple[float, float, float]:
        """Return the position of the camera in the world, m."""
        x, y, z = self._rows[3]
        return x, y, z

    def ground(self, u: float, v: float, height: float = 0.0) -> tuple[float, float] | None:
        """Return the point where the ray of a pixel meets a level plane.

        Args:
            u: column, px.
            v: row, px.
            height: height of the plane above the ground, m.

        Returns:
            x and y, m; None if the ray points at the horizon or above.
        """
        dx, dy, dz = self.ray(u, v)
        px, py, pz = self._rows[3]
        if dz >= 0.0:
            return None
        s = (height - pz) / dz
        return px + s * dx, py + s * dy

    def sees(self, u: float, v: float) -> bool:
        """Return whether column `u` and row `v` are inside the picture."""
        return -0.5 <= u < self.size - 0.5 and -0.5 <= v < self.size - 0.5
