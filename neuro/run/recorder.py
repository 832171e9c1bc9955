"""Probes of states: the run is cut where one is due, so that any backend can be probed."""

from __future__ import annotations

import numpy as np

from neuro.program.backend import Engine
from neuro.program.program import Floats, Ints, Program


class Recorder:
    """Records the states that probes ask for, at the steps that are multiples of their interval.

    Args:
        program: names the probes.
    """

    def __init__(self, program: Program) -> None:
        self.probes = {p.name: p for p in program.probes if p.record != "spikes"}
        self.sizes = {
            name: program.populations[p.population].size if p.ids is None else p.ids.size
            for name, p in self.probes.items()
        }
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.steps: dict[str, list[int]] = {name: [] for name in self.probes}
        self.values: dict[str, list[Floats]] = {name: [] for name in self.probes}

    def run(self, engine: Engine, steps: int) -> None:
        """Advance an engine, recording on the way."""
        end = engine.step + steps
        while engine.step < end:
            now = engine.step
            stop = min((now - now % p.every + p.every for p in self.probes.values()), default=end)
            engine.run(min(stop, end) - now)
            for name, probe in self.probes.items():
                if engine.step % probe.every == 0:
                    self.steps[name].append(engine.step)
                    self.values[name].append(engine.get(probe.population, probe.record, probe.ids))

    def read(self, name: str) -> tuple[Ints, Floats]:
        """Steps, and the values in them, shape (steps, neurons)."""
        steps = np.array(self.steps[name], dtype=np.int64)
        values = np.array(self.values[name], dtype=np.float64).reshape(len(steps), self.sizes[name])
        return steps, values

    def put(self, name: str, steps: Ints, values: Floats) -> None:
        """Set what has been recorded."""
        self.steps[name], self.values[name] = steps.tolist(), list(values)

    def forget(self, before: int) -> None:
        """Drop what was recorded up to a step."""
        for name, steps in self.steps.items():
            first = int(np.searchsorted(steps, before, side="right"))
            del self.steps[name][:first], self.values[name][:first]
