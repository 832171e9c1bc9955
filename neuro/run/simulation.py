"""The class that users hold: it translates names and milliseconds, checks, records and reports."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from neuro.compiler import compile_network
from neuro.core.checks import check, is_number
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError, unknown
from neuro.core.paths import file_path
from neuro.core.quantities import Quantity, word_of
from neuro.core.values import shown
from neuro.files.state import Identity, fingerprint, read_state, write_state
from neuro.model.network import Network
from neuro.model.neurons import Generator, Neuron, spike_generator
from neuro.program.backend import Backend, Engine, Problem, Registers, find_backend, unreadable
from neuro.program.counts import Counts, Tally
from neuro.program.program import Floats, Ints, Program
from neuro.run import settable
from neuro.run.finite import Watch, check_weights
from neuro.run.inflow import Inflow
from neuro.run.learned_network import learnt_network
from neuro.run.recorder import Recorder
from neuro.run.trials import TrialCounts, TrialLoop, TrialResults

if TYPE_CHECKING:
    from neuro.chips.pricing.energy import Energy

T = TypeVar("T")
_SMALL = 1_000_000
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


class Names(dict[str, T]):
    """Parts by name; a value that is no text is the name of none."""

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and super().__contains__(name)


class Simulation:
    """A network in execution; made by `neuro.compile`.

    Times are in ms, neurons are counted from 0 in C order of their population's shape, values are in the units
    of their models.

    Attributes:
        backend: the name of the backend.
        program: the resolved network.
    """

    def __init__(self, net: Network, backend: str, program: Any, engine: Engine) -> None:
        self.backend, self.program = backend, program
        self._net, self._engine = net, engine
        self._clock = Clock(program.resolution)
        self._populations: Names[int] = Names({part.name: index for index, part in enumerate(program.populations)})
        self._projections: Names[int] = Names({part.name: index for index, part in enumerate(program.projections)})
        self._signals: Names[int] = Names({part.name: index for index, part in enumerate(program.signals)})
        self._rules = {index: part.synapse for index, part in enumerate(program.projections)}
        self._recorder = Recorder(program)
        self._tally = Tally(program)
        self._inflow = Inflow(program, engine)
        self._watch = Watch(program, engine, self._clock)
        self._ends: dict[int, tuple[Ints, Ints]] = {}

    def __repr__(self) -> str:
        return f"Simulation({self.program.name!r}, backend={self.backend!r}, time={self.time:g} ms)"

    # time

    @property
    def time(self) -> float:
        """The end of the last finished step in ms."""
        return self._clock.ms(self._engine.step)

    def run(self, ms: float) -> None:
        """Advance by a multiple of the resolution; running in parts gives the same bits.

        Raises:
            ModelError: the time is no such multiple, a recording that is played is damaged, before which the run
                stops, or a state is no number at the end: a numerical instability.
        """
        steps = self._clock.step(ms, "run")
        if not 0 <= steps < NEVER:
            raise ModelError(f"run = {ms:g} ms: expected a finite time >= 0 ms")
        for stretch in self._inflow.stretches(steps):
            if self._recorder.probes:
                self._recorder.run(self._engine, stretch)
            else:
                self._engine.run(stretch)
        self._watch.look()

    def reset(self, weights: bool = False) -> None:
        """Back to time 0 and the initial states; weights only if asked. Parameters that were set stay."""
        weights = check(_FLAG, weights, "reset: weights")
        self._inflow.check_again("reset")
        self._engine.reset(weights)
        self._inflow.rewind()
        self._recorder.clear()
        if self.program.trials is not None:
            self._trials.start_anew()

    # parameters, states and weights

    def set(self, name: str, **values: Any) -> None:
        """Change parameters or states of a population, or parameters of a projection's synapse model.

        The change acts from the next step on.

        Args:
            name: the population or projection.
            values: by name, one for all neurons or one for each (also a distribution).

        Raises:
            ModelError: a name is unknown or a value is out of bounds.
        """
        if name in self._populations:
            self._set_population(self._populations[name], values)
        elif name in self._projections:
            self._set_rule(self._projections[name], {word_of(word): value for word, value in values.items()})
        else:
            raise unknown("population or projection", name, [*self._populations, *self._projections])

    def _set_population(self, index: int, values: Mapping[str, Any]) -> None:
        part, step = self.program.populations[index], self._engine.step
        named = {word_of(word): value for word, value in values.items()}
        new = {word: settable.new_values(part, word, value, self.program.seed, step) for word, value in named.items()}
        settable.check_together(self.program, index, new, self._engine, self._clock)
        self._engine.set(index, new)

    def _set_rule(self, index: int, values: Mapping[str, Any]) -> None:
        rule = settable.new_rule(self.program.projections[index], self._rules[index], values)
        settable.check_rule(self.program.projections[index], rule, self._engine.get_synapses(index, "weight"))
        self._engine.set_rule(index, rule.vector())
        self._rules[index] = rule

    def get(self, name: str, what: str, raw: bool = False) -> Any:
        """A state or parameter of every neuron, or a state of every synapse, in physical units.

        Args:
            name: the population or projection.
            what: a state or parameter of a population's model; of a projection "weight" or a state of its
                synapses, where "K_plus" is the trace of each synapse's source and "n" the dopamine of its target.
            raw: read a chip's registers instead.
        """
        if check(_FLAG, raw, "raw"):
            return self._raw(name, what)
        if name in self._projections:
            index = self._projections[name]
            known = settable.synapse_states(self.program.projections[index])
            if not isinstance(what, str) or what not in known:
                raise unknown("state of synapses", what, known).at(None, f"projection '{name}'")
            return self._weights(index) if what == "weight" else self._engine.get_synapses(index, what)
        index = self._population(name)
        part = self.program.populations[index]
        word = word_of(what) if isinstance(what, str) else ""
        if word not in part.parameters and word not in settable.states(part):
            known = [*settable.states(part), *part.parameters]
            raise unknown("parameter or state", what, known).at(None, f"population '{name}'")
        return self._engine.get(index, word)

    def states(self, name: str) -> list[str]:
        """The states of a population's neurons that this backend shows, in the order of its model."""
        hidden = unreadable(self._engine)
        return [
            word for word in settable.states(self.program.populations[self._population(name)]) if word not in hidden
        ]

    def _raw(self, name: str, what: str) -> Any:
        """A register of every neuron or synapse, by its own name or that of what it stands for."""
        if not isinstance(self._engine, Registers):
            raise ModelError(f"raw = True: expected False, as backend '{self.backend}' has no registers")
        if name in self._projections:
            return self._engine.synapse_registers(self._projections[name], what)
        return self._engine.registers(self._population(name), word_of(what))

    def weights(self, name: str) -> Any:
        """The weights of a projection.

        Returns:
            (pre, post, weight), one entry a synapse, sorted by pre, then post; of a grid its kernels, shape
            (maps, channels, height, width). The weights are those stored, as in NEST: that of `stdp` changes
            when a pre spike is sent.

        Raises:
            ModelError: there is no such projection, or a weight is no number: a numerical instability of its rule.
        """
        index = self._projection(name)
        weight = self._weights(index)
        g = self.program.projections[index].grid
        if g is not None:
            return weight.reshape(g.kernels)
        pre, post = self._connections(index)
        return pre, post, weight

    def _weights(self, index: int) -> Floats:
        part, weight = self.program.projections[index], self._engine.get_synapses(index, "weight")
        return check_weights(part.name, part.synapse.name, weight) if part.synapse.learns else weight

    def set_weights(self, name: str, weights: ArrayLike) -> None:
        """Replace the weights of a projection: one for all, or an array in the form that `weights` gives."""
        index = self._projection(name)
        part = self.program.projections[index]
        array = settable.new_weights(part, self._rules[index], weights)
        self._engine.set_weights(index, array)

    def _check_weights(self) -> None:
        for index, part in enumerate(self.program.projections):
            if part.synapse.learns:
                self._weights(index)

    def _connections(self, index: int) -> tuple[Ints, Ints]:
        if index in self._ends:
            return self._ends[index]
        ends: tuple[Ints, Ints] = self.program.connections(index)
        for ids in ends:
            ids.flags.writeable = False
        if len(ends[0]) <= _SMALL:
            self._ends[index] = ends
        return ends

    # input and output

    def inject(self, name: str, times: ArrayLike, ids: ArrayLike) -> None:
        """Add spikes to a spike_generator.

        Args:
            name: the population.
            times: in ms, on the grid of steps and later than `time`.
            ids: its neurons, one for each time.
        """
        index = self._population(name)
        part = self.program.populations[index]
        if not isinstance(part.model, spike_generator):
            raise ModelError(f"inject: '{name}' is a {part.model.name}: expected a spike_generator")
        steps, neurons = settable.new_spikes(self._clock, times, ids, part.size)
        if steps.size and steps.min() <= self._engine.step:
            early = self._clock.ms(int(steps.min()))
            raise ModelError(f"inject: a spike at {early:g} ms: expected times after {self.time:g} ms, the present")
        self._engine.inject(index, steps, neurons)

    def feed(self, name: str, events: Any) -> None:
        """Let an event camera emit more events than those of its recording, while it runs.

        Args:
            name: the population, an `event_camera`.
            events: Events, a structured array with t, x, y and p, or an iterable of such, in the order of time. Their
                times count as those of the recording do; without one from `origin`, or from 0.

        Raises:
            ModelError: they are of another sensor, or one comes too late: its step is not after the present.
        """
        index = self._population(name)
        part = self.program.populations[index]
        if part.stream is None:
            raise ModelError(f"feed: '{name}' is a {part.model.name}: expected an event_camera")
        try:
            steps, ids = part.stream.given(events)
        except ModelError as error:
            raise error.at(None, f"feed: '{name}'") from None
        if steps.size and steps.min() <= self._engine.step:
            late = self._clock.ms(int(steps.min()))
            told = f"feed: an event of '{name}' in the step that ends at {late:g} ms"
            raise ModelError(f"{told}: expected later than {self.time:g} ms, the present")
        self._engine.inject(index, steps, ids)

    def signal(self, name: str, values: ArrayLike) -> None:
        """Set a signal: one value for all neurons of its population or one for each; acts from the next step on."""
        if name not in self._signals:
            raise unknown("signal", name, self._signals)
        index = self._signals[name]
        size = self.program.populations[self.program.signals[index].target].size
        self._engine.signal(index, settable.signal_values(name, values, size))

    def spikes(self, name: str, since: float | None = None) -> tuple[Floats, Ints]:
        """Recorded spikes of a population.

        Args:
            name: the population.
            since: only those after this time in ms.

        Returns:
            times in ms and neurons, sorted by time, then neuron; several spikes of one neuron in one step are
            listed as often.
        """
        index = self._population(name)
        part = self.program.populations[index]
        if not part.records:
            what = part.model.name
            hint = f"net.probe('name', '{name}') records them" if isinstance(part.model, Generator) else ""
            raise ModelError(f"spikes of '{name}', a {what}, are not recorded", hint=hint)
        found = self._engine.spikes(index, -1 if since is None else self._clock.floor(since, "since"))
        steps, ids = found.steps, found.ids
        if found.multiplicity.size and found.multiplicity.max() > 1:
            steps, ids = np.repeat(steps, found.multiplicity), np.repeat(ids, found.multiplicity)
        return self._clock.array_ms(steps), ids

    def trace(self, name: str) -> tuple[Floats, NDArray[Any]]:
        """What a probe has recorded: times in ms and values, shape (times, neurons); of a spike probe the neurons."""
        probes = Names({probe.name: probe for probe in self.program.probes})
        if name not in probes:
            raise unknown("probe", name, probes)
        if probes[name].record == "spikes":
            return self.spikes(self.program.populations[probes[name].population].name)
        steps, values = self._recorder.read(name)
        return self._clock.array_ms(steps), values

    def forget(self, before: float) -> None:
        """Free the memory of spikes and traces recorded up to a time in ms."""
        step = self._clock.floor(before, "forget")
        self._engine.forget(step)
        self._recorder.forget(step)

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
        for name in self._recorder.probes:
            arrays[f"probes/{name}/steps"], arrays[f"probes/{name}/values"] = self._recorder.read(name)
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
        self._inflow.check_again("restore")
        arrays = read_state(file_path(path, "path"), self._identity)
        begin = len("engine/")
        self._engine.restore({name[begin:]: v for name, v in arrays.items() if name.startswith("engine/")})
        for name in self._recorder.probes:
            self._recorder.put(name, arrays[f"probes/{name}/steps"], arrays[f"probes/{name}/values"])
        for index, rule in self._rules.items():
            self._rules[index] = settable.rule_of(rule, arrays[f"rules/{index}"])
        begin = len("streams/")
        self._inflow.put({name[begin:]: step for name, step in arrays.items() if name.startswith("streams/")})
        if self.program.trials is not None:
            self._trials.put(arrays["trials"])

    def _population(self, name: str) -> int:
        if name not in self._populations:
            raise unknown("population", name, self._populations)
        return self._populations[name]

    def _projection(self, name: str) -> int:
        if name not in self._projections:
            raise unknown("projection", name, self._projections)
        return self._projections[name]
