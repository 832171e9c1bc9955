"""What there is to be seen at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["WorldScene"]


@dataclass(frozen=True, slots=True, eq=False)
class WorldScene:
    """Objects on the ground; how bright they are is the scenario's.

    Attributes:
        ball: x, y, z of the middle and the radius, m; None for no ball.
        line: (n, 4) float64, segments from x, y to x, y on the ground, m; None for no line.
    """

    ball: tuple[float, float, float, float] | None = None
    line: npt.NDArray[np.float64] | None = None
