"""The currents of dc_generators, written where the loop reads them."""

from __future__ import annotations

import numpy as np

from neuro.program.currents import Currents
from neuro.program.program import Program
from neuro_event import loop
from neuro_event.arrays import Arrays


def apply(currents: Currents, program: Program, arrays: Arrays, view: int, step: int) -> None:
    """Set the currents that hold from step + 1 on; populations whose current changes are woken."""
    for target in currents.targets:
        place = arrays.places[target]
        current = place.by_place(currents.into(target, step + 1))
        now = arrays.net["current"][place.begin : place.end]
        if not np.array_equal(current, now):
            loop.wake_population(view, target, step, program.resolution)
            now[:] = current
