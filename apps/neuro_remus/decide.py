"""From the decisions of a recording's frames to the decision for the recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from neuro import Simulation
from neuro_remus.features import Spikes

if TYPE_CHECKING:
    from neuro import TrialResults

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
SILENT = -1


@dataclass(frozen=True, slots=True, eq=False)
class Decisions:
    """What was decided for each recording, in two ways; `SILENT` where no frame says anything.

    Attributes:
        counts: (recordings, classes) frames that each class has won.
        sums: (recordings, classes) over the frames, the largest potential of the class' grids at the
            decision, mV.
    """

    counts: Ints
    sums: Floats

    @property
    def majority(self) -> Ints:
        """The class that has won most frames; among equals the one with the larger sum."""
        equal = self.counts == self.counts.max(axis=1, keepdims=True)
        return np.where(self.counts.any(axis=1), np.where(equal, self.sums, -np.inf).argmax(axis=1), SILENT)

    @property
    def potentials(self) -> Ints:
        """The class with the largest sum of potentials."""
        return np.where(self.sums.any(axis=1), self.sums.argmax(axis=1), SILENT)

    def by(self, vote: str) -> Ints:
        """The decisions by ``majority`` or ``potentials``."""
        return {"majority": self.majority, "potentials": self.potentials}[vote]


def decide(sim: Simulation, spikes: Spikes) -> Decisions:
    """Show recordings without teaching.

    Args:
        sim: a trained network.
        spikes: of the recordings; one without frames is silent.

    Returns:
        Decisions for all of them.
    """
    return decisions(present(sim, spikes), spikes)


def present(sim: Simulation, spikes: Spikes) -> TrialResults:
    """Show all frames of recordings without teaching; how each ended, and what all took."""
    results = sim.trials(spikes.times, spikes.ids, spikes.offsets)
    sim.forget(before=sim.time)
    return results


def decisions(results: TrialResults, spikes: Spikes) -> Decisions:
    """The decisions for recordings whose frames were shown.

    Args:
        results: of `present`.
        spikes: of the same recordings.
    """
    n, classes = len(spikes), len(spikes.classes)
    decided = results.label >= 0
    counts = np.zeros((n, classes), np.int64)
    np.add.at(counts, (spikes.sample[decided], results.label[decided]), 1)
    sums = np.zeros((n, classes))
    per_class = results.potential.shape[1] // classes
    np.add.at(sums, spikes.sample, results.potential.reshape(-1, classes, per_class).max(axis=2))
    return Decisions(counts, sums)
