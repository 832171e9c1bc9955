"""All populations and projections of a program, which advance step by step."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core import keyed_random
from neuro.model.neurons import Neuron
from neuro.model.neurons.base import PAYLOAD
from neuro.model.parts import lateral_reset, local_winners, winner_take_all
from neuro.program.backend import Outcome, Sent, Spikes, Wins
from neuro.program.currents import filtered_current
from neuro.program.program import Floats, Ints, Program
from neuro.program.spikes import too_many
from neuro_reference.learning import MoveLearning, PairLearning, SharedLearning, emit_dopamine
from neuro_reference.populations import ReferencePopulation
from neuro_reference.projections import ReferenceProjection

NO_IDS: Ints = np.zeros(0, dtype=np.int64)
Bools = NDArray[np.bool_]
Counts = NDArray[np.uint8]


class ReferenceNetwork:
    """The populations and projections of a program at a step.

    Attributes:
        step: the last finished step.
        ids, multiplicity: spikes of each population in that step; for a graded population the payloads. They update
            plastic synapses and are sent when the next step begins. Spikes of generators along synapses without
            learning are sent in the same step.
        potentials: first state of each population in that step, before spikes reset it.
        closed: whether no neuron of a group may fire any more, by group.
        won: neurons of each group that fired in that step, the best first.
        local: state of the groups with several winners, by group.
        rivals: number of each neuron's set of rivals, by group, for groups in which a spike resets rivals.
        silenced: neurons of each population that must not fire.
        notes: states of synapses at pre spikes, for probes.
        pairs, moves, shared: learning of the plastic projections, by projection.
        by_numbers: learning whose states need no update when the numbers of its rule change, by projection.
        rules: numbers of the rules for trials, by projection.
        trial_updates: number of weights changed at the end of trials, for each projection.
    """

    saved: ClassVar[tuple[str, ...]] = ("step", "closed", "trial_updates")

    def __init__(self, program: Program) -> None:
        self.program, self.step = program, 0
        self.cells = [ReferencePopulation(part, program.resolution, program.seed) for part in program.populations]
        self.synapses = [ReferenceProjection(program, i) for i in range(len(program.projections))]
        self.pairs = {
            i: PairLearning(program, synapses, self.cells[synapses.part.target].parameters["tau_minus"])
            for i, synapses in enumerate(self.synapses)
            if synapses.part.synapse.learns == "pairs" and synapses.part.grid is None
        }
        self.shared = {
            i: SharedLearning(program, synapses, self.cells[synapses.part.target].parameters["tau_minus"])
            for i, synapses in enumerate(self.synapses)
            if synapses.part.synapse.learns == "pairs" and synapses.part.grid is not None
        }
        self.moves = {
            i: MoveLearning(program, synapses)
            for i, synapses in enumerate(self.synapses)
            if synapses.part.synapse.learns == "moves"
        }
        self.by_numbers: dict[int, MoveLearning | SharedLearning] = {**self.moves, **self.shared}
        self.notes = SynapseRecords(program)
        self.rules = {
            i: synapses.part.synapse.vector()
            for i, synapses in enumerate(self.synapses)
            if synapses.part.synapse.learns == "trials"
        }
        self.records = [SpikeRecord(part.size, part.records, part.model.graded) for part in program.populations]
        self.ties = [keyed_random.key(program.seed, "tie", group.name) for group in program.groups]
        self.local = {
            k: LocalWinners(g.choice, program.populations[g.population].shape)
            for k, g in enumerate(program.groups)
            if isinstance(g.choice, local_winners)
        }
        self.rivals = {
            k: rivals(program.populations[g.population].shape, g.choice.axis)
            for k, g in enumerate(program.groups)
            if isinstance(g.choice, lateral_reset)
        }
        self.silenced = [np.zeros(part.size, dtype=bool) for part in program.populations]
        self.trial_updates: Ints = np.zeros(len(self.synapses), dtype=np.int64)
        self.potentials: list[Floats] = [c.states[:1].copy() for c in self.cells]
        self.drop()

    def drop(self) -> None:
        """Drop the spikes under way and the decisions of groups. Currents stay."""
        for synapses in self.synapses:
            if synapses.part.carries != "current":
                synapses.reset()
        self.ids: list[Ints] = [NO_IDS for _ in self.cells]
        self.multiplicity: list[Ints] = [NO_IDS for _ in self.cells]
        self.closed: Bools = np.zeros(len(self.program.groups), dtype=bool)
        self.won: list[Ints] = [NO_IDS for _ in self.program.groups]
        for local in self.local.values():
            local.open()

    def advance(self, presented: Ints = NO_IDS) -> None:
        """Run one step.

        Args:
            presented: neurons of the trials' input that emit an additional spike in this step.
        """
        # Now the spikes of the last step update plastic synapses and are sent, except spikes sent `at_once` before.
        for index, synapses in enumerate(self.synapses):
            if not synapses.at_once:
                self.send(index, self.step)
        for shared in self.shared.values():  # after sending, so that spikes have the weights before these changes
            shared.spike(self.ids[shared.part.source], self.multiplicity[shared.part.source])
        step = self.step + 1
        inputs = [self._arrivals(index, step) for index in range(len(self.cells))]
        reached = [
            cells.update(x, current, step) if cells.part.kind == "neuron" else np.zeros(cells.size, dtype=np.uint8)
            for cells, (x, current, _) in zip(self.cells, inputs, strict=True)
        ]
        self.potentials = [cells.states[:1].copy() for cells in self.cells]
        for index in range(len(self.program.groups)):
            self._decide(index, reached, step)
        for index, (x, _, received) in enumerate(inputs):
            self._emit(index, step, reached[index], x, presented)
            self.records[index].add(step, self.ids[index], self.multiplicity[index])
            if self.cells[index].part.kind == "neuron":
                received[self.ids[index]] = True
                self.records[index].active += int(received.sum())
        for index, synapses in enumerate(self.synapses):
            if synapses.part.carries == "current":
                if synapses.part.receptor is not None:  # adds to the state that holds the receptor's current
                    cells = self.cells[synapses.part.target]
                    state, share = filtered_current(self.program, synapses.part, cells.parameters)
                    cells.states[state] += share * synapses.arrive(step)[0][0]
                source = self.cells[synapses.part.source]
                schedule = source.part.schedule
                synapses.send_current(source.parameters if schedule is None else {"amplitude": schedule.at(step)}, step)
            elif synapses.at_once:
                self.send(index, step)
        for pairs in self.pairs.values():
            pairs.emit_post(self.ids[pairs.part.target], self.multiplicity[pairs.part.target], step)
            pairs.arrive(step)
            if pairs.part.dopamine >= 0:
                emit_dopamine(pairs, self.ids[pairs.part.dopamine], self.multiplicity[pairs.part.dopamine], step)
        for shared in self.shared.values():
            target, dopamine = shared.part.target, shared.part.dopamine
            shared.arrive(self.ids[target], self.multiplicity[target], step)
            if dopamine >= 0:
                emit_dopamine(shared, self.ids[dopamine], self.multiplicity[dopamine], step)
        for moves in self.moves.values():
            target = moves.part.target
            moves.gather(self.ids[target], self.multiplicity[target], self.cells[target].states)
        self.step = step

    def send(self, index: int, step: int) -> None:
        """Update plastic synapses by the spikes of a projection's source in a step, and send the spikes."""
        synapses = self.synapses[index]
        model = self.cells[synapses.part.target].part.model
        assert isinstance(model, Neuron)
        origin = synapses.part.source
        for source, multiplicity in zip(self.ids[origin], self.multiplicity[origin], strict=True):
            if index in self.moves:
                self.moves[index].came[source] += multiplicity
            if index not in self.pairs:
                if synapses.part.synapse.delays:
                    synapses.set_out(synapses.row(source), synapses.late[synapses.row(source)])
                weights = synapses.weights[synapses.slot[synapses.row(source)]]
                synapses.send(source, multiplicity, step, weights, model.relay)
                continue
            for nth in range(int(multiplicity)):
                weights = self.pairs[index].spike(source, step, nth)
                self.notes.add(self.pairs[index], index, source, step)
                synapses.send(source, 1, step, weights, model.relay)

    def _arrivals(self, index: int, step: int) -> tuple[Floats, Floats, Bools]:
        """Return the input by receptor, the external current, and which neurons receive a spike, for one population."""
        size = self.cells[index].size
        x = np.zeros((self.cells[index].receptors, size))
        current, receives = np.zeros(size), np.zeros(size, dtype=bool)
        for synapses in self.synapses:
            carries_current = synapses.part.carries == "current"
            if synapses.part.target == index and not (carries_current and synapses.part.receptor is not None):
                amount, has_spike = synapses.arrive(step)
                if carries_current:
                    current += amount[0]
                else:
                    x += amount
                    receives |= has_spike
        return x, current, receives

    def _decide(self, index: int, reached: list[Counts], step: int) -> None:
        """Reduce the candidates of a group to the winners, if it may still decide, and reset the losers."""
        group = self.program.groups[index]
        cells = self.cells[group.population]
        candidates = np.flatnonzero((reached[group.population] > 0) & ~self.silenced[group.population])
        reached[group.population][:] = 0
        self.won[index] = NO_IDS
        if self.closed[index] or not len(candidates):
            return
        above = cells.states[0, candidates] - cells.constants[candidates, 0]
        draws = keyed_random.uniform(self.ties[index], step, candidates)
        ranked = candidates[np.lexsort((candidates, -draws, -above))]
        self.won[index], lost = self._winners(index, ranked)
        reached[group.population][self.won[index]] = 1
        cells.fire(lost)

    def _winners(self, index: int, ranked: Ints) -> tuple[Ints, Ints]:
        """Return the winning candidates of a group, the best first, and the neurons that are reset without a spike."""
        if index in self.local:
            local = self.local[index]
            winners = local.enter(ranked)
            self.closed[index] = np.all(local.blocked | self.silenced[self.program.groups[index].population])
            return winners, NO_IDS
        if index in self.rivals:
            place = self.rivals[index]
            winners = ranked[np.sort(np.unique(place[ranked], return_index=True)[1])]
            return winners, np.setdiff1d(np.flatnonzero(np.isin(place, place[winners])), winners)
        choice = self.program.groups[index].choice
        self.closed[index] = isinstance(choice, winner_take_all) and choice.first_to_fire
        return ranked[:1], NO_IDS if self.closed[index] else np.sort(ranked[1:])

    def _emit(self, index: int, step: int, reached: Counts, x: Floats, presented: Ints) -> None:
        """Determine the spikes of one population, and reset the neurons that spike."""
        cells = self.cells[index]
        if isinstance(cells.part.model, Neuron):
            self.ids[index] = ((reached > 0) & ~self.silenced[index]).nonzero()[0]
            cells.fire(self.ids[index])
            numbers_sent = (
                x[0]
                if cells.part.model.relay
                else cells.states[cells.names.index(PAYLOAD)]
                if cells.part.model.graded
                else reached
            )
            if cells.part.model.relay and np.any(x[0] + self.records[index].spikes >= 2.0**63):
                raise too_many(cells.part)
            self.multiplicity[index] = numbers_sent[self.ids[index]].astype(np.int64)
            return
        numbers = cells.generate(step)
        if self.program.trials is not None and index == self.program.trials.input:
            numbers = numbers + np.bincount(presented, minlength=cells.size)
        self.ids[index] = numbers.nonzero()[0]
        self.multiplicity[index] = numbers[self.ids[index]]


def rivals(shape: tuple[int, ...], axis: int) -> Ints:
    """Return the number of each neuron's set of rivals. The neurons of a set differ along one axis only."""
    first = np.arange(math.prod(shape)).reshape(shape).take([0], axis=axis)
    return np.broadcast_to(first, shape).ravel()


class SpikeRecord:
    """Recorded spikes of a population, in the order of steps, and spike counts.

    Args:
        size: number of neurons.
        keeps: whether spikes are recorded.
        graded: whether a spike has a payload in place of a multiplicity. It then counts as one spike.
    """

    saved: ClassVar[tuple[str, ...]] = ("steps", "ids", "multiplicity", "events", "spikes", "active")

    def __init__(self, size: int, keeps: bool, graded: bool) -> None:
        self.keeps, self.graded = keeps, graded
        self.steps: list[int] = []
        self.ids: list[int] = []
        self.multiplicity: list[int] = []
        self.events: Ints = np.zeros(size, dtype=np.int64)
        self.spikes: Ints = np.zeros(size, dtype=np.int64)
        self.active = 0

    def add(self, step: int, ids: Ints, multiplicity: Ints) -> None:
        """Add the spikes of one step."""
        if not len(ids):
            return
        self.events[ids] += 1
        self.spikes[ids] += 1 if self.graded else multiplicity
        if self.keeps:
            self.steps += [step] * len(ids)
            self.ids += ids.tolist()
            self.multiplicity += multiplicity.tolist()

    def since(self, step: int) -> Spikes:
        """Return the spikes after a step."""
        first = int(np.searchsorted(self.steps, step, side="right")) if self.steps else 0
        return Spikes(
            np.array(self.steps[first:], dtype=np.int64),
            np.array(self.ids[first:], dtype=np.int64),
            np.array(self.multiplicity[first:], dtype=np.int64),
        )

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        tail = self.since(before)
        self.steps, self.ids, self.multiplicity = (tail.steps.tolist(), tail.ids.tolist(), tail.multiplicity.tolist())


class SynapseRecords:
    """States of synapses after pre spikes, by the number of the probe.

    Args:
        program: the program with the probes.
    """

    def __init__(self, program: Program) -> None:
        self.probes = {number: probe for number, probe in enumerate(program.synapse_probes) if not probe.every}
        self.records: dict[int, list[tuple[int, int, float]]] = {number: [] for number in self.probes}

    def add(self, pairs: PairLearning, projection: int, source: int, step: int) -> None:
        """Record the synapses of a source after the effect of its spike."""
        for number, probe in self.probes.items():
            if probe.projection == projection:
                values, row = pairs.state(probe.record), pairs.synapses.row(source)
                synapses = np.arange(row.start, row.stop)
                probed = synapses if probe.synapses is None else synapses[np.isin(synapses, probe.synapses)]
                self.records[number] += [(step, int(e), float(values[e])) for e in probed]

    def take(self, number: int) -> Sent:
        """Return the records of a probe, and remove them."""
        records, self.records[number] = self.records[number], []
        columns = [np.array(column) for column in zip(*records, strict=True)] or [np.zeros(0)] * 3
        return Sent(columns[0].astype(np.int64), columns[1].astype(np.int64), columns[2])


class LocalWinners:
    """State of a group with several winners.

    Attributes:
        blocked: neurons that are silenced until the next trial or reset.
        wins: number of wins of each map.
    """

    saved: ClassVar[tuple[str, ...]] = ("blocked", "wins")

    def __init__(self, choice: local_winners, shape: tuple[int, ...]) -> None:
        self._choice, self._maps = choice, shape[0]
        self._map, self._row, self._column = np.indices(shape).reshape(3, -1)
        self.open()

    def open(self) -> None:
        """Let all neurons fire again: no neuron has won."""
        self.blocked: Bools = np.zeros(self._map.size, dtype=bool)
        self.wins: Ints = np.zeros(self._maps, dtype=np.int64)

    def enter(self, ranked: Ints) -> Ints:
        """Return the winners among some candidates, the best first. Each winner blocks the neurons near it."""
        winners = []
        for neuron in ranked.tolist():
            if not self.blocked[neuron]:
                winners.append(neuron)
                near = abs(self._row - self._row[neuron]) <= self._choice.radius
                self.blocked |= near & (abs(self._column - self._column[neuron]) <= self._choice.radius)
                own_map = self._map[neuron]
                self.wins[own_map] += 1
                if self.wins[own_map] == self._choice.per_map:
                    self.blocked |= self._map == own_map
        return np.array(winners, dtype=np.int64)


class TrialCourse:
    """Potentials and winners during a trial.

    Args:
        maps: number of maps of the output.
        size: number of neurons of the output.
        several: whether several neurons may win, so that each map has its own decision.
    """

    def __init__(self, maps: int, size: int, several: bool) -> None:
        self._several, self._per_map = several, size // maps
        self._undecided = np.ones(maps, dtype=bool)
        self._potential = np.zeros((maps, self._per_map))
        self._neurons: list[int] = []
        self._ticks: list[int] = []
        self._peak, self._peak_tick = np.full(size, -np.inf), np.zeros(size, dtype=np.int64)

    def take(self, tick: int, potential: Floats, winners: Ints) -> None:
        """Record one tick, which is a step of the trial.

        Args:
            tick: number of the tick.
            potential: V_m of all neurons, before spikes reset it.
            winners: winners of the tick, in order.
        """
        self._potential[self._undecided] = potential.reshape(self._potential.shape)[self._undecided]
        if not self._neurons:
            higher = potential > self._peak
            self._peak[higher], self._peak_tick[higher] = potential[higher], tick
        self._neurons += winners.tolist()
        self._ticks += [tick] * len(winners)
        if len(winners):
            self._undecided[winners // self._per_map if self._several else slice(None)] = False

    def outcome(self, ticks: int) -> Outcome:
        """Return the outcome of the trial after some ticks."""
        winner, decided = (self._neurons[0], self._ticks[0]) if self._neurons else (-1, -1)
        best = self._potential.argmax(axis=1) + np.arange(len(self._potential)) * self._per_map
        if winner >= 0:
            self._peak[winner], self._peak_tick[winner] = np.inf, decided
        wins = Wins(np.array(self._neurons, dtype=np.int64), np.array(self._ticks, dtype=np.int64))
        return Outcome(
            winner, decided, self._potential.max(axis=1), best, ticks,
            self._peak, self._peak_tick, wins if self._several else None,
        )  # fmt: skip
