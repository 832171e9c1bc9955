"""The drone's eye: pictures of the world with exact shares of pixels, and the events that a DVS makes of them."""

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
"""Brightness above the horizon, as a share of full scale; it is in the picture at tilts below 32.5 degrees."""

CORNERS = 1024
"""Most corners of the polygon that stands for a ball's outline; a power of 2."""

Box = tuple[int, int, int, int]


class Eye:
    """What the camera sees, and the events that it makes of it.

    A pixel's brightness is the mean over its square: ball, line, ground and sky count by the share that they cover.
    Brightness is the same all over a body (no shading), times the scenario's light. A ball is in front of all else and
    hides ground, line and sky within a pixel in proportion, so where its outline crosses theirs that one pixel is near
    the mean, but not it. A pattern on the ground is filtered, not exact; see `neuro_drone.eye`.

    Args:
        scenario: camera, ground, light and task.
        seed: of the ground's pattern, and as for `reset`.

    Attributes:
        view: the camera, as it stood when it saw last.
        image: (128, 128) float32, what it saw last, linear in light, 1 = full scale; drawn over by the next.
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
        self._looked_up = np.zeros((size, -(-size // RUN))), np.zeros(size), np.zeros(size)
        self._base, self._drawn = np.zeros((size, size), np.float32), np.zeros((5, 3))
        self.image: npt.NDArray[np.float32] = np.zeros((size, size), np.float32)
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """A new episode: the next picture is the first.

        Args:
            seed: of the camera's noise and shake, and of the ground's pattern where the scenario draws it anew; not
                negative.
        """
        self._dvs = self._new_dvs(seed)
        if self._ground.redraw:
            self._pattern = pattern(self._ground, self._light, seed)
        self._rng = np.random.default_rng([seed, 2])
        self._drawn[4, 0] = 1.0
        self._boxed = False

    def _new_dvs(self, seed: int) -> DVS:
        return DVS((self.view.size, self.view.size), self._parameters, seed=seed)

    def see(self, pose: Pose, scene: WorldScene, t_us: int) -> Events:
        """Look at the world.

        Args:
            pose: of the drone.
            scene: what there is on the ground. Arrays of a scene are not changed after it was seen.
            t_us: time, us; more than that of the look before.

        Returns:
            The events since the look before; none after a reset.
        """
        boxed = self._boxed
        self.draw(pose, scene)
        events = self._dvs.see(self.image, t_us, changed=self.box if boxed else None)
        self._boxed = True
        return events

    def draw(self, pose: Pose, scene: WorldScene) -> npt.NDArray[np.float32]:
        """The picture alone.

        Args:
            pose: of the drone.
            scene: what there is on the ground.

        Returns:
            The attribute `image`, drawn anew.
        """
        view, self._boxed = self.view, False
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
            view.matrix, view.focal, view.middle, self._shades, self._pattern + self._looked_up, self._ball,
            self._strips, self._circle, self._work, (self._drawn, self._base, self.image, self._box),
        )  # fmt: skip
        return self.image

    @property
    def box(self) -> Box:
        """Columns and rows of the image that may differ from the one before: first x and y, x and y behind the last."""
        x0, y0, x1, y1 = self._box.tolist()
        return x0, y0, x1, y1


def pixels(camera: Camera) -> DVSParameters:
    """The pixels of a scenario's camera.

    Args:
        camera: of the scenario.
    """
    names = (
        "pos_thres", "neg_thres", "sigma_thres", "leak_rate_hz", "shot_noise_rate_hz", "refractory_period_s"
    )  # fmt: skip
    given: dict[str, Any] = {name: getattr(camera, name) for name in names}
    return DVSParameters(**given)


def buffers(size: int, corners: int) -> tuple[npt.NDArray[Any], ...]:
    """What `paint` works in: points, their pictures, shares of pixels, columns touched now and before."""
    spans = np.zeros((2, size, 2), np.int64)
    spans[:, :, 0] = size
    return np.zeros((corners, 3)), np.zeros((corners + 4, 2)), np.zeros((size, size)), spans[0], spans[1]


APART = 1e-6
"""Ends that are not farther from each other than this are one corner, m."""
SHARPEST = 0.25
"""Strips are mitred where 1 + cos(turn) is more than this (a turn of 138 degrees); else their ends are cut square."""


def strips(line: npt.NDArray[np.float64], width: float) -> npt.NDArray[np.float64]:
    """Outlines of a line's segments; where one begins at the end of the one before, the two share a mitred edge.

    Args:
        line: (n, 4), segments from x, y to x, y, m; the last may end where the first begins.
        width: of the line, m.

    Returns:
        (n, 4, 2), corners of the strips, m. Strips of segments without a length are empty.
    """
    start, end = line[:, :2], line[:, 2:]
    along = end - start
    length = np.hypot(along[:, 0], along[:, 1])[:, None]
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
    side = 0.5 * width * np.stack([-along[:, 1], along[:, 0]], axis=1)
    cosine = (along * np.roll(along, 1, axis=0)).sum(1)
    met = (np.abs(start - np.roll(end, 1, axis=0)) <= APART).all(1)
    met &= (1.0 + cosine > SHARPEST) & (length[:, 0] > 0.0)
    mitre = (side + np.roll(side, 1, axis=0)) / np.where(met, 1.0 + cosine, 1.0)[:, None]
    first = np.where(met[:, None], mitre, side)
    joined = np.roll(met, -1)
    last = np.where(joined[:, None], np.roll(mitre, -1, axis=0), side)
    return np.ascontiguousarray(np.stack([start + first, end + last, end - last, start - first], axis=1))


SIZE = 512
"""Texels of a side of the tile, which is repeated; a power of 2."""
OCTAVES = (32, 64, 128, 256)
"""Random values on a side of the tile; each octave has half the weight of the one before."""


Pattern = tuple[npt.NDArray[np.float32], int, float]


def pattern(ground: Ground, light: float, seed: int) -> Pattern:
    """Brightness of a ground for the camera.

    Args:
        ground: its texture is the largest deviation of the brightness, its grain the distance between the random
            values of the coarsest lattice.
        light: factor on all brightness.
        seed: of the pattern, not negative.

    Returns:
        Levels of `pyramid` (empty for a plain ground), texels of a side of the tile, and their size, m.
    """
    size = ground.grain * OCTAVES[0] / SIZE
    if ground.texture == 0.0:
        return np.zeros(0, np.float32), SIZE, size
    noise = tile(np.random.default_rng([seed, 3]))
    return pyramid(light * ground.brightness * (1.0 + ground.texture * noise)), SIZE, size


def tile(rng: np.random.Generator) -> npt.NDArray[np.float64]:
    """A tile of value noise: random values on ever finer lattices, with smooth steps in between.

    Args:
        rng: draws the values.

    Returns:
        (SIZE, SIZE), mean 0, between -1 and 1, one of which is reached.

    Source: D. Ebert et al., Texturing and Modeling, 3rd ed., 2003, chapter 2 (value noise, sums of octaves).
    """
    total = np.zeros((SIZE, SIZE))
    for k, cells in enumerate(OCTAVES):
        values = rng.uniform(-1.0, 1.0, (cells, cells)) * 0.5**k
        place = (np.arange(SIZE) + 0.5) * cells / SIZE
        low = place.astype(np.int64)
        share = place - low
        share = share * share * (3.0 - 2.0 * share)
        high = (low + 1) % cells
        rows = values[low] * (1.0 - share[:, None]) + values[high] * share[:, None]
        total += rows[:, low] * (1.0 - share) + rows[:, high] * share
    total -= total.mean()
    return np.asarray(total / np.abs(total).max())


def pyramid(level: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """A tile and its means over ever larger squares.

    Args:
        level: (n, n), the tile; n a power of 2.

    Returns:
        (m,), the tile, then means over 2 x 2, 4 x 4, ... texels, to the mean of all, each row by row.
    """
    levels = [level]
    while len(level) > 1:
        half = len(level) // 2
        level = level.reshape(half, 2, half, 2).mean(axis=(1, 3))
        levels.append(level)
    return np.concatenate([level.ravel() for level in levels]).astype(np.float32)
