"""Recordings of shapes that flicker in the middle of a small field."""

import numpy as np

from neuro.events import Events

SIDE, FIELD = 23, 34
"""Of a shape, and of the field round it, px."""


def drawn(name: str, seed: int, n: int = 3000) -> Events:
    """300 ms of a cross or a ring."""
    rng = np.random.default_rng([seed, len(name)])
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE // 2
    y, x = np.nonzero((abs(x) < 4) | (abs(y) < 4) if name == "cross" else abs(np.hypot(x, y) - 9) < 3)
    of, t = rng.integers(len(x), size=n), np.sort(rng.integers(300_000, size=n))
    shift = (FIELD - SIDE) // 2 + rng.integers(-1, 2, 2)
    return Events(t, x[of] + shift[0], y[of] + shift[1], rng.integers(2, size=n), (FIELD, FIELD))
