"""The machine: a running program that can go back to step 0 and be saved and restored."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.interrupts import torn
from neuro.program.spikes import RecordedSpikes
from neuro_chip import tables as t
from neuro_chip.build import write_registers, write_states
from neuro_chip.loop import open_all
from neuro_chip.running import RunningMachine

_CLEARED = (
    *("ring", "arrived", "arrived_all", "v", "u", "g_inh", "hold", "payload", "first"),
    *("events", "spikes", "active", "native", "set_out"),
)
_LIVE = (*_CLEARED, "emitted", "emitted_times", "groups", "clock", "potential", "mean", "nothing")
_WON = ("muted", "standing", "map_wins")
"""Arrays that are also saved for networks in which several neurons of a group may win."""


class Machine(RunningMachine):
    """A quantised program that advances, is saved and restored, and starts anew."""

    def start_anew(self, weights: bool) -> None:
        """Go back to step 0 and the initial states, and with `weights` to the initial weights."""
        for name in _CLEARED:
            self.arrays[name][:] = 0
        self._torn = False
        self.arrays["first"][:] = NEVER
        self.arrays["clock"][:] = 0
        self.arrays["clock"][t.STOP_GROUP] = t.NONE
        open_all(self.bound.view, self.bound.words)
        for k in range(len(self.program.populations)):
            write_states(self.arrays, k, self.cells.fixed[k])
        self.record = RecordedSpikes()
        self._list_spikes()
        previous = self.currents
        del self.currents
        for k, part in enumerate(self.program.populations):
            if part.kind == "current" and part.schedule is None:  # amplitudes that a user set hold from step 0
                self.currents.set(k, "amplitude", previous.parameter(k, "amplitude"), 0)
        self._list_rates(1)
        self.weights.start_anew(weights)
        self.learners.start_anew(weights)
        self.delays.start_anew(weights)
        self._warned.clear()
        self.bind()

    def _list_rates(self, step: int) -> None:
        """Set the rates that are listed for a step."""
        for k, rate in self.rates.at(step):
            self.set_rate(k, rate)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all arrays that `restore` needs."""
        if self._torn:
            raise torn()
        return {
            **{f"live.{name}": self.arrays[name].copy() for name in self._live()},
            **self.record.snapshot(),
            **({} if self._lists is None else self._lists.snapshot()),
            **self.currents.snapshot(),
            **self.weights.snapshot(),
            **self.learners.snapshot(),
            **self.delays.snapshot(),
            **self.cells.snapshot(),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        self.learners.restore(arrays)  # first, because it refuses snapshots of earlier versions
        self.weights.take(self.cells.restore(arrays))
        for k in range(len(self.program.populations)):
            write_registers(self.arrays, self.fixed, k, self.cells.fixed[k])
        for name in self._live():
            if (saved := arrays.get(f"live.{name}")) is not None:  # snapshots of earlier versions have no payloads
                self.arrays[name][:] = saved
        self._torn = False
        self.arrays["came"][:] = 1  # a snapshot does not say which slots have input
        self.record.restore(arrays)
        if self._lists is not None:
            self._lists.restore(arrays, self.step)
        self.currents.restore(arrays)
        self._list_rates(self.step)
        self.weights.restore(arrays)
        self.delays.restore(arrays)
        self.bind()

    def _live(self) -> tuple[str, ...]:
        """Return the names of the arrays in a snapshot."""
        return _LIVE + (_WON if any(group.choice.several for group in self.program.groups) else ())
