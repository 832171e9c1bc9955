"""Trials on a chip: the host resets states, sends the input, waits for the decision, and applies rules after it."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neuro.chips.loihi_learning import FRACTIONS
from neuro.core import keyed_random
from neuro.core.clock import NEVER
from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import compiled, kernel, subkernel
from neuro.program.backend import Outcome, Trial, Wins
from neuro.program.program import Floats, Ints, Projection
from neuro_chip import tables as t
from neuro_chip.build import STATES
from neuro_chip.loop import count_open, open_groups
from neuro_chip.machine import Machine
from neuro_chip.tables import net_of

_REGISTERS = {"V_m": ("v",), "I_syn_ex": ("u", "g_exc"), "I_syn_in": ("u", "g_inh")}


arrays_of: Any = net_of
"""`net_of` for type checkers, for which an intrinsic has an additional argument."""


class Scale(NamedTuple):
    """The scale of some weights: weight per mantissa, smallest and largest mantissa, and the step between two."""

    step: float
    low: int
    high: int
    grain: int


class ChipTrials:
    """The presentation of trials, and the rules that learn at their ends.

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
        self._states = {state_name for name in section.reset for state_name in names(section.output, name)}
        names_of_states = [name for state in self._states for name in _REGISTERS[state] if name in STATES]
        self._registers = tuple(dict.fromkeys(names_of_states))
        self._began = 0
        self.changes = 0
        self._inputs: dict[tuple[int, int], tuple[Ints, Ints]] = {}
        self._rules: dict[int, tuple[Floats, Floats, ModuleType]] = {}
        self._keys = [keyed_random.key(machine.program.seed, "rounding", p.name) for p in machine.program.projections]

    def start_anew(self) -> None:
        """Start the draws of rounding anew."""
        self.changes = 0

    def present(self, trial: Trial) -> Outcome:
        """Run one trial."""
        machine, section, group = self._machine, self._section, self._section.group
        began = self._began = machine.step
        self._begin(trial)
        # With `peaks` the host reads the voltages after each tick up to the decision.
        peak = self._follow() if trial.peaks else None
        decided = machine.arrays["groups"][group, t.CLOSED] == 1
        if not (decided and section.stop_at_decision):
            machine.advance_to(began + section.duration, group if section.stop_at_decision else t.NONE)
        machine.spike_lists.drop(section.input)
        potential, winners = np.empty(section.maps), np.empty(section.maps, dtype=np.int64)
        cells, bound = machine.cells.fixed[section.output], machine.bound
        wrapped = end_trial(
            bound.view, bound.words, section.output, group, float(cells.volt), cells.rest, potential, winners
        )
        if wrapped or machine.learners:
            machine.check_overflows()
        winner, decided = (int(machine.arrays["groups"][group, column]) for column in (t.WINNER, t.DECIDED))
        decided = decided - began - 1 if winner >= 0 else -1
        if peak is not None and winner >= 0:
            peak[0][winner], peak[1][winner] = np.inf, decided
        values, peak_steps = peak or (None, None)
        wins = None
        if machine.program.groups[group].choice.several:
            won = machine.arrays["won"][self._output][: machine.arrays["standing"][group, t.WINS]]
            wins = Wins(won[:, 0].copy(), won[:, 1] - began - 1)
        return Outcome(winner, decided, potential, winners, machine.step - began, values, peak_steps, wins)

    def _follow(self) -> tuple[Floats, Ints]:
        """Run to the decision or the end; return the largest V_m of each neuron and its tick."""
        machine, section = self._machine, self._section
        size = self._output.stop - self._output.start
        peak, peak_steps = np.full(size, -np.inf), np.zeros(size, dtype=np.int64)
        for tick in range(section.duration):
            machine.advance_to(self._began + 1 + tick)
            volt = machine.cells.state(section.output, "V_m", {"v": machine.arrays["v"][self._output]})
            higher = volt > peak
            peak[higher], peak_steps[higher] = volt[higher], tick
            if machine.arrays["groups"][section.group, t.WINNER] >= 0:
                break
        return peak, peak_steps

    def _begin(self, trial: Trial) -> None:
        """Drop pending input, reset the states of the output, and list the trial's spikes."""
        machine, output = self._machine, self._section.output
        machine.spike_lists.drop(self._section.input)
        if machine.spike_lists.reserve(self._section.input, trial.ids.size, self._began):
            machine.bind()
        first = machine.spike_lists.place(self._section.input)
        view, words = machine.bound.view, machine.bound.words
        begin_trial(view, words, output, trial.silenced, "V_m" in self._states)
        cells = machine.cells.fixed[output]
        for name in self._registers:
            machine.arrays[STATES[name]][self._output] = cells.initial.get(name, 0)
        list_trial(view, words, self._section.input, first, trial.ticks, trial.ids, self._began)

    def _inputs_of(self, projection: int, neuron: int) -> tuple[Ints, Ints]:
        """Return the source of each synapse onto a neuron, and the index of the synapse's weight."""
        key = (projection, neuron)
        if key not in self._inputs:
            part = self._machine.program.projections[projection]
            if part.grid is None:
                pre, post = self._machine.program.connections(projection)
                slots = np.flatnonzero(post == neuron)
                self._inputs[key] = pre[slots], slots
            else:
                # Find the sources under the kernel of one neuron of a grid, and the weight that connects each source.
                g = part.grid
                m, position = divmod(neuron, g.rows * g.columns)
                r, c = divmod(position, g.columns)
                _, depth, height, width = g.kernels
                k, i, j = np.indices((depth, height, width))
                y, x = r * g.stride + i - g.top, c * g.stride + j - g.left
                inside = (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
                source = (((k + m // g.reach) * g.height + y) * g.width + x)[inside]
                slot = (((m * depth + k) * height + i) * width + j)[inside]
                self._inputs[key] = source.astype(np.int64), slot.astype(np.int64)
        return self._inputs[key]

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply the rule's `teach` to the inputs of one neuron, with stochastic rounding."""
        machine = self._machine
        part, weights = machine.program.projections[projection], machine.weights
        sources, slots = self._inputs_of(projection, neuron)
        first, begin = machine.arrays["first"], machine.slice(part.source).start
        if projection in machine.delays:  # present delays in steps
            delay: NDArray[Any] = machine.delays.steps(projection)[slots]
        else:
            delay = part.delay[:1] if part.grid is not None else np.broadcast_to(part.delay, part.size)[slots]
            delay = delay.astype(np.int64)
        lesson_step = tick + self._began + 1
        ages_ms = np.empty(len(sources))
        ages(first, begin, sources, delay, lesson_step, machine.program.resolution, ages_ms)
        scale, rule, key, arithmetic = self._prepare_change(projection)
        weights.updates[projection] += len(slots)
        if projection in machine.delays:
            units, unit = machine.delays.units[projection], machine.program.resolution / FRACTIONS
            scale = Scale(unit, *machine.delays.bounds(projection), 1)
            teacher(arithmetic.teach)(units, scale, slots, ages_ms, lesson, rule, key, self.changes)
            machine.delays.write(projection)
            return
        mantissas = weights.mantissas[projection]
        teacher(arithmetic.teach)(mantissas, scale, slots, ages_ms, lesson, rule, key, self.changes)
        if (settle := getattr(arithmetic, "settle", None)) is not None:
            total = float(mantissas[slots].sum() * scale.step)
            self.changes += 1
            teacher(settle)(mantissas, scale, slots, ages_ms, total, rule, key, self.changes)
        weights.write_some(projection, slots)

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply the rule's `encourage` to every weight of some maps, with stochastic rounding."""
        weights = self._machine.weights
        part = self._machine.program.projections[projection]
        scale, rule, key, arithmetic = self._prepare_change(projection)
        grow = grower(arithmetic.encourage)
        for begin, end in self._ranges(part, maps):
            grow(weights.mantissas[projection], scale, begin, end, rule, key, self.changes)
            weights.updates[projection] += end - begin
            weights.write_some(projection, np.arange(begin, end))

    def _ranges(self, part: Projection, maps: Ints) -> list[tuple[int, int]]:
        """Return the weights onto some maps, as ranges."""
        if part.grid is not None:
            size, ranges = part.size // part.grid.maps, list[tuple[int, int]]()
            for m in maps.tolist():
                begin = ranges.pop()[0] if ranges and ranges[-1][1] == m * size else m * size
                ranges.append((begin, (m + 1) * size))
            return ranges
        _, post = self._machine.program.connections(self._machine.program.projections.index(part))
        slots = np.flatnonzero(np.isin(post // self._per_map, maps))
        ends = np.flatnonzero(np.diff(slots, append=-2) != 1)
        begins = np.concatenate(([0], ends[:-1] + 1))
        return [(int(slots[a]), int(slots[b]) + 1) for a, b in zip(begins, ends, strict=True)] if slots.size else []

    def _prepare_change(self, projection: int) -> tuple[Scale, Floats, np.uint64, ModuleType]:
        """Count a change; return scale, constants of the rule, key of the draws, and rule of a projection."""
        machine = self._machine
        numbers = machine.weights.rules[projection]
        cached = self._rules.get(projection)
        if cached is None or cached[0] is not numbers:
            synapse = machine.program.projections[projection].synapse
            cached = self._rules[projection] = numbers, np.zeros(synapse.width), synapse.arithmetic
            cached[2].constants(numbers, machine.program.resolution, cached[1])
        self.changes += 1
        wires = machine.weights.wires_of(projection)
        scale = Scale(float(wires.step[0]), wires.low, wires.high, wires.grain)
        return scale, cached[1], np.uint64(self._keys[projection]), cached[2]


@kernel
def begin_trial(view, words, output, silenced, rested):
    """Drop pending input, silence maps of a population, and open the groups.

    Args:
        view: table of the arrays, see `net_of`.
        words: array of words, see `net_of`.
        output: the index of the population.
        silenced: whether each of its maps is silenced.
        rested: whether to end the refractory periods of its neurons.
    """
    net = arrays_of(view, words)
    # A single kernel, because each of a dozen calls of NumPy would need about a microsecond.
    net.ring[:] = 0
    net.came[:] = 0
    net.arrived[:] = 0
    net.arrived_all[:] = 0
    net.first[:] = NEVER
    net.clock[t.EMITTED] = 0
    begin, end = net.pops[output, t.BEGIN], net.pops[output, t.END]
    per_map = (end - begin) // silenced.size
    for m in range(silenced.size):
        net.muted[begin + m * per_map : begin + (m + 1) * per_map] = t.SILENCED if silenced[m] else 0
    if rested:
        # Otherwise a neuron that decided the last trial in its last step would begin this trial refractory.
        net.hold[begin:end] = 0
    open_groups(net)


@kernel
def list_trial(view, words, population, first, ticks, ids, began):
    """List a trial's spikes (sorted by tick, then id) for a generator from place `first` on; merge equal spikes."""
    net = arrays_of(view, words)
    at, begin = first - 1, net.pops[population, t.BEGIN]
    for k in range(ticks.size):
        # Several spikes of a neuron in a tick become an event with a multiplicity, as generators emit them.
        if k > 0 and ticks[k] == ticks[k - 1] and ids[k] == ids[k - 1]:
            net.list_counts[at] += 1
            continue
        at += 1
        net.list_steps[at] = began + 1 + ticks[k]
        net.list_ids[at] = begin + ids[k]
        net.list_counts[at] = 1
    net.cursor[0, population], net.cursor[1, population] = first, at + 1


@kernel
def end_trial(view, words, output, group, volt, rest, potential, best):
    """End the silence of the trial, and find the largest V_m of each map and the first neuron that has it.

    V_m is the present value, or the value at the decision if the group has decided. With several winners each map has
    its own decision.

    Args:
        view: table of the arrays, see `net_of`.
        words: array of words, see `net_of`.
        output: the index of the population.
        group: the group that decides the trial.
        volt: units of the voltage register per mV.
        rest: potential in mV where the register is 0, one value or one per neuron.
        potential: output in mV, one entry per map.
        best: output, numbers of neurons in the population.

    Returns:
        whether a register has overflowed since the start.
    """
    net = arrays_of(view, words)
    begin, end = net.pops[output, t.BEGIN], net.pops[output, t.END]
    for i in range(begin, end):
        net.muted[i] &= ~t.SILENCED
    count_open(net)
    per_map = (end - begin) // potential.size
    for m in range(potential.size):
        if net.local[group, t.RADIUS] >= 0:
            decided = net.map_wins[group, m] > 0
        else:
            decided = net.groups[group, t.WINNER] >= 0
        # Losers are reset at the decision, so their present voltages do not show how close the decision was.
        v = net.potential if decided else net.v
        potential[m] = -math.inf
        for k in range(m * per_map, (m + 1) * per_map):
            # In mV, because neurons can have different resting potentials.
            v_m = v[begin + k] / volt + rest[k if rest.size > 1 else 0]
            if v_m > potential[m]:
                potential[m], best[m] = v_m, k
    wrapped = False
    for pop in range(net.native.shape[0]):
        for column in range(t.MERGED):
            wrapped |= net.native[pop, column] != 0
    return wrapped


@subkernel
def rounded(weight, scale, draw):
    """Return the mantissa below or above a weight, so that the mean is exact; `draw` is uniform in [0, 1)."""
    # Rounding to the nearest mantissa would lose all changes below half a step; with draws the mean is exact.
    exact = weight / scale.step / scale.grain
    floor = np.floor(exact)
    mantissa = np.int64(floor + (draw < exact - floor)) * scale.grain
    return min(max(mantissa, scale.low), scale.high)


@kernel
def ages(first, begin, sources, delay, now, resolution, since):
    """Write the ms from the arrival of each source's first spike to step `now`; -inf if it has not fired.

    `first` has all neurons, of which the sources' population begins at `begin`; `delay` has one entry, or one per
    source.
    """
    for k in range(sources.size):
        fired = first[begin + sources[k]]
        lag = delay[k if delay.size > 1 else 0]
        since[k] = -np.inf if fired == NEVER else (now - fired - lag) * resolution


@cache
def teacher(teach):
    """Return the kernel that applies a rule's `teach` to the inputs of one neuron."""
    function = compiled(teach)

    @kernel
    def learn(mantissas, scale, slots, since, lesson, rule, key, count):
        """Apply the rule to the inputs of one neuron.

        Args:
            mantissas: all weights; changed.
            scale: the scale of the weights.
            slots: the index of each input's weight.
            since: ms from the arrival of each input's spike to the lesson.
            lesson: the number that the rule receives.
            rule: constants of the rule.
            key: key of the draws.
            count: number of changes so far, including this one; each change has its own draws.
        """
        # Keyed by the number of changes, so that the draws do not depend on how trials are divided into calls.
        base = step_word(key, count)
        for k in range(slots.size):
            w = function(mantissas[slots[k]] * scale.step, since[k], lesson, rule)
            mantissas[slots[k]] = rounded(w, scale, uniform(base, slots[k]))

    return learn


@cache
def grower(encourage):
    """Return the kernel that applies a rule's `encourage` to a range of weights."""
    function = compiled(encourage)

    @kernel
    def grow(mantissas, scale, begin, end, rule, key, count):
        """Apply the rule to all weights from begin to end; other arguments are those of `teacher`."""
        base = step_word(key, count)
        for k in range(begin, end):
            w = function(mantissas[k] * scale.step, rule)
            mantissas[k] = rounded(w, scale, uniform(base, k))

    return grow
