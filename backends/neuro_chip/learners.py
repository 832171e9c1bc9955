"""The projections that learn in each step: by the chip's learning engine, or by delays that the host changes.

The host stores a delay as a whole number of 1/256 steps. The delay register holds the nearest whole step, which
determines when spikes sent now arrive, and the tag holds the signed rest.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

from __future__ import annotations

from collections import namedtuple
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.fixed import FixedProjection
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.inputs import acts_late, register
from neuro.chips.loihi_learning import FRACTIONS
from neuro.chips.loihi_registers import REGISTER_OF_ONE
from neuro.chips.spinnaker_rule import SpinnakerRule
from neuro.core.errors import ModelError
from neuro.kernels.jit import compiled, kernel
from neuro.model.synapses import loihi2_learning, stdp_dopa
from neuro.model.synapses.base import DELAY
from neuro.model.synapses.loihi_rule import POST, PRE, LearningRule
from neuro.program.program import Floats, Ints, Program, Projection
from neuro_chip import learning as kernels, tables as t
from neuro_chip.deferred import Deferred
from neuro_chip.plastic import Learner, Plastic, ThreeFactors, TwoFactors, numbers_of
from neuro_chip.tables import Arrays
from neuro_chip.weights import ChipWeights

_TOO_SMALL = ("tags at a bound", "accumulator overflows", "trace saturations", "wrapped words", "wrapped traces")


def fired(arrays: Arrays, population: int) -> tuple[Ints, Ints]:
    """Return the neurons of a population that fired in the last step, and their payloads."""
    emitted, row = arrays["emitted"][: arrays["clock"][t.EMITTED]], arrays["pops"][population]
    first, last = np.searchsorted(emitted, (row[t.BEGIN], row[t.END]))
    return emitted[first:last] - row[t.BEGIN], arrays["emitted_times"][first:last]


class Learners:
    """All projections with a rule of the learning engine.

    On Loihi a spike is sent with the weight from before the learning of its own step, as in Brian2Loihi and lava.
    Weights that are learnt in a step are therefore written to the loop's arrays only after the next step has sent its
    spikes. On SpiNNaker a spike is sent with the weight after the update of the row.

    Args:
        fixed: the quantised program.
        weights: the weight memory.
        arrays: the arrays of the loop.
    """

    def __init__(self, fixed: FixedProgram, weights: ChipWeights, arrays: dict[str, NDArray[Any]]) -> None:
        self._fixed, self._program, self._weights, self._a = fixed, fixed.program, weights, arrays
        self._parts: dict[int, Learner | Deferred] = {}
        self._arrivals: dict[int, list[tuple[int, Ints]]] = {}
        for index, wires in enumerate(fixed.projections):
            if wires is not None and wires.rule is not None:
                self._parts[index] = _learner(self._program, index, wires)
                self._arrivals[index] = []
        self._fresh = np.ones(len(fixed.projections), dtype=np.bool_)

    def __bool__(self) -> bool:
        return bool(self._parts)

    def __contains__(self, index: object) -> bool:
        return index in self._parts

    def after(self, step: int) -> None:
        """Learn from the spikes of a step; called at the end of the step."""
        for index, plastic in self._parts.items():
            part = self._program.projections[index]
            (pre, payloads), (post, _) = fired(self._a, part.source), fired(self._a, part.target)
            if isinstance(plastic, Deferred):
                if part.dopamine >= 0:  # packets reach all targets, or one target per source
                    ids, times = fired(self._a, part.dopamine)
                    n = self._program.populations[part.target].size
                    spikes = np.repeat(ids, times)
                    plastic.release(step, spikes if part.dopamine_one_to_one else np.tile(np.arange(n), spikes.size))
                synapses, differences = plastic.step(step, pre, post, payloads)
                self._weights.mantissas[index][synapses] = plastic.words(synapses)
                self._weights.write_some(index, synapses)
                if differences.any():
                    self._send(index, step, synapses, differences)
                continue
            if self._fresh[index]:
                self._weights.put(index, plastic.mantissas)
            n_before = plastic.counts[kernels.CHANGED]
            plastic.step(step, pre, post, payloads)
            self._fresh[index] = bool(plastic.counts[kernels.CHANGED] != n_before)
            if part.dopamine >= 0:
                assert isinstance(plastic, Plastic)
                # Dopamine spikes of this step are queued, and those that arrive now act.
                ids, arrivals = fired(self._a, part.dopamine)[0], self._arrivals[index]
                if ids.size:
                    n = self._program.populations[part.target].size
                    reached = ids if part.dopamine_one_to_one else np.tile(np.arange(n), ids.size)
                    arrivals.append((step + part.dopamine_delay, reached))
                while arrivals and arrivals[0][0] <= step:
                    plastic.release(step, arrivals.pop(0)[1])

    def _send(self, index: int, step: int, synapses: Ints, weights: Ints) -> None:
        """Add words to the slots in which the packets of a step arrive, besides the words that the loop will send."""
        plastic, part, lags = self._parts[index], self._program.projections[index], self._wires(index).lag
        assert isinstance(plastic, Deferred)
        row, lag = self._a["pops"][part.target], lags if lags.size == 1 else lags[synapses]
        lag = lag - plastic.synapses.stages[synapses] * plastic.rule.slots  # packets have been held back
        n = row[t.END] - row[t.BEGIN]
        slots = (step + lag) % row[t.SLOTS] + (row[t.SLOTS] if plastic.rule.inhibits else 0)
        np.add.at(
            self._a["ring"], row[t.RING] + slots * n + plastic.synapses.targets[synapses], weights.astype(np.int32)
        )

    def signal(self, signal: int, values: Floats, step: int) -> None:
        """Set the modulatory traces of every projection with this signal."""
        for index, plastic in self._parts.items():
            if self._program.projections[index].signal == signal:
                plastic.modulate(step, values, self._wires(index).n_scale)

    def _wires(self, index: int) -> FixedProjection:
        wires = self._fixed.projections[index]
        assert wires is not None
        return wires

    def mantissas(self, index: int) -> NDArray[np.int32]:
        """Return the present weights of a projection."""
        return self._parts[index].mantissas

    def set(self, index: int, mantissas: NDArray[np.int32]) -> None:
        """Replace the weights of a projection."""
        plastic = self._parts[index]
        plastic.weights[:] = abs(mantissas) if isinstance(plastic, Deferred) else mantissas
        if isinstance(plastic, Deferred):
            self._weights.put(index, plastic.words())

    def read(self, index: int, name: str) -> Floats:
        """Return K_plus, c, t or n of every synapse, in units of the language."""
        plastic, step = self._parts[index], int(self._a["clock"][t.STEP])
        pre, post = self._program.connections(index)
        if isinstance(plastic, Deferred):
            return plastic.read(name, step, pre, post, self._wires(index).n_scale)
        rule = plastic.rule
        if name in (*PRE, *POST):
            return plastic.trace(name, step)[pre if name in PRE else post]
        if name == "K_plus":
            impulse = rule.traces["x1"].impulse if "x1" in rule.traces else 0
            units = plastic.trace("x1", step)[pre]
            return units / impulse if impulse else np.zeros(pre.size)
        if name == "n":
            excess, deficit = plastic.modulatory(step).astype(np.float64)
            amount: Floats = (excess - deficit)[post] * self._wires(index).n_scale
            return amount
        tags: Floats = plastic.tags.astype(np.float64)
        if name == "t" or not isinstance(self._program.projections[index].synapse, stdp_dopa):
            return tags  # a user's own rule also has its state in the tag
        # Units of the tag for an eligibility of 1, from the product that a post spike adds to it.
        term = next(term for term in rule.dt if term.gate == "y0")
        units_of_pair = term.mantissa * 2.0**term.exponent * rule.traces["x1"].impulse
        parameters = self._program.projections[index].synapse.parameters()
        tag = float(units_of_pair / (parameters["A_plus"] * np.exp(-self._program.resolution / parameters["tau_plus"])))
        return tags / tag

    def raw(self, index: int, name: str) -> Ints | None:
        """Return the tag of every synapse, or None for another name."""
        return self._parts[index].tags.astype(np.int64) if name in ("t", "c", "tag") else None

    def native(self) -> dict[str, int]:
        """Return the counts that exist only on the chip, by name."""
        counts: dict[str, int] = {}
        for index, plastic in self._parts.items():
            name = self._program.projections[index].name
            counts |= {f"{label} in {name}": count for label, count in plastic.native().items()}
        return counts

    def overflows(self) -> dict[str, int]:
        """Return the counts of registers of the learning engine that were too small, by name."""
        return {name: count for name, count in self.native().items() if name.startswith(_TOO_SMALL)}

    def nbytes(self) -> int:
        """Return the bytes of all arrays."""
        return sum(plastic.nbytes for plastic in self._parts.values())

    def start_anew(self, weights: bool) -> None:
        """Go back to step 0, and with `weights` to the initial weights."""
        for index, plastic in list(self._parts.items()):
            initial = _learner(self._program, index, self._wires(index))
            if not weights:
                initial.weights[:] = plastic.weights
            self._parts[index], self._arrivals[index], self._fresh[index] = initial, [], True
            if isinstance(initial, Deferred):
                self._weights.put(index, initial.words())

    def _state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that change in place."""
        parts = self._parts.items()
        arrays = {f"plastic.{index}.{name}": getattr(part, name) for index, part in parts for name in part.saved}
        return arrays | ({"plastic.fresh": self._fresh} if arrays else {})

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of all arrays that change."""
        arrays = {name: array.copy() for name, array in self._state().items()}
        for index, arrivals in self._arrivals.items():
            rows = [(step_of_spike, neuron) for step_of_spike, ids in arrivals for neuron in ids.tolist()]
            arrays[f"plastic.{index}.due"] = np.array(rows, dtype=np.int64).reshape(-1, 2)
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore a snapshot.

        Raises:
            ModelError: an earlier version with other arrays made the snapshot; nothing is changed.
        """
        state = self._state()
        if missing_names := [name for name in state if name not in arrays]:
            raise ModelError(
                f"the snapshot lacks '{missing_names[0]}': an earlier version of neuro saved it",
                hint="run the network again and save it with this version",
            )
        for name, array in state.items():
            array[:] = arrays[name]
        for index in self._arrivals:
            rows = arrays[f"plastic.{index}.due"]
            self._arrivals[index] = [(int(s), rows[rows[:, 0] == s, 1].copy()) for s in np.unique(rows[:, 0])]


def _learner(program: Program, index: int, wires: FixedProjection) -> Learner | Deferred:
    """Return the state of a projection that learns, with its connections as CSR."""
    part = program.projections[index]
    n_source, n_target = program.populations[part.source].size, program.populations[part.target].size
    pre, post = program.connections(index)
    row_ends = np.concatenate(([0], np.cumsum(np.bincount(pre, minlength=n_source)))).astype(np.int64)
    mantissas = np.broadcast_to(wires.mantissas, part.size).astype(np.int64)
    if isinstance(rule := wires.rule, SpinnakerRule):
        stages, delays = np.divmod(np.broadcast_to(wires.delay, part.size).astype(np.int64) - 1, rule.slots)
        delays = (delays + 1) % rule.slots
        ends = row_ends, post.astype(np.int32), n_target, abs(mantissas)
        return Deferred(rule, *ends, delays, delays > 0, np.full(part.size, rule.shift), stages)
    assert isinstance(rule, LearningRule)
    synapses = row_ends, post.astype(np.int32), n_target, mantissas
    if isinstance(part.synapse, loihi2_learning):
        return TwoFactors(part.name, program.seed, rule, part.synapse.parameters(), *synapses)
    if rule.outgoing is not None:
        return ThreeFactors(part.name, program.seed, rule, numbers_of(rule, wires.sign_mode), *synapses)
    return Plastic(part.name, program.seed, rule, *synapses, wires.bits, wires.sign_mode)


_NO_SPIKE = -1

_Sides = namedtuple("_Sides", "by_source row_ends by_target column_ends source target last_pre last_post y c")
"""The synapses of a pairwise rule for delays, by source and by target, and the values that the rule reads.

Source i has the synapses by_source[row_ends[i] : row_ends[i + 1]], target j has by_target[column_ends[j] :
column_ends[j + 1]]. `source` and `target` are the neurons of each synapse. `last_pre` and `last_post` are the steps in
which each neuron fired last, or -1. `y` is a buffer for the state of one synapse, `c` has the constants of the rule.
"""


class Delays:
    """The delays of all projections whose rules change delays.

    Args:
        fixed: the quantised program.
        arrays: the arrays of the loop; their lags are written.

    Attributes:
        units: the delays of each such projection in 1/256 steps, int32.
    """

    def __init__(self, fixed: FixedProgram, arrays: Arrays) -> None:
        self._program, self._a = fixed.program, arrays
        self.units: dict[int, NDArray[np.int32]] = {}
        self._pairs: dict[int, _PairRule] = {}
        for index, part in enumerate(self._program.projections):
            if part.synapse.delays:
                self.units[index] = _units(part)
                if part.synapse.learns == "pairs":
                    self._pairs[index] = _PairRule(fixed, index)

    def __contains__(self, index: object) -> bool:
        return index in self.units

    def __bool__(self) -> bool:
        """Return whether any rule changes delays after each step."""
        return bool(self._pairs)

    def steps(self, index: int) -> Ints:
        """Return the delays of the next spikes in whole steps, one per synapse."""
        return (self.units[index].astype(np.int64) + FRACTIONS // 2) // FRACTIONS

    def read(self, index: int) -> Floats:
        """Return the delays in ms."""
        return self.units[index].astype(np.float64) * (self._program.resolution / FRACTIONS)

    def raw(self, index: int, name: str) -> Ints | None:
        """Return the delay registers or the tags; None for another name."""
        if name == "delay":
            return register(self._lags(index).astype(np.int32), REGISTER_OF_ONE).astype(np.int64)
        # The tag is signed, from -128 to 127: the register has the nearest step, not the step below.
        return self.units[index] - FRACTIONS * self.steps(index) if name in ("t", "tag") else None

    def bounds(self, index: int) -> tuple[int, int]:
        """Return the smallest and the largest delay, in 1/256 steps."""
        fewest, largest = self._program.projections[index].delay_range(self._program.resolution)
        return FRACTIONS * fewest, FRACTIONS * largest

    def _lags(self, index: int) -> Ints:
        model = self._program.populations[self._program.projections[index].target].model
        return self.steps(index) + acts_late(model)

    def write(self, index: int) -> None:
        """Write the present delays to the loop's arrays."""
        first = self._a["projections"][index, t.LAG]
        self._a["lags"][first : first + self.units[index].size] = self._lags(index)

    def after(self, step: int) -> None:
        """Change delays by the spikes of a step; spikes emitted in this step are sent with the new delays."""
        # The loop stops after each step if spike pairs change delays. The host writes the delays, as it would on the
        # chip, which cannot write its own delay registers.
        for index, pairs in self._pairs.items():
            part = self._program.projections[index]
            pre, post = (fired(self._a, k)[0] for k in (part.source, part.target))
            if pre.size or post.size:
                pairs.learn(self.units[index], *self.bounds(index), pre, post, step)
                self.write(index)

    def start_anew(self, described: bool) -> None:
        """Forget all spikes, and with `described` set the delays to their described values."""
        for pairs in self._pairs.values():
            pairs.start_anew()
        for index in self.units if described else ():
            self.units[index] = _units(self._program.projections[index])
            self.write(index)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return copies of all arrays that change."""
        return {name: array.copy() for name, array in self._state().items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore a snapshot."""
        for name, array in self._state().items():
            array[:] = arrays[name]
        for index in self.units:
            self.write(index)

    def _state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that change in place."""
        arrays: dict[str, NDArray[Any]] = {f"delays.{index}": units for index, units in self.units.items()}
        for index, pairs in self._pairs.items():
            arrays |= {f"delays.{index}.pre": pairs.last_pre, f"delays.{index}.post": pairs.last_post}
        return arrays


def _units(part: Projection) -> NDArray[np.int32]:
    """Return the described delays in 1/256 steps."""
    return np.broadcast_to(part.delay * FRACTIONS, part.size).astype(np.int32)


class _PairRule:
    """A pairwise rule for the delays of a projection, with the last spikes of its sources and targets."""

    def __init__(self, fixed: FixedProgram, index: int) -> None:
        program = fixed.program
        part = program.projections[index]
        n_source, n_target = (program.populations[k].size for k in (part.source, part.target))
        pre, post = program.connections(index)
        source_order, target_order = np.argsort(pre, kind="stable"), np.argsort(post, kind="stable")
        rows = source_order, np.searchsorted(pre[source_order], np.arange(n_source + 1))
        columns = target_order, np.searchsorted(post[target_order], np.arange(n_target + 1))
        self._h, c, arithmetic = program.resolution, np.zeros(part.synapse.width), part.synapse.arithmetic
        arithmetic.constants(part.synapse.vector(), self._h, c)
        self._pass = _compiled_rule(arithmetic.on_pre, arithmetic.on_post)
        self.last_pre, self.last_post = np.full(n_source, _NO_SPIKE), np.full(n_target, _NO_SPIKE)
        ends = pre.astype(np.int64), post.astype(np.int64)
        self._sides = _Sides(*rows, *columns, *ends, self.last_pre, self.last_post, np.zeros((2, 1)), c)

    def start_anew(self) -> None:
        """Forget all spikes."""
        self.last_pre[:] = _NO_SPIKE
        self.last_post[:] = _NO_SPIKE

    def learn(self, units: NDArray[np.int32], low: int, high: int, pre: Ints, post: Ints, step: int) -> None:
        """Apply the post spikes, then the pre spikes of a step.

        Neither side sees the other side's spikes of this step.
        """
        self._pass(units, low, high, self._sides, pre, post, step, self._h)


@cache
def _compiled_rule(on_pre: Any, on_post: Any) -> Any:
    """Return the kernel that applies a rule to the synapses of the neurons that fired."""
    pre_rule, post_rule = compiled(on_pre), compiled(on_post)

    @kernel
    def learn(units, low, high, sides, pre, post, step, h):
        y, c, unit = sides.y, sides.c, h / FRACTIONS
        # Post before pre, as in the float backends. Neither side sees the other's spikes of this step, which are
        # stored below.
        for j in post:
            for n in range(sides.column_ends[j], sides.column_ends[j + 1]):
                e = sides.by_target[n]
                last = sides.last_pre[sides.source[e]]
                # The rule computes in ms. The two registers store whole units of 1/256 step.
                y[DELAY, 0] = units[e] * unit
                post_rule(y, 0, c, (np.inf if last < 0 else (step - last) * h,), (0.0,))
                units[e] = min(high, max(low, np.int64(np.floor(y[DELAY, 0] / unit + 0.5))))
        for i in pre:
            for n in range(sides.row_ends[i], sides.row_ends[i + 1]):
                e = sides.by_source[n]
                last = sides.last_post[sides.target[e]]
                y[DELAY, 0] = units[e] * unit
                pre_rule(y, 0, c, (0.0,), (np.inf if last < 0 else (step - last) * h,))
                units[e] = min(high, max(low, np.int64(np.floor(y[DELAY, 0] / unit + 0.5))))
        for i in pre:
            sides.last_pre[i] = step
        for j in post:
            sides.last_post[j] = step

    return learn
