"""The weight memory while a program runs: mantissas, and the words that the loop sends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed import FixedProjection, Words
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.known import arithmetic_of
from neuro.core.errors import ModelError
from neuro.program.program import Floats, Ints
from neuro_chip import deliver, tables as t

_NOWHERE: Ints = np.zeros(0, dtype=np.int64)

_GIVEN = "given"
"""What saved states call weights as they were set."""


class ChipWeights:
    """Mantissas of all projections.

    Args:
        fixed: the quantised program.
        arrays: of the loop; `words` and the columns that point into it are written.

    Attributes:
        wires: the projections, with the scale that they have now.
        mantissas: of each projection, shape (1,) where shared.
        rules: numbers of the rules for trials, by projection.
        updates: weights that the host changed at the end of trials, for each projection.
    """

    def __init__(self, fixed: FixedProgram, arrays: dict[str, NDArray[Any]]) -> None:
        self._program, self._a, self._arithmetic = fixed.program, arrays, arithmetic_of(fixed.chip)
        self.wires = list(fixed.projections)
        self._described = fixed.projections
        self._given: dict[int, Floats] = {}
        self._words: dict[int, tuple[FixedProjection, NDArray[Any]]] = {}
        self._places: dict[int, Ints] = {}
        self.mantissas: list[Words] = []
        self.rules: dict[int, Floats] = {}
        self.updates: Ints = np.zeros(len(self.wires), dtype=np.int64)
        self.writes = 0
        for index, (part, wires) in enumerate(zip(self._program.projections, self.wires, strict=True)):
            own = np.zeros(0, dtype=np.int32) if wires is None else wires.mantissas
            if part.synapse.learns:
                own = np.broadcast_to(own, part.size).copy()
            if part.synapse.learns == "trials":
                self.rules[index] = part.synapse.vector()
            self.mantissas.append(own)  # others are replaced, never changed in place

    def wires_of(self, index: int) -> FixedProjection:
        """A projection that carries spikes, with the scale that it has now."""
        wires = self.wires[index]
        assert wires is not None
        return wires

    def read(self, index: int, learnt: Words | None = None) -> Floats:
        """What every synapse sends in the unit of the language; `learnt` are mantissas that are not sent yet."""
        part, wires = self._program.projections[index], self.wires[index]
        if wires is None:
            return np.broadcast_to(part.weight, part.size).copy()
        mantissas = self.mantissas[index] if learnt is None else learnt
        return np.broadcast_to(wires.acting(self._arithmetic.words(wires, mantissas)), part.size).copy()

    def raw(self, index: int) -> Ints:
        """The mantissa of every synapse."""
        part = self._program.projections[index]
        return np.broadcast_to(self.mantissas[index], part.size).astype(np.int64)

    def wanted(self) -> dict[int, Floats]:
        """The weights of all projections that carry spikes: as they were described or set, or as they were learnt.

        Another scale rounds these anew, so that nothing is rounded twice.
        """
        return {k: self._wanted(k) for k, wires in enumerate(self.wires) if wires is not None}

    def _wanted(self, index: int) -> Floats:
        part = self._program.projections[index]
        if part.synapse.learns:
            return self.wires_of(index).weights(self.mantissas[index])
        return self._given.get(index, part.weight)

    def set(self, index: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or those that are chosen of them, by the nearest mantissas.

        Raises:
            ModelError: one is beyond the largest mantissa.
        """
        part, wires = self._program.projections[index], self.wires[index]
        if wires is None:
            raise ModelError(f"weights of '{part.name}', which carries a current, are fixed on a chip")
        if chosen is not None and not part.synapse.learns:
            weights = np.where(chosen, weights, self._wanted(index))  # the others are rounded once, not twice
        mantissas = _nearest(wires, weights)
        own = wires.acting(self._arithmetic.words(wires, mantissas)) == weights  # what was read can be written
        exact = wires.exact(weights)
        if wires.native:
            # Refuse what is no mantissa, as where it is described; `own` marks what a mantissa sends.
            fits = (weights == np.rint(weights)) & (weights >= wires.low) & (weights <= wires.high)
            bad = np.flatnonzero(~own & ~fits)
            if bad.size:
                raise ModelError(
                    f"weights of '{part.name}': weight[{bad[0]}] = {weights[bad[0]]:g}: "
                    f"a mantissa in sign mode {wires.sign_mode} is a whole number from {wires.low} to {wires.high}"
                )
        bad = np.flatnonzero(~own & ((exact > wires.high + 0.5) | (exact < wires.low - 0.5)))
        if bad.size:
            low, high = wires.weights(np.array([wires.low, wires.high], dtype=np.int32))[[0, -1]]
            raise ModelError(
                f"weights of '{part.name}': weight[{bad[0]}] = {weights[bad[0]]:g}: expected {low:.6g} to {high:.6g}, "
                "what its registers hold at the scale chosen from the described weights",
                hint="describe the network with its largest weights",
            )
        self._given[index] = weights.copy()
        self.put(index, mantissas)
        self.writes += part.size if chosen is None else int(np.count_nonzero(chosen))

    def put(self, index: int, mantissas: Words) -> None:
        """Replace all mantissas."""
        self.mantissas[index] = mantissas.copy()
        self.write(index)

    def write(self, index: int) -> None:
        """Let the loop send what the mantissas are now."""
        wires, mantissas = self.wires_of(index), self.mantissas[index]
        words = self._arithmetic.words(wires, mantissas)
        row = self._a["projections"][index]
        if row[t.WORD_STRIDE]:
            words = np.broadcast_to(words, self._program.projections[index].size)
        elif mantissas.size > 1:
            row[[t.WORD, t.WORD_STRIDE]] = self._a["words"].size, 1
            self._a["words"] = np.concatenate((self._a["words"], words.astype(self._a["words"].dtype)))
        self._a["words"][row[t.WORD] : row[t.WORD] + words.size] = words
        row[[t.POSITIVE, t.NEGATIVE]] = bool(np.any(words > 0)), bool(np.any(words < 0))
        deliver.copy_words(self._a, self._program.projections[index], row)

    def write_some(self, index: int, synapses: Ints) -> None:
        """Likewise of some synapses, the only ones that have changed."""
        row, part = self._a["projections"][index], self._program.projections[index]
        if not row[t.WORD_STRIDE] or self.mantissas[index].size != part.size:
            self.write(index)
            return
        # The word of each mantissa is computed once at a scale.
        wires, table = self.wires_of(index), self._words.get(index)
        if table is None or table[0] is not wires:
            every = self._arithmetic.words(wires, np.arange(wires.low, wires.high + 1, dtype=np.int32))
            table = self._words[index] = wires, every.astype(self._a["words"].dtype)
        if index not in self._places:
            self._places[index] = _NOWHERE if part.grid is None else deliver.places(part.grid)
        words, kernels = self._a["words"], self._a["kernels"]
        deliver.write_some(
            self.mantissas[index], synapses, table[1], wires.low, words, kernels, row, self._places[index]
        )

    def take(self, wires: Mapping[int, FixedProjection]) -> None:
        """Other scales and mantissas of some projections."""
        for index, found in wires.items():
            same = np.array_equal(found.step, self.wires_of(index).step)
            self.wires[index] = found
            if not same:
                size = self.mantissas[index].size
                self.put(index, np.broadcast_to(found.mantissas, max(size, found.mantissas.size)).copy())

    def native(self) -> dict[str, int]:
        """What only chips count."""
        return {"weight writes by the host": self.writes} if self.writes else {}

    def nbytes(self) -> int:
        """Bytes held."""
        return sum(m.nbytes for m in self.mantissas)

    def start_anew(self, weights: bool) -> None:
        """Back to step 0, and to the initial weights if asked."""
        self.updates[:] = 0
        self.writes = 0
        if not weights:
            return
        self._given.clear()
        for index, wires in enumerate(self.wires):
            if wires is not None:
                # The mantissas of the described weights at the present scale.
                described = self._described[index]
                assert described is not None
                if np.array_equal(wires.step, described.step):
                    anew = described.mantissas
                else:
                    anew = _nearest(wires, self._program.projections[index].weight)
                self.put(index, np.broadcast_to(anew, self.mantissas[index].shape))

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that changes."""
        arrays: dict[str, NDArray[Any]] = {f"mantissas.{k}": m.copy() for k, m in enumerate(self.mantissas)}
        arrays |= {f"rule.{k}": rule.copy() for k, rule in self.rules.items()}
        arrays |= {f"{_GIVEN}.{k}": weights.copy() for k, weights in self._given.items()}
        return arrays | {"weights.updates": self.updates.copy(), "weights.writes": np.array(self.writes)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        for k, wires in enumerate(self.wires):
            if wires is not None:
                self.put(k, arrays[f"mantissas.{k}"].astype(np.int32))
        self.rules = {k: arrays[f"rule.{k}"].copy() for k in self.rules}
        self._given = {k: arrays[f"{_GIVEN}.{k}"].copy() for k in range(len(self.wires)) if f"{_GIVEN}.{k}" in arrays}
        self.updates[:] = arrays["weights.updates"]
        self.writes = int(arrays["weights.writes"])


def _nearest(wires: FixedProjection, weights: Floats) -> Words:
    """The mantissas nearest to some weights."""
    steps = np.rint(wires.exact(weights) / wires.grain)
    found: Words = np.clip(steps * wires.grain, wires.low, wires.high).astype(np.int32)
    return found
