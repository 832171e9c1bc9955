"""The engine of the reference backend: steps, trials, and reads and writes between steps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.model.synapses.base import DELAY
from neuro.program.backend import EngineCounts, Outcome, Sent, Spikes, Trial
from neuro.program.program import Floats, Ints, Program
from neuro.program.spikes import carrying
from neuro_reference.network import ReferenceNetwork, TrialCourse
from neuro_reference.projections import ReferenceProjection


class ReferenceEngine:
    """A running program; `neuro.program.backend.Engine` documents each method."""

    def __init__(self, program: Program) -> None:
        self.program, self.net = program, ReferenceNetwork(program)
        self._ticks: list[list[list[int]]] = []

    @property
    def step(self) -> int:
        """The last finished step."""
        return self.net.step

    def run(self, steps: int) -> None:
        """Advance by some steps."""
        with np.errstate(over="ignore", invalid="ignore"):  # diverging states become infinite, as on all backends
            for _ in range(steps):
                self.net.advance()

    def present(self, trial: Trial) -> Outcome:
        """Run one trial."""
        net, section = self.net, self.program.trials
        assert section is not None
        output = net.cells[section.output]
        per_map = output.size // section.maps
        net.drop()
        net.cells[section.input].drop_listed()
        net.silenced[section.output] = np.repeat(trial.silenced, per_map)
        output.start_trial(section.reset)
        if section.anew:
            for cells in net.cells:
                cells.reset([*cells.names])
            for pairs in net.pairs.values():
                pairs.reset(net.step)
        self._ticks = [[[] for _ in range(cells.size)] for cells in net.cells]
        course = TrialCourse(section.maps, output.size, section.group in net.local)
        tick = 0
        for tick in range(section.duration):
            net.advance(trial.ids[trial.ticks == tick])
            for ticks, ids, multiplicity in zip(self._ticks, net.ids, net.multiplicity, strict=True):
                for neuron, m in zip(ids, multiplicity, strict=True):
                    ticks[neuron] += [tick] * m
            course.take(tick, net.potentials[section.output][0], net.won[section.group])
            if section.stop_at_decision and net.closed[section.group]:
                break
        net.silenced[section.output][:] = False
        return course.outcome(tick + 1)

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply `teach` of the rule to the inputs of one neuron."""
        synapses, teach = self.net.synapses[projection], self.program.projections[projection].synapse.arithmetic.teach
        inputs = np.flatnonzero(synapses.target == neuron)
        if synapses.part.synapse.delays:
            synapses.set_out(inputs, synapses.late[inputs])
        values, places = (
            (synapses.late, inputs) if synapses.part.synapse.delays else (synapses.weights, synapses.slot[inputs])
        )
        times_since_arrival = [self._since(synapses, e, tick) for e in inputs.tolist()]
        for place, times in zip(places, times_since_arrival, strict=True):
            for time in times:
                values[place] = teach(values[place], time, lesson, self._rule(projection))
        if (settle := getattr(synapses.part.synapse.arithmetic, "settle", None)) is not None:
            total = np.sum(values[places])
            for place, times in zip(places, times_since_arrival, strict=True):
                values[place] = settle(values[place], times[0], total, self._rule(projection))
        self.net.trial_updates[projection] += len(inputs)

    def _since(self, synapses: ReferenceProjection, synapse: int, tick: int) -> list[float]:
        """Return the times in ms from the arrivals of a synapse's spikes to a tick; -inf for a silent input."""
        assert self.program.trials is not None
        ticks = self._ticks[synapses.part.source][synapses.source[synapse]]
        times = ticks if self.program.trials.spikes == "each" else ticks[:1]
        return [(tick - time - int(synapses.delay[synapse])) * self.program.resolution for time in times] or [-math.inf]

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply `encourage` of the rule to every weight of some maps."""
        synapses, section = self.net.synapses[projection], self.program.trials
        assert section is not None
        per_map = self.net.cells[section.output].size // section.maps
        slots = np.unique(synapses.slot[np.isin(synapses.target // per_map, maps)])
        for slot in slots:
            synapses.weights[slot] = synapses.part.synapse.arithmetic.encourage(
                synapses.weights[slot], self._rule(projection)
            )
        self.net.trial_updates[projection] += len(slots)

    def _rule(self, projection: int) -> Floats:
        part = self.program.projections[projection]
        c: Floats = np.zeros(part.synapse.width)
        part.synapse.arithmetic.constants(self.net.rules[projection], self.program.resolution, c)
        return c

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population."""
        self.net.cells[population].inject(steps, ids, self.net.step, payloads)

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine concentration of all synapses with this signal, or teach those that learn by moves."""
        for pairs in self.net.pairs.values():
            if pairs.part.signal == signal:
                pairs.signal(values, self.step)
        for shared in self.net.shared.values():
            if shared.part.signal == signal:
                shared.signal(values)
        for moves in self.net.moves.values():
            if moves.part.gate == signal:
                moves.gate[:] = values
            if moves.part.signal == signal:
                moves.teach(values)

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """Return a state or parameter of every neuron, or of some."""
        cells = self.net.cells[population]
        values = cells.states[cells.names.index(name)] if name in cells.names else cells.parameters[name]
        all_values = np.broadcast_to(values, cells.size)
        return all_values.copy() if ids is None else all_values[ids]

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Set states and parameters."""
        cells = self.net.cells[population]
        for name, array in values.items():
            if name in cells.names:
                cells.states[cells.names.index(name)] = array
            else:
                cells.parameters[name] = array.copy()
        cells.refresh()

    def get_synapses(self, projection: int, name: str) -> Floats:
        """Return a state of every synapse."""
        pairs = self.net.pairs.get(projection)
        if pairs is not None:
            return pairs.read(name, self.step)
        if projection in self.net.moves:
            return self.net.moves[projection].state(name).copy()
        synapses = self.net.synapses[projection]
        return synapses.late.copy() if name == "delay" else synapses.weights.copy()

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Set the numbers of a synapse model."""
        if projection in self.net.pairs:
            self.net.pairs[projection].set_rule(parameters, self.step)
        elif projection in self.net.by_numbers:
            self.net.by_numbers[projection].rule = parameters.copy()
            self.net.by_numbers[projection].refresh()
        else:
            self.net.rules[projection] = parameters.copy()

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or the chosen ones."""
        indices = slice(None) if chosen is None else chosen
        own_weights = self.net.synapses[projection].weights
        own_weights[indices] = np.broadcast_to(weights, own_weights.shape)[indices]
        if projection in self.net.pairs:
            self.net.pairs[projection].set_weights(own_weights, self.step, indices)
        if projection in self.net.moves:
            self.net.moves[projection].y[0] = own_weights

    def set_synapses(self, projection: int, name: str, values: Floats) -> None:
        """Set a state of the synapses of a projection that learns by moves."""
        self.net.moves[projection].state(name)[:] = values

    def spikes(self, population: int, since: int) -> Spikes:
        """Return the recorded spikes after a step."""
        return carrying(self.program.populations[population], self.net.records[population].since(since))

    def noted(self, probe: int) -> Sent:
        """Return the states at pre spikes recorded for a probe since the last call."""
        return self.net.notes.take(probe)

    def forget(self, before: int) -> None:
        """Drop recorded spikes up to a step."""
        for record in self.net.records:
            record.forget(before)

    def counts(self) -> EngineCounts:
        """Return the counts since the start or the last reset."""
        records = self.net.records
        return EngineCounts(
            steps=self.step,
            events=tuple(record.events.copy() for record in records),
            spikes=tuple(record.spikes.copy() for record in records),
            active=np.array([record.active for record in records], dtype=np.int64),
            trial_updates=self.net.trial_updates.copy(),
        )

    def memory(self) -> dict[str, int]:
        """Return the bytes of states, synapses and recorded spikes."""
        net = self.net
        return {
            "neurons": sum(cells.states.nbytes for cells in net.cells),
            "synapses": sum(w.weights.nbytes + w.source.nbytes + w.target.nbytes + w.slot.nbytes for w in net.synapses),
            "spikes": sum(24 * len(record.steps) for record in net.records),
        }

    def reset(self, weights: bool) -> None:
        """Return to step 0. Parameters and numbers of rules that were set stay."""
        old_net = self.net
        self.net = ReferenceNetwork(self.program)
        for old, new in zip(old_net.cells, self.net.cells, strict=True):
            new.parameters = old.parameters
            new.refresh()
        self.net.rules = old_net.rules
        for index, plastic in old_net.pairs.items():
            self.net.pairs[index].set_rule(plastic.rule, 0)
        for index, learning in old_net.by_numbers.items():
            self.set_rule(index, learning.rule)
        if not weights:
            for index, synapses in enumerate(old_net.synapses):
                pairs = old_net.pairs.get(index)
                self.set_weights(index, synapses.weights if pairs is None else pairs.read("weight", old_net.step))
                if pairs is not None and pairs.delays:
                    self.net.pairs[index].y[DELAY] = pairs.y[DELAY]
                elif synapses.part.synapse.delays:
                    self.net.synapses[index].late = synapses.late

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all arrays that `restore` needs."""
        return take(self.net)

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot."""
        put(self.net, arrays)


Arrays = Mapping[str, NDArray[Any]]


def take(net: ReferenceNetwork) -> dict[str, NDArray[Any]]:
    """Return copies of everything that changes while a network runs."""
    arrays: dict[str, NDArray[Any]] = {}
    for path, part in _parts(net):
        for name in part.saved:
            arrays[f"{path}/{name}"] = np.array(getattr(part, name))
    for index, cells in enumerate(net.cells):
        arrays[f"emitted/{index}/ids"] = net.ids[index].copy()
        arrays[f"emitted/{index}/multiplicity"] = net.multiplicity[index].copy()
        for name, values in cells.parameters.items():
            arrays[f"parameter/{index}/{name}"] = values.copy()
    for index, rule in net.rules.items():
        arrays[f"rule/{index}"] = rule.copy()
    return arrays


def put(net: ReferenceNetwork, arrays: Arrays) -> None:
    """Restore the arrays of `take` in a network of the same program."""
    for path, part in _parts(net):
        for name in part.saved:
            value = arrays[f"{path}/{name}"]
            old_value = getattr(part, name)
            setattr(part, name, value.copy() if isinstance(old_value, np.ndarray) else type(old_value)(value.tolist()))
    for index, cells in enumerate(net.cells):
        net.ids[index] = arrays[f"emitted/{index}/ids"].copy()
        net.multiplicity[index] = arrays[f"emitted/{index}/multiplicity"].copy()
        cells.parameters = {name: arrays[f"parameter/{index}/{name}"].copy() for name in cells.parameters}
        cells.refresh()
    net.rules = {index: arrays[f"rule/{index}"].copy() for index in net.rules}
    for pairs in net.pairs.values():
        pairs.refresh()
    for learning in net.by_numbers.values():
        learning.refresh()


def _parts(net: ReferenceNetwork) -> Iterator[tuple[str, Any]]:
    yield "net", net
    for label, parts in (("cells", net.cells), ("wires", net.synapses), ("records", net.records)):
        for index, part in enumerate(parts):
            yield f"{label}/{index}", part
    for index, local in net.local.items():
        yield f"local/{index}", local
    for number, moves in net.moves.items():
        yield f"moves/{number}", moves
    for number, shared in net.shared.items():
        yield f"shared/{number}", shared
    for number, pairs in net.pairs.items():
        yield f"pairs/{number}", pairs
        yield f"pairs/{number}/pre", pairs.pre
        yield f"pairs/{number}/post", pairs.post
