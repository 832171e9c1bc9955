"""Currents from dc_generators: constant between a few steps, so that no loop over time need carry them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Floats, Ints, Program

NEVER = np.iinfo(np.int64).max


History = list[tuple[int, Floats]]
"""Values with the steps after which they hold."""


class Currents:
    """Keeps the amplitudes and weights of all currents with the steps after which they hold.

    What a dc_generator emits in step k over a delay of D steps is the external current of step k + D + 1; what is set
    after step k is first emitted in step k + 1.

    Args:
        program: the whole network.

    Attributes:
        targets: indices of the populations that receive a current.
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._amplitudes: dict[int, History] = {}
        for k, p in enumerate(program.populations):
            if p.kind == "current":
                amplitude = np.broadcast_to(p.parameters["amplitude"], p.size).astype(np.float64)
                self._amplitudes[k] = [(0, amplitude.copy())]
        self._weights: dict[int, History] = {
            q: [(0, np.broadcast_to(p.weight, p.size).astype(np.float64).copy())]
            for q, p in enumerate(program.projections)
            if p.source in self._amplitudes
        }
        self._longest = 1 + max([1, *(int(program.projections[q].delay.max(initial=1)) for q in self._weights)])
        self.targets = sorted({program.projections[q].target for q in self._weights})
        self._changes = self._steps_of_change()

    def __contains__(self, population: int) -> bool:
        return population in self._amplitudes

    def amplitude(self, population: int) -> Floats:
        """The amplitude that is set now, one value a neuron."""
        return self._amplitudes[population][-1][1]

    def set_amplitude(self, population: int, values: Floats, step: int) -> None:
        """Set it; what is emitted after `step` has it."""
        n = self._program.populations[population].size
        self._append(self._amplitudes[population], step, np.broadcast_to(values, n))

    def set_weights(self, projection: int, weights: Floats, step: int) -> None:
        """Set the weights of a projection that carries a current; what is emitted after `step` has them."""
        n = self._program.projections[projection].size
        self._append(self._weights[projection], step, np.broadcast_to(weights, n))

    def _append(self, history: History, step: int, values: Floats) -> None:
        """Enter values, and drop those of which nothing is under way any more."""
        history.append((step, values.astype(np.float64)))
        while history[1][0] + self._longest < step:
            del history[0]
        self._changes = self._steps_of_change()

    def _steps_of_change(self) -> Ints:
        """Steps whose current differs from that of the step before."""
        steps = [0]
        for q, weights in self._weights.items():
            p = self._program.projections[q]
            source = self._program.populations[p.source]
            since = [since + 1 for since, _ in [*self._amplitudes[p.source], *weights]]
            for delay in np.unique(p.delay):
                steps += [min(e, NEVER // 2) + int(delay) + 1 for e in (source.start, source.stop, *since)]
        return np.unique(np.array(steps, dtype=np.int64))

    def next_change(self, step: int) -> int:
        """The last step before the next change after step + 1, or a step that never comes."""
        if not self._weights:
            return int(NEVER)
        later = self._changes[self._changes > step + 1]
        return int(later[0]) - 1 if later.size else int(NEVER)

    def into(self, population: int, step: int) -> Floats:
        """The current in pA into every neuron of a population in a step."""
        current = np.zeros(self._program.populations[population].size)
        for q in self._weights:
            if self._program.projections[q].target == population:
                self._add(current, q, step)
        return current

    def full(self, population: int, instead: Mapping[int, Floats] | None = None) -> Floats:
        """The current in pA into every neuron of a population while all generators are on.

        Args:
            population: the target.
            instead: amplitudes that are not the present ones, by generator; one value for all of it, or one each.
        """
        instead = instead or {}
        current = np.zeros(self._program.populations[population].size)
        for q, weights in self._weights.items():
            p = self._program.projections[q]
            if p.target == population:
                pre, post = self._program.connections(q)
                value = np.broadcast_to(
                    instead.get(p.source, self.amplitude(p.source)), self._program.populations[p.source].size
                )
                np.add.at(current, post, value[pre] * weights[-1][1])
        return current

    def _add(self, current: Floats, q: int, step: int) -> None:
        p = self._program.projections[q]
        source = self._program.populations[p.source]
        pre, post = self._program.connections(q)
        emitted = step - 1 - np.broadcast_to(p.delay, pre.size).astype(np.int64)
        amplitude, weight = np.zeros(pre.size), np.zeros(pre.size)
        for since, values in self._amplitudes[p.source]:
            amplitude = np.where(emitted > since, values[pre], amplitude)
        for since, values in self._weights[q]:
            weight = np.where(emitted > since, values, weight)
        on = (emitted >= source.start) & (emitted < source.stop)
        np.add.at(current, post, np.where(on, amplitude, 0.0) * weight)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """The amplitudes and weights with the steps after which they hold."""
        named = {f"current.{k}": history for k, history in self._amplitudes.items()}
        named |= {f"current_weights.{q}": history for q, history in self._weights.items()}
        return {name: np.array([[float(since), *v] for since, v in history]) for name, history in named.items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        for k in self._amplitudes:
            self._amplitudes[k] = [(int(row[0]), row[1:].copy()) for row in arrays[f"current.{k}"]]
        for q in self._weights:
            self._weights[q] = [(int(row[0]), row[1:].copy()) for row in arrays[f"current_weights.{q}"]]
        self._changes = self._steps_of_change()
