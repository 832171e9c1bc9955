"""Primate reaching: the velocity of a cursor that a monkey moves, from the spikes of its motor cortex."""

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
"""ms between two positions of the cursor, as they were recorded."""
LONGEST = 2000
"""Steps of a segment from which on the monkey is taken to rest, 8 s."""
LARGEST = 1e9
"""Of times in s and positions in mm."""
VARIABLES = ("t", "cursor_pos", "target_pos", "spikes")
FAILURES = (OSError, ValueError, TypeError, RuntimeError, AttributeError, MemoryError)
"""What h5py raises for a damaged file, beside KeyError."""

SOURCE = (
    "O'Doherty et al., https://zenodo.org/records/583331: indy_20160622_01.mat, indy_20160630_01.mat, "
    "indy_20170131_02.mat, loco_20170210_03.mat, loco_20170215_02.mat, loco_20170301_05.mat; "
    "Yik et al., Nature Communications 16:1545, 2025"
)


class PrimateReaching(Task):
    """The velocity of the cursor in each step of 4 ms, mm a step, by the spikes until then; a fold a file.

    As in NeuroBench (``datasets/primate_reaching.py`` and ``examples/primate_reaching`` of 2.3): a channel spikes in a
    step if any of its units does, sorted or not; velocities are central differences; a segment lasts until the target
    moves; the first half of the segments is to learn from, the next quarter to choose by, the last to be tested on.
    ``active`` leaves out segments of 8 s or more (its ``remove_segments_inactive``).
    """

    kind = "regression"
    called_by = "primate-reaching"
    title = "primate reaching, velocity of the cursor by spikes of the motor cortex"
    licence = "CC BY 4.0"
    source = SOURCE
    metric = "R2, mean of x and y"
    splits = ("official", "active")

    def folds(self) -> Sequence[Fold]:
        """One for each file, or that of the file.

        Raises:
            ModelError: there is no file, or one is damaged, is of something else, or has too few segments.
        """
        assert self.data is not None
        files = sorted(self.data.glob("*.mat")) if self.data.is_dir() else [self.data]
        if not files:
            raise ModelError(f"{self.data}: has no .mat: expected files of the data set", hint=self.source)
        return [self._fold(file) for file in files]

    def _fold(self, file: Path) -> Fold:
        recording, segments = read(file)
        train = len(segments) // 2
        held = (len(segments) - train) // 2
        if not held:
            message = f"{file}: target_pos moves {len(segments) - 1} times: expected at least 2, for three segments"
            raise ModelError(message, hint=SOURCE)
        lengths = np.diff(segments, axis=1)[:, 0]
        short = np.repeat(lengths < LONGEST, lengths)

        def part(first: int, behind: int) -> Recording:
            steps = slice(segments[first, 0], segments[behind - 1, 1])
            found = recording.take(steps)
            return found if self.split == "official" else found.take(short[steps])

        parts = part(0, train), part(train, train + held), part(0, train + held), part(train + held, len(segments))
        if not all(map(len, parts)):
            message = f"{file}: all segments of a part last 8 s or more: expected shorter ones"
            raise ModelError(message, hint="--split official")
        return Fold(file.stem, *parts)

    def score(self, predicted: Any, wanted: Recording) -> float:
        """The mean R2 of x and y."""
        return r_squared(predicted, wanted.targets)


def read(path: Path) -> tuple[Recording, npt.NDArray[np.int64]]:
    """A file of the data set, MATLAB 7.3, which is HDF5.

    Returns:
        Spikes and velocities, and of each segment the first step and that behind the last, (segments, 2).

    Raises:
        ModelError: it is damaged, or is no such file.
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
            # of an empty cell MATLAB writes the shape in place of the content
            units = [[[] if cell.attrs.get("MATLAB_empty", 0) else np.ravel(cell[()]) for cell in row] for row in units]
    except KeyError as error:
        message = f"{path}: {error.args[0]}: expected the variables {', '.join(VARIABLES)}"
        raise ModelError(message, hint=SOURCE) from None
    except FAILURES as error:
        raise ModelError(f"{path}: cannot be read as MATLAB 7.3: {error}", hint=SOURCE) from None
    step = 1000.0 * (t[-1] - t[0]) / (n - 1)
    if abs(step - STEP) > 0.01 * STEP:
        raise ModelError(f"{path}: t has steps of {step:.4g} ms: expected {STEP:g}", hint=SOURCE)
    ends = t[0] + STEP / 1000.0 * np.arange(-1, n - 1)
    spikes = np.zeros((n, cells.shape[1]), dtype=np.bool_)
    for row in units:
        for channel, times in enumerate(row):
            at = np.searchsorted(ends, times, side="right")  # the step whose end lies behind the spike
            spikes[at[(at > 0) & (at < n)], channel] = True
    velocity = np.gradient(cursor, axis=1).T.astype(np.float32)
    moved = np.flatnonzero(np.diff(target, axis=1).any(axis=0))
    bounds = np.concatenate(([0], moved, [n]))
    return Recording(spikes, velocity, STEP), np.stack((bounds[:-1], bounds[1:]), axis=1)


def _check(path: Path, name: str, values: Any, shape: tuple[int, int]) -> None:
    """Refuse a variable of another shape, or with NaN or numbers out of range."""
    if values.shape != shape or shape[1] < 2:
        raise ModelError(f"{path}: {name}: found the shape {values.shape}: expected {shape}", hint=SOURCE)
    if values.dtype.kind not in "iuf" or not (np.abs(values) < LARGEST).all():
        raise ModelError(f"{path}: {name}: expected numbers below {LARGEST:g}", hint=SOURCE)
