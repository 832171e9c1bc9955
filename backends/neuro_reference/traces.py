"""Traces of the spikes of one side of a projection: of its sources, or of its targets as each synapse hears them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from neuro.model.synapses import Trace
from neuro.program.program import Floats, Ints

NEVER = -1
"""The step of the last spike where there was none."""


class Traces:
    """The traces of one side.

    Args:
        kinds: what the rule reads.
        taus: the time constant of each in ms, one or one per place.
        n: sources, or synapses.
        h: length of a step in ms.

    Attributes:
        after: the values at step `since`, shape (traces, n).
        before: the values just before the spikes of step `last`, the last that had any.
    """

    kept: ClassVar[tuple[str, ...]] = ("after", "before", "since", "last")

    def __init__(self, kinds: Sequence[Trace], taus: Sequence[Floats], n: int, h: float) -> None:
        self.kinds, self.h = kinds, h
        self.after: Floats = np.zeros((len(kinds), n))
        self.before: Floats = np.zeros((len(kinds), n))
        self.since: Ints = np.zeros(n, dtype=np.int64)
        self.last: Ints = np.full(n, NEVER, dtype=np.int64)
        self.taus = [np.broadcast_to(tau, n) for tau in taus]

    def at(self, place: int, step: int) -> tuple[float, ...]:
        """The values at a step, of all spikes so far."""
        return tuple(self._value(k, place, step) for k in range(len(self.kinds)))

    def earlier(self, place: int, step: int) -> tuple[float, ...]:
        """The values at a step, of the spikes strictly before it."""
        if self.last[place] == step:
            return tuple(float(self.before[k, place]) for k in range(len(self.kinds)))
        return self.at(place, step)

    def spike(self, place: int, step: int) -> None:
        """A spike at a step, after all that came before."""
        values = self.at(place, step)
        if self.last[place] != step:
            self.before[:, place] = values
        for k, (kind, value) in enumerate(zip(self.kinds, values, strict=True)):
            self.after[k, place] = kind.adds if kind.nearest else kind.adds + value
        self.since[place] = self.last[place] = step

    def bring(self, step: int) -> None:
        """Let all decay to a step, as before their time constants change."""
        for place in range(len(self.since)):
            self.after[:, place], self.since[place] = self.at(place, step), step

    def _value(self, k: int, place: int, step: int) -> float:
        if not self.kinds[k].tau:
            return float(step - self.last[place]) * self.h if self.last[place] != NEVER else math.inf
        passed, tau = (step - self.since[place]) * self.h, self.taus[k][place]
        return float(self.after[k, place] * math.exp(-passed / tau)) if tau > 0.0 else 0.0
