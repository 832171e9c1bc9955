"""The weight memory of a running program: mantissas, and the words that the loop sends."""

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

_NO_SYNAPSES: Ints = np.zeros(0, dtype=np.int64)

_SET = "given"
"""Prefix, in snapshots, of weights that a user set, before rounding."""


class ChipWeights:
    """The mantissas of all projections.

    Args:
        fixed: the quantised program.
        arrays: the arrays of the loop; `words` and the columns that refer to it are written.

    Attributes:
        wires: the projections at their present scale.
        mantissas: mantissas of each projection, shape (1,) if all synapses share one.
        rules: parameters of the rules for trials, by projection.
        updates: number of weights that the host changed at the end of trials, by projection.
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
            part_mantissas = np.zeros(0, dtype=np.int32) if wires is None else wires.mantissas
            if part.synapse.learns:
                part_mantissas = np.broadcast_to(part_mantissas, part.size).copy()
            if part.synapse.learns == "trials":
                self.rules[index] = part.synapse.vector()
            self.mantissas.append(part_mantissas)  # shared arrays are replaced, never changed in place

    def wires_of(self, index: int) -> FixedProjection:
        """Return a projection that carries spikes, at its present scale."""
        wires = self.wires[index]
        assert wires is not None
        return wires

    def read(self, index: int, new_mantissas: Words | None = None) -> Floats:
        """Return the weight that every synapse sends, in the unit of the language.

        Args:
            index: the index of the projection.
            new_mantissas: mantissas that learning has changed but spikes do not send yet.
        """
        part, wires = self._program.projections[index], self.wires[index]
        if wires is None:
            return np.broadcast_to(part.weight, part.size).copy()
        mantissas = self.mantissas[index] if new_mantissas is None else new_mantissas
        return np.broadcast_to(wires.acting(self._arithmetic.words(wires, mantissas)), part.size).copy()

    def raw(self, index: int) -> Ints:
        """Return the mantissa of every synapse."""
        part = self._program.projections[index]
        return np.broadcast_to(self.mantissas[index], part.size).astype(np.int64)

    def before_rounding(self) -> dict[int, Floats]:
        """Return the weights of all projections that carry spikes: as described, as set by the user, or as learnt.

        A new scale rounds these weights, so that no weight is rounded twice.
        """
        return {k: self._before_rounding(k) for k, wires in enumerate(self.wires) if wires is not None}

    def _before_rounding(self, index: int) -> Floats:
        part = self._program.projections[index]
        if part.synapse.learns:
            return self.wires_of(index).weights(self.mantissas[index])
        return self._given.get(index, part.weight)

    def set(self, index: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or the chosen ones, by the nearest mantissas.

        Raises:
            ModelError: a weight is beyond the largest mantissa.
        """
        part, wires = self._program.projections[index], self.wires[index]
        if wires is None:
            raise ModelError(f"weights of '{part.name}', which carries a current, are fixed on a chip")
        if chosen is not None and not part.synapse.learns:
            weights = np.where(chosen, weights, self._before_rounding(index))  # others are rounded only once
        mantissas = _nearest(wires, weights)
        is_sent = wires.acting(self._arithmetic.words(wires, mantissas)) == weights  # a read weight can be written back
        exact = wires.exact(weights)
        if wires.native:
            # Like quantising, refuse weights that are no mantissa; `is_sent` marks weights that some mantissa sends.
            fits = (weights == np.rint(weights)) & (weights >= wires.low) & (weights <= wires.high)
            bad = np.flatnonzero(~is_sent & ~fits)
            if bad.size:
                raise ModelError(
                    f"weights of '{part.name}': weight[{bad[0]}] = {weights[bad[0]]:g}: "
                    f"a mantissa in sign mode {wires.sign_mode} is a whole number from {wires.low} to {wires.high}"
                )
        bad = np.flatnonzero(~is_sent & ((exact > wires.high + 0.5) | (exact < wires.low - 0.5)))
        if bad.size:
            low, high = wires.weights(np.array([wires.low, wires.high], dtype=np.int32))[[0, -1]]
            raise ModelError(
                f"weights of '{part.name}': weight[{bad[0]}] = {weights[bad[0]]:g}: expected {low:.6g} to {high:.6g}, "
                "the range of its registers at the scale chosen from the described weights",
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
        """Write the words of the present mantissas to the loop's arrays."""
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
        """Write the words of some synapses, the only ones that have changed."""
        row, part = self._a["projections"][index], self._program.projections[index]
        if not row[t.WORD_STRIDE] or self.mantissas[index].size != part.size:
            self.write(index)
            return
        # The word of each mantissa is computed once per scale.
        wires, table = self.wires_of(index), self._words.get(index)
        if table is None or table[0] is not wires:
            all_words = self._arithmetic.words(wires, np.arange(wires.low, wires.high + 1, dtype=np.int32))
            table = self._words[index] = wires, all_words.astype(self._a["words"].dtype)
        if index not in self._places:
            self._places[index] = _NO_SYNAPSES if part.grid is None else deliver.places(part.grid)
        words, kernels = self._a["words"], self._a["kernels"]
        deliver.write_some(
            self.mantissas[index], synapses, table[1], wires.low, words, kernels, row, self._places[index]
        )

    def take(self, wires: Mapping[int, FixedProjection]) -> None:
        """Replace the scales of some projections, and the mantissas of each projection whose scale changes."""
        for index, new in wires.items():
            has_same_step = np.array_equal(new.step, self.wires_of(index).step)
            self.wires[index] = new
            if not has_same_step:
                size = self.mantissas[index].size
                self.put(index, np.broadcast_to(new.mantissas, max(size, new.mantissas.size)).copy())

    def native(self) -> dict[str, int]:
        """Return the counts that exist only on chips."""
        return {"weight writes by the host": self.writes} if self.writes else {}

    def nbytes(self) -> int:
        """Return the bytes of all mantissas."""
        return sum(m.nbytes for m in self.mantissas)

    def start_anew(self, weights: bool) -> None:
        """Go back to step 0, and with `weights` to the initial weights."""
        self.updates[:] = 0
        self.writes = 0
        if not weights:
            return
        self._given.clear()
        for index, wires in enumerate(self.wires):
            if wires is not None:
                # Mantissas of the described weights at the present scale.
                described = self._described[index]
                assert described is not None
                if np.array_equal(wires.step, described.step):
                    initial = described.mantissas
                else:
                    initial = _nearest(wires, self._program.projections[index].weight)
                self.put(index, np.broadcast_to(initial, self.mantissas[index].shape))

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of all arrays that change."""
        arrays: dict[str, NDArray[Any]] = {f"mantissas.{k}": m.copy() for k, m in enumerate(self.mantissas)}
        arrays |= {f"rule.{k}": rule.copy() for k, rule in self.rules.items()}
        arrays |= {f"{_SET}.{k}": weights.copy() for k, weights in self._given.items()}
        return arrays | {"weights.updates": self.updates.copy(), "weights.writes": np.array(self.writes)}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore a snapshot."""
        for k, wires in enumerate(self.wires):
            if wires is not None:
                self.put(k, arrays[f"mantissas.{k}"].astype(np.int32))
        self.rules = {k: arrays[f"rule.{k}"].copy() for k in self.rules}
        self._given = {k: arrays[f"{_SET}.{k}"].copy() for k in range(len(self.wires)) if f"{_SET}.{k}" in arrays}
        self.updates[:] = arrays["weights.updates"]
        self.writes = int(arrays["weights.writes"])


def _nearest(wires: FixedProjection, weights: Floats) -> Words:
    """Return the mantissas nearest to some weights."""
    steps = np.rint(wires.exact(weights) / wires.grain)
    mantissas: Words = np.clip(steps * wires.grain, wires.low, wires.high).astype(np.int32)
    return mantissas
