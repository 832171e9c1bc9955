"""What was recorded, read in one way of a simulation that runs and of the results that one has left."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import in_ms
from neuro.core.values import shown
from neuro.files.finished_runs import FinishedRun
from neuro.model.parts import Part
from neuro.model.views import Shaped, View, named
from neuro.program.program import Floats, Ints, Program
from neuro.program.spikes import one_by_one

Window = tuple[float, float]
SMALL = 1_000_000
"""Static weights of more synapses, which follow from network and seed, are kept only where they are asked for."""
_SAME = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SpikeTrain:
    """Spikes of neurons of one population.

    Attributes:
        population: its name.
        neurons: whose spikes these are, ascending.
        times_ms, ids: one entry a spike, sorted by time.
        window: the spikes are those after its begin and up to its end, in ms.
    """

    population: str
    neurons: Ints
    times_ms: Floats
    ids: Ints
    window: Window

    @property
    def rate_hz(self) -> float:
        """The mean rate of a neuron; 0 of none, and of a window without length."""
        seconds = (self.window[1] - self.window[0]) / 1000.0
        return self.times_ms.size / (self.neurons.size * seconds) if self.neurons.size and seconds else 0.0


def intervals(times_ms: Floats, ids: Ints) -> tuple[Floats, Ints]:
    """The intervals between spikes of the same neuron in ms, and whose they are, by neuron, then time."""
    order = np.lexsort((times_ms, ids))
    times_ms, ids = times_ms[order], ids[order]
    same = ids[1:] == ids[:-1]
    return np.diff(times_ms)[same], ids[1:][same]


def variation(times_ms: Floats, ids: Ints) -> Floats:
    """The coefficient of variation of the intervals of each neuron that has two or more, by neuron.

    Standard deviation (of the intervals themselves, not of those they are drawn from) by mean; 1 of a Poisson process.
    Intervals that are all 0, of neurons that emit several spikes in one step and no others, have none.
    Source: Softky & Koch, J. Neurosci. 13:334, 1993
    """
    lengths, whose = intervals(times_ms, ids)
    _, whose, count = np.unique(whose, return_inverse=True, return_counts=True)
    mean = np.bincount(whose, lengths) / count
    square = np.bincount(whose, (lengths - mean[whose]) ** 2) / count
    defined = (count >= 2) & (mean > 0)
    return np.asarray(np.sqrt(square[defined]) / mean[defined])


@dataclass(frozen=True, slots=True, eq=False)
class StateTrace:
    """What a probe recorded of one state, in `unit`.

    Attributes:
        of: the population or projection.
        noun: what a column is of, "neuron" or "synapse"; "" of a rate or a mean, which has one.
        columns: their numbers: of neurons in the population, of synapses among those that are recorded.
        values: shape (times, columns); of synapses at pre spikes (times,), one entry for each spike and synapse.
        pre, post: the ends of each column, at pre spikes of each entry; None of neurons, means and grids.
    """

    of: str
    state: str
    unit: str
    noun: str
    columns: Ints
    times_ms: Floats
    values: NDArray[Any]
    pre: Ints | None = None
    post: Ints | None = None

    @property
    def at_pre_spikes(self) -> bool:
        """Whether it has what pre spikes leave, at their times."""
        return self.values.ndim == 1

    def within(self, window: Window) -> StateTrace:
        """What was recorded in a window, its begin and end included."""
        inside = slice(int(np.searchsorted(self.times_ms, window[0])), up_to(self.times_ms, window[1]))
        pre, post = self.pre, self.post
        if pre is not None and post is not None and self.at_pre_spikes:
            pre, post = pre[inside], post[inside]
        return replace(self, times_ms=self.times_ms[inside], values=self.values[inside], pre=pre, post=post)


@dataclass(frozen=True, slots=True, eq=False)
class SynapseWeights:
    """Weights of one projection: `pre` and `post` of each, None of a grid, whose weights are its kernels."""

    shape: tuple[int, int]
    pre: Ints | None
    post: Ints | None
    weight: Floats


class Recorded(Protocol):
    """What a simulation and results have in common."""

    network: str
    seed: int
    backend: str
    duration_ms: float
    resolution_ms: float
    shapes: dict[str, tuple[int, ...]]
    kept: list[str]
    held_ms: float
    """What was recorded up to then is not held any more."""
    weighed: list[str]

    @property
    def probes(self) -> Mapping[str, str]:
        """The probe of each trace, by the name of the trace."""

    def spikes(self, population: str, since: float) -> tuple[Floats, Ints]:
        """Times in ms after `since`, and neurons, sorted by time."""

    def trace(self, name: str) -> StateTrace:
        """What a probe recorded of one state."""

    def weights(self, projection: str) -> SynapseWeights:
        """Weights of a projection."""


class RunningSimulation(Protocol):
    """What is asked of a simulation."""

    backend: str
    program: Program

    @property
    def time(self) -> float:
        """The present in ms."""

    @property
    def held(self) -> float:
        """The time in ms after which spikes and traces are held."""

    def spikes(self, name: str, since: float | None = None) -> tuple[Floats, Ints]:
        """Recorded spikes."""

    @property
    def traces(self) -> Mapping[str, Any]:
        """States by the name of their trace."""

    def weights(self, name: str) -> Any:
        """Weights of a projection."""


def recorded(run: object) -> Recorded:
    """What was recorded.

    Args:
        run: a `neuro.Simulation`, or results.

    Raises:
        ModelError: it is neither.
    """
    if hasattr(run, "program") and hasattr(run, "spikes"):
        return _OfSimulation(run)  # type: ignore[arg-type]
    if hasattr(run, "traces") and hasattr(run, "populations"):
        return _OfResults(run)  # type: ignore[arg-type]
    hint = "neuro.compile(net) gives a simulation" if hasattr(run, "populations") else ""
    raise ModelError(f"found {shown(run)}: expected a simulation, or results of a run", hint=hint)


class _OfSimulation:
    def __init__(self, run: RunningSimulation) -> None:
        self._run, self._program = run, run.program
        self.network, self.backend, self.seed = run.program.name, run.backend, run.program.seed
        self.duration_ms, self.resolution_ms = run.time, run.program.resolution
        self.shapes = {part.name: part.shape for part in run.program.populations}
        self.kept = [part.name for part in run.program.populations if part.records]
        self.held_ms = run.held
        self.weighed = [part.name for part in run.program.projections if part.synapse.learns or part.size <= SMALL]

    @cached_property
    def _traces(self) -> Mapping[str, Any]:
        """All of them; a simulation copies what it has recorded."""
        return self._run.traces

    @property
    def probes(self) -> Mapping[str, str]:
        return _probes(self._traces)

    def spikes(self, population: str, since: float) -> tuple[Floats, Ints]:
        return self._run.spikes(population, since=since)

    def trace(self, name: str) -> StateTrace:
        return _trace(self._traces[name])

    def weights(self, projection: str) -> SynapseWeights:
        part = next((each for each in self._program.projections if each.name == projection), None)
        if part is None:
            raise unknown("projection", projection, [each.name for each in self._program.projections])
        shape = (self._program.populations[part.source].size, self._program.populations[part.target].size)
        found = self._run.weights(projection)
        return SynapseWeights(shape, *found) if part.grid is None else SynapseWeights(shape, None, None, found)


class _OfResults:
    def __init__(self, run: FinishedRun) -> None:
        self._run = run
        self.network, self.duration_ms = str(run.about["network"]), float(run.about["duration_ms"])
        self.backend, self.seed = str(run.about.get("backend", "")), int(run.about.get("seed", 0))
        self.resolution_ms = float(run.about["resolution_ms"])
        self.shapes = {name: tuple(part.shape) for name, part in run.populations.items()}
        self.kept = [name for name, part in run.populations.items() if part.recorded]
        self.probes = _probes(run.traces)
        self.held_ms = 0.0
        self.weighed = [name for name, part in run.projections.items() if part.weight is not None]

    def spikes(self, population: str, since: float) -> tuple[Floats, Ints]:
        if population not in self.kept:
            hint = f"'neuro run --record {population}' keeps them"
            raise ModelError(f"spikes of '{population}' were not kept", hint=hint)
        part = self._run.populations[population]
        times = part.times_ms
        first = up_to(times, since) if since > 0 else 0
        found = one_by_one(population, part.multiplicity[first:], times[first:], part.ids[first:])
        return found[0], found[1]

    def trace(self, name: str) -> StateTrace:
        return _trace(self._run.traces[name])

    def weights(self, projection: str) -> SynapseWeights:
        if projection not in self._run.projections:
            raise unknown("projection", projection, self._run.projections)
        part = self._run.projections[projection]
        if part.weight is None:
            raise ModelError(f"weights of '{projection}' were not kept", hint="'neuro run --all-weights' keeps them")
        sizes = [math.prod(self.shapes[name]) for name in (part.source, part.target)]
        return SynapseWeights((sizes[0], sizes[1]), part.pre, part.post, part.weight)


def _probes(traces: Mapping[str, Any]) -> dict[str, str]:
    return {name: trace.probe or name for name, trace in traces.items()}


def _trace(part: Any) -> StateTrace:
    """A trace of `neuro.files.results`."""
    noun = "" if part.single else "synapse" if part.projection else "neuron"
    columns = part.ids if part.ids is not None else np.arange(0 if part.at_pre_spikes else part.columns)
    values = part.values[:, None] if part.single else part.values
    words = (part.state, part.unit, noun, columns, part.times_ms, values)
    return StateTrace(part.projection or part.population, *words, part.pre, part.post)


def trains(run: Recorded, of: Any = None, window: Any = None) -> list[SpikeTrain]:
    """Spikes of populations or of some of their neurons.

    Args:
        run: what was recorded.
        of: a population or a view of one, its name, or a list of these; all that was recorded if not given.
        window: begin and end in ms; the whole run if not given.

    Raises:
        ModelError: there is no such population, nothing was recorded, or the window is none.
    """
    begin, end = checked_window(run, window)
    if of is None and not run.kept:
        raise ModelError("no spikes were recorded", hint="net.probe or 'neuro run --record NAME' keeps them")
    asked = run.kept if of is None else [of] if _is_one(of) else list(of)
    if not asked:
        raise ModelError(f"of = {shown(of)}: expected a population, a view of one, a name, or a list of these")
    found = []
    for each in asked:
        name, neurons = _named(run, each)
        times, ids = run.spikes(name, begin)
        last = up_to(times, end)
        times, ids = times[:last], ids[:last]
        if neurons is None:
            neurons = np.arange(math.prod(run.shapes[name]))
        else:
            mine = np.isin(ids, neurons)
            times, ids = times[mine], ids[mine]
        found.append(SpikeTrain(name, np.sort(neurons), times, ids, (begin, end)))
    return found


def checked_window(run: Recorded, window: Any) -> Window:
    """Begin and end in ms of what is looked at: all that is held of the run if not given.

    Raises:
        ModelError: these are not two times, one before the other, what came then is not held any more, or the run ends
            before.
    """
    if window is None:
        return run.held_ms, run.duration_ms
    given = tuple(window) if isinstance(window, (tuple, list, np.ndarray)) else ()
    pair = [in_ms(ms, "window") for ms in given]
    if len(pair) != 2 or not all(is_number(ms) and math.isfinite(ms) for ms in pair) or not 0 <= pair[0] < pair[1]:
        raise ModelError(f"window = {shown(window)}: expected (begin, end) in ms with 0 <= begin < end")
    if pair[0] < run.held_ms:
        message = f"window = {shown(window)}: what was recorded up to {run.held_ms:g} ms is not held any more"
        raise ModelError(f"{message}: expected a begin >= {run.held_ms:g} ms")
    if pair[1] > run.duration_ms * (1.0 + _SAME):
        last = f"{run.duration_ms:.12g} ms"
        raise ModelError(f"window = {shown(window)}: the run ends at {last}: expected an end <= {last}")
    return float(pair[0]), float(pair[1])


def up_to(times_ms: Floats, ms: float) -> int:
    """How many times are not after one; what differs in the last digits only is the same."""
    return int(np.searchsorted(times_ms, ms * (1.0 + _SAME), side="right"))


def _is_one(of: Any) -> bool:
    return isinstance(of, (str, Part, View, Mapping)) or not isinstance(of, Iterable)


def _named(run: Recorded, of: Any) -> tuple[str, Ints | None]:
    """The name of a population, and the neurons of a view of it."""
    of = named(of, {name: Shaped(name, shape) for name, shape in run.shapes.items()})
    part = of.population if isinstance(of, View) else of
    name = getattr(part, "name", part)
    if not isinstance(name, str) or name not in run.shapes:
        raise unknown("population", name, run.shapes)
    return name, of.within(run.shapes[name])[0] if isinstance(of, View) else None
