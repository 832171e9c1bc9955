"""Tasks with recorded spikes: N-MNIST, POKER-DVS and DVS Gesture from event cameras, and Spiking Heidelberg Digits."""

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
    """Base class for the classification of event-camera recordings.

    Non-spiking networks get frames with log(1 + number of events) for each pixel and polarity. Spiking networks get the
    events of the same interval as spikes; several events of a pixel in a step become a single spike.

    Class attributes:
        step: length of a step, ms.
        steps: number of steps, from the first event on. Later events are dropped. A shorter recording has no spikes in
            its last steps.
        frames: number of frames, all of the same length.
        side: side of the used square in neurons; the square begins at pixel (0, 0).
        scale: side in px of the square of pixels that share a neuron.
        part: folder of the recordings, if a data set has several such as Train and Test; None for all recordings.
    """

    step: ClassVar[float] = 5.0
    steps: ClassVar[int] = 21
    frames: ClassVar[int] = 3
    side: ClassVar[int] = 34
    scale: ClassVar[int] = 1
    part: ClassVar[str | None] = None

    def folds(self) -> Sequence[Fold]:
        """Return five random folds.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: there are too few recordings, or a recording has no class or no event in the square.
        """
        dataset = recordings(str(self.data), part=self.part)
        labels = np.asarray(dataset.labels)
        if (labels < 0).any():
            unlabelled = dataset[int(np.flatnonzero(labels < 0)[0])].name
            raise ModelError(f"{self.data}: {unlabelled} has no class: expected folders of classes", hint=self.source)
        counts = np.zeros((len(dataset), self.steps, 2, self.side, self.side), dtype=np.uint16)
        for k in range(len(dataset)):
            events = dataset[k].load()
            x, y, t = (
                events.x // self.scale,
                events.y // self.scale,
                (events.t - events.t[:1]) // round(1e3 * self.step),
            )
            inside = (t < self.steps) & (x < self.side) & (y < self.side)
            if not inside.any():
                message = f"{self.data}: {dataset[k].name} has no event in the first {self.side * self.scale} px"
                raise ModelError(f"{message}: expected recordings of '{self.called_by}'", hint=self.source)
            np.add.at(counts[k], (t[inside], events.p[inside], y[inside], x[inside]), 1)
        frames = counts.reshape(len(dataset), self.frames, -1, 2, self.side, self.side).sum(axis=2, dtype=np.float32)
        frames = np.log1p(frames.reshape(len(dataset), -1, self.side, self.side))
        examples = Examples(frames, labels, dataset.classes, Spikes.of_dense(counts, self.step))
        return random_folds(examples, 5, self.seed)


class NMNIST(Recorded):
    """Classification of digits from the first of three saccades."""

    called_by = "n-mnist"
    title = "N-MNIST, the first 105 ms"
    licence = "CC BY-SA 4.0"
    source = (
        "https://www.garrickorchard.com/datasets/n-mnist (Orchard et al., Front. Neurosci. 9:437, 2015):"
        " a folder or zip of Train/DIGIT/INDEX.bin"
    )
    part = "Train"


class PokerDVS(Recorded):
    """Classification of four symbols on fast-moving cards."""

    called_by = "poker-dvs"
    title = "POKER-DVS, 20 ms"
    licence = "free to use with citation"
    source = (
        "http://www2.imse-cnm.csic.es/caviar/POKERDVS.html (Serrano-Gotarredona and Linares-Barranco, Front. Neurosci."
        " 9:481, 2015): a folder or zip of its AEDAT files"
    )
    step, steps, frames, side = 1.0, 20, 4, 35


class DVSGesture(Recorded):
    """Classification of arm gestures from the first 1.5 s."""

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
"""Number of channels of the cochlea, and of neighbouring channels that share a neuron."""
STEP, STEPS, COLUMNS = 10.0, 100, 50
"""Length of a step in ms, steps in the first second of a recording, and columns of a frame."""


class SHD(Task):
    """Classification of 20 spoken digits with the official training and test part.

    A tenth of the training part is the validation part. Spiking networks get 140 channels with at most one spike in
    10 ms. Non-spiking networks get log(1 + number of spikes) in bins of 20 ms.
    """

    called_by = "shd"
    title = "Spiking Heidelberg Digits, 140 channels of the first second"
    licence = "CC BY 4.0"
    source = "Cramer et al., IEEE TNNLS 33(7):2744, 2022; https://zenkelab.org/resources: shd_train.h5 and shd_test.h5"
    splits = ("official",)

    def folds(self) -> Sequence[Fold]:
        """Return the official fold.

        Raises:
            ModelError: a file is missing or has another format.
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
        test = np.arange(len(labels)) >= sizes[0]
        validation = np.zeros(len(labels), dtype=np.bool_)
        validation[np.random.default_rng((self.seed, 2)).permutation(sizes[0])[: max(1, sizes[0] // 10)]] = True
        return Folds(examples, [("official", ~test & ~validation, validation, test)])


def _read(path: Path) -> tuple[Any, Ints, tuple[str, ...]]:
    """Return the spike counts of a file, shape (recordings, steps, pooled channels), labels and class names."""
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
        step, channel = (1000.0 * time.astype(np.float64) / STEP).astype(np.int64), unit.astype(np.int64)
        inside = step < STEPS
        if len(channel) and not 0 <= channel.min() <= channel.max() < CHANNELS:
            raise ModelError(f"{path}: recording {k} has channel {channel.max()}: expected 0 to {CHANNELS - 1}")
        np.add.at(spikes[k], (step[inside], channel[inside] // POOLED), 1)
    return spikes, labels.astype(np.int64), classes
