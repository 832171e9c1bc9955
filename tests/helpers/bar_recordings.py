"""Recordings of bars that move over a small field, upright and lying in turn."""

from pathlib import Path

import numpy as np

from neuro.events import Events, save


def write_bars(folder: Path) -> Path:
    """Fill a folder: 16 recordings in Train and 8 in Test, in folders of their classes."""
    rng = np.random.default_rng(0)
    for k in range(24):
        along, across = rng.integers(8, 27, 900), 14 + np.arange(900) // 180 + rng.integers(0, 2, 900)
        x, y = (along, across) if k % 2 else (across, along)
        path = folder / ("Train" if k < 16 else "Test") / ("lying" if k % 2 else "upright") / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(Events(np.arange(900) * 100, x, y, rng.integers(0, 2, 900), (34, 34)), path)
    return folder
