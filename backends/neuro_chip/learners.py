"""The projections that learn on the chip, step by step, and what reaches them from outside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.quantising.fixed import FixedProjection
from neuro.chips.quantising.fixed_program import FixedProgram
from neuro.model.synapses import loihi2_learning
from neuro.model.synapses.loihi_rule import POST, LearningRule, Term
from neuro.program.program import Floats, Ints, Program
from neuro_chip import learning as kernels, tables as t
from neuro_chip.plastic import Plastic
from neuro_chip.two_factors import TwoFactors
from neuro_chip.weights import ChipWeights

_COUNTED = {
    kernels.EVALUATED: "rules applied",
    kernels.CHANGED: "weight writes",
    kernels.WEIGHT_SATURATED: "weights at a bound",
    kernels.TAG_SATURATED: "tags at a bound",
    kernels.OVERFLOWS: "accumulator overflows",
}
_TOO_SMALL = ("tags at a bound", "accumulator overflows", "trace saturations")


class Learners:
    """Every projection with a rule of the learning engine.

    A spike is sent with the weight from before the learning of its own step, as in Brian2Loihi and lava: what is learnt
    in a step is written where the loop reads it only after the next step has sent.

    Args:
        fixed: the quantised program.
        weights: the weight memory.
        arrays: of the loop.
    """

    def __init__(self, fixed: FixedProgram, weights: ChipWeights, arrays: dict[str, NDArray[Any]]) -> None:
        self._fixed, self._program, self._weights, self._a = fixed, fixed.program, weights, arrays
        self._parts: dict[int, Plastic | TwoFactors] = {}
        self._due: dict[int, list[tuple[int, Ints]]] = {}
        for index, wires in enumerate(fixed.projections):
            if wires is not None and wires.rule is not None:
                self._parts[index] = _plastic(self._program, index, wires)
                self._due[index] = []
        self._fresh = dict.fromkeys(self._parts, True)

    def __bool__(self) -> bool:
        return bool(self._parts)

    def __contains__(self, index: object) -> bool:
        return index in self._parts

    def after(self, step: int) -> None:
        """What the spikes of a step teach; called when the step is done."""
        emitted = self._a["emitted"][: self._a["clock"][t.EMITTED]]
        times = self._a["emitted_times"]
        pops = self._a["pops"]
        fired: dict[int, Ints] = {}
        payloads: dict[int, Ints] = {}
        for index, plastic in self._parts.items():
            part = self._program.projections[index]
            for k in (part.source, part.target, part.dopamine):
                if k >= 0 and k not in fired:
                    lo, hi = np.searchsorted(emitted, (pops[k, t.BEGIN], pops[k, t.END]))
                    fired[k] = emitted[lo:hi] - pops[k, t.BEGIN]
                    payloads[k] = times[lo:hi]
            if self._fresh[index]:
                self._weights.put(index, plastic.weights.astype(np.int32))
            before = plastic.counts[kernels.CHANGED]
            plastic.step(step, fired[part.source], fired[part.target], payloads[part.source])
            self._fresh[index] = bool(plastic.counts[kernels.CHANGED] != before)
            if part.dopamine >= 0:
                self._release(index, step, fired[part.dopamine])

    def _release(self, index: int, step: int, ids: Ints) -> None:
        """Dopamine spikes are sent, and those that arrive act."""
        part, due = self._program.projections[index], self._due[index]
        if ids.size:
            n = self._program.populations[part.target].size
            reached = ids if part.dopamine_one_to_one else np.tile(np.arange(n), ids.size)
            due.append((step + part.dopamine_delay, reached))
        plastic = self._parts[index]
        assert isinstance(plastic, Plastic)
        while due and due[0][0] <= step:
            plastic.release(step, due.pop(0)[1])

    def signal(self, signal: int, values: Floats, step: int) -> None:
        """Set the modulatory traces of every projection that listens."""
        for index, plastic in self._parts.items():
            if isinstance(plastic, Plastic) and self._program.projections[index].signal == signal:
                plastic.modulate(step, values, self._wires(index).n_scale)

    def _wires(self, index: int) -> FixedProjection:
        wires = self._fixed.projections[index]
        assert wires is not None
        return wires

    def mantissas(self, index: int) -> NDArray[np.int32]:
        """The weights that a projection has learnt."""
        return self._parts[index].weights.astype(np.int32)

    def set(self, index: int, mantissas: NDArray[np.int32]) -> None:
        """Replace the weights of a projection."""
        self._parts[index].weights[:] = mantissas

    def read(self, index: int, name: str) -> Floats:
        """K_plus, c, t or n of every synapse, in the units of the language."""
        plastic, rule = self._parts[index], self._parts[index].rule
        if isinstance(plastic, TwoFactors):
            return (plastic.tags if name == "t" else plastic.present(name)).astype(np.float64)
        now = (self.step_of(plastic) - 1) % plastic.epoch
        pre, post = self._program.connections(index)
        if name == "K_plus":
            kept = plastic.xs[now, 0].astype(np.float64)[pre]
            impulse = rule.traces["x1"].impulse if "x1" in rule.traces else 0
            return kept / impulse if impulse else np.zeros(pre.size)
        if name == "n":
            r = plastic.ys[now, len(POST) :].astype(np.float64)
            amount: Floats = (r[0] - r[1])[post] * self._wires(index).n_scale
            return amount
        tags = plastic.tags.astype(np.float64)
        return tags if name == "t" else tags / _tag_of_one(rule, self._program, index)

    def step_of(self, plastic: Plastic | TwoFactors) -> int:
        """The last finished step."""
        return int(self._a["clock"][t.STEP])

    def raw(self, index: int, name: str) -> Ints | None:
        """The tag of every synapse; None for another name."""
        return self._parts[index].tags.astype(np.int64) if name in ("t", "c", "tag") else None

    def native(self) -> dict[str, int]:
        """What only the chip counts."""
        found = {}
        for index, plastic in self._parts.items():
            name = self._program.projections[index].name
            for column, what in _COUNTED.items():
                if plastic.counts[column]:
                    found[f"{what} in {name}"] = int(plastic.counts[column])
            if plastic.saturated[0]:
                found[f"trace saturations in {name}"] = int(plastic.saturated[0])
        return found

    def overflows(self) -> dict[str, int]:
        """Registers of the learning engine that were too small, by what they are."""
        return {name: count for name, count in self.native().items() if name.startswith(_TOO_SMALL)}

    def nbytes(self) -> int:
        """Bytes held."""
        names = ("weights", "tags", "xs", "ys", "targets", "incoming", "sources")
        return sum(getattr(plastic, name).nbytes for plastic in self._parts.values() for name in names)

    def start_anew(self, weights: bool) -> None:
        """Back to step 0, and to the initial weights if asked."""
        for index, plastic in list(self._parts.items()):
            new = _plastic(self._program, index, self._wires(index))
            if not weights:
                new.weights[:] = plastic.weights
            self._parts[index], self._due[index], self._fresh[index] = new, [], True

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that changes."""
        arrays: dict[str, NDArray[Any]] = {}
        for index, plastic in self._parts.items():
            arrays |= {f"plastic.{index}.{name}": getattr(plastic, name).copy() for name in plastic.kept}
            arrays[f"plastic.{index}.fresh"] = np.array(self._fresh[index])
            rows = [(at, neuron) for at, ids in self._due[index] for neuron in ids.tolist()]
            arrays[f"plastic.{index}.due"] = np.array(rows, dtype=np.int64).reshape(-1, 2)
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
        for index, plastic in self._parts.items():
            for name in plastic.kept:
                getattr(plastic, name)[:] = arrays[f"plastic.{index}.{name}"]
            self._fresh[index] = bool(arrays[f"plastic.{index}.fresh"])
            rows = arrays[f"plastic.{index}.due"]
            self._due[index] = [(int(at), rows[rows[:, 0] == at, 1].copy()) for at in np.unique(rows[:, 0])]


def _plastic(program: Program, index: int, wires: FixedProjection) -> Plastic | TwoFactors:
    """The arrays of a projection as CSR."""
    part = program.projections[index]
    n_source, n_target = program.populations[part.source].size, program.populations[part.target].size
    pre, post = program.connections(index)
    row_ends = np.concatenate(([0], np.cumsum(np.bincount(pre, minlength=n_source)))).astype(np.int64)
    mantissas = np.broadcast_to(wires.mantissas, part.size).astype(np.int64)
    assert isinstance(wires.rule, LearningRule)
    synapses = row_ends, post.astype(np.int32), n_target, mantissas
    if isinstance(part.synapse, loihi2_learning):
        return TwoFactors(part.name, program.seed, wires.rule, part.synapse, *synapses)
    return Plastic(part.name, program.seed, wires.rule, *synapses, wires.bits, wires.sign_mode)


def _tag_of_one(rule: LearningRule, program: Program, index: int) -> float:
    """Units of the tag for an eligibility of 1, from the product that a post spike adds to it."""
    term: Term = next(term for term in rule.dt if term.gate == "y0")
    units = term.mantissa * 2.0**term.exponent * rule.traces["x1"].impulse
    described = program.projections[index].synapse.parameters()
    return float(units / (described["A_plus"] * np.exp(-program.resolution / described["tau_plus"])))
