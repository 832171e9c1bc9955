"""All parts of a program in NEST, one stretch of steps, and what it records."""

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
from neuro_nest.kernel import nest_errors, set_nodes, sign
from neuro_nest.projections import NestProjection, Nodes, RuleProjection, dealt_out
from neuro_nest.sources import NONE, InjectedTrain, Noise, TrainSource, is_noise, nodes_of, train
from neuro_nest.tables import DEVICE, ENDLESS, FIXED_TRUE, LACKING, NODES, OF_TARGET, UNREADABLE, NestClock

LONGEST = 10_000
"""Steps of a stretch: what injectors hold and the recorder gathers."""

CELLS_AT_ONCE = 1 << 24
"""Neuron-steps of a stretch."""


class NestNetwork:
    """A program in NEST at the step it has reached.

    Args:
        program: the network.
        nest: the module, its kernel empty.
        threads: of NEST.
        parameters: of each population.
        weights: of each projection.
        rules: numbers of the synapse models of each projection.
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
        sent_at_once = {p.source for p in program.projections if self._is_at_once(p)}
        # What NEST draws follows from its seed and from the node of each neuron. These are dealt out for threads as for
        # processes, so that a process with two threads has the network of two processes.
        draws = any(p.undrawn is not None for p in program.projections)
        dealt = max(program.share.number, threads if draws and program.share.number == 1 else 1)
        with nest_errors():
            nest.local_num_threads = threads
            nest.set(resolution=self.clock.ms(1), rng_seed=1 + program.seed % _SEEDS)
            longest = max((max(p.delay_span[1], p.dopamine_delay) for p in program.projections), default=1)
            nest.set(min_delay=self.clock.ms(1), max_delay=self.clock.ms(longest))
            sign(nest)
            self.cells = [
                NestPopulation(
                    nest, part, own, self.clock, program.share, nodes_of(program, k), k in sent_at_once, dealt
                )
                for k, (part, own) in enumerate(zip(program.populations, parameters, strict=True))
            ]
            left = accumulate((p.size if p.undrawn is not None else 0 for p in program.projections), initial=0)
            self.wires = [
                NestProjection(program, i, w) if part.undrawn is None else RuleProjection(program, i, w, before)
                for i, (part, w, before) in enumerate(zip(program.projections, weights, left, strict=False))
            ]
            for wires in self.wires:
                with nest_errors(f"projection '{wires.part.name}'"):
                    self._connect(wires)
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
        self.noise = {k: Noise(program, k, self.currents) for k, p in enumerate(program.populations) if is_noise(p)}
        for index in self.noise:
            self.set_noise(index, parameters[index])
        self.records = [NestRecord(p.size, p.records) for p in program.populations]
        listed = [w for w in self.wires if isinstance(w, NestProjection)]
        self.activity = Activity(program, [w for w in listed if w.part.carries != "current"])
        self._stretch = max(1, min(LONGEST, CELLS_AT_ONCE // sum(p.size for p in program.populations)))

    def run(self, steps: int) -> None:
        """Advance."""
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
            spikes = np.stack([np.asarray(events[word]).astype(np.int64) for word in ("senders", "times")], axis=1)
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
        for wires in self.wires:
            wires.ran()
        self.step = to

    def _simulate(self, to: int) -> None:
        """Let NEST run to a step; after an error of its it cannot go on."""
        if self._failed:
            raise ModelError("NEST: cannot run on after its error", hint="reset the simulation, or compile it anew")
        try:
            with nest_errors():
                self.nest.Simulate(self.clock.ms(to - self.step))
        except ModelError as error:
            self._failed = True
            # The populations of the model that it names; those that are beyond its bounds, if any are.
            named = error.message.rstrip(".")
            cells = [c for c in self.cells if named.endswith(f" {NODES[c.part.model.name]}")]
            beyond = [c for c in cells if any(np.any(np.abs(c.get(s)) > bound) for s, bound in _BOUNDS.items())]
            names = " or ".join(f"'{each.part.name}'" for each in beyond or cells)
            message = error.message.replace("NEST: ", f"NEST: population {names}: ", 1) if names else error.message
            raise error.but(message=message, hint=f"weaken its input, or {error.hint}", kind="instability") from None

    def set_noise(self, population: int, values: Mapping[str, Floats]) -> None:
        """Set parameters of noise; what is sent after the present step has them."""
        for word, each in values.items():
            self.currents.set(population, word, each, self.step)

    def _connect(self, wires: NestProjection | RuleProjection) -> None:
        part = wires.part
        if isinstance(wires, RuleProjection):
            source, target = self.cells[part.source], self.cells[part.target]
            wires.connect(self.nest, source.senders(self._is_at_once(part)), target.nodes, self.clock)
            return
        transmitters = self._transmitters(wires) if part.synapse.modulated else None
        shared = zip(part.synapse.numbers(), common(self.rules[wires.index]), strict=True)
        if of_target := {word: value for word, value in shared if word in OF_TARGET}:
            set_nodes(self.nest, self.cells[part.target].nodes, [of_target])
        wires.connect(self.nest, self.ends(wires), self.clock, self.words(wires), transmitters)

    def ends(self, wires: NestProjection) -> tuple[Nodes, Nodes]:
        """The nodes of source and target."""
        source = self.cells[wires.part.source]
        nodes = source.devices_of if self._is_at_once(wires.part) else source.nodes_of
        return nodes, self.cells[wires.part.target].nodes_of

    def _is_at_once(self, part: Projection) -> bool:
        """Whether devices send along a projection: a spike takes the weights of its emission."""
        return part.carries == "spikes" and self.program.sends_at_once(part)

    def words(self, wires: NestProjection) -> dict[str, Any]:
        """The numbers of a synapse model in NEST's words, and the states in which its synapses start.

        Each is of all synapses, or has a value for each.
        """
        elsewhere = {"deliver_interval", "c_min", *OF_TARGET, *FIXED_TRUE}
        rules = self.rules[wires.index]
        each = rules if rules.ndim == 1 else wires.each(rules)
        numbers = dict(zip(wires.part.synapse.numbers(), each.T, strict=True))
        return {w: value for w, value in numbers.items() if w not in elsewhere} | wires.part.synapse.initial(numbers)

    def grid(self, wires: NestProjection) -> int:
        """Steps between the moments at which NEST brings a synapse under dopamine up to date."""
        return self.program.min_delay * int(wires.part.synapse.parameters()["deliver_interval"])

    def _transmitters(self, wires: NestProjection) -> Any:
        """The volume transmitters of a projection, which hear its dopamine."""
        part = wires.part
        number = wires.n_target if part.dopamine_one_to_one else 1
        transmitters = self.nest.Create("volume_transmitter", number, {"deliver_interval": self.grid(wires)})
        if part.dopamine >= 0:
            rule = "one_to_one" if part.dopamine_one_to_one else "all_to_all"
            delay = self.clock.ms(part.dopamine_delay)
            self.nest.Connect(self.cells[part.dopamine].nodes, transmitters, rule, {"delay": delay})
        return transmitters


_BOUNDS = {"V_m": 1e3, "w": 1e6}
"""Beyond these values, in mV and pA, NEST's aeif neurons give up."""

_SEEDS = 2**32 - 1
"""NEST's seeds go from 1 to this."""

_WITH_E_L = ("V_th", "V_reset", "V_min", "V_m")
"""What NEST holds relative to E_L: set again with it, so that no rounding moves it."""


class NestPopulation:
    """The nodes of a population and its present parameters.

    Args:
        nest: the module.
        part: the population.
        parameters: by word, shape (1,) or (size,).
        clock: of the network.
        share: which of the neurons are of this process.
        number: of nodes, if it is not that of its neurons.
        devices: whether those of a generator send along synapses that do not learn.
        dealt: processes, or threads, of which each has neighbouring neurons.

    Attributes:
        nodes_of: the nodes of the neurons.
        devices_of: likewise of the devices.
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
        dealt: int = 1,
    ) -> None:
        self.part, self.parameters, self._clock, self._share = part, parameters, clock, share
        # NEST deals its nodes out in turn, whatever is not a device: the first of these is of the first process.
        if part.kind == "current":
            dealt = 1
        if gap := -(nest.network_size + 1) % dealt:
            nest.Create("parrot_neuron", gap)
        self._nest, self.nodes = nest, nest.Create(NODES[part.model.name], number or part.size)
        at = dealt_out(part.size, dealt) if dealt > 1 else None
        self.nodes_of = Nodes(int(self.nodes[0].global_id), at)
        self._emitting = [self.nodes, *([nest.Create(DEVICE, part.size)] if devices else [])]
        self.devices_of = Nodes(int(self._emitting[-1][0].global_id), at)
        self._tell(self._first_words())
        if part.kind == "current" and part.schedule is not None:
            # When the current changes, and its values.
            times = clock.array_ms(part.schedule.steps)
            rows = np.broadcast_to(part.schedule.values.T, (part.size, times.size))
            set_nodes(nest, self.nodes, [{"amplitude_times": times, "amplitude_values": row.copy()} for row in rows])

    def _first_words(self) -> dict[str, Floats]:
        """All that NEST must know before step 1."""
        if self.part.kind == "current":
            span = {"start": self._clock.ms(self.part.start)}
            if self.part.stop < NEVER:
                span["stop"] = self._clock.ms(self.part.stop)
            return self.parameters | {word: np.array([value]) for word, value in span.items()}
        if self.part.kind != "neuron":
            return {}
        states = [state.name for state in self.part.model.states if not (state.hidden or state.follows)]
        return self.parameters | {name: self.part.initial[name] for name in states if name not in UNREADABLE}

    def senders(self, at_once: bool) -> Any:
        """The nodes that send, of devices if `at_once`."""
        return self._emitting[-1 if at_once else 0]

    def emit(self, spikes: InjectedTrain) -> None:
        """Let the injectors fire, and the devices."""
        places = self.nodes_of.places(spikes.ids)
        order = np.argsort(places, kind="stable")
        ids, begin = np.unique(places[order], return_index=True)
        times = np.split(self._clock.array_ms(spikes.steps[order]), begin[1:])
        numbers = np.split(spikes.multiplicity[order], begin[1:])
        if ids.size:
            words = [{"spike_times": t, "spike_multiplicities": m} for t, m in zip(times, numbers, strict=True)]
            for nodes in self._emitting:
                set_nodes(self._nest, nodes[ids.tolist()], words)

    def get(self, name: str, ids: Ints | None = None) -> Floats:
        """A state or parameter of every neuron, or of some."""
        if name in self.parameters:
            every = np.broadcast_to(self.parameters[name], self.part.size)
            return every.copy() if ids is None else every[ids]
        if self._share.number > 1:
            gathered = self._gathered(name)
            return gathered if ids is None else gathered[ids]
        if ids is None:
            in_turn = np.atleast_1d(np.array(self.nodes.get(name), dtype=np.float64))
            return in_turn[self.nodes_of.places(np.arange(self.part.size))]
        places = self.nodes_of.places(ids)
        order = np.argsort(places)  # NEST takes its nodes in ascending order only
        found: Floats = np.empty(places.size)
        found[order] = self.nodes[places[order].tolist()].get(name)
        return found

    def _gathered(self, name: str) -> Floats:
        """A state of the neurons of all processes."""
        number, first = self._share.number, self.nodes_of.first
        mine = (self._share.index - first) % number
        here = self.nodes[mine::number] if mine < self.part.size else ()
        told = here.get(["global_id", name]) if here else {"global_id": [], name: []}
        ids, values = (
            np.atleast_1d(told["global_id"]).astype(np.int64),
            np.atleast_1d(told[name]).astype(np.float64),
        )
        found: Floats = np.empty(self.part.size)
        found[self.nodes_of.neurons(self._share.gather(ids))] = self._share.gather(values)
        return found

    def set(self, values: Mapping[str, Floats]) -> None:
        """Change states and parameters, all or none."""
        old = {name: self.get(name) for name in values}
        parameters = self.parameters | {name: v.copy() for name, v in values.items() if name in self.parameters}
        try:
            self._tell(values)
        except Exception:
            self._tell(old)
            raise
        self.parameters.update(parameters)

    def _tell(self, values: Mapping[str, Floats]) -> None:
        if self.part.kind in ("poisson", "listed", "generator") or is_noise(self.part):
            return
        if "E_L" in values:
            beside = [n for n in _WITH_E_L if n not in values and (n in self.parameters or n == "V_m")]
            values = {n: self.get(n) for n in beside} | dict(values)
        words = {name: self._in_words_of_nest(name, each) for name, each in values.items() if name not in LACKING}
        own = {name: each for name, each in words.items() if len(each) > 1}
        shared = {name: each[0] for name, each in words.items() if name not in own}
        turn = self.nodes_of.in_turn(self.part.size) if own else ()
        neurons = [shared | {name: own[name][i] for name in own} for i in turn] or [shared]
        with nest_errors(f"population '{self.part.name}'"):
            set_nodes(self._nest, self.nodes, neurons)

    def _in_words_of_nest(self, name: str, values: Floats) -> list[Any]:
        if name == "refractory_input":
            return [bool(v) for v in values]
        if name == "tau_m":
            return [ENDLESS if np.isinf(v) else v for v in values.tolist()]
        if name == "t_ref":
            return [self._clock.ms(round(v / self._clock.resolution)) for v in values.tolist()]
        plain: list[Any] = values.tolist()
        return plain


SYNAPSES_AT_ONCE = 1 << 20


class NestRecord:
    """Spikes of one population, stretch by stretch, and its counts.

    Args:
        size: neurons.
        keeps: whether spikes are kept.

    Attributes:
        sent: step of each neuron's last spike that was sent; one of the latest step was not yet.
    """

    def __init__(self, size: int, keeps: bool) -> None:
        self.size, self.keeps = size, keeps
        self._stretches: list[InjectedTrain] = []
        self.events: Ints = np.zeros(size, dtype=np.int64)
        self.spikes: Ints = np.zeros(size, dtype=np.int64)
        self.sent: Ints = np.zeros(size, dtype=np.int64)
        self._waiting: tuple[Ints, int] = (NONE, 0)

    def add(self, spikes: InjectedTrain, to: int) -> None:
        """The spikes of a stretch that ends with step `to`."""
        ids, step = self._waiting
        self.sent[ids] = step
        gone = spikes.steps < to
        np.maximum.at(self.sent, spikes.ids[gone], spikes.steps[gone])
        self._waiting = (spikes.ids[~gone], to)
        self.events += np.bincount(spikes.ids, minlength=self.size)
        np.add.at(self.spikes, spikes.ids, spikes.multiplicity)
        if self.keeps and spikes.ids.size:
            self._stretches.append(spikes)

    def since(self, step: int) -> Spikes:
        """The spikes after a step."""
        late = [s for s in self._stretches if s.steps[-1] > step]
        steps, ids, multiplicity = (
            np.concatenate([np.zeros(0, dtype=np.int64), *(getattr(s, name) for s in late)])
            for name in ("steps", "ids", "multiplicity")
        )
        begin = int(np.searchsorted(steps, step, side="right"))
        return Spikes(steps[begin:], ids[begin:], multiplicity[begin:].astype(np.int64))

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        left = self.since(before)
        kept = InjectedTrain(left.steps, left.ids, left.multiplicity.astype(np.int64))
        self._stretches = [kept] if kept.ids.size else []

    @property
    def nbytes(self) -> int:
        """Memory of the spikes."""
        return sum(24 * len(s.steps) for s in self._stretches)


class Activity:
    """Counts the neuron-steps with an arrival or a spike, of the neurons of this process.

    Args:
        program: the whole network.
        wires: all projections that carry spikes.
    """

    def __init__(self, program: Program, wires: list[NestProjection]) -> None:
        self._wires, self._share = wires, program.share
        self._reach = max((w.part.delay_span[1] for w in wires if w.part.size), default=0)
        self._heard = [np.zeros((self._reach, p.size), dtype=bool) for p in program.populations]
        self.active: Ints = np.zeros(len(program.populations), dtype=np.int64)

    def add(self, trains: list[InjectedTrain], after: int, to: int) -> None:
        """The spikes of all populations in steps after < k <= to."""
        steps = to - after
        heard = [np.concatenate((h, np.zeros((steps, h.shape[1]), dtype=bool))) for h in self._heard]
        for wires in self._wires:
            spikes = trains[wires.part.source]
            at_once = max(1, SYNAPSES_AT_ONCE // wires.longest_row)
            for first in range(0, len(spikes.ids), at_once):
                synapses, number = wires.rows(spikes.ids[first : first + at_once])
                arrival = np.repeat(spikes.steps[first : first + at_once], number) + wires.delay[synapses]
                heard[wires.part.target][arrival - after - 1, wires.target[synapses]] = True
        for index, (spikes, here) in enumerate(zip(trains, heard, strict=True)):
            here[spikes.steps - after - 1, spikes.ids] = True
            first, end = self._share.of(here.shape[1])
            self.active[index] += np.count_nonzero(here[:steps, first:end])
            self._heard[index] = here[steps:]
