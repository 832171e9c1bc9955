"""The end of a trial, and the lessons that a rule for trials derives from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Lesson(NamedTuple):
    """Change the weights of the inputs of one neuron by the rule's `teach`.

    Attributes:
        neuron: id of the neuron.
        tick: time of the lesson in ticks of the trial. `teach` gets the arrival times relative to it.
        lesson: the argument `lesson` of `teach`, > 0 for a reward and < 0 for a punishment.
    """

    neuron: int
    tick: int
    lesson: float


class Growth(NamedTuple):
    """Change every weight onto some maps by the rule's `encourage`.

    Attributes:
        maps: indices of the maps of the output.
    """

    maps: Ints


@dataclass(slots=True, eq=False)
class TrialEnd:
    """End of a trial in which the network learns. If several neurons won, a rule gets one `TrialEnd` per winner.

    Attributes:
        winner: the neuron that decided, or -1.
        tick: tick of the decision, counted from 0, or -1.
        ticks: number of ticks that were run.
        label: the right label, or -1 if unknown.
        hit: whether the neuron that decided has the right label.
        reward: reward of the outcome in the section `trials`, 0 without a decision or a label.
        maps: the maps of the right label.
        silenced: whether dropout silenced each map, shape (maps,).
        potential: largest V_m of each map at the decision (before the reset), or at the end of a trial without a
            decision, shape (maps,). With several winners, V_m of each map is read at the first decision of the map.
        best: the neuron with the V_m `potential` in each map, shape (maps,).
        peak: for rules with `peaks`, the largest V_m of each neuron of the output up to the decision, shape (neurons,).
            It is infinite for the neuron that decided.
        peak_tick: for rules with `peaks`, the first tick with this V_m, shape (neurons,). For the neuron that
            decided, the tick of its decision.
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
        """Return the neuron of the right label with the largest V_m, from `potential` and `best`.

        The result is -1 if all maps of the label are silenced.
        """
        active_maps = self.maps[~self.silenced[self.maps]]
        return int(self.best[active_maps[self.potential[active_maps].argmax()]]) if len(active_maps) else -1

    def highest(self) -> tuple[int, int]:
        """Return the neuron of the right label with the largest `peak`, and the tick of the peak.

        The result is (-1, -1) if all maps of the label are silenced.
        """
        assert self.peak is not None, "for rules with peaks = True"
        assert self.peak_tick is not None
        active_maps = self.maps[~self.silenced[self.maps]]
        if not len(active_maps):
            return -1, -1
        per_map = len(self.peak) // len(self.silenced)
        cells = (active_maps[:, None] * per_map + np.arange(per_map)).ravel()
        neuron = int(cells[self.peak[cells].argmax()])
        return neuron, int(self.peak_tick[neuron])
