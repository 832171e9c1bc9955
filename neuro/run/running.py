"""Base class of `Simulation`, with methods that advance a network and read records."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from os import PathLike
from typing import TYPE_CHECKING, Any, NoReturn
from weakref import WeakSet

from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity
from neuro.model.network import Network
from neuro.model.parts import Part, Population, Probe
from neuro.model.views import View
from neuro.program.backend import Engine
from neuro.program.program import Floats, Ints
from neuro.run.handles import Run
from neuro.run.records import Records
from neuro.run.turn import Turn, exclusive
from neuro.run.watch import Watch

if TYPE_CHECKING:
    from neuro.chips.hosting import HostWork
    from neuro.run.collect import ResultsWriter
    from neuro.run.ports import Port
    from neuro.run.signals import SignalFeeder
    from neuro.run.streams import Inflow

_FLAG = Quantity(kind="boolean")


class RunningNetwork:
    """The part of a `Simulation` that advances a network and reads its records.

    Modules for other purposes of a simulation are imported on first use, so that a plain run imports few modules.
    """

    def __init__(self, net: Network, backend: str, program: Any, engine: Engine) -> None:
        self.backend, self.program = backend, program
        self._run = run = Run(net, backend, program, engine)
        self._net, self._engine, self._latest = net, engine, net.latest
        self._clock, self.handles, self._rules = run.clock, run.handles, run.rules
        self._records, self._watch = Records(run), Watch(run)
        self._inflow: Inflow | None = None
        if any(part.stream is not None for part in program.populations):
            self._inflow = self._new_inflow()
        self._signals: SignalFeeder | None = None
        if any(part.values is not None for part in program.signals):
            from neuro.run.signals import SignalFeeder

            self._signals = SignalFeeder(program, engine)
        self.steered: dict[str, None] = {}
        self.host_work: list[HostWork] = [] if self._signals is None else self._signals.host_work()
        self._ports: WeakSet[Port] = WeakSet()
        self._calls: Turn = {}
        self._turn: Turn | None = None
        inner = object.__new__(type(self))
        inner.__dict__ |= self.__dict__
        self._inner, self._turn = inner, self._calls

    def _new_inflow(self) -> Inflow:
        from neuro.run.streams import Inflow

        return Inflow(self.program, self._engine)

    @property
    def time(self) -> float:
        """End of the last finished step in ms."""
        return self._clock.ms(self._engine.step)

    @exclusive
    def run(self, ms: float, progress: bool = False, out: str | PathLike[str] | None = None) -> None:
        """Advance by a multiple of the resolution. Several short runs give the same bits as a long one.

        Args:
            ms: duration of the run.
            progress: whether to report progress on stderr: a bar on a terminal, elsewhere a line every 10 s.
            out: path of a file for the records, see `record_to`.

        Raises:
            ModelError: a part was added to the network after compilation, the time is not a multiple of the resolution,
                a recording is damaged (the run stops before the damage), or a state is NaN or infinite at the end,
                which is a numerical instability. Models that cannot become unstable by themselves are checked only
                each time that the elapsed time has doubled, and at least every 10,000 steps.
        """
        if self._net.latest is not self._latest:
            self._refuse_changed()
        steps = self._run.steps(ms)
        if out is not None:
            with self.record_to(out):
                self.run(ms, progress)
            return
        if progress is not False and check(_FLAG, progress, "run: progress"):
            from neuro.core.progress import Bar, advance

            with Bar() as bar:
                advance(self, steps, bar)
            return
        self._records.check_room(steps)
        for stretch in [steps] if self._signals is None else self._signals.stretches(steps):
            for part in [stretch] if self._inflow is None else self._inflow.stretches(stretch):
                self._records.run(part)
        self._watch.look()

    def check_room(self, steps: int) -> None:
        """Refuse a run whose records do not fit into memory, or onto the disk of the file of `record_to`.

        Args:
            steps: number of steps of the whole run, which may consist of several calls of `run`.

        Raises:
            ModelError: the records do not fit. The message has the needed bytes, the free bytes, and the largest probe.
        """
        self._records.check_room(steps)

    def _refuse_changed(self) -> NoReturn:
        """Raise an error for a part added after compilation: it does not run, but files of results would contain it."""
        added = self._net.latest
        subject = f"{added.word} '{added.name}' was" if isinstance(added, Part) else "trials were"
        origin = getattr(added, "origin", self._net.trials_origin)
        message = f"network '{self._net.name}': {subject} added after it was compiled, and has no effect here"
        raise ModelError(f"{message}: expected the network as it was", where=origin, hint="compile the network again")

    @contextmanager
    def record_to(
        self,
        path: str | PathLike[str],
        *,
        threads: int = 1,
        record: Collection[str] = (),
        all_weights: bool = False,
        live: bool = False,
    ) -> Iterator[ResultsWriter]:
        """Write records to a file of results while the network runs, instead of storing them in memory.

        Earlier records in memory are moved to the file, too. `spikes` and `trace` read from the file until the network
        runs again after the block; from then on they return only later records. `neuro.results.read` reads the file at
        any time.

        The file is called PATH.part until the block ends without an error. After an error or a kill, that file has all
        records except those of the last two seconds of wall-clock time.

        Args:
            path: path of the file.
            threads: number of threads of the run, stored in the file.
            record: names of the populations whose spikes are stored; empty: all recorded populations.
            all_weights: whether to store the weights of static projections above a million synapses, too. They follow
                from network and seed.
            live: whether another process writes the file, so that the run never waits for the disk. Nothing is
                compressed, and records are written when the caller calls `drain` or `commit` of the writer, which is
                the value of the `with` statement.

        Raises:
            ModelError: the file cannot be written, or the simulation records to a file already.
        """
        inner = self if self._turn is None else self._inner
        options = {"threads": threads, "record": record, "all_weights": all_weights, "live": live}
        with self._records.to_file(inner, path, self._turn, **options) as recording:
            yield recording

    @exclusive
    def spikes(
        self, of: Population | View | str, since: float | None = None, until: float | None = None
    ) -> tuple[Floats, Ints]:
        """Return recorded spikes of a population or of some of its neurons.

        Args:
            of: the population, or a view of it.
            since: only spikes after this time in ms; by default all spikes in memory.
            until: only spikes up to and including this time in ms. It can be `since` of the next call.

        Returns:
            times in ms and neurons, sorted by time, then neuron. Several spikes of a neuron in a step are repeated
            entries. Neurons are ids of the population, also for a view.

        Raises:
            ModelError: spikes are not recorded, or the spikes of that time were forgotten or are in a file only.
        """
        return self._records.spikes(self.handles.neurons(of), since, until)

    @exclusive
    def train(self, of: Population | View | str) -> tuple[Ints, Ints, Ints]:
        """Return recorded spikes in steps, with one entry for several spikes of a neuron in a step.

        Returns:
            steps, neurons and number of spikes of each entry, sorted by step, then neuron.

        Raises:
            ModelError: see `spikes`.
        """
        return self._records.train(self.handles.neurons(of))[:3]

    @exclusive
    def payloads(
        self, of: Population | View | str, since: float | None = None, until: float | None = None
    ) -> tuple[Floats, Ints, Ints]:
        """Return recorded spikes of a graded population, as `spikes` does, and the payload of each.

        Raises:
            ModelError: see `spikes`; or the spikes have no payloads.
        """
        return self._records.payloads(self.handles.neurons(of), since, until)

    @exclusive
    def trace(self, of: Probe | str) -> tuple[Floats, Any]:
        """Return the records of a probe.

        Returns:
            times in ms, shape (times,), and values. The values of a rate or a mean have the shape (times,), those of a
            state of n neurons or synapses (times, n), in the order of the view or of the chosen synapses. For a probe
            of spikes the values are the neurons, (times,). For a list of states the values are a dictionary by state.
            For a probe at presynaptic spikes they are a dictionary with `pre`, `post` and the state, each (times,),
            with an entry per synapse and spike, by time, then synapse.
        """
        return self._records.trace(self.handles.probe(of))

    @property
    def held(self) -> float:
        """Time in ms after which spikes and traces are in memory. Earlier records were forgotten."""
        return self._records.held_ms

    @exclusive
    def forget(self, before: float) -> None:
        """Free the memory of spikes and traces recorded up to a time in ms.

        Afterwards `spikes` and `trace` return later records only, and `spikes` refuses a `since` before that time.
        """
        if self._signals is not None:  # expressions may need the times of spikes that are forgotten now
            self._signals.listen()
        self._records.forget(before)
