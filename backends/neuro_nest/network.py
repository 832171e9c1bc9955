"""A program in NEST: nodes and synapses, the run by stretches of steps, and the recorded spikes."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate
from typing import Any

import numpy as np

from neuro.core.clock import NEVER
from neuro.core.errors import ModelError
from neuro.model.synapses.base import common
from neuro.program.backend import Spikes
from neuro.program.currents import Currents
from neuro.program.program import Floats, Ints, Population, Program, Projection, Share
from neuro_nest.kernel import mark_as_ours, nest_errors, set_nodes
from neuro_nest.projections import NestProjection, Nodes, RuleProjection, node_places
from neuro_nest.sources import NONE, InjectedTrain, Noise, TrainSource, is_noise, nodes_of, train
from neuro_nest.tables import DEVICE, FIXED_TRUE, LACKING, LARGE_TAU, NODES, OF_TARGET, UNREADABLE, NestClock

LONGEST = 10_000
"""Largest number of steps of a stretch, for which injectors and the recorder hold spikes."""

NEURON_STEPS = 1 << 24
"""Largest number of neuron steps of a stretch."""


class NestNetwork:
    """A program in NEST at a step.

    Args:
        program: the network.
        nest: the module, with an empty kernel.
        threads: number of NEST's threads.
        parameters: parameters of each population.
        weights: weights of each projection.
        rules: parameters of the synapse model of each projection.
    """

    def __init__(
        self,
        program: Program,
        nest: Any,
        threads: int,
        parameters: list[dict[str, Floats]],
        weights: list[Floats],
        rules: list[Floats],
    ) -> None:
        self.program, self.nest, self.step = program, nest, 0
        self._failed = False
        self.clock = NestClock(program.resolution)
        self.rules = rules
        sent_at_once = {projection.source for projection in program.projections if self._is_at_once(projection)}
        # NEST's draws depend on its seed and on the node of each neuron. Nodes are assigned for threads as for
        # processes, so that a process with two threads has the network of two processes.
        draws = any(projection.undrawn is not None for projection in program.projections)
        n_workers = max(program.share.number, threads if draws and program.share.number == 1 else 1)
        with nest_errors():
            nest.local_num_threads = threads
            nest.set(resolution=self.clock.ms(1), rng_seed=1 + program.seed % _SEEDS)
            longest = max(
                (max(projection.delay_span[1], projection.dopamine_delay) for projection in program.projections),
                default=1,
            )
            nest.set(min_delay=self.clock.ms(1), max_delay=self.clock.ms(longest))
            mark_as_ours(nest)
            self.cells = [
                NestPopulation(
                    nest, part, values, self.clock, program.share, nodes_of(program, k), k in sent_at_once, n_workers
                )
                for k, (part, values) in enumerate(zip(program.populations, parameters, strict=True))
            ]
            before_each = accumulate(
                (projection.size if projection.undrawn is not None else 0 for projection in program.projections),
                initial=0,
            )
            self.synapses = [
                NestProjection(program, i, w) if part.undrawn is None else RuleProjection(program, i, w, n_before)
                for i, (part, w, n_before) in enumerate(zip(program.projections, weights, before_each, strict=False))
            ]
            for synapses in self.synapses:
                with nest_errors(f"projection '{synapses.part.name}'"):
                    self._connect(synapses)
            self._recorder = nest.Create("spike_recorder", params={"time_in_steps": True})
            for cells in self.cells:
                if cells.part.kind == "neuron":
                    nest.Connect(cells.nodes, self._recorder, syn_spec={"delay": self.clock.ms(1)})
        self.sources = {
            index: TrainSource(cells.part, cells.parameters, program.resolution, program.seed)
            for index, cells in enumerate(self.cells)
            if cells.part.kind in ("poisson", "listed", "generator")
        }
        self.currents = Currents(program)
        self.noise = {
            k: Noise(program, k, self.currents) for k, part in enumerate(program.populations) if is_noise(part)
        }
        for index in self.noise:
            self.set_noise(index, parameters[index])
        self.records = [NestRecord(part.size, part.records) for part in program.populations]
        with_synapses = [w for w in self.synapses if isinstance(w, NestProjection)]
        self.activity = Activity(program, [w for w in with_synapses if w.part.carries != "current"])
        self._stretch = max(1, min(LONGEST, NEURON_STEPS // sum(part.size for part in program.populations)))

    def run(self, steps: int) -> None:
        """Advance by some steps."""
        end = self.step + steps
        while self.step < end:
            self._advance(min(end, self.step + self._stretch))

    def _advance(self, to: int) -> None:
        trains = [InjectedTrain(NONE, NONE, NONE)] * len(self.cells)
        for index, source in self.sources.items():
            trains[index] = source.emit(self.step, to)
            with nest_errors():
                self.cells[index].emit(trains[index])
        with nest_errors():
            for index, noise in self.noise.items():
                noise.emit(self.nest, self.cells[index].nodes, self.step, to)
        self._simulate(to)
        with nest_errors():
            events = self._recorder.events
            if len(events["times"]):
                self._recorder.n_events = 0
            spikes = np.stack([np.asarray(events[name]).astype(np.int64) for name in ("senders", "times")], axis=1)
            spikes = self.program.share.gather(spikes)
            senders, steps = spikes[np.argsort(spikes[:, 0], kind="stable")].T
        for index, cells in enumerate(self.cells):
            if cells.part.kind == "neuron":
                first = cells.nodes_of.first
                begin, end = np.searchsorted(senders, (first, first + cells.part.size))
                trains[index] = train(steps[begin:end], cells.nodes_of.neurons(senders[begin:end]), cells.part.size)
        for record, emitted in zip(self.records, trains, strict=True):
            record.add(emitted, to)
        self.activity.add(trains, self.step, to)
        for synapses in self.synapses:
            synapses.after_run()
        self.step = to

    def _simulate(self, end: int) -> None:
        """Let NEST run to a step. After an error NEST cannot continue."""
        if self._failed:
            raise ModelError("NEST: cannot continue after an error", hint="reset the simulation, or compile it again")
        try:
            with nest_errors():
                self.nest.Simulate(self.clock.ms(end - self.step))
        except ModelError as error:
            self._failed = True
            # The message names a model. Report the model's populations with states beyond NEST's bounds, else all its
            # populations.
            text = error.message.rstrip(".")
            cells = [c for c in self.cells if text.endswith(f" {NODES[c.part.model.name]}")]
            unstable_cells = [c for c in cells if any(np.any(np.abs(c.get(s)) > bound) for s, bound in _BOUNDS.items())]
            names = " or ".join(f"'{population.part.name}'" for population in unstable_cells or cells)
            message = error.message.replace("NEST: ", f"NEST: population {names}: ", 1) if names else error.message
            raise error.but(message=message, hint=f"weaken its input, or {error.hint}", kind="instability") from None

    def set_noise(self, population: int, values: Mapping[str, Floats]) -> None:
        """Set parameters of noise, which hold for currents sent after the present step."""
        for name, noise_values in values.items():
            self.currents.set(population, name, noise_values, self.step)

    def _connect(self, synapses: NestProjection | RuleProjection) -> None:
        part = synapses.part
        if isinstance(synapses, RuleProjection):
            source, target = self.cells[part.source], self.cells[part.target]
            synapses.connect(self.nest, source.senders(self._is_at_once(part)), target.nodes, self.clock)
            return
        transmitters = self._transmitters(synapses) if part.synapse.modulated else None
        shared = zip(part.synapse.numbers(), common(self.rules[synapses.index]), strict=True)
        if target_parameters := {name: value for name, value in shared if name in OF_TARGET}:
            set_nodes(self.nest, self.cells[part.target].nodes, [target_parameters])
        synapses.connect(self.nest, self.ends(synapses), self.clock, self.synapse_parameters(synapses), transmitters)

    def ends(self, synapses: NestProjection) -> tuple[Nodes, Nodes]:
        """Return the nodes of source and target of a projection."""
        source = self.cells[synapses.part.source]
        nodes = source.devices_of if self._is_at_once(synapses.part) else source.nodes_of
        return nodes, self.cells[synapses.part.target].nodes_of

    def _is_at_once(self, part: Projection) -> bool:
        """Return whether devices send along a projection, with the weights at emission."""
        return part.carries == "spikes" and self.program.sends_at_once(part)

    def synapse_parameters(self, synapses: NestProjection) -> dict[str, Any]:
        """Return the numbers of a synapse model by NEST's names, and the initial states of the synapses.

        Each entry has a value for all synapses, or a value per synapse.
        """
        left_out = {"deliver_interval", "c_min", *OF_TARGET, *FIXED_TRUE}
        rules = self.rules[synapses.index]
        row = rules if rules.ndim == 1 else synapses.per_synapse(rules)
        numbers = dict(zip(synapses.part.synapse.numbers(), row.T, strict=True))
        return {w: value for w, value in numbers.items() if w not in left_out} | synapses.part.synapse.initial(numbers)

    def grid(self, synapses: NestProjection) -> int:
        """Return the interval in steps at which NEST updates synapses with dopamine."""
        return self.program.min_delay * int(synapses.part.synapse.parameters()["deliver_interval"])

    def _transmitters(self, synapses: NestProjection) -> Any:
        """Create the volume transmitters of a projection, which receive its dopamine spikes."""
        part = synapses.part
        number = synapses.n_target if part.dopamine_one_to_one else 1
        transmitters = self.nest.Create("volume_transmitter", number, {"deliver_interval": self.grid(synapses)})
        if part.dopamine >= 0:
            rule = "one_to_one" if part.dopamine_one_to_one else "all_to_all"
            delay = self.clock.ms(part.dopamine_delay)
            self.nest.Connect(self.cells[part.dopamine].nodes, transmitters, rule, {"delay": delay})
        return transmitters


_BOUNDS = {"V_m": 1e3, "w": 1e6}
"""Absolute values, in mV and pA, beyond which NEST's aeif neurons raise an error."""

_SEEDS = 2**32 - 1
"""Largest seed of NEST; the smallest is 1."""

_WITH_E_L = ("V_th", "V_reset", "V_min", "V_m")
"""Values that NEST stores relative to E_L. Each is set again together with E_L, so that no rounding changes it."""


class NestPopulation:
    """The nodes of a population and its present parameters.

    Args:
        nest: the module.
        part: the population.
        parameters: values by name, shape (1,) or (size,).
        clock: clock of the network.
        share: the share of the neurons that this process has.
        number: number of nodes; None for one node per neuron.
        devices: whether a generator also has devices, which send along static synapses.
        n_workers: number of processes or threads, each of which has neighbouring neurons.

    Attributes:
        nodes_of: nodes of the neurons.
        devices_of: nodes of the devices.
    """

    def __init__(
        self,
        nest: Any,
        part: Population,
        parameters: dict[str, Floats],
        clock: NestClock,
        share: Share,
        number: int | None = None,
        devices: bool = False,
        n_workers: int = 1,
    ) -> None:
        self.part, self.parameters, self._clock, self._share = part, parameters, clock, share
        # NEST assigns nodes that are not devices to processes in turn, so the first node must be on the first process.
        if part.kind == "current":
            n_workers = 1
        if gap := -(nest.network_size + 1) % n_workers:
            nest.Create("parrot_neuron", gap)
        self._nest, self.nodes = nest, nest.Create(NODES[part.model.name], number or part.size)
        places = node_places(part.size, n_workers) if n_workers > 1 else None
        self.nodes_of = Nodes(int(self.nodes[0].global_id), places)
        self._emitting = [self.nodes, *([nest.Create(DEVICE, part.size)] if devices else [])]
        self.devices_of = Nodes(int(self._emitting[-1][0].global_id), places)
        self._set_nodes(self._first_words())
        if part.kind == "current" and part.schedule is not None:
            # Times at which the current changes, and its values.
            times = clock.array_ms(part.schedule.steps)
            rows = np.broadcast_to(part.schedule.values.T, (part.size, times.size))
            set_nodes(nest, self.nodes, [{"amplitude_times": times, "amplitude_values": row.copy()} for row in rows])

    def _first_words(self) -> dict[str, Floats]:
        """Return all values that NEST must have before step 1."""
        if self.part.kind == "current":
            span = {"start": self._clock.ms(self.part.start)}
            if self.part.stop < NEVER:
                span["stop"] = self._clock.ms(self.part.stop)
            return self.parameters | {name: np.array([value]) for name, value in span.items()}
        if self.part.kind != "neuron":
            return {}
        states = [state.name for state in self.part.model.states if not (state.hidden or state.follows)]
        return self.parameters | {name: self.part.initial[name] for name in states if name not in UNREADABLE}

    def senders(self, at_once: bool) -> Any:
        """Return the nodes that send: the devices if `at_once` is true."""
        return self._emitting[-1 if at_once else 0]

    def emit(self, spikes: InjectedTrain) -> None:
        """Pass spikes to the injectors, and to the devices."""
        places = self.nodes_of.places(spikes.ids)
        order = np.argsort(places, kind="stable")
        node_indices, begin = np.unique(places[order], return_index=True)
        times = np.split(self._clock.array_ms(spikes.steps[order]), begin[1:])
        numbers = np.split(spikes.multiplicity[order], begin[1:])
        if node_indices.size:
            spikes_of_nodes = [
                {"spike_times": t, "spike_multiplicities": m} for t, m in zip(times, numbers, strict=True)
            ]
            for nodes in self._emitting:
                set_nodes(self._nest, nodes[node_indices.tolist()], spikes_of_nodes)

    def get(self, name: str, ids: Ints | None = None) -> Floats:
        """Return a state or parameter of every neuron, or of some."""
        if name in self.parameters:
            all_values = np.broadcast_to(self.parameters[name], self.part.size)
            return all_values.copy() if ids is None else all_values[ids]
        if self._share.number > 1:
            gathered = self._gathered(name)
            return gathered if ids is None else gathered[ids]
        if ids is None:
            node_values = np.atleast_1d(np.array(self.nodes.get(name), dtype=np.float64))
            return node_values[self.nodes_of.places(np.arange(self.part.size))]
        places = self.nodes_of.places(ids)
        order = np.argsort(places)  # NEST accepts nodes in ascending order only
        values: Floats = np.empty(places.size)
        values[order] = self.nodes[places[order].tolist()].get(name)
        return values

    def _gathered(self, name: str) -> Floats:
        """Return a state of the neurons of all processes."""
        number, first = self._share.number, self.nodes_of.first
        first_own = (self._share.index - first) % number
        own_nodes = self.nodes[first_own::number] if first_own < self.part.size else ()
        answers = own_nodes.get(["global_id", name]) if own_nodes else {"global_id": [], name: []}
        ids, values = (
            np.atleast_1d(answers["global_id"]).astype(np.int64),
            np.atleast_1d(answers[name]).astype(np.float64),
        )
        all_values: Floats = np.empty(self.part.size)
        all_values[self.nodes_of.neurons(self._share.gather(ids))] = self._share.gather(values)
        return all_values

    def set(self, values: Mapping[str, Floats]) -> None:
        """Set states and parameters, all or none."""
        old_values = {name: self.get(name) for name in values}
        parameters = self.parameters | {name: v.copy() for name, v in values.items() if name in self.parameters}
        try:
            self._set_nodes(values)
        except Exception:
            self._set_nodes(old_values)
            raise
        self.parameters.update(parameters)

    def _set_nodes(self, values: Mapping[str, Floats]) -> None:
        if self.part.kind in ("poisson", "listed", "generator") or is_noise(self.part):
            return
        if "E_L" in values:
            relative = [n for n in _WITH_E_L if n not in values and (n in self.parameters or n == "V_m")]
            values = {n: self.get(n) for n in relative} | dict(values)
        nest_values = {name: self._in_nest_units(name, array) for name, array in values.items() if name not in LACKING}
        per_node = {name: array for name, array in nest_values.items() if len(array) > 1}
        for_all = {name: array[0] for name, array in nest_values.items() if name not in per_node}
        node_order = self.nodes_of.in_turn(self.part.size) if per_node else ()
        neurons = [for_all | {name: per_node[name][i] for name in per_node} for i in node_order] or [for_all]
        with nest_errors(f"population '{self.part.name}'"):
            set_nodes(self._nest, self.nodes, neurons)

    def _in_nest_units(self, name: str, values: Floats) -> list[Any]:
        if name == "refractory_input":
            return [bool(v) for v in values]
        if name == "tau_m":
            return [LARGE_TAU if np.isinf(v) else v for v in values.tolist()]
        if name == "t_ref":
            return [self._clock.ms(round(v / self._clock.resolution)) for v in values.tolist()]
        numbers: list[Any] = values.tolist()
        return numbers


SYNAPSES_AT_ONCE = 1 << 20
"""Approximate number of synapses for which arrivals are computed at a time."""


class NestRecord:
    """The spikes of a population by stretch, and spike counts.

    Args:
        size: number of neurons.
        keeps: whether spikes are recorded.

    Attributes:
        sent: step of each neuron's last spike that NEST has sent. Spikes of the latest step are not sent yet.
    """

    def __init__(self, size: int, keeps: bool) -> None:
        self.size, self.keeps = size, keeps
        self._stretches: list[InjectedTrain] = []
        self.events: Ints = np.zeros(size, dtype=np.int64)
        self.spikes: Ints = np.zeros(size, dtype=np.int64)
        self.sent: Ints = np.zeros(size, dtype=np.int64)
        self._waiting: tuple[Ints, int] = (NONE, 0)

    def add(self, spikes: InjectedTrain, to: int) -> None:
        """Add the spikes of a stretch that ends with step `to`."""
        ids, step = self._waiting
        self.sent[ids] = step
        is_sent = spikes.steps < to
        np.maximum.at(self.sent, spikes.ids[is_sent], spikes.steps[is_sent])
        self._waiting = (spikes.ids[~is_sent], to)
        self.events += np.bincount(spikes.ids, minlength=self.size)
        np.add.at(self.spikes, spikes.ids, spikes.multiplicity)
        if self.keeps and spikes.ids.size:
            self._stretches.append(spikes)

    def since(self, step: int) -> Spikes:
        """Return the spikes after a step."""
        later_stretches = [s for s in self._stretches if s.steps[-1] > step]
        steps, ids, multiplicity = (
            np.concatenate([np.zeros(0, dtype=np.int64), *(getattr(s, name) for s in later_stretches)])
            for name in ("steps", "ids", "multiplicity")
        )
        begin = int(np.searchsorted(steps, step, side="right"))
        return Spikes(steps[begin:], ids[begin:], multiplicity[begin:].astype(np.int64))

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        spikes = self.since(before)
        remaining = InjectedTrain(spikes.steps, spikes.ids, spikes.multiplicity.astype(np.int64))
        self._stretches = [remaining] if remaining.ids.size else []

    @property
    def nbytes(self) -> int:
        """Memory of the spikes, bytes."""
        return sum(24 * len(s.steps) for s in self._stretches)


class Activity:
    """Count of the neuron steps with an arrival or a spike, for the neurons of this process.

    Args:
        program: the whole network.
        synapses: all projections that carry spikes.
    """

    def __init__(self, program: Program, synapses: list[NestProjection]) -> None:
        self._synapses, self._share = synapses, program.share
        self._longest_delay = max((w.part.delay_span[1] for w in synapses if w.part.size), default=0)
        self._pending = [np.zeros((self._longest_delay, p.size), dtype=bool) for p in program.populations]
        self.active: Ints = np.zeros(len(program.populations), dtype=np.int64)

    def add(self, trains: list[InjectedTrain], after: int, to: int) -> None:
        """Count the neuron steps of the steps k with after < k <= to, from the spikes of all populations."""
        steps = to - after
        arrivals = [np.concatenate((h, np.zeros((steps, h.shape[1]), dtype=bool))) for h in self._pending]
        for synapses in self._synapses:
            spikes = trains[synapses.part.source]
            rows_per_call = max(1, SYNAPSES_AT_ONCE // synapses.longest_row)
            for first in range(0, len(spikes.ids), rows_per_call):
                indices, number = synapses.rows(spikes.ids[first : first + rows_per_call])
                arrival = np.repeat(spikes.steps[first : first + rows_per_call], number) + synapses.delay[indices]
                arrivals[synapses.part.target][arrival - after - 1, synapses.target[indices]] = True
        for index, (spikes, receives) in enumerate(zip(trains, arrivals, strict=True)):
            receives[spikes.steps - after - 1, spikes.ids] = True
            first, end = self._share.of(receives.shape[1])
            self.active[index] += np.count_nonzero(receives[:steps, first:end])
            self._pending[index] = receives[steps:]
