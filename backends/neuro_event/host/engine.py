"""The engine, with its trials, counts and snapshots. Its base classes in `running` and `settable` do the rest."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.errors import ModelError
from neuro.core.interrupts import AT_ONCE, Interruptible, end_if_stopped
from neuro.program.backend import EngineCounts, Outcome, Sent, Trial, Wins
from neuro.program.program import Floats, Ints, Trials
from neuro.program.together import Engines
from neuro_event.building import build, joined_rows, layout, learning, move_rules, shared_kernels, thread_partition
from neuro_event.host import reading
from neuro_event.host.settable import Settable
from neuro_event.loop import steps, tables as t, trial_rules
from neuro_event.loop.together import follow_peaks


class EventEngine(Settable):
    """A program that runs on the compiled loop; see `neuro.program.backend.Engine`."""

    def present(self, trial: Trial) -> Outcome:
        """Run one trial."""
        spec = self._program.trials
        assert spec is not None
        place = self._arrays.places[spec.output]
        if self._spike_lists.replace(spec.input, trial.ticks + (self._step + 1), trial.ids, self._step):
            self._pack()
        self._arrays.net["muted"][place.begin : place.end] = trial.silenced[self._arrays.net["map_of"]]
        net, start, h = self._arrays.net, self._step, self._program.resolution
        self._refuse_torn()
        self.join_rows()
        if spec.anew:
            self._synapse_reader.drop()
            for k in self._arrays.plastic_of.values():
                reading.catch_up_all(self._arrays, self._view, k, start)
            learning.reset_states(self._arrays, start)
        steps.begin_trial(self._view, spec.output, spec.group, start, h)
        peaks = None
        if trial.peaks:  # the largest V_m of each neuron up to the decision, and the tick at which it occurred
            size = self._program.populations[spec.output].size
            peaks = np.full(size, -np.inf), np.zeros(size, dtype=np.int64)
        with Interruptible(self._stop):
            try:
                ticks = self._run_trial(spec, peaks)
            except BaseException:
                self._torn = int(self._stop[0]) == AT_ONCE
                raise
        self._spike_lists.drop(spec.input)
        steps.end_trial(self._view, spec.output, spec.group, start + ticks, h)
        self._trial_start, self._step = start, start + ticks
        inside, decided = (int(net["groups"][spec.group, column]) for column in (t.WINNER, t.DECIDED))
        winner, tick = (int(net["order"][inside]), decided - start - 1) if inside >= 0 else (-1, -1)
        peak, peak_tick = peaks or (None, None)
        if peaks is not None and winner >= 0:
            peaks[0][winner], peaks[1][winner] = np.inf, tick
        won = net["won"][: net["standing"][spec.group, t.WINS]]
        has_several = self._program.groups[spec.group].choice.several
        wins = Wins(net["order"][won[:, 0]], won[:, 1] - start - 1) if has_several else None
        return Outcome(winner, tick, net["potential"].copy(), net["order"][net["best"]], ticks, peak, peak_tick, wins)

    def _run_trial(self, spec: Trials, peaks: tuple[Floats, Ints] | None) -> int:
        """Run a trial that has begun, up to its end or decision. Return its number of ticks.

        If peaks are recorded, each step until the decision is a separate run.
        """
        step, last = self._step + 1, self._step + 1 + spec.duration
        groups, closed = self._arrays.net["groups"], self._arrays.net["closed"]
        while step < last and not (spec.stop_at_decision and closed[spec.group]):
            end = last if peaks is None else step + 1
            if self._changing is not None:
                end = min(end, self._prepare(self._changing, step - 1) + 1)
            reached = steps.run_trial(
                self._view, spec.group, step, end, spec.stop_at_decision, self._arrays.reach, self._program.resolution
            )
            end_if_stopped(self._stop)
            if reached == step:
                self._drain()
                if steps.has_room(self._view, step, 1, self._arrays.reach) < 1:
                    self._grow_log()
            elif peaks is not None:
                # Peaks need the states after each step, also those of sleeping neurons.
                steps.wake_population(self._view, spec.output, step, self._program.resolution)
                follow_peaks(self._view, spec.output, step - self._step - 1, *peaks)
                peaks = None if groups[spec.group, t.WINNER] >= 0 else peaks
            step = int(reached)
        return step - self._step - 1

    def learn(self, projection: int, neuron: int, tick: int, lesson: float) -> None:
        """Apply the function `teach` of the rule to the inputs of a neuron.

        `tick` is a tick of the last trial.
        """
        part, (arithmetic, constants) = self._program.projections[projection], self._rule(projection)
        inside = self._arrays.places[part.target].inside
        local = neuron if inside is None else int(inside[neuron])
        spikes = self._spikes_that_teach(part.source)
        moment, h = self._trial_start + 1 + tick, self._program.resolution
        lags = self._arrays.net["late"][learning.delay_slice(self._arrays, projection)] if part.synapse.delays else None
        values, where = self._trial_weights(projection) if lags is None else lags, (spikes, moment, neuron, local)
        self._trial_updates[projection] += trial_rules.teacher(arithmetic.teach)(
            self._view, projection, values, constants, *where, lesson, h
        )
        if lags is not None:
            trial_rules.round_inputs(self._view, projection, values, local, *part.delay_range(h), h)
        elif (settle := getattr(arithmetic, "settle", None)) is not None:
            total, where = np.zeros(1), (spikes[:1], moment, neuron, local)
            trial_rules.teacher(trial_rules.add_to_sum)(self._view, projection, values, total, *where, 0.0, h)
            trial_rules.teacher(settle)(self._view, projection, values, constants, *where, float(total[0]), h)

    def _spikes_that_teach(self, population: int) -> Ints:
        """Return the steps of the spikes of each neuron in the last trial, shape (spikes, neurons).

        Without `spikes: each` there is one row, which has the first spike of each neuron. Missing spikes are `NEVER`.
        """
        assert self._program.trials is not None
        rows, size = 1, self._program.populations[population].size
        while True:
            spikes, count = np.full((rows, size), NEVER), np.zeros(size, dtype=np.int64)
            trial_rules.spikes_of(self._view, population, self._trial_start, self._step, spikes, count)
            if self._program.trials.spikes != "each" or rows >= (most := int(count.max(initial=0))):
                return spikes
            rows = most

    def _trial_weights(self, projection: int) -> Floats:
        """Return the weights of a projection that learns by trials, in internal order, as a view."""
        first = int(self._arrays.net["projections"][projection, t.WEIGHT])
        weights: Floats = self._arrays.net["weights"][first : first + self._program.projections[projection].size]
        return weights

    def encourage(self, projection: int, maps: Ints) -> None:
        """Apply the function `encourage` of the rule to every weight whose target is in the given maps."""
        arithmetic, c = self._rule(projection)
        spec = self._program.trials
        assert spec is not None
        chosen = np.zeros(spec.maps, dtype=np.bool_)
        chosen[maps] = True
        if projection not in self._weight_maps:
            self._weight_maps[projection] = layout.map_of_weights(self._arrays, projection, spec.maps)
        self._trial_updates[projection] += trial_rules.grower(arithmetic.encourage)(
            self._trial_weights(projection), self._weight_maps[projection], chosen, c
        )

    def _rule(self, projection: int) -> tuple[ModuleType, Floats]:
        """Return the functions and constants of a rule for trials, cached until a parameter of the rule is set."""
        if projection not in self._trial_rules:
            synapse = self._program.projections[projection].synapse
            c, arithmetic = np.zeros(synapse.width), synapse.arithmetic
            arithmetic.constants(self._rules[projection], self._program.resolution, c)
            self._trial_rules[projection] = arithmetic, c
        return self._trial_rules[projection]

    def noted(self, probe: int) -> Sent:
        """Return the states that a probe has recorded at pre spikes since the last call."""
        assert self._pre_spike_records is not None
        return self._pre_spike_records.take(probe)

    @property
    def samples(self) -> Collection[int]:
        """Numbers of the probes that the engine reads while it runs."""
        return self._samples.keys()

    def sampled(self, probe: int) -> tuple[Ints, Floats]:
        """Return the steps and values that a probe has recorded since the last call."""
        return self._samples[probe].take()

    def counts(self) -> EngineCounts:
        """Return the counts of steps, events, spikes and updates since the start or the last reset."""
        net = self._arrays.net
        build.settle(self._arrays)
        events = tuple(p.by_id(net["events"][p.begin : p.end].copy()) for p in self._arrays.places)
        # `spikes` adds up payloads in a graded population, so its number of spikes is in `events`.
        names = ["events" if part.model.graded else "spikes" for part in self._program.populations]
        spikes = tuple(p.by_id(net[n][p.begin : p.end].copy()) for n, p in zip(names, self._arrays.places, strict=True))
        return EngineCounts(
            self._step, events, spikes, net["active"].sum(axis=0)[: len(events)], self._trial_updates.copy()
        )

    def fired(self, population: int) -> Ints:
        """Return the number of spikes of each neuron of a population since the start or the last reset."""
        if self._arrays.net["pops"][population, t.COUNTS] >= 0:
            build.settle(self._arrays)
        place = self._arrays.places[population]
        name = "events" if self._program.populations[population].model.graded else "spikes"
        return place.by_id(self._arrays.net[name][place.begin : place.end].copy())

    def joined(self, engines: Sequence[Any]) -> Engines:
        """Return a group that runs several engines of this network together."""
        from neuro_event.host.together import EventEngines

        return EventEngines(engines)

    def memory(self) -> dict[str, int]:
        """Return the memory of synapses, neurons and spikes in bytes."""
        counted = {"synapses": 0, "neurons": 0, "spikes": self._record.nbytes()}
        for _, array, owner in build.declared_in(self._arrays):
            if not array.life.startswith(("view", "=")):
                counted[array.account] += owner[array.name].nbytes
        return counted

    def reset(self, weights: bool) -> None:
        """Return to step 0 and the initial states, and to the initial weights if `weights` is true.

        Parameters of neurons and rules that were set stay.
        """
        weights_before, delays_before = dict[int, Floats](), dict[int, Floats]()
        if not weights:
            parts = self._program.projections
            as_described = joined_rows.as_described(self._arrays)
            weights_before = {q: self.get_synapses(q, "weight") for q in range(len(parts)) if q not in as_described}
            delays_before = {q: self.get_synapses(q, "delay") for q, part in enumerate(parts) if part.synapse.delays}
        parameters, rules = self._changed_parameters, self._rules
        self._start_over()
        for q, weights_of_q in weights_before.items():
            self._write_weights(q, weights_of_q)
        for q, weights_of_q in delays_before.items():
            learning.write_delays(self._arrays, q, weights_of_q)
        for name, values in parameters.items():
            population, _, word = name.partition(".")
            self._set(int(population), word, values)
        for q, rule in rules.items():
            if np.any(rule != self._rules[q]):
                self.set_rule(q, rule)

    def snapshot(self) -> dict[str, NDArray[Any]]:
        """Return all arrays that `restore` needs to continue with the same results bit for bit."""
        self._refuse_torn()
        self._drain()
        settings = (("given", self._changed_parameters), ("rule", self._rules), ("kept", self._relay_weights))
        return {
            **build.snapshot(self._arrays),
            "engine.step": np.array(self._step),
            "engine.trial_updates": self._trial_updates.copy(),
            "engine.edges": self._arrays.net["edges"].copy(),
            "engine.joined": np.array(sorted(self._arrays.joined), dtype=np.int64),
            **{f"{part}.{key}": values.copy() for part, arrays in settings for key, values in arrays.items()},
            **self._record.snapshot(),
            **({} if self._changing is None else self._changing.currents.snapshot()),
            **({} if self._lists is None else self._lists.snapshot()),
        }

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from a snapshot of the same program.

        Raises:
            ModelError: the snapshot was made with another number of threads.
        """
        edges = arrays["engine.edges"]
        n = edges.shape[1] - 1
        if n not in (thread_partition.parts(self._program, self._n_threads), self._n_threads):
            raise ModelError(f"the state was saved with threads={n}: expected the same number to continue")
        # A snapshot without traces of post spikes comes from an engine in which all synapses learn lazily.
        eager, joined = len(arrays["plastic.heard"]) > 0, frozenset(arrays["engine.joined"].tolist())
        self._start_over(eager, edges, joined)
        build.restore(self._arrays, arrays)
        self._step = int(arrays["engine.step"])
        self._trial_updates = arrays["engine.trial_updates"].copy()
        for name, value in arrays.items():
            part, _, key = name.partition(".")
            if part == "given":
                self._changed_parameters[key] = value.copy()
            elif part in ("rule", "kept"):
                (self._rules if part == "rule" else self._relay_weights)[int(key)] = value.copy()
        learning.write_constants(self._arrays, self._rules)
        for q in self._arrays.moves_of:
            move_rules.set_move_rule(self._arrays, q, self._rules[q])
        for q in self._arrays.shared_of:
            shared_kernels.set_shared_rule(self._arrays, q, self._rules[q])
        self._record.restore(arrays)
        if self._changing is not None:
            self._changing.currents.restore(arrays)
            self._changing.drives.changed()
        if self._lists is not None:
            self._lists.restore(arrays, self._step)
        self._pack()
