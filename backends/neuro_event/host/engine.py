"""The engine: holds the arrays, calls the loop, and translates between ids and internal places."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.english import a
from neuro.core.errors import ModelError
from neuro.core.interrupts import AT_ONCE, Interruptible, end_if_stopped, torn
from neuro.program.backend import EngineCounts, Engines, Outcome, Sent, Spikes, Trial, Wins
from neuro.program.currents import Currents, Rates
from neuro.program.program import Floats, Ints, Program, Trials
from neuro.program.spikes import ListedSpikes, RecordedSpikes, carrying, too_many
from neuro_event.building import (
    build,
    generators,
    joined_rows,
    layout,
    learned_delays,
    learning,
    moves,
    projections,
    thread_partition,
)
from neuro_event.host import reading, snapshot
from neuro_event.host.probes import PotentialPeaks, PreSpikeRecords, StateProbes
from neuro_event.host.snapshot import ChangedValues
from neuro_event.host.threads import Threads
from neuro_event.host.varying_currents import VaryingCurrents, apply
from neuro_event.loop import arrivals, histories, moves as move_kernels, steps, tables as t, trial_rules
from neuro_event.loop.tables import table_of


class EventEngine:
    """A program in execution on the compiled loop; see `neuro.program.backend.Engine`."""

    def __init__(self, program: Program, threads: int) -> None:
        self._program = program
        self._n_threads = threads
        self._stop: Ints = np.zeros(1, dtype=np.int64)
        self._interruptible = Interruptible(self._stop)
        self._start_over(None)

    def _start_over(
        self,
        weights: dict[int, Floats] | None,
        eager: bool = True,
        edges: Ints | None = None,
        joined: frozenset[int] | None = None,
    ) -> None:
        cut = () if edges is None else (edges, joined)
        self._a = build.build(self._program, self._n_threads, eager, *cut)
        self._a.net["stop"] = self._stop
        self._step, self._torn = 0, False
        self._changes = ChangedValues(self._program)
        self._record = RecordedSpikes()
        self._currents = Currents(self._program)
        self._drives = VaryingCurrents(self._program, self._currents, self._a)
        self._rates = Rates(self._program)
        self._steady = not any(p.kind == "current" or p.schedule is not None for p in self._program.populations)
        n_threads = self._a.net["edges"].shape[1] - 1
        self._threads = Threads(n_threads)
        self._listed = ListedSpikes(self._program, self._a.net, [place.begin for place in self._a.places], n_threads)
        self._samples, self._notes = StateProbes(self._a), PreSpikeRecords(self._a)
        self._stops = bool(self._samples.probes or self._notes)
        self._trial_start = 0
        self._trial_updates = np.zeros(len(self._program.projections), dtype=np.int64)
        self._taught: dict[int, tuple[ModuleType, Floats]] = {}
        self._pack()
        for q, w in (weights or {}).items():
            self._write_weights(q, w)

    def _pack(self) -> None:
        """Tell the kernels where the arrays are; needed whenever one is replaced by another."""
        net = self._a.net
        net["awake_groups"] = net["awake"].view(np.uint64)
        net["due_groups"] = net["due"].view(np.uint64)
        net["due_slots"] = net["due"].reshape(len(net["due"]), -1, net["awake"].size)
        net["spot_words"] = net["spots"].view(np.uint64)
        self._a.plastic["traces"] = self._a.plastic["past"].view(np.float64)
        build.link(self._a)
        self._table = table_of(net, self._a.plastic)
        self._view = self._table.ctypes.data
        self._flags = net["clock"][:, t.OVERRUN : t.UNCOUNTED + 1]
        self._no_flags = np.zeros_like(self._flags).tolist()
        self._copy, self._cells = reading.SynapseReader(self._a, self._table), reading.NeuronReader(self._a)

    @property
    def step(self) -> int:
        """The last finished step."""
        return self._step

    def run(self, steps: int) -> None:
        """Advance; stops at the steps where a current or a rate changes and where the record must be emptied."""
        if self._torn:
            raise torn()
        end = self._step + steps
        self.join_rows()
        with self._interruptible:
            while self._step < end:
                self._run_to(end if self._steady else min(end, self._prepare(self._step)))

    def share_stop(self, engines: Sequence[EventEngine]) -> Ints:
        """Let several engines end together; return the number that stops all, see `neuro.core.interrupts`."""
        for engine in engines:
            engine._stop = engine._a.net["stop"] = self._stop
            engine._interruptible = self._interruptible
            engine._pack()
        return self._stop

    def _refuse_torn(self) -> None:
        if self._torn:
            raise torn()

    def join_rows(self) -> None:
        """Lay out joined rows before a run: weights that were set have parted them, and many may be set in turn."""
        if self._a.parted:
            joined_rows.join(self._a)
            self._pack()
            self._a.parted = False  # last: a run that is interrupted before lays them out again

    def _prepare(self, step: int) -> int:
        """Write what generators are to send after a step; return the last step for which it is so."""
        apply(self._currents, self._program, self._a, self._view, step)
        for k, rate in self._rates.new(step):
            generators.set_rate(self._a, k, self._a.places[k].by_place(rate) if rate.size > 1 else rate, step)
        until, replaced = self._drives.prepare(step, self._parameter)
        if replaced:
            self._pack()
        return min(until, self._currents.next_change(step), self._rates.next_change(step))

    def _run_to(self, end: int) -> None:
        first, stop = self._step + 1, self._stop
        while first <= end:
            last = self._next_stop(first, end) if self._stops else end
            self._torn = True
            try:
                reached = self._threads.run(
                    self._view, first, last + 1, self._a.longest_slice, self._a.reach, self._program.resolution, stop
                )
                if stop.item():
                    end_if_stopped(stop)
            except BaseException:  # Ctrl-C is heard as soon as a kernel returns
                self._torn = self._threads.several or int(stop[0]) == AT_ONCE
                self._step = int(self._a.net["reached"][0]) - 1
                raise
            self._torn, self._step = False, int(reached) - 1
            if reached <= last:
                self._drain()
                if reached == first and steps.has_room(self._view, first, 1, self._a.reach) < 1:
                    self._grow_log()
            elif self._stops:
                self._samples.read(self._view, last)
            first = int(reached)
        self._step = end
        self._check_flags()

    def _next_stop(self, first: int, end: int) -> int:
        """The last step that may be run at once: with notes one by one, for these must have room before."""
        if self._notes:
            if self._notes.make_room(self._view, first - 1):
                self._pack()
            end = first
        return min(end, self._samples.next_due(first))

    def _check_flags(self) -> None:
        """Refuse what kernels could not do.

        They count spikes with 64 bits. Histories are as long as refractoriness lets them grow: a model that fires
        earlier has lost spikes.
        """
        flags = self._flags.tolist()
        if flags == self._no_flags:
            return
        overrun, uncounted = (max(column) for column in zip(*flags, strict=True))
        if uncounted:
            raise too_many(self._program.populations[uncounted - 1])
        if overrun:
            part = self._program.populations[overrun - 1]
            raise ModelError(
                f"population '{part.name}': {a(part.model.name)} fired again within its t_ref, so its plastic synapses "
                "missed spikes: expected a model that is silent for t_ref after a spike"
            )

    def _grow_log(self) -> None:
        """Twice the room for spikes under way."""
        net = self._a.net
        old = net["log_ids"].shape[1]
        for name in ("log_ids", "log_counts"):
            bigger = np.zeros((net[name].shape[0], 2 * old), dtype=net[name].dtype)
            for thread in range(bigger.shape[0]):
                places = np.arange(max(0, int(net["log_at"][thread, 0]) - old), int(net["log_at"][thread, 0]))
                bigger[thread, places & (2 * old - 1)] = net[name][thread, places & (old - 1)]
            net[name] = bigger
        self._pack()

    # --- spikes -------------------------------------------------------------------------------------------

    def inject(self, population: int, steps: Ints, ids: Ints, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population, at steps after the present one."""
        if self._listed.add(population, steps, ids, self._step, payloads):
            self._pack()

    def spikes(self, population: int, since: int) -> Spikes:
        """Recorded spikes with step > since."""
        self._drain()
        place = self._a.places[population]
        ids_at = None if place.inside is None else place.outside
        found = self._record.spikes(place.begin, place.end, since, ids_at)
        return carrying(self._program.populations[population], found)

    def _drain(self) -> None:
        """Move recorded spikes out of the loop's buffers."""
        names, filled = ("rec_steps", "rec_ids", "rec_counts"), self._a.net["rec_at"][:, 0]
        steps, ids, counts = (self._a.net[name] for name in names)
        self._record.take((steps[k, :n], ids[k, :n], counts[k, :n]) for k, n in enumerate(filled.tolist()))
        filled[:] = 0

    def forget(self, before: int) -> None:
        """Drop recorded spikes with step <= before."""
        if before >= self._step:
            self._a.net["rec_at"][:, 0] = 0
            self._record = RecordedSpikes()
            return
        self._drain()
        self._record.forget(before)

    def noted(self, probe: int) -> Sent:
        """What pre spikes have left since this was last asked."""
        return self._notes.take(probe)

    @property
    def samples(self) -> Collection[int]:
        """The probes that are read while the engine runs."""
        return self._samples.probes.keys()

    def sampled(self, probe: int) -> tuple[Ints, Floats]:
        """Steps and values of one of them since this was last asked."""
        return self._samples.probes[probe].take()

    # --- trials -------------------------------------------------------------------------------------------

    def present(self, trial: Trial) -> Outcome:
        """Run one trial."""
        spec = self._program.trials
        assert spec is not None
        place = self._a.places[spec.output]
        if self._listed.replace(spec.input, trial.ticks + (self._step + 1), trial.ids, self._step):
            self._pack()
        self._a.net["muted"][place.begin : place.end] = trial.silenced[self._a.net["map_of"]]
        net, start, h = self._a.net, self._step, self._program.resolution
        from neuro_event.loop import steps

        self._refuse_torn()
        self.join_rows()
        steps.begin_trial(self._view, spec.output, spec.group, start, h)
        peaks = PotentialPeaks(spec.output, self._program.populations[spec.output].size, h) if trial.peaks else None
        with Interruptible(self._stop):
            try:
                ticks = self._run_trial(spec, peaks)
            except BaseException:
                self._torn = int(self._stop[0]) == AT_ONCE
                raise
        self._listed.drop(spec.input)
        steps.end_trial(self._view, spec.output, spec.group, start + ticks, h)
        self._trial_start, self._step = start, start + ticks
        inside, decided = (int(net["groups"][spec.group, column]) for column in (t.WINNER, t.DECIDED))
        winner, tick = (int(net["order"][inside]), decided - start - 1) if inside >= 0 else (-1, -1)
        peak, peak_tick = (None, None) if peaks is None else peaks.found(winner, tick)
        wins = self._wins(spec.group) if self._program.groups[spec.group].choice.several else None
        return Outcome(winner, tick, net["potential"].copy(), net["order"][net["best"]], ticks, peak, peak_tick, wins)

    def _wins(self, group: int) -> Wins:
        """All winners of the trial."""
        won = self._a.net["won"][: self._a.net["standing"][group, t.WINS]]
        return Wins(self._a.net["order"][won[:, 0]], won[:, 1] - self._trial_start - 1)

    def _run_trial(self, spec: Trials, peaks: PotentialPeaks | None) -> int:
        """Run a trial that has begun, up to the decision step by step if peaks are followed; return its ticks."""
        from neuro_event.loop import steps

        step, last = self._step + 1, self._step + 1 + spec.duration
        groups, closed = self._a.net["groups"], self._a.net["closed"]
        while step < last and not (spec.stop_at_decision and closed[spec.group]):
            end = min(last if peaks is None else step + 1, self._prepare(step - 1) + 1)
            reached = steps.run_trial(
                self._view, spec.group, step, end, spec.stop_at_decision, self._a.reach, self._program.resolution
            )
            end_if_stopped(self._stop)
            if reached == step:
                self._drain()
                if steps.has_room(self._view, step, 1, self._a.reach) < 1:
                    self._grow_log()
            elif peaks is not None:
                peaks.follow(self._view, step, step - self._step - 1)
                peaks = None if groups[spec.group, t.WINNER] >= 0 else peaks
            step = int(reached)
        return step - self._step - 1

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply the rule's `teach` to the inputs of a neuron, of the trial just presented, at a tick of it."""
        p, (arithmetic, c) = self._program.projections[projection], self._rule(projection)
        inside = self._a.places[p.target].inside
        local = neuron if inside is None else int(inside[neuron])
        first = np.full(self._program.populations[p.source].size, NEVER)
        trial_rules.first_spikes(self._view, p.source, self._trial_start, self._step, first)
        moment, h = self._trial_start + 1 + tick, self._program.resolution
        if projection in self._a.late:
            bounds = (self._a.late[projection], *p.delay_range(h))
            self._trial_updates[projection] += trial_rules.delay_teacher(arithmetic.teach)(
                self._view, projection, c, *bounds, first, moment, local, lesson, h
            )
            return
        where = (first, moment, neuron, local)
        self._trial_updates[projection] += trial_rules.teacher(arithmetic.teach)(
            self._view, projection, c, *where, lesson, h
        )
        if (settle := getattr(arithmetic, "settle", None)) is not None:
            total = np.zeros(1)
            trial_rules.teacher(trial_rules.added)(self._view, projection, total, *where, 0.0, h)
            trial_rules.teacher(settle)(self._view, projection, c, *where, float(total[0]), h)

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply the rule's `encourage` to every weight of the given maps."""
        p, (arithmetic, c) = self._program.projections[projection], self._rule(projection)
        spec = self._program.trials
        assert spec is not None
        chosen = np.zeros(spec.maps, dtype=np.bool_)
        chosen[maps] = True
        size = self._program.populations[p.target].size
        self._trial_updates[projection] += trial_rules.grower(arithmetic.encourage)(
            self._view,
            projection,
            c,
            chosen,
            size // spec.maps,
            self._a.places[p.target].outside,
        )

    def _rule(self, projection: int) -> tuple[ModuleType, Floats]:
        """The functions and the constants of a rule for trials, kept until its numbers change."""
        if projection not in self._taught:
            synapse = self._program.projections[projection].synapse
            c, arithmetic = np.zeros(synapse.width), synapse.arithmetic
            arithmetic.constants(self._changes.rules[projection], self._program.resolution, c)
            self._taught[projection] = arithmetic, c
        return self._taught[projection]

    # --- states, parameters, weights ----------------------------------------------------------------------

    def get(self, population: int, name: str, ids: Ints | None = None) -> Floats:
        """A state or parameter of all neurons or of some; sleeping ones are brought up in a copy."""
        p = self._program.populations[population]
        if layout.computes(p):
            states = [s.name for s in type(p.model).states]
            if name in states:
                return self._cells.state(population, states.index(name), ids, self._step)
        every = self._parameter(population, name)
        return every if ids is None else every[ids]

    def are_finite(self, population: int, states: Sequence[str]) -> bool:
        """As `neuro.program.backend.are_finite`: looks at sleeping neurons as they fell asleep."""
        place, model = self._a.places[population], type(self._program.populations[population].model)
        names = [s.name for s in model.states]
        rows = self._a.net["state"]
        return all(bool(np.isfinite(rows[names.index(name), place.begin : place.end]).all()) for name in states)

    def _parameter(self, population: int, name: str) -> Floats:
        p, place = self._program.populations[population], self._a.places[population]
        if p.kind == "poisson" and name == "rate":
            mean: Floats = self._a.net["mean"][place.begin : place.end]
            return mean / (self._program.resolution * 1e-3)
        if layout.computes(p):
            rows = self._changes.rows.get(population, layout.parameter_rows(p, place))
            column = rows[:, list(p.parameters).index(name)]
            return np.broadcast_to(place.by_id(column) if column.size > 1 else column, p.size).copy()
        value = self._currents.parameter(population, name) if p.kind == "current" else p.parameters[name]
        return np.broadcast_to(value, p.size).astype(np.float64)

    def set(self, population: int, values: Mapping[str, Floats]) -> None:
        """Change states and parameters; acts from the next step on."""
        for name, each in values.items():
            self._set(population, name, each)

    def _set(self, population: int, name: str, values: Floats) -> None:
        p, place = self._program.populations[population], self._a.places[population]
        if name in p.parameters:
            self._changes.given[population, name] = values.copy()
        if p.kind == "poisson":
            generators.set_rate(self._a, population, values, self._step)
            return
        if not layout.computes(p):
            self._currents.set(population, name, values, self._step)
            self._drives.changed()
            return
        if p.kind == "neuron":
            steps.wake_population(self._view, population, self._step, self._program.resolution)
            if any(name == tau for _, tau in getattr(p.model, "filters", {}).values()):
                self._drives.changed()
        inner = place.by_place(values) if values.size > 1 else values
        states = [s.name for s in type(p.model).states]
        if name in states:
            self._a.net["state"][states.index(name), place.begin : place.end] = inner
            return
        rows = self._changes.rows.get(population, layout.parameter_rows(p, place))
        column = list(p.parameters).index(name)
        if inner.size > 1 and rows.shape[0] == 1:
            rows = np.repeat(rows, p.size, axis=0)
        rows = rows.copy()
        rows[:, column] = inner
        self._changes.rows[population] = rows
        if name == "tau_minus":
            self._a.net["tau_minus"][place.begin : place.end] = inner
        if name == "t_ref" and self._a.net["pops"][population, t.HISTORY] >= 0:
            learning.widen_histories(self._a, population, float(inner.min()))
        build.rebuild_constants(self._a, self._changes.rows)
        self._pack()

    def signal(self, signal: int, values: Floats) -> None:
        """Set the dopamine concentration of every synapse that listens to a signal; teach those that learn by moves."""
        for q, k in self._a.moves_of.items():
            p = self._program.projections[q]
            if signal in (p.signal, p.gate):
                inner = np.ascontiguousarray(self._a.places[p.target].by_place(values), dtype=np.float64)
                if p.gate == signal:
                    first = self._a.plastic["move_table"][k, t.MOVE_TARGET]
                    self._a.plastic["move_gate"][first : first + inner.size] = inner
                if p.signal == signal:
                    move_kernels.teach_moves(self._view, k, inner)
        for q, k in self._a.plastic_of.items():
            p = self._program.projections[q]
            if p.signal == signal:
                inner = np.ascontiguousarray(self._a.places[p.target].by_place(values), dtype=np.float64)
                self._copy.give(k, self._step)
                histories.write_signal(self._view, k, inner, self._step, self._program.resolution)

    def get_synapses(self, projection: int, name: str) -> Floats:
        """A state of the synapses, in the order of the program's weights."""
        if projection in self._a.plastic_of:
            return self._copy.synapses(projection, name, self._step)
        p = self._program.projections[projection]
        if projection in self._a.moves_of:
            row, here = self._move_states(projection, name)
            return reading.by_id(self._a.plastic["move_y"][row, here], self._a.synapses[projection].order)
        if name == "delay":
            return reading.by_id(self._a.late[projection], self._a.synapses[projection].order)
        if self._a.net["pops"][p.target, t.RELAY] == 1:
            return np.broadcast_to(self._changes.kept.get(projection, p.weight), p.size).copy()
        return reading.weights(self._a, projection)

    def _move_states(self, projection: int, name: str) -> tuple[int, slice]:
        """Where the weight or a state of a projection that learns by moves lies: row, and synapses."""
        p = self._program.projections[projection]
        first = self._a.plastic["move_table"][self._a.moves_of[projection], t.MOVE_SYNAPSE]
        row = 0 if name == "weight" else 1 + [s.name for s in type(p.synapse).states].index(name)
        return row, slice(first, first + p.size)

    def set_synapses(self, projection: int, name: str, values: Floats) -> None:
        """Set a state of the synapses of a projection that learns by moves."""
        row, here = self._move_states(projection, name)
        order = self._a.synapses[projection].order
        self._a.plastic["move_y"][row, here] = values[order] if order is not None and values.size > 1 else values
        if values.any():
            move_kernels.enliven(self._view, self._a.moves_of[projection])

    def set_rule(self, projection: int, parameters: Floats) -> None:
        """Change the numbers of a synapse model."""
        if projection in self._a.moves_of:
            moves.set_move_rule(self._a, projection, parameters)
        if projection in self._a.plastic_of:
            self._copy.drop()
            reading.bring_all(self._a, self._view, self._a.plastic_of[projection], self._step)
            if learning.set_numbers(self._a, projection, parameters, self._step):
                self._pack()
        self._changes.rules[projection] = parameters.copy()
        self._taught.pop(projection, None)

    def set_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        """Replace all weights, or those that are chosen; spikes under way keep the old ones."""
        row = self._a.net["projections"][projection]
        if row[t.DENSE_COUNTS] == 1:
            self._list_counts(projection, weights)
            return
        if self._step > 0 and projection not in self._a.plastic_of and projection not in self._a.moves_of:
            self._deliver_ahead(projection)
        self._write_weights(projection, weights, chosen)

    def _deliver_ahead(self, projection: int) -> None:
        """Put what was sent into the ring of a projection, with the weights of now."""
        at_once = self._program.sends_at_once(self._program.projections[projection])
        last, lag = self._step if at_once else self._step - 1, self._give_ring(projection)
        arrivals.deliver_between(self._view, projection, self._step - lag + 1, last, self._step)
        self._a.net["set_out"][projection] = last

    def _give_ring(self, projection: int) -> int:
        """Let a projection have a ring; return how many of the last steps may have sent what is not in it."""
        lag = int(self._a.net["projections"][projection, t.LAG])
        if lag == 0:
            return 1
        projections.give_ring(self._a, projection)
        self._pack()
        return lag

    def _list_counts(self, projection: int, weights: Floats) -> None:
        """Replace the weights behind a generator that keeps counts; from now on it lists its spikes.

        Counts are added with the one weight of now, so what is under way is delivered first.
        """
        source = self._program.projections[projection].source
        for q in [q for q, p in enumerate(self._program.projections) if p.source == source]:
            lag = self._give_ring(q)
            arrivals.deliver_counts(self._view, q, self._step - lag + 1, self._step)
            self._a.net["projections"][q, t.DENSE_COUNTS] = 0
        self._a.net["pops"][source, t.COUNTS] = t.NONE
        self._write_weights(projection, weights)

    def _write_weights(self, projection: int, weights: Floats, chosen: NDArray[np.bool_] | None = None) -> None:
        p, row = self._program.projections[projection], self._a.net["projections"][projection]
        if p.size == 0:
            return
        if p.source in self._currents:
            self._currents.set_weights(projection, weights, self._step)
            self._drives.changed()
        order = self._a.synapses[projection].order
        inner = weights[order] if order is not None and weights.size > 1 else weights
        if projection in self._a.plastic_of:
            k = self._a.plastic_of[projection]
            self._copy.drop()
            if self._a.plastic["table"][k, t.EAGER] == 0:
                reading.bring_all(self._a, self._view, k, self._step)
            first = self._a.plastic["table"][k, t.FIRST_SYNAPSE]
            changed = slice(None) if chosen is None else chosen if order is None else chosen[order]
            for kept in (self._a.plastic["y"][0], self._a.plastic["sent"]):
                kept[first : first + p.size][changed] = np.broadcast_to(inner, p.size)[changed]
            return
        if self._a.net["pops"][p.target, t.RELAY] == 1:
            self._changes.kept[projection] = weights.copy()
            return
        if projection in self._a.moves_of:
            self._a.plastic["move_y"][self._move_states(projection, "weight")] = inner
        inner = p.arriving(inner)
        if projections.own_weights(self._a):
            self._pack()
        first, stride = int(row[t.WEIGHT]), int(row[t.WEIGHT_STRIDE])
        if first < 0 or (inner.size > 1 and stride == 0 and p.size > 1):
            row[t.WEIGHT], row[t.WEIGHT_STRIDE] = self._a.net["weights"].size, int(inner.size > 1)
            self._a.net["weights"] = np.concatenate([self._a.net["weights"], inner])
            self._pack()
        else:
            self._a.net["weights"][first : first + (p.size if stride else 1)] = inner
        if projection not in self._a.moves_of:
            row[t.SIGN] = layout.sign(inner)
        if projection in self._a.joined and row[t.LAG] > 0 and not self._a.parted:
            joined_rows.part(self._a)
            self._pack()

    # --- accounts and persistence -------------------------------------------------------------------------

    def counts(self) -> EngineCounts:
        """Counts since the start or the last reset."""
        net = self._a.net
        generators.settle(self._a)
        events = tuple(p.by_id(net["events"][p.begin : p.end].copy()) for p in self._a.places)
        # payloads are not counted, but spikes that carry them
        names = ["events" if part.model.graded else "spikes" for part in self._program.populations]
        spikes = tuple(p.by_id(net[n][p.begin : p.end].copy()) for n, p in zip(names, self._a.places, strict=True))
        return EngineCounts(
            self._step, events, spikes, net["active"].sum(axis=0)[: len(events)], self._trial_updates.copy()
        )

    def fired(self, population: int) -> Ints:
        """Spikes of each neuron of a population since the start or the last reset."""
        if self._a.net["pops"][population, t.COUNTS] >= 0:
            generators.settle(self._a)
        place = self._a.places[population]
        name = "events" if self._program.populations[population].model.graded else "spikes"
        return place.by_id(self._a.net[name][place.begin : place.end].copy())

    def joined(self, engines: Sequence[Any]) -> Engines:
        """Engines of this network as one."""
        from neuro_event.host.together import EventEngines

        return EventEngines(engines)

    def memory(self) -> dict[str, int]:
        """Bytes by what they hold."""
        net, plastic = self._a.net, self._a.plastic
        static = ("rows", "runs", "targets", "weights", "delays", *joined_rows.NAMES)
        learning = ("y", "sent", "reached", "rule", "in_synapse", "in_source", "incoming")
        logs = ("log_ids", "log_counts", "log_ends", "rec_steps", "rec_ids", "rec_counts")
        rest = [k for k in net if k not in {*static, *logs, *snapshot.VIEWS}]
        traces = [k for k in plastic if k not in {*learning, *snapshot.VIEWS}]
        return {
            "synapses": sum(net[k].nbytes for k in static) + sum(plastic[k].nbytes for k in learning),
            "neurons": sum(net[k].nbytes for k in rest) + sum(plastic[k].nbytes for k in traces),
            "spikes": sum(net[k].nbytes for k in logs) + self._record.nbytes(),
        }

    def reset(self, weights: bool) -> None:
        """Back to step 0 and the initial states, and to the initial weights if asked."""
        kept, delays = None, {}
        if not weights:
            parts = self._program.projections
            as_described = joined_rows.as_described(self._a)
            kept = {q: self.get_synapses(q, "weight") for q in range(len(parts)) if q not in as_described}
            delays = {q: self.get_synapses(q, "delay") for q, part in enumerate(parts) if part.synapse.delays}
        before = self._changes
        self._start_over(kept)
        for q, each in delays.items():
            learned_delays.write(self._a, q, each)
        for (k, word), values in before.given.items():
            self._set(k, word, values)
        for q, rule in before.rules.items():
            if np.any(rule != self._changes.rules[q]):
                self.set_rule(q, rule)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Everything that `restore` needs to continue bit for bit."""
        self._refuse_torn()
        self._drain()
        generators.settle(self._a)
        return {
            **snapshot.snapshot(self._a),
            **learned_delays.snapshot(self._a),
            "engine.step": np.array(self._step),
            "engine.trial_updates": self._trial_updates.copy(),
            "engine.edges": self._a.net["edges"].copy(),
            "engine.joined": np.array(sorted(self._a.joined), dtype=np.int64),
            **self._changes.snapshot(),
            **self._record.snapshot(),
            **self._currents.snapshot(),
            **self._listed.snapshot(),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot of the same program.

        Raises:
            ModelError: it was taken with another number of threads.
        """
        edges = arrays["engine.edges"]
        n = edges.shape[1] - 1
        if n not in (thread_partition.parts(self._program, self._n_threads), self._n_threads):
            raise ModelError(f"the state was saved with threads={n}: expected the same to continue")
        self._start_over(None, snapshot.is_eager(arrays), edges, snapshot.joined(arrays))
        snapshot.restore(self._a, arrays)
        learned_delays.restore(self._a, arrays)
        self._step = int(arrays["engine.step"])
        self._trial_updates = arrays["engine.trial_updates"].copy()
        self._changes.restore(arrays)
        learning.lay_constants(self._a, self._changes.rules)
        for q in self._a.moves_of:
            moves.set_move_rule(self._a, q, self._changes.rules[q])
        self._record.restore(arrays)
        self._currents.restore(arrays)
        self._drives.changed()
        self._listed.restore(arrays, self._step)
        self._pack()
