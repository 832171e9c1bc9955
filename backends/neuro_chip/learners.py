"""The projections that learn, step by step: those of the chip's learning engine, and delays that the host changes.

Delays are whole steps in the delay register, the rest in the tag, both written by the host. A delay is kept as a whole
number of 1/256 steps. The register holds the nearest whole step, which is what a spike takes that is sent now, and the
tag the signed rest.
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
    """Every projection with a rule of the learning engine.

    On Loihi a spike is sent with the weight from before the learning of its own step, as in Brian2Loihi and lava: what
    is learnt in a step is written where the loop reads it only after the next step has sent. On SpiNNaker a spike is
    sent with the weight after the update of the row.

    Args:
        fixed: the quantised program.
        weights: the weight memory.
        arrays: of the loop.
    """

    def __init__(self, fixed: FixedProgram, weights: ChipWeights, arrays: dict[str, NDArray[Any]]) -> None:
        self._fixed, self._program, self._weights, self._a = fixed, fixed.program, weights, arrays
        self._parts: dict[int, Learner | Deferred] = {}
        self._due: dict[int, list[tuple[int, Ints]]] = {}
        for index, wires in enumerate(fixed.projections):
            if wires is not None and wires.rule is not None:
                self._parts[index] = _plastic(self._program, index, wires)
                self._due[index] = []
        self._fresh = np.ones(len(fixed.projections), dtype=np.bool_)

    def __bool__(self) -> bool:
        return bool(self._parts)

    def __contains__(self, index: object) -> bool:
        return index in self._parts

    def after(self, step: int) -> None:
        """What the spikes of a step teach; called when the step is done."""
        for index, plastic in self._parts.items():
            part = self._program.projections[index]
            (pre, payloads), (post, _) = fired(self._a, part.source), fired(self._a, part.target)
            if isinstance(plastic, Deferred):
                if part.dopamine >= 0:  # as packets that reach all, or their own
                    ids, times = fired(self._a, part.dopamine)
                    n = self._program.populations[part.target].size
                    every = np.repeat(ids, times)
                    plastic.release(step, every if part.dopamine_one_to_one else np.tile(np.arange(n), every.size))
                synapses, more = plastic.step(step, pre, post, payloads)
                self._weights.mantissas[index][synapses] = plastic.words(synapses)
                self._weights.write_some(index, synapses)
                if more.any():
                    self._send(index, step, synapses, more)
                continue
            if self._fresh[index]:
                self._weights.put(index, plastic.mantissas)
            before = plastic.counts[kernels.CHANGED]
            plastic.step(step, pre, post, payloads)
            self._fresh[index] = bool(plastic.counts[kernels.CHANGED] != before)
            if part.dopamine >= 0:
                assert isinstance(plastic, Plastic)
                # Dopamine spikes are sent, and those that arrive act.
                ids, due = fired(self._a, part.dopamine)[0], self._due[index]
                if ids.size:
                    n = self._program.populations[part.target].size
                    reached = ids if part.dopamine_one_to_one else np.tile(np.arange(n), ids.size)
                    due.append((step + part.dopamine_delay, reached))
                while due and due[0][0] <= step:
                    plastic.release(step, due.pop(0)[1])

    def _send(self, index: int, step: int, synapses: Ints, words: Ints) -> None:
        """Add words to the slots in which the packets of a step arrive, beside what the loop will send."""
        plastic, part, lags = self._parts[index], self._program.projections[index], self._wires(index).lag
        assert isinstance(plastic, Deferred)
        row, lag = self._a["pops"][part.target], lags if lags.size == 1 else lags[synapses]
        lag = lag - plastic.synapses.stages[synapses] * plastic.rule.slots  # held back for so long
        n = row[t.END] - row[t.BEGIN]
        slots = (step + lag) % row[t.SLOTS] + (row[t.SLOTS] if plastic.rule.inhibits else 0)
        np.add.at(self._a["ring"], row[t.RING] + slots * n + plastic.synapses.targets[synapses], words.astype(np.int32))

    def signal(self, signal: int, values: Floats, step: int) -> None:
        """Set the modulatory traces of every projection that listens."""
        for index, plastic in self._parts.items():
            if self._program.projections[index].signal == signal:
                plastic.modulate(step, values, self._wires(index).n_scale)

    def _wires(self, index: int) -> FixedProjection:
        wires = self._fixed.projections[index]
        assert wires is not None
        return wires

    def mantissas(self, index: int) -> NDArray[np.int32]:
        """The weights that a projection has learnt."""
        return self._parts[index].mantissas

    def set(self, index: int, mantissas: NDArray[np.int32]) -> None:
        """Replace the weights of a projection."""
        plastic = self._parts[index]
        plastic.weights[:] = abs(mantissas) if isinstance(plastic, Deferred) else mantissas
        if isinstance(plastic, Deferred):
            self._weights.put(index, plastic.words())

    def read(self, index: int, name: str) -> Floats:
        """K_plus, c, t or n of every synapse, in the units of the language."""
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
            more, less = plastic.modulatory(step).astype(np.float64)
            amount: Floats = (more - less)[post] * self._wires(index).n_scale
            return amount
        tags: Floats = plastic.tags.astype(np.float64)
        if name == "t" or not isinstance(self._program.projections[index].synapse, stdp_dopa):
            return tags  # also of a rule of one's own, whose state is the tag
        # Units of the tag for an eligibility of 1, from the product that a post spike adds to it.
        term = next(term for term in rule.dt if term.gate == "y0")
        units_of_pair = term.mantissa * 2.0**term.exponent * rule.traces["x1"].impulse
        described = self._program.projections[index].synapse.parameters()
        one = float(units_of_pair / (described["A_plus"] * np.exp(-self._program.resolution / described["tau_plus"])))
        return tags / one

    def raw(self, index: int, name: str) -> Ints | None:
        """The tag of every synapse; None for another name."""
        return self._parts[index].tags.astype(np.int64) if name in ("t", "c", "tag") else None

    def native(self) -> dict[str, int]:
        """Counts of the chip alone, by name."""
        counts: dict[str, int] = {}
        for index, plastic in self._parts.items():
            name = self._program.projections[index].name
            counts |= {f"{what} in {name}": count for what, count in plastic.native().items()}
        return counts

    def overflows(self) -> dict[str, int]:
        """Registers of the learning engine that were too small, by what they are."""
        return {name: count for name, count in self.native().items() if name.startswith(_TOO_SMALL)}

    def nbytes(self) -> int:
        """Bytes held."""
        return sum(plastic.nbytes for plastic in self._parts.values())

    def start_anew(self, weights: bool) -> None:
        """Back to step 0, and to the initial weights if asked."""
        for index, plastic in list(self._parts.items()):
            new = _plastic(self._program, index, self._wires(index))
            if not weights:
                new.weights[:] = plastic.weights
            self._parts[index], self._due[index], self._fresh[index] = new, [], True
            if isinstance(new, Deferred):
                self._weights.put(index, new.words())

    def _state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that change in place."""
        parts = self._parts.items()
        arrays = {f"plastic.{index}.{name}": getattr(part, name) for index, part in parts for name in part.kept}
        return arrays | ({"plastic.fresh": self._fresh} if arrays else {})

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that changes."""
        arrays = {name: array.copy() for name, array in self._state().items()}
        for index, due in self._due.items():
            rows = [(at, neuron) for at, ids in due for neuron in ids.tolist()]
            arrays[f"plastic.{index}.due"] = np.array(rows, dtype=np.int64).reshape(-1, 2)
        return arrays

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot.

        Raises:
            ModelError: an earlier version has saved it, with other arrays; nothing is changed.
        """
        state = self._state()
        if missing := [name for name in state if name not in arrays]:
            raise ModelError(
                f"the state lacks '{missing[0]}': an earlier version has saved it",
                hint="save it anew with this version",
            )
        for name, array in state.items():
            array[:] = arrays[name]
        for index in self._due:
            rows = arrays[f"plastic.{index}.due"]
            self._due[index] = [(int(at), rows[rows[:, 0] == at, 1].copy()) for at in np.unique(rows[:, 0])]


def _plastic(program: Program, index: int, wires: FixedProjection) -> Learner | Deferred:
    """The arrays of a projection as CSR."""
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


_NEVER = -1

_Sides = namedtuple("_Sides", "by_source row_ends by_target column_ends source target last_pre last_post y c")
"""The synapses of a rule that spike pairs drive, by source and by target, and what the rule reads.

Those of source i are by_source[row_ends[i] : row_ends[i + 1]], those of a target likewise; `source` and `target` are
the neurons of each synapse. `last_pre` and `last_post` are the steps in which each neuron fired last, -1 if it has not.
`y` has room for the state of one synapse, `c` has the constants of the rule.
"""


class Delays:
    """The delays of all projections whose rules change them.

    Args:
        fixed: the quantised program.
        arrays: of the loop; its lags are written.

    Attributes:
        units: the delays of each such projection in 1/256 steps, int32.
    """

    def __init__(self, fixed: FixedProgram, arrays: Arrays) -> None:
        self._program, self._a = fixed.program, arrays
        self.units: dict[int, NDArray[np.int32]] = {}
        self._pairs: dict[int, _Pairs] = {}
        for index, part in enumerate(self._program.projections):
            if part.synapse.delays:
                self.units[index] = _units(part)
                if part.synapse.learns == "pairs":
                    self._pairs[index] = _Pairs(fixed, index)

    def __contains__(self, index: object) -> bool:
        return index in self.units

    def __bool__(self) -> bool:
        """Whether any changes after each step."""
        return bool(self._pairs)

    def steps(self, index: int) -> Ints:
        """How many steps the next spikes take, one for each synapse."""
        return (self.units[index].astype(np.int64) + FRACTIONS // 2) // FRACTIONS

    def read(self, index: int) -> Floats:
        """The delays in ms."""
        return self.units[index].astype(np.float64) * (self._program.resolution / FRACTIONS)

    def raw(self, index: int, name: str) -> Ints | None:
        """The delay registers or the tags; None for another name."""
        if name == "delay":
            return register(self._lags(index).astype(np.int32), REGISTER_OF_ONE).astype(np.int64)
        # The tag is signed, from -128 to 127: the register has the nearest step, not the one below.
        return self.units[index] - FRACTIONS * self.steps(index) if name in ("t", "tag") else None

    def bounds(self, index: int) -> tuple[int, int]:
        """The smallest and the largest delay, in 1/256 steps."""
        fewest, most = self._program.projections[index].delay_range(self._program.resolution)
        return FRACTIONS * fewest, FRACTIONS * most

    def _lags(self, index: int) -> Ints:
        model = self._program.populations[self._program.projections[index].target].model
        return self.steps(index) + acts_late(model)

    def write(self, index: int) -> None:
        """Let the loop send over the delays that there are now."""
        first = self._a["projections"][index, t.LAG]
        self._a["lags"][first : first + self.units[index].size] = self._lags(index)

    def after(self, step: int) -> None:
        """What the spikes of a step change; those emitted in it are sent with what they have changed."""
        # The loop stops after each step where pairs change delays: the host writes them, as it would on the chip, which
        # cannot write its own delay registers.
        for index, pairs in self._pairs.items():
            part = self._program.projections[index]
            pre, post = (fired(self._a, k)[0] for k in (part.source, part.target))
            if pre.size or post.size:
                pairs.learn(self.units[index], *self.bounds(index), pre, post, step)
                self.write(index)

    def start_anew(self, described: bool) -> None:
        """No spike is known; the delays as described if asked."""
        for pairs in self._pairs.values():
            pairs.start_anew()
        for index in self.units if described else ():
            self.units[index] = _units(self._program.projections[index])
            self.write(index)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that changes."""
        return {name: array.copy() for name, array in self._state().items()}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over a snapshot."""
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


class _Pairs:
    """A rule that spike pairs drive, and when the neurons of its two sides fired last."""

    def __init__(self, fixed: FixedProgram, index: int) -> None:
        program = fixed.program
        part = program.projections[index]
        n_source, n_target = (program.populations[k].size for k in (part.source, part.target))
        pre, post = program.connections(index)
        by_source, by_target = np.argsort(pre, kind="stable"), np.argsort(post, kind="stable")
        rows = by_source, np.searchsorted(pre[by_source], np.arange(n_source + 1))
        columns = by_target, np.searchsorted(post[by_target], np.arange(n_target + 1))
        self._h, c, arithmetic = program.resolution, np.zeros(part.synapse.width), part.synapse.arithmetic
        arithmetic.constants(part.synapse.vector(), self._h, c)
        self._pass = _pass(arithmetic.on_pre, arithmetic.on_post)
        self.last_pre, self.last_post = np.full(n_source, _NEVER), np.full(n_target, _NEVER)
        ends = pre.astype(np.int64), post.astype(np.int64)
        self._sides = _Sides(*rows, *columns, *ends, self.last_pre, self.last_post, np.zeros((2, 1)), c)

    def start_anew(self) -> None:
        """None has fired."""
        self.last_pre[:] = _NEVER
        self.last_post[:] = _NEVER

    def learn(self, units: NDArray[np.int32], low: int, high: int, pre: Ints, post: Ints, step: int) -> None:
        """Post spikes of a step act, then pre spikes; neither side sees those of this step."""
        self._pass(units, low, high, self._sides, pre, post, step, self._h)


@cache
def _pass(on_pre: Any, on_post: Any) -> Any:
    """The pass over the synapses of the neurons that fired, compiled for a rule."""
    by_pre, by_post = compiled(on_pre), compiled(on_post)

    @kernel
    def learn(units, low, high, sides, pre, post, step, h):
        y, c, unit = sides.y, sides.c, h / FRACTIONS
        # Post before pre, as in the float backends; neither side sees the other's spikes of this step, which are
        # entered below.
        for j in post:
            for n in range(sides.column_ends[j], sides.column_ends[j + 1]):
                e = sides.by_target[n]
                last = sides.last_pre[sides.source[e]]
                # The rule's own function in ms; between spikes only whole units of 1/256 step are kept, as the two
                # registers hold them.
                y[DELAY, 0] = units[e] * unit
                by_post(y, 0, c, (np.inf if last < 0 else (step - last) * h,), (0.0,))
                units[e] = min(high, max(low, np.int64(np.floor(y[DELAY, 0] / unit + 0.5))))
        for i in pre:
            for n in range(sides.row_ends[i], sides.row_ends[i + 1]):
                e = sides.by_source[n]
                last = sides.last_post[sides.target[e]]
                y[DELAY, 0] = units[e] * unit
                by_pre(y, 0, c, (0.0,), (np.inf if last < 0 else (step - last) * h,))
                units[e] = min(high, max(low, np.int64(np.floor(y[DELAY, 0] / unit + 0.5))))
        for i in pre:
            sides.last_pre[i] = step
        for j in post:
            sides.last_post[j] = step

    return learn
