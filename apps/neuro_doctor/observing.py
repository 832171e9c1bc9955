"""A short run of a program and its record, whose size is limited for large networks."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from neuro.apps import are_finite, keyed_random, signals_of, unreadable
from neuro.extend import Engine, EngineCounts, Neuron, Population, Program, Stretch
from neuro_doctor.wiring import MOST_SYNAPSES, Floats, Ints

MOST_NEURONS = 100
"""Largest number of sampled neurons of a population: neurons whose potentials and single spikes are recorded."""
READS = 200
"""Number of readings of potentials and synapses in a run."""
BRIEF = 0.01
"""Share of the run below which a generator counts as brief, e.g. since its `stop` is in seconds instead of ms."""
UNEVEN = 3.0
"""Least ratio of variance to mean, of the spikes between readings, at which activity varies in time. The ratio of
independent neurons is at most 1."""
FEW = 0.5
"""Mean spikes per neuron above which a brief input is a volley that starts the network, so it is not reported."""
BIN_MS = 1.0
"""Width of the bins of spike counts, ms, at least one step; a volley through equal delays fits into one bin."""


@dataclass(slots=True, eq=False)
class PopulationRecord:
    """The record of a population.

    Attributes:
        spikes, events: number of spikes of each neuron; in `events` several spikes in one step count once.
        bins: number of spikes of the population in each bin of time.
        ids: the sampled neurons.
        steps, rows: step of each spike of the sampled neurons, and the index of its neuron in `ids`.
        potentials: V_m of the sampled neurons at each reading, (readings, neurons), mV; empty without V_m.
    """

    spikes: Ints
    events: Ints
    bins: Ints
    ids: Ints
    steps: Ints
    rows: Ints
    potentials: Floats


@dataclass(slots=True, eq=False)
class LearningRecord:
    """The record of a projection that learns.

    Attributes:
        first, last: weights of the synapses at the beginning and at the end of the run; delays, ms, if the rule learns
            delays.
        eligibility, modulator: largest magnitude over the synapses at each reading, (readings,); empty if the rule has
            no eligibility.
        product: largest magnitude of eligibility * modulator over the synapses at each reading.
    """

    first: Floats
    last: Floats
    eligibility: Floats
    modulator: Floats
    product: Floats


@dataclass(slots=True, eq=False)
class Observation:
    """The record of a run.

    Attributes:
        program: the program.
        steps, max_steps: completed steps, and requested steps.
        bin: steps per bin.
        populations: records of the populations.
        learning: records of the projections that learn, by index of the projection.
        idle: indices of generators without spikes of their own, which the user's code or a stream feeds.
        driven: the idle generators that were driven in this run.
        unstable: message about a state that became NaN or infinite; "" if all are finite.
        counts: counts of the engine.
        drive: rate of the driven generators, Hz.
        course: spikes of each population between two readings, (readings, populations).
        all_spikes: steps and neurons of all spikes, by population, for the populations in `keep` of `observe`; several
            spikes of a neuron in one step are listed once.
    """

    program: Program
    steps: int
    max_steps: int
    bin: int
    populations: list[PopulationRecord]
    learning: dict[int, LearningRecord]
    idle: set[int]
    driven: set[int]
    counts: EngineCounts
    drive: float
    course: Ints
    unstable: str = ""
    all_spikes: Mapping[int, tuple[Ints, Ints]] = field(default_factory=dict)

    @property
    def native(self) -> Mapping[str, int]:
        """Counts of the backend alone, such as overflows on a chip."""
        return self.counts.native

    @property
    def ms(self) -> float:
        """Duration of the run, ms."""
        return self.steps * self.program.resolution

    def rate(self, population: int) -> float:
        """Return the mean rate of a population's neurons, Hz."""
        spikes = self.populations[population].spikes
        return float(spikes.mean()) / self.ms * 1000.0 if self.steps else 0.0

    def varies(self, population: int) -> bool:
        """Return whether the activity of a population varies more in time than that of independent neurons."""
        course = self.course[:, population]
        return bool(course.var() > UNEVEN * course.mean())

    def is_brief(self, population: int) -> bool:
        """Return whether a Poisson generator is on so briefly that most of its neurons do not fire."""
        part = self.program.populations[population]
        starts = part.kind == "poisson" and part.start < min(part.stop, self.steps)
        short = starts and part.stop - part.start < BRIEF * self.steps
        return short and float(self.populations[population].spikes.mean()) < FEW

    def per_step(self) -> dict[int, float]:
        """Return the mean spikes per neuron and step of each population."""
        steps = max(self.steps, 1)
        return {k: float(record.spikes.mean()) / steps for k, record in enumerate(self.populations)}


def idle_inputs(program: Program) -> set[int]:
    """Return the indices of spike generators that emit no spikes unless the user's code feeds them."""
    return {k for k, part in enumerate(program.populations) if _is_idle(part)}


def _is_idle(part: Population) -> bool:
    if part.kind == "listed":
        # An iterator can be read once only; its events are left for the user's own run.
        return (part.stream is None or not part.stream.repeatable) and not part.spike_steps.size
    return part.kind == "poisson" and part.largest("rate") == 0.0


def observe(
    engine: Engine, program: Program, steps: int, drive: float, seconds: float, keep: Iterable[int] = ()
) -> Observation:
    """Run an engine and record its activity.

    Args:
        engine: engine of the program, at step 0.
        program: the program.
        steps: steps to run.
        drive: rate of Poisson spikes for idle inputs, Hz; 0 keeps them silent.
        seconds: wall-clock time after which the run ends early, s.
        keep: indices of populations of which all spikes are recorded.
    """
    watch = _Watch(engine, program, steps, drive, keep)
    chunk, start_time = max(1, steps // READS), None
    while watch.steps < steps and not watch.unstable:
        watch.advance(min(chunk, steps - watch.steps))
        start_time = start_time or time.perf_counter()  # the first chunk compiles kernels
        if time.perf_counter() - start_time > seconds:
            break
    return watch.observation()


class _Watch:
    """A recorder that feeds an engine with input and reads its activity, see `observe`."""

    def __init__(self, engine: Engine, program: Program, max_steps: int, drive: float, keep: Iterable[int]) -> None:
        self.engine, self.program, self.max_steps, self.drive = engine, program, max_steps, drive
        self.steps, self.unstable = 0, ""
        self.signals = signals_of(program, engine)
        self.bin = max(1, round(BIN_MS / program.resolution))
        self.idle = idle_inputs(program)
        self.driven = self.idle if drive > 0.0 else set[int]()
        self.bins = np.zeros((len(program.populations), max_steps // self.bin + 1), dtype=np.int64)
        self.ids = [_sample(part.size) for part in program.populations]
        self.rasters: list[list[tuple[Ints, Ints]]] = [[] for _ in program.populations]
        self.potentials: list[list[Floats]] = [[] for _ in program.populations]
        self.draws = keyed_random.generator(program.seed, "doctor", program.name)
        self.streams: dict[int, Iterator[Stretch]] = {
            k: part.stream.after(0)
            for k, part in enumerate(program.populations)
            if part.stream is not None and part.stream.repeatable
        }
        self.filled = dict.fromkeys(self.streams, 0)
        self.plastic = [
            q
            for q, part in enumerate(program.projections)
            if part.synapse.learns in ("pairs", "moves", "chip") and 0 < part.size <= MOST_SYNAPSES
        ]
        self.first = {q: self._learnt_values(q).copy() for q in self.plastic}
        self.traces: dict[int, list[tuple[float, float, float]]] = {
            q: [] for q in self.plastic if self._has_eligibility(q)
        }
        self.all_spikes: dict[int, list[tuple[Ints, Ints]]] = {k: [] for k in keep}
        self.totals: list[list[int]] = [[0] * len(program.populations)]
        self._drive_rates()

    def _learnt_values(self, projection: int) -> Floats:
        """Return the values that a rule changes: delays or weights."""
        word = "delay" if self.program.projections[projection].synapse.delays else "weight"
        return self.engine.get_synapses(projection, word)

    def _has_eligibility(self, projection: int) -> bool:
        part = self.program.projections[projection]
        return part.synapse.modulated and any(state.name == "c" for state in part.synapse.states)

    def _drive_rates(self) -> None:
        for k in self.driven:
            if self.program.populations[k].kind == "poisson":
                self.engine.set(k, {"rate": np.full(self.program.populations[k].size, self.drive)})

    def advance(self, steps: int) -> None:
        """Run some steps and take a reading."""
        self._feed(self.steps + steps)
        for stretch in [steps] if self.signals is None else self.signals.stretches(steps):
            self.engine.run(stretch)
        last_steps, self.steps = self.steps, self.steps + steps
        for k, part in enumerate(self.program.populations):
            if part.kind == "current":
                continue
            if part.records:
                self._record_spikes(k, last_steps)
            if part.kind == "neuron" and part.model.states and part.model.states[0].name == "V_m":
                self._read_potentials(k)
        for q, readings in self.traces.items():
            c, n = (np.abs(self.engine.get_synapses(q, word)) for word in ("c", "n"))
            readings.append((float(c.max()), float(n.max()), float((c * n).max())))
        self.engine.forget(self.steps)
        self.totals.append([int(spikes.sum()) for spikes in self.engine.counts().spikes])

    def _feed(self, end: int) -> None:
        for k, stream in self.streams.items():
            while self.filled[k] < end:
                stretch = next(stream, Stretch(2**62, *[np.zeros(0, dtype=np.int64)] * 2))
                if stretch.steps.size:
                    self.engine.inject(k, stretch.steps, stretch.ids)
                self.filled[k] = max(stretch.until, self.filled[k])
        for k in self.driven:
            part = self.program.populations[k]
            if part.kind == "listed":
                chance = min(self.drive * self.program.resolution / 1000.0, 1.0)
                steps, ids = np.nonzero(self.draws.random((end - self.steps, part.size)) < chance)
                if steps.size:
                    self.engine.inject(k, steps + self.steps + 1, ids)

    def _record_spikes(self, population: int, begin: int) -> None:
        spikes = self.engine.spikes(population, begin)
        counts = np.bincount((spikes.steps - 1) // self.bin, spikes.multiplicity, self.bins.shape[1])
        self.bins[population] += counts.astype(np.int64)[: self.bins.shape[1]]
        ids = self.ids[population]
        rows = np.searchsorted(ids, spikes.ids).clip(max=ids.size - 1)
        is_sampled = ids[rows] == spikes.ids
        if population in self.all_spikes:
            self.all_spikes[population].append((spikes.steps, spikes.ids))
        self.rasters[population].append((spikes.steps[is_sampled], rows[is_sampled]))

    def _read_potentials(self, population: int) -> None:
        part = self.program.populations[population]
        v = self.engine.get(population, "V_m", self.ids[population])
        self.potentials[population].append(v)
        unreadable_names = unreadable(self.engine)
        names = [state.name for state in part.model.states if not state.hidden and state.name not in unreadable_names]
        # Only every tenth reading checks all neurons, since that updates neurons which the engine would skip.
        check_all = len(self.potentials[population]) % 10 == 0 or self.steps >= self.max_steps
        if not np.isfinite(v).all() or (check_all and not self._is_finite(population, names)):
            self.unstable = f"a state of '{part.name}' was NaN or infinite after {self.steps:,} steps"

    def _is_finite(self, population: int, names: list[str]) -> bool:
        model = self.program.populations[population].model
        if isinstance(model, Neuron) and model.linear:
            return are_finite(self.engine, population, names)
        return all(bool(np.isfinite(self.engine.get(population, name)).all()) for name in names)

    def observation(self) -> Observation:
        """Return the record."""
        counts = self.engine.counts()
        populations = []
        for k in range(len(self.program.populations)):
            steps, rows = _concatenate(self.rasters[k])
            v = np.array(self.potentials[k]) if self.potentials[k] else np.zeros((0, 0))
            bins = self.bins[k][: max(1, self.steps // self.bin)]
            populations.append(PopulationRecord(counts.spikes[k], counts.events[k], bins, self.ids[k], steps, rows, v))
        learning = {}
        for q in self.plastic:
            traces = np.array(self.traces.get(q, [])).reshape(-1, 3).T
            learning[q] = LearningRecord(self.first[q], self._learnt_values(q), *traces)
            if not np.isfinite(learning[q].last).all() and not self.unstable:
                self.unstable = f"a weight of '{self.program.projections[q].name}' became NaN or infinite"
        all_spikes = {k: _concatenate(parts) for k, parts in self.all_spikes.items()}
        run, inputs = (self.program, self.steps, self.max_steps, self.bin), (self.idle, self.driven)
        course = np.diff(self.totals, axis=0)
        return Observation(*run, populations, learning, *inputs, counts, self.drive, course, self.unstable, all_spikes)


def _sample(size: int) -> Ints:
    ids: Ints = np.unique(np.linspace(0, size - 1, min(size, MOST_NEURONS)).astype(np.int64))
    return ids


def _concatenate(parts: list[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    if not parts:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.concatenate([steps for steps, _ in parts]), np.concatenate([rows for _, rows in parts])
