"""A short run of a program, and what is kept of it: little, however large the network is."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from neuro.apps import are_finite, keyed_random, signals_of, unreadable
from neuro.extend import Engine, EngineCounts, Neuron, Population, Program, Stretch
from neuro_doctor.wiring import MOST_SYNAPSES, Floats, Ints

MOST_NEURONS = 100
"""Of a population, whose potentials are read and whose spikes are kept one by one."""
READS = 200
"""Times at which potentials and synapses are read."""
BRIEF = 0.01
"""Share of the run below which a generator is on briefly: a `stop` in seconds is a thousandth."""
UNEVEN = 3.0
"""Variance over mean of the spikes between readings; independent neurons have at most 1, for long runs of readings."""
FEW = 0.5
"""Spikes of a neuron below which a brief input is no volley that starts a network."""
BIN_MS = 1.0
"""Length of the bins in which spikes are counted, at least a step: a volley along equal delays fits in one."""


@dataclass(slots=True, eq=False)
class Seen:
    """What was seen of a population.

    Attributes:
        spikes, events: of each neuron, with and without multiplicity.
        bins: spikes in each bin of time.
        ids: neurons of which more is kept.
        steps, rows: spikes of these: the step, and the place in `ids`.
        potentials: V_m of these at each reading, (times, neurons); empty without V_m.
    """

    spikes: Ints
    events: Ints
    bins: Ints
    ids: Ints
    steps: Ints
    rows: Ints
    potentials: Floats


@dataclass(slots=True, eq=False)
class Learnt:
    """What was seen of a projection that learns.

    Attributes:
        first, last: its weights at the beginning and at the end; its delays in ms if it learns these.
        eligibility, modulator: their largest magnitude at each reading; empty where the rule has none.
        together: the largest magnitude of their product at one synapse, likewise.
    """

    first: Floats
    last: Floats
    eligibility: Floats
    modulator: Floats
    together: Floats


@dataclass(slots=True, eq=False)
class Observation:
    """A run.

    Attributes:
        program: what ran.
        steps: how many ran, and `wanted`, how many should have.
        bin: steps of a bin.
        populations: by index.
        learning: by the index of the projection.
        idle: generators that emit nothing by themselves, as a program or a stream is to feed them.
        driven: which of these were driven for the run.
        unstable: a state that became NaN or infinite, in words; "" if none did.
        counts: of the engine.
        drive: the rate in Hz of those that were driven.
        course: spikes of each population between two readings, shape (readings, populations).
        kept: all spikes, each step of a neuron once, of the populations for which it was asked: steps and neurons.
    """

    program: Program
    steps: int
    wanted: int
    bin: int
    populations: list[Seen]
    learning: dict[int, Learnt]
    idle: set[int]
    driven: set[int]
    counts: EngineCounts
    drive: float
    course: Ints
    unstable: str = ""
    kept: Mapping[int, tuple[Ints, Ints]] = field(default_factory=dict)

    @property
    def native(self) -> Mapping[str, int]:
        """What only the backend counts, as a chip's overflows."""
        return self.counts.native

    @property
    def ms(self) -> float:
        """How long the run was."""
        return self.steps * self.program.resolution

    def rate(self, population: int) -> float:
        """The mean rate of a population's neurons in Hz."""
        spikes = self.populations[population].spikes
        return float(spikes.mean()) / self.ms * 1000.0 if self.steps else 0.0

    def varies(self, population: int) -> bool:
        """Whether the spikes of a population come more unevenly in time than those of independent neurons."""
        course = self.course[:, population]
        return bool(course.var() > UNEVEN * course.mean())

    def is_brief(self, population: int) -> bool:
        """Whether a Poisson generator is on for so short a time that most of its neurons do not fire."""
        part = self.program.populations[population]
        begins = part.kind == "poisson" and part.start < min(part.stop, self.steps)
        short = begins and part.stop - part.start < BRIEF * self.steps
        return short and float(self.populations[population].spikes.mean()) < FEW

    def per_step(self) -> dict[int, float]:
        """Spikes of a neuron in a step, the mean of each population."""
        steps = max(self.steps, 1)
        return {k: float(seen.spikes.mean()) / steps for k, seen in enumerate(self.populations)}


def idle_inputs(program: Program) -> set[int]:
    """Generators of spikes that emit none unless a program feeds them."""
    return {k for k, part in enumerate(program.populations) if _is_idle(part)}


def _is_idle(part: Population) -> bool:
    if part.kind == "listed":
        # Events of an iterator come once, and are not taken from whoever will run the network.
        return (part.stream is None or not part.stream.repeatable) and not part.spike_steps.size
    return part.kind == "poisson" and part.largest("rate") == 0.0


def observe(
    engine: Engine, program: Program, steps: int, drive: float, seconds: float, keep: Iterable[int] = ()
) -> Observation:
    """Run an engine from its present step and watch it.

    Args:
        engine: of the program, at step 0.
        program: the network.
        steps: how many to run.
        drive: the rate in Hz at which inputs that are idle are driven; 0: they stay idle.
        seconds: of the clock on the wall after which it ends early.
        keep: populations of which all spikes are kept.
    """
    watch = _Watch(engine, program, steps, drive, keep)
    chunk, began = max(1, steps // READS), None
    while watch.steps < steps and not watch.unstable:
        watch.advance(min(chunk, steps - watch.steps))
        began = began or time.perf_counter()  # the first chunk compiles kernels
        if time.perf_counter() - began > seconds:
            break
    return watch.found()


class _Watch:
    """Feeds an engine, and gathers what it does."""

    def __init__(self, engine: Engine, program: Program, wanted: int, drive: float, keep: Iterable[int]) -> None:
        self.engine, self.program, self.wanted, self.drive = engine, program, wanted, drive
        self.steps, self.unstable = 0, ""
        self.signals = signals_of(program, engine)
        self.bin = max(1, round(BIN_MS / program.resolution))
        self.idle = idle_inputs(program)
        self.driven = self.idle if drive > 0.0 else set[int]()
        self.bins = np.zeros((len(program.populations), wanted // self.bin + 1), dtype=np.int64)
        self.ids = [_some(part.size) for part in program.populations]
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
        self.first = {q: self._moving(q).copy() for q in self.plastic}
        self.traces: dict[int, list[tuple[float, float, float]]] = {q: [] for q in self.plastic if self._teaches(q)}
        self.kept: dict[int, list[tuple[Ints, Ints]]] = {k: [] for k in keep}
        self.totals: list[list[int]] = [[0] * len(program.populations)]
        self._drive_rates()

    def _moving(self, projection: int) -> Floats:
        """What a rule changes: delays or weights."""
        word = "delay" if self.program.projections[projection].synapse.delays else "weight"
        return self.engine.get_synapses(projection, word)

    def _teaches(self, projection: int) -> bool:
        part = self.program.projections[projection]
        return part.synapse.modulated and any(state.name == "c" for state in part.synapse.states)

    def _drive_rates(self) -> None:
        for k in self.driven:
            if self.program.populations[k].kind == "poisson":
                self.engine.set(k, {"rate": np.full(self.program.populations[k].size, self.drive)})

    def advance(self, steps: int) -> None:
        """Run some steps and look."""
        self._feed(self.steps + steps)
        for stretch in [steps] if self.signals is None else self.signals.stretches(steps):
            self.engine.run(stretch)
        before, self.steps = self.steps, self.steps + steps
        for k, part in enumerate(self.program.populations):
            if part.kind == "current":
                continue
            if part.records:
                self._gather(k, before)
            if part.kind == "neuron" and part.model.states and part.model.states[0].name == "V_m":
                self._read(k)
        for q, found in self.traces.items():
            c, n = (np.abs(self.engine.get_synapses(q, word)) for word in ("c", "n"))
            found.append((float(c.max()), float(n.max()), float((c * n).max())))
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

    def _gather(self, population: int, since: int) -> None:
        found = self.engine.spikes(population, since)
        counted = np.bincount((found.steps - 1) // self.bin, found.multiplicity, self.bins.shape[1])
        self.bins[population] += counted.astype(np.int64)[: self.bins.shape[1]]
        ids = self.ids[population]
        rows = np.searchsorted(ids, found.ids).clip(max=ids.size - 1)
        kept = ids[rows] == found.ids
        if population in self.kept:
            self.kept[population].append((found.steps, found.ids))
        self.rasters[population].append((found.steps[kept], rows[kept]))

    def _read(self, population: int) -> None:
        part = self.program.populations[population]
        v = self.engine.get(population, "V_m", self.ids[population])
        self.potentials[population].append(v)
        hidden = unreadable(self.engine)
        names = [state.name for state in part.model.states if not state.hidden and state.name not in hidden]
        # Every tenth reading, as it brings all neurons to the present.
        late = len(self.potentials[population]) % 10 == 0 or self.steps >= self.wanted
        if not np.isfinite(v).all() or (late and not self._is_finite(population, names)):
            self.unstable = f"a state of '{part.name}' was NaN or infinite after {self.steps:,} steps"

    def _is_finite(self, population: int, names: list[str]) -> bool:
        model = self.program.populations[population].model
        if isinstance(model, Neuron) and model.linear:
            return are_finite(self.engine, population, names)
        return all(bool(np.isfinite(self.engine.get(population, name)).all()) for name in names)

    def found(self) -> Observation:
        """All that was gathered."""
        counts = self.engine.counts()
        populations = []
        for k in range(len(self.program.populations)):
            steps, rows = _joined(self.rasters[k])
            v = np.array(self.potentials[k]) if self.potentials[k] else np.zeros((0, 0))
            bins = self.bins[k][: max(1, self.steps // self.bin)]
            populations.append(Seen(counts.spikes[k], counts.events[k], bins, self.ids[k], steps, rows, v))
        learning = {}
        for q in self.plastic:
            traces = np.array(self.traces.get(q, [])).reshape(-1, 3).T
            learning[q] = Learnt(self.first[q], self._moving(q), *traces)
            if not np.isfinite(learning[q].last).all() and not self.unstable:
                self.unstable = f"a weight of '{self.program.projections[q].name}' became NaN or infinite"
        kept = {k: _joined(parts) for k, parts in self.kept.items()}
        run, inputs = (self.program, self.steps, self.wanted, self.bin), (self.idle, self.driven)
        course = np.diff(self.totals, axis=0)
        return Observation(*run, populations, learning, *inputs, counts, self.drive, course, self.unstable, kept)


def _some(size: int) -> Ints:
    ids: Ints = np.unique(np.linspace(0, size - 1, min(size, MOST_NEURONS)).astype(np.int64))
    return ids


def _joined(parts: list[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    if not parts:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.concatenate([steps for steps, _ in parts]), np.concatenate([rows for _, rows in parts])
