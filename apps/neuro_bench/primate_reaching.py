"""Primate reaching: decoding the velocity of a cursor from the spikes of a monkey's motor cortex."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import record_input
from neuro_bench.task import Fold, Recording, Task
from neuro_train.data import r_squared

STEP = 4.0
"""Interval between two recorded cursor positions, ms."""
LONGEST = 2000
"""Segments of this number of steps (8 s) or more count as pauses of the monkey."""
LARGEST = 1e9
"""Valid times in s and positions in mm have a smaller absolute value."""
VARIABLES = ("t", "cursor_pos", "target_pos", "spikes")
FAILURES = (OSError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError)
"""Exceptions of h5py for a damaged file, except KeyError."""

SOURCE = (
    "O'Doherty et al., https://zenodo.org/records/583331: indy_20160622_01.mat, indy_20160630_01.mat, "
    "indy_20170131_02.mat, loco_20170210_03.mat, loco_20170215_02.mat, loco_20170301_05.mat; "
    "Yik et al., Nature Communications 16:1545, 2025"
)


class PrimateReaching(Task):
    """Regression of the cursor's velocity in mm per step of 4 ms from the spikes so far; each file is a fold.

    The rules are those of NeuroBench 2.3 (``datasets/primate_reaching.py`` and ``examples/primate_reaching``). A
    channel spikes in a step if any of its units, sorted or unsorted, spikes. Velocities are central differences. A
    segment ends when the target moves. The first half of the segments is the training part, the next quarter the
    validation part and the last quarter the test part. The split ``active`` omits segments of 8 s or more
    (``remove_segments_inactive``).
    """

    kind = "regression"
    called_by = "primate-reaching"
    title = "primate reaching, velocity of the cursor by spikes of the motor cortex"
    licence = "CC BY 4.0"
    source = SOURCE
    metric = "R2, mean of x and y"
    splits = ("official", "active")

    def folds(self) -> Sequence[Fold]:
        """Return a fold for each file of the folder, or the fold of a single file.

        Raises:
            ModelError: there is no file, or a file is damaged, has another format or too few segments.
        """
        assert self.data is not None
        files = sorted(self.data.glob("*.mat")) if self.data.is_dir() else [self.data]
        if not files:
            raise ModelError(f"{self.data}: has no .mat: expected files of the data set", hint=self.source)
        return [self._fold(file) for file in files]

    def _fold(self, file: Path) -> Fold:
        recording, segments = read(file)
        train = len(segments) // 2
        validation = (len(segments) - train) // 2
        if not validation:
            message = f"{file}: target_pos moves {len(segments) - 1} times: expected at least 2, for three segments"
            raise ModelError(message, hint=SOURCE)
        lengths = np.diff(segments, axis=1)[:, 0]
        is_active = np.repeat(lengths < LONGEST, lengths)

        def part(first: int, end: int) -> Recording:
            steps = slice(segments[first, 0], segments[end - 1, 1])
            whole_part = recording.take(steps)
            return whole_part if self.split == "official" else whole_part.take(is_active[steps])

        test_begin = train + validation
        parts = part(0, train), part(train, test_begin), part(0, test_begin), part(test_begin, len(segments))
        if not all(map(len, parts)):
            message = f"{file}: all segments of a part last 8 s or more: expected shorter ones"
            raise ModelError(message, hint="--split official")
        return Fold(file.stem, *parts)

    def score(self, predicted: Any, expected: Recording) -> float:
        """Return the mean R2 of the x and y components."""
        return r_squared(predicted, expected.targets)


def read(path: Path) -> tuple[Recording, npt.NDArray[np.int64]]:
    """Read a file of the data set in MATLAB 7.3 format, which is HDF5.

    Returns:
        spikes and velocities, and the first step and the last step + 1 of each segment, shape (segments, 2).

    Raises:
        ModelError: the file is damaged or has another format.
    """
    import h5py

    record_input(path)
    try:
        with h5py.File(path, "r") as file:
            t, cursor, target, cells = (file[name][()] for name in VARIABLES)
            t, n = np.ravel(t), np.size(t)
            for name, values in (("t", t[None]), ("cursor_pos", cursor), ("target_pos", target)):
                _check(path, name, values, (1 if name == "t" else 2, n))
            if cells.ndim != 2 or cells.dtype != h5py.ref_dtype:
                raise ModelError(f"{path}: spikes: expected cells, one for each unit of each channel", hint=SOURCE)
            units = [[file[cell] for cell in row] for row in cells]
            # For an empty cell MATLAB stores the shape instead of the content.
            units = [[[] if cell.attrs.get("MATLAB_empty", 0) else np.ravel(cell[()]) for cell in row] for row in units]
    except KeyError as error:
        message = f"{path}: {error.args[0]}: expected the variables {', '.join(VARIABLES)}"
        raise ModelError(message, hint=SOURCE) from None
    except FAILURES as error:
        raise ModelError(f"{path}: cannot be read as MATLAB 7.3: {error}", hint=SOURCE) from None
    interval = 1000.0 * (t[-1] - t[0]) / (n - 1)
    if abs(interval - STEP) > 0.01 * STEP:
        raise ModelError(f"{path}: t has steps of {interval:.4g} ms: expected {STEP:g}", hint=SOURCE)
    ends = t[0] + STEP / 1000.0 * np.arange(-1, n - 1)
    spikes = np.zeros((n, cells.shape[1]), dtype=np.bool_)
    for row in units:
        for channel, times in enumerate(row):
            step = np.searchsorted(ends, times, side="right")  # the first step that ends after the spike
            spikes[step[(step > 0) & (step < n)], channel] = True
    velocity = np.gradient(cursor, axis=1).T.astype(np.float32)
    target_moves = np.flatnonzero(np.diff(target, axis=1).any(axis=0))
    bounds = np.concatenate(([0], target_moves, [n]))
    return Recording(spikes, velocity, STEP), np.stack((bounds[:-1], bounds[1:]), axis=1)


def _check(path: Path, name: str, values: Any, shape: tuple[int, int]) -> None:
    """Raise an error if a variable has another shape, NaN or a number above the bound."""
    if values.shape != shape or shape[1] < 2:
        raise ModelError(f"{path}: {name}: found the shape {values.shape}: expected {shape}", hint=SOURCE)
    if values.dtype.kind not in "iuf" or not (np.abs(values) < LARGEST).all():
        raise ModelError(f"{path}: {name}: expected numbers below {LARGEST:g}", hint=SOURCE)
