"""Recorded spikes as tasks: N-MNIST, POKER-DVS and DVS Gesture of event cameras, and the Spiking Heidelberg Digits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from neuro import ModelError
from neuro.apps import record_input
from neuro_bench.task import Examples, Fold, Folds, Ints, Spikes, Task, random_folds
from neuro_events import recordings


class Recorded(Task):
    """Base of these: which class a recording shows.

    Artificial networks see frames of counts for each polarity, log(1 + count); spiking ones the events of the same time
    in steps, several of a pixel in a step as one.

    Class attributes:
        step: ms.
        steps: of a recording, from its first event on; what comes later is left out, what is missing is silent.
        frames: that artificial networks see, each of as many steps.
        side: of the square that is seen, from the first pixel on, in neurons.
        scale: px in a row and in a column that are one neuron.
        part: folder of the recordings, where there are several, such as Train and Test.
    """

    step: ClassVar[float] = 5.0
    steps: ClassVar[int] = 21
    frames: ClassVar[int] = 3
    side: ClassVar[int] = 34
    scale: ClassVar[int] = 1
    part: ClassVar[str | None] = None

    def folds(self) -> Sequence[Fold]:
        """Five random ones.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: there are too few, one has no class, or no event within the square.
        """
        found = recordings(str(self.data), part=self.part)
        labels = np.asarray(found.labels)
        if (labels < 0).any():
            nameless = found[int(np.flatnonzero(labels < 0)[0])].name
            raise ModelError(f"{self.data}: {nameless} has no class: expected folders of classes", hint=self.source)
        counts = np.zeros((len(found), self.steps, 2, self.side, self.side), dtype=np.uint16)
        for k in range(len(found)):
            events = found[k].load()
            x, y, t = (
                events.x // self.scale,
                events.y // self.scale,
                (events.t - events.t[:1]) // round(1e3 * self.step),
            )
            seen = (t < self.steps) & (x < self.side) & (y < self.side)
            if not seen.any():
                message = f"{self.data}: {found[k].name} has no event in the first {self.side * self.scale} px"
                raise ModelError(f"{message}: expected recordings of '{self.called_by}'", hint=self.source)
            np.add.at(counts[k], (t[seen], events.p[seen], y[seen], x[seen]), 1)
        frames = counts.reshape(len(found), self.frames, -1, 2, self.side, self.side).sum(axis=2, dtype=np.float32)
        frames = np.log1p(frames.reshape(len(found), -1, self.side, self.side))
        examples = Examples(frames, labels, found.classes, Spikes.of_dense(counts, self.step))
        return random_folds(examples, 5, self.seed)


class NMNIST(Recorded):
    """Which digit was seen, from the first of three saccades."""

    called_by = "n-mnist"
    title = "N-MNIST, the first 105 ms"
    licence = "CC BY-SA 4.0"
    source = (
        "https://www.garrickorchard.com/datasets/n-mnist (Orchard et al., Front. Neurosci. 9:437, 2015):"
        " a folder or zip of Train/DIGIT/INDEX.bin"
    )
    part = "Train"


class PokerDVS(Recorded):
    """Which of four symbols a card shows that is moved by fast."""

    called_by = "poker-dvs"
    title = "POKER-DVS, 20 ms"
    licence = "free to use with citation"
    source = (
        "http://www2.imse-cnm.csic.es/caviar/POKERDVS.html (Serrano-Gotarredona and Linares-Barranco, Front. Neurosci."
        " 9:481, 2015): a folder or zip of its AEDAT files"
    )
    step, steps, frames, side = 1.0, 20, 4, 35


class DVSGesture(Recorded):
    """Which gesture of the arms was made, from its first 1.5 s."""

    called_by = "dvs-gesture"
    title = "DVS Gesture, the first 1.5 s, 4 x 4 px as one"
    licence = "CC BY 4.0"
    source = (
        "https://research.ibm.com/interactive/dvsgesture/ (Amir et al., CVPR 2017): a folder or zip of"
        " GESTURE/RECORDING in any format of neuro.events, cut by its labels"
    )
    step, steps, frames, side, scale = 25.0, 60, 5, 32, 4


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
