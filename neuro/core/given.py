"""Checks values that third-party parts return."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError


def check_returned(values: Any, shape: tuple[int, ...], told: str) -> NDArray[Any]:
    """What a third-party part returned, as numbers of a shape; they may be NaN.

    Args:
        values: that.
        shape: the shape they must have.
        told: what gave them, with a verb, e.g. "normal() drew".

    Raises:
        ModelError: they have another shape, or are no numbers.
    """
    array = np.asarray(values)
    if array.shape != shape or array.dtype.kind not in "fiu":
        found = f"shape {list(array.shape)} and type {array.dtype}"
        raise ModelError(f"{told} values of {found}: expected {math.prod(shape)} numbers")
    return array
