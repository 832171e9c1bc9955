"""The templates of layer S2: how often each C1 neuron spikes for a class."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from neuro_recognise.hfirst.settings import HFirstSettings
from neuro_recognise.hfirst.spikes import Floats, Ints, LayerSpikes


def c1_counts(settings: HFirstSettings, recordings: Sequence[LayerSpikes]) -> Ints:
    """Spikes of each C1 neuron in each recording, (recordings, C1 neurons)."""
    size = int(np.prod(settings.shape))
    return np.stack([np.bincount(spikes.ids, minlength=size) for spikes in recordings])


def templates(settings: HFirstSettings, counts: Ints, labels: npt.ArrayLike, classes: int) -> Floats:
    """The weights of S2, in mV.

    A class has the sum of its counts, scaled to `settings.norm`; what is below `settings.below` becomes `unseen`.

    Args:
        settings: of the network.
        counts: from `c1_counts`.
        labels: class of each recording.
        classes: how many there are; one without a recording is unseen all over.

    Returns:
        (classes, C1 neurons).

    Source: `full_NMINST_example.m` and `HFIRST.m` of the authors' code.
    """
    sums = np.stack([counts[np.asarray(labels) == label].sum(axis=0) for label in range(classes)])
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    scaled = settings.norm * sums / np.where(norms > 0.0, norms, 1.0)
    return np.where(scaled < settings.below, settings.unseen, scaled)
