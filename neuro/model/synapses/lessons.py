"""How a trial ended, and what a rule for trials makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Lesson(NamedTuple):
    """Teach the inputs of one neuron by the rule's `teach`.

    Attributes:
        neuron: its id.
        tick: the moment from which arrivals are counted, ticks of the trial.
        lesson: the argument of `teach`, > 0 a reward and < 0 a punishment.
    """

    neuron: int
    tick: int
    lesson: float


class Growth(NamedTuple):
    """Change every weight onto some maps by the rule's `encourage`.

    Attributes:
        maps: the maps of the output.
    """

    maps: Ints


@dataclass(slots=True, eq=False)
class TrialEnd:
    """How a trial that is learnt from ended. Where several neurons won, a rule sees one after the other.

    Attributes:
        winner: the neuron that decided, or -1.
        tick: the tick of the decision, from 0, or -1.
        ticks: ticks that were run.
        label: the right label, or -1 where none is known.
        hit: whether the neuron that decided is of the right label.
        reward: what the section `trials` gives for this outcome; 0 in silence and where no label is known.
        maps: the maps of the right label.
        silenced: the maps that dropout silenced, shape (maps,).
        potential: largest V_m of each map at the decision, of several at its own first (before the reset), or at the
            end, shape (maps,).
        best: the neuron of each map that has it, shape (maps,).
        peak: for rules with `peaks`, the largest V_m of each neuron of the output up to the decision, shape (neurons,);
            infinite for the neuron that decided.
        peak_tick: the first tick at which it had it; for the neuron that decided its decision.
    """

    winner: int
    tick: int
    ticks: int
    label: int
    hit: bool
    reward: float
    maps: Ints
    silenced: Bools
    potential: Floats
    best: Ints
    peak: Floats | None
    peak_tick: Ints | None

    def best_excited(self) -> int:
        """The neuron of the right label with the largest V_m at the decision or the end, or -1 if all are silenced."""
        awake = self.maps[~self.silenced[self.maps]]
        return int(self.best[awake[self.potential[awake].argmax()]]) if len(awake) else -1

    def highest(self) -> tuple[int, int]:
        """The neuron of the right label with the largest `peak`, and its tick; (-1, -1) if all are silenced."""
        assert self.peak is not None, "for rules with peaks = True"
        assert self.peak_tick is not None
        awake = self.maps[~self.silenced[self.maps]]
        if not len(awake):
            return -1, -1
        per_map = len(self.peak) // len(self.silenced)
        cells = (awake[:, None] * per_map + np.arange(per_map)).ravel()
        neuron = int(cells[self.peak[cells].argmax()])
        return neuron, int(self.peak_tick[neuron])
