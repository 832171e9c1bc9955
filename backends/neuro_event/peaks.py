"""The largest V_m of each neuron of a trial's output up to the decision, followed where a rule asks for it."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import numpy as np

from neuro.kernels.jit import kernel
from neuro.program.program import Floats, Ints
from neuro_event import loop, tables as t
from neuro_event.views import net_of


@kernel
def _follow(view, pop, tick, value, when):
    """Note whose V_m is larger than at all ticks before, by id."""
    net = net_of(view)
    for i in range(net.pops[pop, t.BEGIN], net.pops[pop, t.END]):
        k = net.order[i]
        if net.state[0, i] > value[k]:
            value[k], when[k] = net.state[0, i], tick


class Peaks:
    """The peaks of one trial.

    Args:
        population: the output.
        size: its neurons.
        h: the resolution in ms.
    """

    def __init__(self, population: int, size: int, h: float) -> None:
        self._population, self._h = population, h
        self._value: Floats = np.full(size, -np.inf)
        self._when: Ints = np.zeros(size, dtype=np.int64)

    def follow(self, view: int, step: int, tick: int) -> None:
        """See the states after a step, of sleeping neurons, too."""
        loop.wake_population(view, self._population, step, self._h)
        _follow(view, self._population, tick, self._value, self._when)

    def found(self, winner: int, tick: int) -> tuple[Floats, Ints]:
        """The peaks and their ticks; the decision is the peak of the neuron that decided, if one did."""
        if winner >= 0:
            self._value[winner], self._when[winner] = np.inf, tick
        return self._value, self._when
