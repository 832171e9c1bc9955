"""Spiking Heidelberg Digits: spoken digits in German and English, as spikes of a cochlea with 700 channels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import record_input
from neuro_bench.task import Examples, Fold, Folds, Ints, Spikes, Task

FILES = ("shd_train.h5", "shd_test.h5")
CHANNELS, POOLED = 700, 5
"""Of the cochlea; neighbours that are one."""
STEP, STEPS, COLUMNS = 10.0, 100, 50
"""ms of a step; steps of a recording, the first second; columns of the frames of counts."""


class SHD(Task):
    """Which digit was heard, of 20, by the official parts; a tenth of what is learnt from chooses the settings.

    Spiking networks see 140 channels, each at most one spike in 10 ms; artificial ones counts in 20 ms, log(1 + count).
    """

    called_by = "shd"
    title = "Spiking Heidelberg Digits, 140 channels of the first second"
    licence = "CC BY 4.0"
    source = "Cramer et al., IEEE TNNLS 33(7):2744, 2022; https://zenkelab.org/resources: shd_train.h5 and shd_test.h5"
    splits = ("official",)

    def folds(self) -> Sequence[Fold]:
        """The official one.

        Raises:
            ModelError: a file is missing, or is not such a file.
        """
        assert self.data is not None
        parts = [_read(self.data / name) for name in FILES]
        sizes = [len(labels) for _, labels, _ in parts]
        spikes = np.concatenate([spikes for spikes, _, _ in parts])
        labels, classes = np.concatenate([labels for _, labels, _ in parts]), parts[0][2]
        rows = spikes.shape[-1]
        counts = spikes.reshape(len(labels), COLUMNS, STEPS // COLUMNS, rows).sum(axis=2, dtype=np.float32)
        frames = np.log1p(counts.transpose(0, 2, 1)[:, None])
        examples = Examples(frames, labels, classes, Spikes.of_dense(spikes[:, :, None, None], STEP))
        tested = np.arange(len(labels)) >= sizes[0]
        held = np.zeros(len(labels), dtype=np.bool_)
        held[np.random.default_rng((self.seed, 2)).permutation(sizes[0])[: max(1, sizes[0] // 10)]] = True
        return Folds(examples, [("official", ~tested & ~held, held, tested)])


def _read(path: Path) -> tuple[Any, Ints, tuple[str, ...]]:
    """Counts of spikes, shape (recordings, steps, channels), labels and names of classes of a file."""
    import h5py

    record_input(path)
    try:
        with h5py.File(path, "r") as file:
            times, units, labels = file["spikes/times"][()], file["spikes/units"][()], file["labels"][()]
            classes = tuple(name.decode() for name in file["extra/keys"][()])
    except OSError as error:
        raise ModelError(f"{path}: cannot be read as HDF5: {error}", hint=SHD.source) from None
    except KeyError as error:
        message = f"{path}: {error.args[0]}: expected spikes/times, spikes/units, labels and extra/keys"
        raise ModelError(message, hint=SHD.source) from None
    spikes = np.zeros((len(labels), STEPS, CHANNELS // POOLED), dtype=np.uint8)
    for k, (time, unit) in enumerate(zip(times, units, strict=True)):
        at, channel = (1000.0 * time.astype(np.float64) / STEP).astype(np.int64), unit.astype(np.int64)
        seen = at < STEPS
        if len(channel) and not 0 <= channel.min() <= channel.max() < CHANNELS:
            raise ModelError(f"{path}: recording {k} has channel {channel.max()}: expected 0 to {CHANNELS - 1}")
        np.add.at(spikes[k], (at[seen], channel[seen] // POOLED), 1)
    return spikes, labels.astype(np.int64), classes
