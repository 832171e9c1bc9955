"""A pattern on the ground that looks the same everywhere and from every distance."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from neuro_drone.scenario import Ground

__all__ = ["Pattern", "pattern", "pyramid", "tile"]

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
