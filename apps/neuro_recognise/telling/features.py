"""What weights on oriented filters look like: the filters themselves, each as strong as its weight, smoothed."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.signal import convolve

from neuro_recognise.shown import Floats

__all__ = ["reconstructed"]


def reconstructed(kernels: Floats, filters: Floats, side: int) -> Floats:
    """The sum of all filters times their weights, as far as it is positive, smoothed by half a cell.

    Args:
        kernels: (features, orientations, rows, columns) weights of cells; negative ones are left out.
        filters: (orientations, height, width) of the cells' filters, odd sides.
        side: px, of a cell; its filter stands in its middle.

    Returns:
        (features, rows * side, columns * side).

    Source: Masquelier and Thorpe, PLoS Comput. Biol. 3:e31, 2007, figure 3.
    """
    n, orientations, rows, columns = kernels.shape
    placed = np.zeros((n, orientations, rows * side, columns * side))
    placed[:, :, side // 2 :: side, side // 2 :: side] = np.maximum(kernels, 0.0)
    drawn = sum(convolve(placed[:, k], filters[k][None], mode="same") for k in range(orientations))
    smooth: Floats = gaussian_filter(np.maximum(np.asarray(drawn), 0.0), (0.0, side / 2, side / 2), mode="constant")
    return smooth
