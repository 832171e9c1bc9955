"""The class that users hold: it translates names and milliseconds, checks, records and reports."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from neuro.compiler import compile_network
from neuro.core.checks import check, check_span, is_number
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError, unknown
from neuro.core.paths import file_path
from neuro.core.progress import Bar
from neuro.core.quantities import Quantity, word_of
from neuro.core.tables import Table, as_html, as_text
from neuro.core.values import shown
from neuro.files.run_tables import projection_table, run_table
from neuro.files.state import Identity, fingerprint, read_state, write_state
from neuro.model.network import Network
from neuro.model.neurons import Generator, Neuron
from neuro.model.parts import Population, Probe, Projection, Signal
from neuro.model.views import View
from neuro.program.backend import Backend, Engine, Problem, Registers, find_backend, unreadable
from neuro.program.counts import Counts, Tally
from neuro.program.program import Floats, Ints, Program
from neuro.run import settable
from neuro.run.finite import Watch
from neuro.run.handles import Handles, Neurons
from neuro.run.inflow import Inflow
from neuro.run.learned_network import learnt_network
from neuro.run.ports import Port, Ports
from neuro.run.progress import advance
from neuro.run.recorder import Recorder
from neuro.run.synapses import Synapses
from neuro.run.trials import TrialCounts, TrialLoop, TrialResults

if TYPE_CHECKING:
    import neo
    from matplotlib.figure import Figure

    from neuro.chips.pricing.energy import Energy
    from neuro.files.frames import Frames
    from neuro.files.results import Results, Trace
    from neuro.run.recording import Recording

_THREADS = Quantity(kind="integer", at_least=1, at_most=max(64, os.cpu_count() or 1))
_FLAG = Quantity(kind="boolean")


class ModelWarning(UserWarning):
    """A network runs, but its parameters are likely not meant so."""


class ApproximationWarning(UserWarning):
    """A backend runs a network, but not exactly as described."""


def compile(
    net: Network, backend: str | PathLike[str] | Backend = "event", seed: int = 0, threads: int = 1, **options: Any
) -> Simulation:
    """Make a network ready to run.

    Args:
        net: the network.
        backend: the name of an installed backend, the table file of a chip, or the backend itself.
        seed: of everything random; the same seed gives the same run on every float backend.
        threads: cores to use; results do not depend on it.
        options: of the backend.

    Raises:
        ModelError: the network cannot be run as described; all that the backend refuses is listed.
    """
    if not isinstance(net, Network):
        raise ModelError(f"neuro.compile: found {net!r}: expected a Network", hint="neuro.load reads one from YAML")
    threads = check(_THREADS, threads, "threads")
    if not is_number(seed) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**63:
        most = " and < 2^63" if isinstance(seed, int) and seed >= 2**63 else ""
        raise ModelError(f"seed = {shown(seed)}: expected a whole number >= 0{most}")
    chosen = _backend(backend)
    try:
        program = compile_network(net, int(seed))
        _caution(program)
        _report(chosen.name, chosen.problems(program, **options))
        return Simulation(net, chosen.name, program, chosen.build(program, threads=threads, **options))
    except MemoryError as error:
        raise ModelError(f"network '{net.name}' needs more memory than there is: {error}") from None


def _backend(given: str | PathLike[str] | Backend) -> Backend:
    if isinstance(given, (str, PathLike)):
        return find_backend(given)
    if isinstance(given, type) or not all(hasattr(given, word) for word in ("name", "problems", "build")):
        raise ModelError(f"backend = {shown(given)}: expected the name of a backend, or a backend itself")
    return given


def _caution(program: Program) -> None:
    """Warn of parameters that are likely not meant so."""
    for part in program.populations:
        if isinstance(part.model, Neuron) and (told := part.model.caution(part.parameters, program.resolution)):
            place = f"{part.origin}: " if part.origin else ""
            warnings.warn(f"{place}population '{part.name}': {part.model.name}: {told}", ModelWarning, stacklevel=3)


def _report(backend: str, problems: Iterable[Problem]) -> None:
    """Raise one error for all that is refused; warn of what is approximated."""
    told = {True: [], False: []}  # type: dict[bool, list[str]]
    for problem in problems:
        place = f"{problem.origin}: " if problem.origin else ""
        way_out = f"\n  hint: {problem.way_out}" if problem.way_out else ""
        told[problem.refused].append(f"{place}{problem.what}: {problem.why}{way_out}")
    if told[True]:
        count = f"{len(told[True])} problem" + "s" * (len(told[True]) > 1)
        raise ModelError(f"backend '{backend}' cannot run this network ({count})\n" + "\n".join(told[True]))
    for text in told[False]:
        warnings.warn(f"backend '{backend}': {text}", ApproximationWarning, stacklevel=3)


class Simulation:
    """A network in execution; made by `neuro.compile`.

    Times are in ms, neurons are counted from 0 in C order of their population's shape, values are in the units
    of their models. A part is named by its name, or by what `net.population`, `net.connect` and others returned; where
    neurons are asked for, also by a view such as `exc[:100]`. Values of a view are in its order; ids are always those
    of the population.

    Attributes:
        backend: the name of the backend.
        program: the resolved network.
        handles: finds its parts by what names them.
    """

    def __init__(self, net: Network, backend: str, program: Any, engine: Engine) -> None:
        self.backend, self.program = backend, program
        self._net, self._engine = net, engine
        self._clock = Clock(program.resolution)
        self.handles = Handles(net, program)
        self._rules = {index: part.synapse for index, part in enumerate(program.projections)}
        self._synapses = Synapses(program, engine, self._clock, self._rules)
        self._recorder = Recorder(program, engine)
        self._recording: Recording | None = None
        self._left: tuple[int, Path] | None = None
        self._tally = Tally(program)
        self._inflow = Inflow(program, engine)
        self._watch = Watch(program, engine, self._clock)
        self._ports = Ports(program, engine, self._clock, self.handles)

    def __repr__(self) -> str:
        return f"Simulation({self.program.name!r}, backend={self.backend!r}, time={self.time:g} ms)"

    def __str__(self) -> str:
        return as_text(repr(self), self._tables())

    def _repr_html_(self) -> str:
        return as_html(repr(self), self._tables())

    def _tables(self) -> list[Table]:
        """A row for each population and projection."""
        populations, counts = self.program.populations, self.counts().populations
        return [
            run_table(self.time, ((p.name, p.model.name, p.size, counts[p.name].spikes) for p in populations)),
            projection_table(
                (p.name, populations[p.source].name, populations[p.target].name, p.synapse.name, p.size)
                for p in self.program.projections
            ),
        ]

    # time

    @property
    def time(self) -> float:
        """The end of the last finished step in ms."""
        return self._clock.ms(self._engine.step)

    def run(self, ms: float, progress: bool = False, out: str | PathLike[str] | None = None) -> None:
        """Advance by a multiple of the resolution; running in parts gives the same bits.

        Args:
            ms: how long.
            progress: whether to tell on stderr how far it is: by a bar on a terminal, elsewhere a line every 10 s.
            out: a file to which what is recorded goes, as of `record_to`.

        Raises:
            ModelError: the time is no such multiple, a recording that is played is damaged, before which the run
                stops, or a state is no number at the end: a numerical instability.
        """
        steps = self._clock.step(ms, "run")
        if not 0 <= steps < NEVER:
            raise ModelError(f"run = {ms:g} ms: expected a finite time >= 0 ms")
        if out is not None:
            with self.record_to(out):
                self.run(ms, progress)
            return
        if progress is not False and check(_FLAG, progress, "run: progress"):
            with Bar() as bar:
                advance(self, steps, bar)
            return
        recorded = self._recorder if self._recording is None else self._recording
        for stretch in self._inflow.stretches(steps):
            recorded.run(stretch)
        self._watch.look()

    @contextmanager
    def record_to(
        self,
        path: str | PathLike[str],
        *,
        threads: int = 1,
        record: Collection[str] = (),
        all_weights: bool = False,
    ) -> Iterator[None]:
        """Write what is recorded to a file of results while the network runs, and keep none of it in memory.

        What memory holds of the time before goes there, too. `spikes` and `trace` read it from the file until the
        network runs on after the block, and then have what came since; `neuro.results.read` reads it at any time. The
        file is called PATH.part until the block ends well. If it does not, or the process is killed, that has all but
        the last two seconds (of the clock on the wall).

        Args:
            path: of the file.
            threads: that the network runs on, to be written there.
            record: names of the populations whose spikes to keep; all that are recorded if empty.
            all_weights: keep also the weights of static projections above a million synapses, which follow from
                network and seed.

        Raises:
            ModelError: the file cannot be written, now or later, or the simulation records to a file already.
        """
        from neuro.run.recording import Recording

        self._refuse_while_recording("record_to")
        parts = (self, self._net, self._engine, self._recorder)
        self._recording = Recording(*parts, path, threads=threads, record=record, all_weights=all_weights)
        try:
            yield
            self._recording.finish()
            self._left = self._engine.step, self._recording.path
        finally:
            recording, self._recording = self._recording, None
            recording.close()

    def reset(self, weights: bool = False) -> None:
        """Back to time 0 and the initial states; weights only if asked. Parameters that were set stay."""
        self._refuse_while_recording("reset")
        weights = check(_FLAG, weights, "reset: weights")
        self._inflow.check_again("reset")
        self._engine.reset(weights)
        self._inflow.rewind()
        self._recorder.clear()
        self._left = None
        self._ports.begin()
        if self.program.trials is not None:
            self._trials.start_anew()

    # parameters, states and weights

    def set(
        self,
        of: Population | View | Projection | str,
        *,
        pre: Population | View | None = None,
        post: Population | View | None = None,
        **values: Any,
    ) -> None:
        """Change parameters or states of neurons, or weights or parameters of the synapse model of a projection.

        The change acts from the next step on.

        Args:
            of: the population, a view, or the projection.
            pre: of a projection only the synapses from these neurons, whose `weight` can be changed, or parameters of
                which each synapse has its own.
            post: likewise those onto these neurons.
            values: by name, one for all neurons or one for each (also a distribution, of which a neuron draws the same
                value in whatever view); `weight` stands alone, one for all synapses or one for each in the order of
                `weights`; so may parameters of a synapse model be that have a value for each synapse.

        Raises:
            ModelError: a name is unknown or a value is out of bounds.
        """
        named = {word_of(word): value for word, value in values.items()}
        neurons = self.handles.neurons_or_projection(of)
        if isinstance(neurons, int):
            self._set_projection(neurons, named, *self._chosen(pre, post))
            return
        _refuse_ends(neurons, pre, post)
        new = {
            word: settable.new_values(neurons, word, value, self._engine, self.program.seed)
            for word, value in named.items()
        }
        settable.check_together(self.program, neurons.index, new, self._engine, self._clock)
        self._engine.set(neurons.index, new)

    def _chosen(
        self, pre: Population | View | None, post: Population | View | None
    ) -> tuple[Neurons | None, Neurons | None]:
        found = [None if end is None else self.handles.neurons(end) for end in (pre, post)]
        return found[0], found[1]

    def _set_projection(self, index: int, values: dict[str, Any], pre: Neurons | None, post: Neurons | None) -> None:
        part, chosen = self.program.projections[index], self._synapses.chosen(index, pre, post)
        if [*values] == ["weight"]:
            new = self._synapses.new_weights(index, self._rules[index], values["weight"], chosen)
            self._engine.set_weights(index, new, chosen)
            return
        quantities = part.synapse.quantities()
        shared = [word for word in values if word != "weight" and not (word in quantities and quantities[word].arrays)]
        if "weight" in values or (shared and (pre or post)):
            word = next((word for word in [*shared, *values] if word != "weight"), "")
            alone = "is one for all synapses" if word in shared else "is set without weights"
            told = f"{part.synapse.name}.{word} of '{part.name}' {alone}"
            raise ModelError(f"{told}: expected 'weight' alone" + " with pre or post" * bool(pre or post))
        rule = settable.new_rule(part, self._rules[index], values, chosen)
        settable.check_rule(part, rule, self._engine.get_synapses(index, "weight"))
        self._engine.set_rule(index, rule.vector())
        self._rules[index] = rule

    def get(
        self,
        of: Population | View | Projection | str,
        what: str,
        raw: bool = False,
        *,
        pre: Population | View | None = None,
        post: Population | View | None = None,
    ) -> Any:
        """A state or parameter of neurons, or a state of synapses, in physical units; one value each, in a row.

        Args:
            of: the population, a view, or the projection.
            what: a state or parameter of a population's model; of a projection "weight", "delay" in ms, a parameter or
                a state of its synapses, where "K_plus" is the trace of each synapse's source and "n" the dopamine of
                its target.
            raw: read a chip's registers instead.
            pre: of a projection only the synapses from these neurons; `weights` says which they are.
            post: likewise those onto these neurons.
        """
        registers = self._registers() if check(_FLAG, raw, "raw") else None
        neurons = self.handles.neurons_or_projection(of)
        if isinstance(neurons, int):
            values = registers.synapse_registers(neurons, what) if registers else self._synapses.read(neurons, what)
            chosen = self._synapses.chosen(neurons, *self._chosen(pre, post))
            return values if chosen is None else values[chosen]
        _refuse_ends(neurons, pre, post)
        if registers is not None:
            every = registers.registers(neurons.index, word_of(what))
            return every if neurons.ids is None else every[neurons.ids]
        part = neurons.part
        word = word_of(what) if isinstance(what, str) else ""
        if word not in part.parameters and word not in settable.states(part):
            known = [*settable.states(part), *part.parameters]
            raise unknown("parameter or state", what, known).at(None, f"population '{part.name}'")
        return self._engine.get(neurons.index, word, neurons.ids)

    def states(self, of: Population | View | str) -> list[str]:
        """The states of a population's neurons that this backend shows, in the order of its model."""
        hidden = unreadable(self._engine)
        return [word for word in settable.states(self.handles.neurons(of).part) if word not in hidden]

    def _registers(self) -> Registers:
        if not isinstance(self._engine, Registers):
            raise ModelError(f"raw = True: expected False, as backend '{self.backend}' has no registers")
        return self._engine

    def weights(
        self,
        of: Projection | str,
        *,
        pre: Population | View | None = None,
        post: Population | View | None = None,
        delays: bool = False,
    ) -> Any:
        """The weights of a projection.

        Args:
            of: the projection.
            pre: only of the synapses from these neurons.
            post: only of the synapses onto these neurons.
            delays: whether to give the delays in ms, too.

        Returns:
            (pre, post, weight), one entry a synapse, sorted by pre, then post, and with `delays` a fourth row; of a
            grid its kernels, shape (maps, channels, height, width), with `delays` (kernels, delay). The weights are
            those stored, as in NEST: that of `stdp` changes when a pre spike is sent.

        Raises:
            ModelError: there is no such projection, or a weight is no number: a numerical instability of its rule.
        """
        index = self.handles.projection(of)
        chosen = self._synapses.chosen(index, *self._chosen(pre, post))
        grid, weight = self.program.projections[index].grid, self._synapses.weights(index)
        late = (self._synapses.read(index, "delay"),) if check(_FLAG, delays, "delays") else ()
        if grid is not None:
            return (weight.reshape(grid.kernels), float(late[0][0])) if late else weight.reshape(grid.kernels)
        rows = (*self._synapses.ends(index), weight, *late)
        return rows if chosen is None else tuple(row[chosen] for row in rows)

    def set_weights(self, of: Projection | str, weights: ArrayLike) -> None:
        """Replace the weights of a projection: one for all, or an array in the form that `weights` gives."""
        index = self.handles.projection(of)
        self._engine.set_weights(index, self._synapses.new_weights(index, self._rules[index], weights, None))

    def _check_weights(self) -> None:
        for index, part in enumerate(self.program.projections):
            if part.synapse.learns:
                self._synapses.weights(index)

    # input and output

    def inject(self, of: Population | View | str, times: ArrayLike, ids: ArrayLike | None = None) -> None:
        """Add spikes to a spike_generator.

        Args:
            of: the population, or a view of it.
            times: in ms, on the grid of steps and later than `time`.
            ids: its neurons, one for each time; of a view these are ids of the population, too, and must be among
                those of the view. If not given, each neuron emits at all times.
        """
        neurons = self.handles.neurons(of)
        part = neurons.part
        if part.kind != "listed" or part.stream is not None:
            raise ModelError(f"inject: '{part.name}' is a {part.model.name}: expected a spike_generator")
        steps, emit = settable.new_spikes(self._clock, times, ids, neurons)
        if steps.size and steps.min() <= self._engine.step:
            early = self._clock.ms(int(steps.min()))
            raise ModelError(f"inject: a spike at {early:g} ms: expected times after {self.time:g} ms, the present")
        self._engine.inject(neurons.index, steps, emit)

    def feed(self, of: Population | str, events: Any) -> None:
        """Let an event camera emit more events than those of its recording, while it runs.

        Args:
            of: the population, an `event_camera`.
            events: Events, a structured array with t, x, y and p, or an iterable of such, in the order of time. Their
                times count as those of the recording do; without one from `origin`, or from 0.

        Raises:
            ModelError: they are of another sensor, or one comes too late: its step is not after the present.
        """
        neurons = self.handles.neurons(of)
        index, part = neurons.index, neurons.part
        if neurons.view is not None:
            raise ModelError(f"feed: found the view {neurons.view}: expected the whole event_camera")
        if part.stream is None:
            raise ModelError(f"feed: '{part.name}' is a {part.model.name}: expected an event_camera")
        try:
            steps, ids = part.stream.given(events)
        except ModelError as error:
            raise error.at(None, f"feed: '{part.name}'") from None
        if steps.size and steps.min() <= self._engine.step:
            late = self._clock.ms(int(steps.min()))
            told = f"feed: an event of '{part.name}' in the step that ends at {late:g} ms"
            raise ModelError(f"{told}: expected later than {self.time:g} ms, the present")
        self._engine.inject(index, steps, ids)

    def signal(self, of: Signal | str, values: ArrayLike) -> None:
        """Set a signal: one value for all neurons of its population or one for each; acts from the next step on."""
        index = self.handles.signal(of)
        part = self.program.signals[index]
        size = self.program.populations[part.target].size
        self._engine.signal(index, settable.signal_values(part.name, values, size))

    def spikes(
        self, of: Population | View | str, since: float | None = None, until: float | None = None
    ) -> tuple[Floats, Ints]:
        """Recorded spikes of a population or of some of its neurons.

        Args:
            of: the population, or a view of it.
            since: only those after this time in ms.
            until: only those up to this time in ms, so that `until` of one call is `since` of the next.

        Returns:
            times in ms and neurons, sorted by time, then neuron; several spikes of one neuron in one step are
            listed as often. Neurons are ids of the population, also of a view.
        """
        return self._spikes(self.handles.neurons(of), since, until)

    def _spikes(self, of: Neurons, since: float | None, until: float | None) -> tuple[Floats, Ints]:
        part = of.part
        if not part.records:
            hint = f"net.probe('name', '{part.name}') records them" if isinstance(part.model, Generator) else ""
            raise ModelError(f"spikes of '{part.name}', a {part.model.name}, are not recorded", hint=hint)
        if (results := self._file()) is not None:
            return results.spikes_of(part.name, of.ids, since, until)
        after = -1 if since is None else self._clock.floor(since, "since")
        to = NEVER if until is None else self._clock.floor(until, "until")
        check_span(after, to, since, until)
        found = self._engine.spikes(of.index, after)
        end = None if until is None else np.searchsorted(found.steps, to, side="right")
        steps, ids, multiplicity = found.steps[:end], found.ids[:end], found.multiplicity[:end]
        if of.ids is not None:
            kept = of.among()[ids]
            steps, ids, multiplicity = steps[kept], ids[kept], multiplicity[kept]
        if multiplicity.size and multiplicity.max() > 1:
            steps, ids = np.repeat(steps, multiplicity), np.repeat(ids, multiplicity)
        return self._clock.array_ms(steps), ids

    def trace(self, of: Probe | str) -> tuple[Floats, Any]:
        """What a probe has recorded.

        Returns:
            times in ms, shape (times,), and values, shape (times, neurons or synapses), one column of a rate or a mean;
            of a list of states the values by state. Of a spike probe the neurons, one for each time. At pre spikes one
            entry for each synapse and spike, by time, then synapse: `pre`, `post` and the state, by name. Columns of a
            view or of chosen synapses are in their order.
        """
        probe = self.handles.probe(of)
        traces = {state: self._trace(name) for state, name in probe.traces().items()}
        times, values = next(iter(traces.values()))
        if isinstance(probe.record, str):
            return times, values
        by_name: dict[str, Any] = {}
        for state, (_, found) in traces.items():
            by_name |= found if isinstance(found, dict) else {state: found}
        return times, by_name

    def _trace(self, name: str) -> tuple[Floats, Any]:
        """What was recorded of one state, or the spikes."""
        if name in (*self._recorder.series, *self._recorder.pre_spikes) and (results := self._file()) is not None:
            return results.trace(name)
        if name in self._recorder.series:
            steps, values = self._recorder.series[name].read()
            return self._clock.array_ms(steps), values
        if name in self._recorder.pre_spikes:
            recorded = self._recorder.pre_spikes[name]
            sent, (pre, post) = recorded.read(), self._synapses.ends(recorded.probe.projection)
            ends = {"pre": pre[sent.synapses], "post": post[sent.synapses]}
            return self._clock.array_ms(sent.steps), {**ends, recorded.probe.record: sent.values}
        return self._spikes(self.handles.recorded(self.handles.recording(name)), None, None)

    def _file(self) -> Results | None:
        """What was recorded, where that is in a file: while it is written, and after that until the network runs on."""
        if self._recording is not None:
            return self._recording.results
        if self._left is None or self._left[0] != self._engine.step:
            return None
        from neuro.files.results import read

        return read(self._left[1])

    def forget(self, before: float) -> None:
        """Free the memory of spikes and traces recorded up to a time in ms."""
        step = self._clock.floor(before, "forget")
        self._engine.forget(step)
        self._recorder.forget(step)

    def port(self, of: Population | View | Projection | Signal | str, what: str | None = None) -> Port:
        """Something that a closed loop sets or reads at every step, found once: `set` and `get` in less time.

        The values, and the errors, are those of `set`, `signal`, `get` and `spikes`.

        Args:
            of: the population, a view, the projection, or the signal.
            what: a parameter or state of the neurons; the weight or another state of the synapses; of neurons
                "spikes", the ids of those that fired since the port was made or last read, and "counts", how often each
                did. A signal has none. After `reset` and `restore` spikes and counts begin anew.

        Raises:
            ModelError: there is no such part, it has nothing of that name, or its spikes are not recorded.
        """
        return self._ports.port(self, of, what)

    @property
    def traces(self) -> dict[str, Trace]:
        """What probes of states have recorded so far, by the names of their traces, with units, as of results."""
        from neuro.run.collect import traces

        return traces(self)

    def plot(self, of: Any = None, window: tuple[float, float] | None = None) -> Figure:
        """Raster, rates and traces of the run so far, as `neuro.plots.overview` draws them.

        Args:
            of: a population or a list of these; all that is recorded if not given.
            window: begin and end in ms; all of the run if not given.

        Raises:
            ModelError: nothing of this was recorded.
        """
        from neuro.plots import overview

        return overview(self, of, window=window)

    def to_neo(self) -> neo.Block:
        """Spikes and traces so far as a block of Neo, see `neuro.files.neo_block.to_neo`; needs the extra `neo`."""
        from neuro.files.neo_block import to_neo

        return to_neo(self)

    def to_pandas(self) -> Frames:
        """Spikes, rates, traces and weights so far as data frames; needs the extra `pandas`."""
        from neuro.files.frames import to_pandas

        return to_pandas(self)

    # trials

    @cached_property
    def _trials(self) -> TrialLoop:
        return TrialLoop(self.program, self._engine, self._clock, self._tally, self._rules)

    def trials(
        self,
        times: ArrayLike,
        ids: ArrayLike,
        offsets: ArrayLike,
        labels: ArrayLike | None = None,
        learn: bool = False,
        samples: ArrayLike | None = None,
        epoch: int = 0,
    ) -> TrialResults:
        """Present a batch of trials, one after the other.

        Args:
            times: of the input spikes in ms from the start of their trial, 0 <= t < duration, on the grid.
            ids: neurons of the trials' input, one for each time.
            offsets: where each trial begins in `times`, and the end: one more than there are trials.
            labels: the right label of each trial; rules that are not supervised learn without.
            learn: whether the trials teach.
            samples: which sample each trial belongs to, for dropout; each is its own if not given.
            epoch: how often all has been seen, for the decay of dropout.

        Raises:
            ModelError: the network has no trials, or the batch does not fit them.
        """
        if self.program.trials is None:
            raise ModelError("the network has no section 'trials'", hint="net.trials(input=..., duration=...) adds one")
        return self._trials.run(times, ids, offsets, labels, learn, samples, epoch)

    # accounts

    def counts(self) -> Counts:
        """What has happened since the start or the last reset."""
        return self._tally.between(None, self._engine.counts())

    def taken(self) -> TrialCounts:
        """What has happened since the start or the last reset, to be added up over several runs for one bill."""
        return TrialCounts(0, self._engine.counts(), self._tally)

    def energy(self, target: str | PathLike[str], of: TrialResults | TrialCounts | None = None) -> Energy:
        """What the run would take on a chip: the counts of any backend x published figures, and static power.

        Args:
            target: "loihi", "spinnaker", "spinnaker2", "truenorth", "cpu", "gpu", or a table file of your own.
            of: a batch of trials to price instead of all since the start, or what several took together.

        Returns:
            the bill: `total_j`, `dynamic_j`, `static_j`, `items` with count, joules each and source; `per(n, what)`
            divides it; `str` prints it.

        Raises:
            ModelError: there is no such target, the network does not fit on it, or it has no published costs.
        """
        from neuro.chips.pricing.bill import bill

        return bill(self.program, self._engine.counts() if of is None else of.raw_counts, target)

    def memory(self) -> dict[str, int]:
        """Bytes of the engine by what they hold."""
        return self._engine.memory()

    def network(self) -> Network:
        """The network with what it has learnt: save it, or compile it for another backend."""
        self._check_weights()
        return learnt_network(self._net, self.program, self._engine, self._clock, self._rules)

    # files

    def _refuse_while_recording(self, what: str) -> None:
        """Refuse what would turn back the time of a file that is being written."""
        if self._recording is not None:
            path = self._recording.part
            raise ModelError(f"{what}: found a simulation that records to {path}: expected the end of 'record_to'")

    @cached_property
    def _identity(self) -> Identity:
        program = self.program
        return Identity(program.name, self.backend, program.seed, fingerprint(program))

    def save(self, path: str | PathLike[str]) -> None:
        """Write the whole state to an HDF5 file.

        Raises:
            ModelError: the file cannot be written, or a weight is no number: a numerical instability of its rule.
        """
        self._check_weights()
        arrays = {f"engine/{name}": values for name, values in self._engine.snapshot().items()}
        arrays |= {f"probes/{name}": values for name, values in self._recorder.snapshot().items()}
        for index, rule in self._rules.items():
            arrays[f"rules/{index}"] = rule.vector()
        arrays |= {f"streams/{name}": step for name, step in self._inflow.state().items()}
        if self.program.trials is not None:
            arrays["trials"] = self._trials.state()
        write_state(file_path(path, "path"), self._identity, arrays)

    def restore(self, path: str | PathLike[str]) -> None:
        """Continue from a file that `save` wrote for the same network, backend and seed, bit for bit.

        Raises:
            ModelError: the file is of something else; the simulation stays as it is.
        """
        self._refuse_while_recording("restore")
        self._inflow.check_again("restore")
        arrays = read_state(file_path(path, "path"), self._identity)
        self._left = None
        begin = len("engine/")
        self._engine.restore({name[begin:]: v for name, v in arrays.items() if name.startswith("engine/")})
        begin = len("probes/")
        self._recorder.restore({name[begin:]: v for name, v in arrays.items() if name.startswith("probes/")})
        for index, rule in self._rules.items():
            self._rules[index] = settable.rule_of(rule, arrays[f"rules/{index}"])
        begin = len("streams/")
        self._inflow.put({name[begin:]: step for name, step in arrays.items() if name.startswith("streams/")})
        if self.program.trials is not None:
            self._trials.put(arrays["trials"])
        self._ports.begin()


def _refuse_ends(neurons: Neurons, pre: object, post: object) -> None:
    if pre is not None or post is not None:
        raise ModelError(f"pre and post of {neurons.text}: they choose synapses: expected a projection")
