"""N-MNIST: digits that an event camera saw in three saccades."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neuro.events import recordings
from neuro_bench.task import Examples, Fold, Spikes, Task, random_folds

STEP, STEPS, SIDE, FRAMES = 5.0, 21, 34, 3
"""ms of a step, steps: the first 105 ms, the first saccade; px; frames that artificial networks see."""


class NMNIST(Task):
    """Which digit was seen.

    Artificial networks see three frames of counts for each polarity of the first 105 ms, log(1 + count); spiking ones
    the events of the same time in steps of 5 ms.
    """

    called_by = "n-mnist"
    title = "N-MNIST, the first 105 ms"
    licence = "CC BY-SA 4.0"
    source = "Orchard et al., Front. Neurosci. 9:437, 2015: a folder or zip of Train/DIGIT/INDEX.bin"

    def folds(self) -> Sequence[Fold]:
        """Five random ones.

        Raises:
            EventFileError: a recording is damaged.
            ModelError: there are too few.
        """
        found = recordings(str(self.data), part="Train")
        spikes = np.zeros((len(found), STEPS, 2, SIDE, SIDE), dtype=np.uint16)
        for k in range(len(found)):
            events = found[k].load()
            t = (events.t - events.t[0]) // round(1000 * STEP)
            seen = t < STEPS
            np.add.at(spikes[k], (t[seen], events.p[seen], events.y[seen], events.x[seen]), 1)
        frames = spikes.reshape(len(found), FRAMES, STEPS // FRAMES, 2, SIDE, SIDE).sum(axis=2, dtype=np.float32)
        frames = np.log1p(frames.reshape(len(found), FRAMES * 2, SIDE, SIDE))
        examples = Examples(frames, found.labels, found.classes, Spikes.of_dense(spikes, STEP))
        return random_folds(examples, 5, self.seed)
