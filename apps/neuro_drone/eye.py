"""The drone's eye: pictures of the world with exact pixel coverage, and the events that a DVS emits for them."""

from __future__ import annotations

from math import radians
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.geometry import CameraView, Pose, WorldScene
from neuro_drone.parts import Camera, Ground, Line
from neuro_drone.scenario import Scenario
from neuro_events import DVS, DVSParameters, Events

SKY = 0.9
"""Brightness above the horizon as a share of full scale. The horizon is in the picture at tilts below 32.5 degrees."""

CORNERS = 1024
"""Largest number of corners of the polygon that approximates a ball's outline; a power of 2."""

Box = tuple[int, int, int, int]


class Eye:
    """The camera's picture and its events.

    A pixel's brightness is the mean over its square: ball, line, ground and sky are weighted by the share that they
    cover. Each object has one brightness (no shading), times the scenario's light. A ball is in front of everything
    else. Within a pixel, it hides ground, line and sky in equal proportion, so a pixel where the ball's outline crosses
    another edge is approximate. A pattern on the ground is filtered, not exact.

    Args:
        scenario: camera, ground, light and task.
        seed: seed of the ground's pattern. The constructor also calls `reset` with this seed.

    Attributes:
        view: the camera, in its last pose.
        image: (128, 128) float32, the last picture, linear in light, 1 = full scale. The next picture overwrites it.
    """

    def __init__(self, scenario: Scenario, *, seed: int = 0) -> None:
        from neuro_drone._paint_kernels import RUN, paint

        camera, task, light = scenario.camera, scenario.task, scenario.light
        self._ground, self._light = scenario.ground, light
        self.view = CameraView(fov=camera.fov, tilt=camera.tilt, fixed=camera.mount == "body", roll=camera.roll)
        size = self.view.size
        self._shake = radians(camera.shake)
        self._shades = light * np.array([SKY, scenario.ground.brightness, task.brightness, task.brightness])
        self._width = task.width if isinstance(task, Line) else 0.0
        self._parameters = pixels(camera)
        self._paint, self._work = paint, buffers(size, CORNERS)
        angle = 2.0 * np.pi / CORNERS * np.arange(CORNERS)
        self._circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self._ball, self._box = np.zeros(4), np.zeros(4, np.int64)
        self._line: npt.NDArray[np.float64] | None = None
        self._strips = np.zeros((0, 4, 2))
        self._dvs = self._new_dvs(seed)
        self._pattern: Pattern = pattern(scenario.ground, light, seed)
        self._ground_buffers = np.zeros((size, -(-size // RUN))), np.zeros(size), np.zeros(size)
        self._base, self._base_pose = np.zeros((size, size), np.float32), np.zeros((5, 3))
        self.image: npt.NDArray[np.float32] = np.zeros((size, size), np.float32)
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Begin a new episode: the next picture makes no events.

        Args:
            seed: seed of the camera's noise and shake, and of the ground's pattern if the scenario redraws it; >= 0.
        """
        self._dvs = self._new_dvs(seed)
        if self._ground.redraw:
            self._pattern = pattern(self._ground, self._light, seed)
        self._rng = np.random.default_rng([seed, 2])
        self._base_pose[4, 0] = 1.0  # makes `paint` draw everything
        self._box_is_valid = False

    def _new_dvs(self, seed: int) -> DVS:
        return DVS((self.view.size, self.view.size), self._parameters, seed=seed)

    def see(self, pose: Pose, scene: WorldScene, t_us: int) -> Events:
        """Take a picture of the world and return its events.

        Args:
            pose: pose of the drone.
            scene: objects on the ground. Do not change a scene's arrays after this call.
            t_us: time, us; later than the previous picture.

        Returns:
            The events since the previous picture; none after a reset.
        """
        box_is_valid = self._box_is_valid
        self.draw(pose, scene)
        events = self._dvs.see(self.image, t_us, changed=self.box if box_is_valid else None)
        self._box_is_valid = True
        return events

    def draw(self, pose: Pose, scene: WorldScene) -> npt.NDArray[np.float32]:
        """Draw the picture without making events.

        Args:
            pose: pose of the drone.
            scene: objects on the ground.

        Returns:
            The attribute `image`.
        """
        view, self._box_is_valid = self.view, False
        if self._shake:
            right, down = self._rng.normal(0.0, self._shake, 2).tolist()
            view.look(pose, (right, down))
        else:
            view.look(pose)
        if scene.line is not self._line:
            self._line = scene.line
            self._strips = np.zeros((0, 4, 2)) if scene.line is None else strips(scene.line, self._width)
        self._ball[:] = scene.ball or (0.0, 0.0, 0.0, 0.0)
        self._paint(
            view.matrix, view.focal, view.middle, self._shades, self._pattern + self._ground_buffers, self._ball,
            self._strips, self._circle, self._work, (self._base_pose, self._base, self.image, self._box),
        )  # fmt: skip
        return self.image

    @property
    def box(self) -> Box:
        """Part of the image that may differ from the previous one: first column and row, end column and row."""
        x0, y0, x1, y1 = self._box.tolist()
        return x0, y0, x1, y1


def pixels(camera: Camera) -> DVSParameters:
    """Return the pixel parameters of a scenario's camera."""
    names = (
        "pos_thres", "neg_thres", "sigma_thres", "leak_rate_hz", "shot_noise_rate_hz", "refractory_period_s"
    )  # fmt: skip
    values: dict[str, Any] = {name: getattr(camera, name) for name in names}
    return DVSParameters(**values)


def buffers(size: int, corners: int) -> tuple[npt.NDArray[Any], ...]:
    """Allocate the work arrays of `paint`: points, corners, cover, and the spans of this and the previous picture.

    Args:
        size: width and height of the picture, px.
        corners: largest number of corners of an outline.
    """
    spans = np.zeros((2, size, 2), np.int64)
    spans[:, :, 0] = size
    return np.zeros((corners, 3)), np.zeros((corners + 4, 2)), np.zeros((size, size)), spans[0], spans[1]


APART = 1e-6
"""Largest distance between the ends of two segments that share a corner, m."""
SHARPEST = 0.25
"""Least 1 + cos(turn) of a mitred corner, i.e. a turn of up to 138 degrees. At sharper corners, strips end square."""


def strips(line: npt.NDArray[np.float64], width: float) -> npt.NDArray[np.float64]:
    """Return the outlines of a line's segments; consecutive segments share a mitred edge.

    Args:
        line: (n, 4), segments from x, y to x, y, m; the last may end where the first begins.
        width: width of the line, m.

    Returns:
        (n, 4, 2), corners of the strips, m. The strip of a segment without length is empty.
    """
    start, end = line[:, :2], line[:, 2:]
    direction = end - start
    length = np.hypot(direction[:, 0], direction[:, 1])[:, None]
    direction = np.divide(direction, length, out=np.zeros_like(direction), where=length > 0.0)
    side = 0.5 * width * np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    cosine = (direction * np.roll(direction, 1, axis=0)).sum(1)
    mitred_start = (np.abs(start - np.roll(end, 1, axis=0)) <= APART).all(1)
    mitred_start &= (1.0 + cosine > SHARPEST) & (length[:, 0] > 0.0)
    mitre = (side + np.roll(side, 1, axis=0)) / np.where(mitred_start, 1.0 + cosine, 1.0)[:, None]
    first = np.where(mitred_start[:, None], mitre, side)
    mitred_end = np.roll(mitred_start, -1)
    last = np.where(mitred_end[:, None], np.roll(mitre, -1, axis=0), side)
    return np.ascontiguousarray(np.stack([start + first, end + last, end - last, start - first], axis=1))


SIZE = 512
"""Width and height of the repeated tile, texels; a power of 2."""
OCTAVES = (32, 64, 128, 256)
"""Random values along a side of the tile, for each octave. Each octave has half the weight of the previous octave."""


Pattern = tuple[npt.NDArray[np.float32], int, float]


def pattern(ground: Ground, light: float, seed: int) -> Pattern:
    """Return the brightness pattern of a ground.

    Args:
        ground: the ground. Its texture is the largest deviation of the brightness. Its grain is the distance between
            the random values of the coarsest lattice.
        light: factor on all brightness.
        seed: seed of the pattern, >= 0.

    Returns:
        Levels of `pyramid` (empty for a plain ground), texels along a side of the tile, and the size of a texel, m.
    """
    size = ground.grain * OCTAVES[0] / SIZE
    if ground.texture == 0.0:
        return np.zeros(0, np.float32), SIZE, size
    noise = tile(np.random.default_rng([seed, 3]))
    return pyramid(light * ground.brightness * (1.0 + ground.texture * noise)), SIZE, size


def tile(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """Return a tile of value noise: the sum of random values on finer and finer lattices, smoothly interpolated.

    Args:
        rng: random generator of the values.

    Returns:
        (SIZE, SIZE), mean 0, largest absolute value 1.

    Source: D. Ebert et al., Texturing and Modeling, 3rd ed., 2003, chapter 2 (value noise, sums of octaves).
    """
    total = np.zeros((SIZE, SIZE))
    for octave, cells in enumerate(OCTAVES):
        values = rng.uniform(-1.0, 1.0, (cells, cells)) * 0.5**octave
        position = (np.arange(SIZE) + 0.5) * cells / SIZE
        low = position.astype(np.int64)
        share = position - low
        share = share * share * (3.0 - 2.0 * share)
        high = (low + 1) % cells
        rows = values[low] * (1.0 - share[:, None]) + values[high] * share[:, None]
        total += rows[:, low] * (1.0 - share) + rows[:, high] * share
    total -= total.mean()
    return np.asarray(total / np.abs(total).max())


def pyramid(level: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """Return the mipmap of a tile: the tile, then its means over larger and larger squares.

    Args:
        level: (n, n), the tile; n a power of 2.

    Returns:
        (m,), the tile, then the means over 2 x 2, 4 x 4, ... texels, down to one value; each level row by row.
    """
    levels = [level]
    while len(level) > 1:
        half = len(level) // 2
        level = level.reshape(half, 2, half, 2).mean(axis=(1, 3))
        levels.append(level)
    return np.concatenate([level.ravel() for level in levels]).astype(np.float32)
