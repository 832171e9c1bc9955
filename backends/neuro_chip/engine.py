"""The engine of the emulated chips, which drives the machine, presents trials and counts operations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed_program import FixedProgram
from neuro.program.backend import EngineCounts, Outcome, Spikes, Trial
from neuro.program.program import Ints
from neuro.program.spikes import carrying
from neuro_chip import tables as t
from neuro_chip.machine import Machine
from neuro_chip.settable import Settable
from neuro_chip.trials import ChipTrials


class ChipEngine(Settable):
    """A quantised program in execution; `neuro.program.backend.Engine` describes the methods.

    Args:
        fixed: the program in the integers of the chip: registers of neurons and words of weights.
        strict: whether an overflow during a run is an error instead of a warning.
    """

    def __init__(self, fixed: FixedProgram, strict: bool) -> None:
        self.fixed, self.program = fixed, fixed.program
        self._machine = Machine(fixed, strict)
        self._trials = ChipTrials(self._machine) if self.program.trials is not None else None

    # time

    @property
    def step(self) -> int:
        """The last finished step."""
        return self._machine.step

    def run(self, steps: int) -> None:
        """Run some steps."""
        self._machine.advance_to(self.step + steps)
        self._machine.check_overflows()

    # trials

    def present(self, trial: Trial) -> Outcome:
        """Present one trial."""
        assert self._trials is not None
        return self._trials.present(trial)

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply a rule's `teach` to the inputs of one neuron, on the host."""
        assert self._trials is not None
        self._trials.learn(projection, neuron, tick, lesson)

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply a rule's `encourage` to every weight of some maps, on the host."""
        assert self._trials is not None
        self._trials.encourage(projection, maps)

    # input

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes to a population of listed spikes."""
        if self._machine.spike_lists.add(population, steps, ids, self.step, payloads):
            self._machine.bind()

    # recordings and counts

    def are_finite(self, population: int, states: Sequence[str]) -> bool:
        """Return True, because registers hold whole numbers."""
        return True

    def spikes(self, population: int, since: int) -> Spikes:
        """Return the recorded spikes after a step."""
        span = self._machine.slice(population)
        return carrying(self.program.populations[population], self._machine.record.spikes(span.start, span.stop, since))

    def forget(self, before: int) -> None:
        """Drop the recorded spikes up to a step."""
        self._machine.record.forget(before)

    def counts(self) -> EngineCounts:
        """Return the counts since the start or the last reset."""
        machine, a = self._machine, self._machine.arrays
        parts = [(part, machine.slice(k)) for k, part in enumerate(self.program.populations)]
        native = machine.native(t.NATIVE_COLUMNS) | machine.weights.native() | machine.learners.native()
        return EngineCounts(
            steps=self.step,
            events=tuple(a["events"][neurons].copy() for _, neurons in parts),
            spikes=tuple(a["events" if part.model.graded else "spikes"][neurons].copy() for part, neurons in parts),
            active=a["active"].copy(),
            trial_updates=machine.weights.updates.copy(),
            native=native,
        )

    def memory(self) -> dict[str, int]:
        """Return the bytes of neurons, synapses and recorded spikes."""
        machine, names = self._machine, ("words", "lags", "rows", "targets")
        synapses = sum(machine.arrays[name].nbytes for name in names)
        return {
            "neurons": sum(a.nbytes for a in machine.arrays.values()) - synapses,
            "synapses": synapses + machine.weights.nbytes() + machine.learners.nbytes(),
            "spikes": machine.record.nbytes(),
        }

    def reset(self, weights: bool) -> None:
        """Go back to step 0."""
        self._machine.start_anew(weights)
        if self._trials:
            self._trials.start_anew()

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all arrays that `restore` needs."""
        changes = np.array(self._trials.changes if self._trials else 0)
        return {**self._machine.snapshot(), "trials.changes": changes}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        self._machine.restore(arrays)
        if self._trials:
            self._trials.changes = int(arrays["trials.changes"])
