"""Currents from dc_generators: constant between a few steps, so that no loop over time need carry them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.neurons import dc_generator
from neuro.program import Floats, Ints, Program

NEVER = np.iinfo(np.int64).max


class Currents:
    """Keeps for every current source the steps at which its current changes, and what it is from then on.

    Args:
        program: the whole network.

    Attributes:
        targets: indices of the populations that receive a current.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._history: dict[int, list[tuple[int, Floats]]] = {}
        for k, p in enumerate(program.populations):
            if isinstance(p.model, dc_generator):
                amplitude = np.broadcast_to(p.parameters["amplitude"], p.size).astype(np.float64)
                self._history[k] = [(0, amplitude.copy())]
        self.targets = sorted({p.target for p in program.projections if p.source in self._history})
        self._changes = self._steps_of_change()

    def __contains__(self, population: int) -> bool:
        return population in self._history

    def amplitude(self, population: int) -> Floats:
        """The amplitude that is set now, one value a neuron."""
        return self._history[population][-1][1]

    def set_amplitude(self, population: int, values: Floats, step: int) -> None:
        """Set it; what is emitted after `step` has it."""
        n = self._program.populations[population].size
        self._history[population].append((step, np.broadcast_to(values, n).astype(np.float64).copy()))
        self._changes = self._steps_of_change()

    def _steps_of_change(self) -> Ints:
        """Steps whose current differs from that of the step before."""
        steps = [0]
        for p in self._program.projections:
            if p.source in self._history:
                source = self._program.populations[p.source]
                emitted = [source.start, source.stop, *(since for since, _ in self._history[p.source])]
                for delay in np.unique(p.delay):
                    steps += [min(e, NEVER // 2) + int(delay) + 1 for e in emitted]
        return np.unique(np.array(steps, dtype=np.int64))

    def next_change(self, step: int) -> int:
        """The last step before the next change after step + 1, or a step that never comes."""
        if not self._history:
            return int(NEVER)
        later = self._changes[self._changes > step + 1]
        return int(later[0]) - 1 if later.size else int(NEVER)

    def into(self, population: int, step: int) -> Floats:
        """The current in pA into every neuron of a population in a step."""
        current = np.zeros(self._program.populations[population].size)
        for q, p in enumerate(self._program.projections):
            if p.target == population and p.source in self._history:
                self._add(current, q, step)
        return current

    def full(self, population: int, source: int, amplitude: Floats) -> Floats:
        """The current in pA into every neuron of a population while all generators are on, one with another amplitude.

        Args:
            population: the target.
            source: the generator whose amplitude is not the present one.
            amplitude: one value for all of it, or one each.
        """
        current = np.zeros(self._program.populations[population].size)
        for q, p in enumerate(self._program.projections):
            if p.target == population and p.source in self._history:
                pre, post = self._program.connections(q)
                own = amplitude if p.source == source else self.amplitude(p.source)
                value = np.broadcast_to(own, self._program.populations[p.source].size)
                np.add.at(current, post, value[pre] * p.weight)
        return current

    def _add(self, current: Floats, q: int, step: int) -> None:
        p = self._program.projections[q]
        source = self._program.populations[p.source]
        pre, post = self._program.connections(q)
        emitted = step - 1 - np.broadcast_to(p.delay, pre.size).astype(np.int64)
        value = np.zeros(pre.size)
        for since, amplitude in self._history[p.source]:
            value = np.where(emitted >= since, amplitude[pre], value)
        on = (emitted >= source.start) & (emitted < source.stop)
        np.add.at(current, post, np.where(on, value, 0.0) * p.weight)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """The amplitudes with the steps from which they hold."""
        out = {}
        for k, history in self._history.items():
            out[f"current.{k}"] = np.array([[float(since), *amplitude] for since, amplitude in history])
        return out

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        for k in self._history:
            self._history[k] = [(int(row[0]), row[1:].copy()) for row in arrays[f"current.{k}"]]
        self._changes = self._steps_of_change()
