"""The Gabor filters of layer S1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt


def gabor_bank(
    sizes: Sequence[int],
    sigmas: Sequence[float],
    wavelengths: Sequence[float],
    gamma: float,
    orientations: Sequence[float],
    *,
    literal: bool = False,
    circular: bool = False,
    smooth: bool = False,
) -> npt.NDArray[np.float64]:
    """Make one filter per scale and orientation.

    ``g = exp(-(x'^2 + gamma^2 y'^2) / (2 sigma^2)) cos(2 pi x' / wavelength)`` with x' and y' the
    coordinates turned by the orientation; x to the right, y downwards. The bar that a filter
    prefers runs along y', so orientation 0 is a vertical bar and 90 a horizontal one.

    Args:
        sizes: (scales,) odd side lengths, px.
        sigmas: (scales,) widths of the Gaussian, px.
        wavelengths: (scales,) of the cosine, px.
        gamma: aspect ratio; less than 1 is longer along the bar.
        orientations: degrees.
        literal: keep the values of the formula; else each filter has zero mean and unit L2 norm, so
            that an even area excites none and all scales answer alike.
        circular: 0 where farther from the middle than half a side, before the mean is taken.
        smooth: each filter blurred by a box of 3 x 3 px, as if the picture was.

    Returns:
        (scales, orientations, side, side) with side the largest size; smaller filters lie in the
        middle of zeros.

    Source: thesis eqs 122-124, lines 2342-2346.
    """
    side = max(sizes)
    bank = np.zeros((len(sizes), len(orientations), side, side))
    for s, (size, sigma, wavelength) in enumerate(zip(sizes, sigmas, wavelengths, strict=True)):
        half = size // 2
        y, x = np.mgrid[-half : half + 1, -half : half + 1].astype(np.float64)
        margin = (side - size) // 2
        inner = slice(margin, margin + size)
        for o, angle in enumerate(np.deg2rad(orientations)):
            across = x * np.cos(angle) + y * np.sin(angle)
            along = -x * np.sin(angle) + y * np.cos(angle)
            g = np.exp(-(across**2 + gamma**2 * along**2) / (2 * sigma**2))
            g *= np.cos(2 * np.pi * across / wavelength)
            if circular:
                g[np.hypot(x, y) > size / 2] = 0.0
            if not literal:
                g -= g.mean()
                g /= np.linalg.norm(g)
            bank[s, o, inner, inner] = _blurred(g) if smooth else g
    return bank


def _blurred(filter: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The mean of each place and its eight neighbours, 0 outside."""
    wide = np.pad(filter, 1)
    rows, columns = filter.shape
    near = [wide[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    found: npt.NDArray[np.float64] = np.mean(near, axis=0, dtype=np.float64)
    return found
