"""Trials on a chip: the host resets, sends the input, waits for the decision, and teaches between them."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from neuro.chips.fixed import FixedProjection
from neuro.chips.loihi_learning import FRACTIONS
from neuro.core import keyed_random
from neuro.program.backend import Outcome, Trial, Wins
from neuro.program.program import Floats, Ints, Projection
from neuro_chip import tables as t, trial_kernels as kernels
from neuro_chip.build import STATES
from neuro_chip.machine import Machine

_REGISTERS = {"V_m": ("v",), "I_syn_ex": ("u", "g_exc"), "I_syn_in": ("u", "g_inh")}


class ChipTrials:
    """Presents trials and applies rules to their ends.

    Args:
        machine: the chip.
    """

    def __init__(self, machine: Machine) -> None:
        section = machine.program.trials
        assert section is not None
        self._machine, self._section = machine, section
        self._output = machine.slice(section.output)
        self._per_map = (self._output.stop - self._output.start) // section.maps
        names = machine.cells.names
        self._states = {each for name in section.reset for each in names(section.output, name)}
        found = [name for state in self._states for name in _REGISTERS[state] if name in STATES]
        self._registers = tuple(dict.fromkeys(found))
        self._began = 0
        self.changes = 0
        self._inputs: dict[tuple[int, int], tuple[Ints, Ints]] = {}
        self._taught: dict[int, tuple[Floats, Floats, ModuleType]] = {}
        self._keys = [keyed_random.key(machine.program.seed, "rounding", p.name) for p in machine.program.projections]

    def start_anew(self) -> None:
        """Nothing was taught: the draws of rounding begin again."""
        self.changes = 0

    def present(self, trial: Trial) -> Outcome:
        """Run one trial."""
        machine, section, group = self._machine, self._section, self._section.group
        began = self._began = machine.step
        self._begin(trial)
        peak = self._advance(trial.peaks)
        machine.listed.drop(section.input)
        potential, best = np.empty(section.maps), np.empty(section.maps, dtype=np.int64)
        cells, bound = machine.cells.fixed[section.output], machine.bound
        wrapped = kernels.end_trial(
            bound.view, bound.words, section.output, group, float(cells.volt), cells.rest, potential, best
        )
        if wrapped or machine.learners:
            machine.check_overflows()
        winner, decided = (int(machine.arrays["groups"][group, column]) for column in (t.WINNER, t.DECIDED))
        decided = decided - began - 1 if winner >= 0 else -1
        if peak is not None and winner >= 0:
            peak[0][winner], peak[1][winner] = np.inf, decided
        values, when = peak or (None, None)
        return Outcome(winner, decided, potential, best, machine.step - began, values, when, self._wins())

    def _wins(self) -> Wins | None:
        """All winners, where there may be several."""
        a, group = self._machine.arrays, self._section.group
        if not self._machine.program.groups[group].choice.several:
            return None
        won = a["won"][self._output][: a["standing"][group, t.WINS]]
        return Wins(won[:, 0].copy(), won[:, 1] - self._began - 1)

    def _advance(self, peaks: bool) -> tuple[Floats, Ints] | None:
        """Run to the end of a trial; with `peaks` the host reads the voltages after each tick up to the decision."""
        machine, section = self._machine, self._section
        found = self._follow() if peaks else None
        decided = machine.arrays["groups"][section.group, t.CLOSED] == 1
        if not (decided and section.stop_at_decision):
            machine.advance_to(self._began + section.duration, section.group if section.stop_at_decision else t.NONE)
        return found

    def _follow(self) -> tuple[Floats, Ints]:
        """Run to the decision or the end, and see the largest V_m of each neuron and its tick."""
        machine, section = self._machine, self._section
        size = self._output.stop - self._output.start
        peak, when = np.full(size, -np.inf), np.zeros(size, dtype=np.int64)
        for tick in range(section.duration):
            machine.advance_to(self._began + 1 + tick)
            volt = machine.cells.state(section.output, "V_m", {"v": machine.arrays["v"][self._output]})
            higher = volt > peak
            peak[higher], when[higher] = volt[higher], tick
            if machine.arrays["groups"][section.group, t.WINNER] >= 0:
                break
        return peak, when

    def _begin(self, trial: Trial) -> None:
        """Drop what is under way, start the output's states anew, and list the trial's spikes."""
        machine, output = self._machine, self._section.output
        machine.listed.drop(self._section.input)
        if machine.listed.reserve(self._section.input, trial.ids.size, self._began):
            machine.bind()
        first = machine.listed.place(self._section.input)
        view, words = machine.bound.view, machine.bound.words
        kernels.begin_trial(view, words, output, trial.silenced, "V_m" in self._states)
        cells = machine.cells.fixed[output]
        for name in self._registers:
            machine.arrays[STATES[name]][self._output] = cells.initial.get(name, 0)
        kernels.list_trial(view, words, self._section.input, first, trial.ticks, trial.ids, self._began)

    def _inputs_of(self, projection: int, neuron: int) -> tuple[Ints, Ints]:
        """Sources of a neuron's synapses, and which weight each has."""
        key = (projection, neuron)
        if key not in self._inputs:
            part = self._machine.program.projections[projection]
            if part.grid is None:
                pre, post = self._machine.program.connections(projection)
                slots = np.flatnonzero(post == neuron)
                self._inputs[key] = pre[slots], slots
            else:
                self._inputs[key] = _under_kernel(part, neuron)
        return self._inputs[key]

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply the rule's `teach` to the inputs of one neuron, rounding stochastically."""
        machine = self._machine
        part, weights = machine.program.projections[projection], machine.weights
        sources, slots = self._inputs_of(projection, neuron)
        first, begin = machine.arrays["first"], machine.slice(part.source).start
        delay, now = self._delays_of(projection, slots), tick + self._began + 1
        since = np.empty(len(sources))
        kernels.ages(first, begin, sources, delay, now, machine.program.resolution, since)
        wires, rule, key, arithmetic = self._prepared(projection)
        weights.updates[projection] += len(slots)
        if projection in machine.delays:
            units, unit = machine.delays.units[projection], machine.program.resolution / FRACTIONS
            kernels.teacher(arithmetic.teach)(
                units, unit, *machine.delays.bounds(projection), 1,
                slots, since, lesson, rule, key, self.changes,
            )  # fmt: skip
            machine.delays.write(projection)
            return
        kernels.teacher(arithmetic.teach)(
            weights.mantissas[projection], float(wires.step[0]), wires.low, wires.high, wires.grain,
            slots, since, lesson, rule, key, self.changes,
        )  # fmt: skip
        if (settle := getattr(arithmetic, "settle", None)) is not None:
            total = float(weights.mantissas[projection][slots].sum() * float(wires.step[0]))
            self.changes += 1
            kernels.teacher(settle)(
                weights.mantissas[projection], float(wires.step[0]), wires.low, wires.high, wires.grain,
                slots, since, total, rule, key, self.changes,
            )  # fmt: skip
        weights.write_some(projection, slots)

    def _delays_of(self, projection: int, slots: Ints) -> Ints:
        """Steps that spikes take along some synapses."""
        part = self._machine.program.projections[projection]
        if projection in self._machine.delays:
            return self._machine.delays.steps(projection)[slots]
        delay = part.delay[:1] if part.grid is not None else np.broadcast_to(part.delay, part.size)[slots]
        return delay.astype(np.int64)

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply the rule's `encourage` to every weight of some maps, rounding stochastically."""
        weights = self._machine.weights
        part = self._machine.program.projections[projection]
        wires, rule, key, arithmetic = self._prepared(projection)
        grow = kernels.grower(arithmetic.encourage)
        for begin, end in self._ranges(part, maps):
            grow(
                weights.mantissas[projection], float(wires.step[0]), wires.low, wires.high, wires.grain,
                begin, end, rule, key, self.changes,
            )  # fmt: skip
            weights.updates[projection] += end - begin
            weights.write_some(projection, np.arange(begin, end))

    def _ranges(self, part: Projection, maps: Ints) -> list[tuple[int, int]]:
        """Weights onto some maps, as ranges."""
        if part.grid is not None:
            size, found = part.size // part.grid.maps, list[tuple[int, int]]()
            for m in maps.tolist():
                begin = found.pop()[0] if found and found[-1][1] == m * size else m * size
                found.append((begin, (m + 1) * size))
            return found
        _, post = self._machine.program.connections(self._machine.program.projections.index(part))
        slots = np.flatnonzero(np.isin(post // self._per_map, maps))
        ends = np.flatnonzero(np.diff(slots, append=-2) != 1)
        begins = np.concatenate(([0], ends[:-1] + 1))
        return [(int(slots[a]), int(slots[b]) + 1) for a, b in zip(begins, ends, strict=True)] if slots.size else []

    def _prepared(self, projection: int) -> tuple[FixedProjection, Floats, np.uint64, ModuleType]:
        """The scale of a projection, its rule's constants, the key of its draws, and the rule; counts a change."""
        machine = self._machine
        numbers = machine.weights.rules[projection]
        kept = self._taught.get(projection)
        if kept is None or kept[0] is not numbers:
            synapse = machine.program.projections[projection].synapse
            kept = self._taught[projection] = numbers, np.zeros(synapse.width), synapse.arithmetic
            kept[2].constants(numbers, machine.program.resolution, kept[1])
        self.changes += 1
        return machine.weights.wires_of(projection), kept[1], np.uint64(self._keys[projection]), kept[2]


def _under_kernel(part: Projection, neuron: int) -> tuple[Ints, Ints]:
    """Sources under the kernel of one neuron of a grid, and which weight each meets."""
    g = part.grid
    assert g is not None
    m, rest = divmod(neuron, g.rows * g.columns)
    r, c = divmod(rest, g.columns)
    _, depth, height, width = g.kernels
    k, i, j = np.indices((depth, height, width))
    y, x = r * g.stride + i - g.top, c * g.stride + j - g.left
    inside = (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
    source = (((k + m // g.reach) * g.height + y) * g.width + x)[inside]
    slot = (((m * depth + k) * height + i) * width + j)[inside]
    return source.astype(np.int64), slot.astype(np.int64)
