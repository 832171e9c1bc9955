"""A network that runs: the engine, what is recorded of it, and the watch on its states."""

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
from neuro.run.turn import Turn, alone
from neuro.run.watch import Watch

if TYPE_CHECKING:
    from neuro.run.collect import ResultsWriter
    from neuro.run.ports import Port
    from neuro.run.signals import SignalFeeder
    from neuro.run.streams import Inflow

_FLAG = Quantity(kind="boolean")


class RunningNetwork:
    """What a `Simulation` needs to advance a network and to tell what it recorded.

    Each other purpose of a simulation is imported when it is asked for, so that a run enters few modules.
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
        """The end of the last finished step in ms."""
        return self._clock.ms(self._engine.step)

    @alone
    def run(self, ms: float, progress: bool = False, out: str | PathLike[str] | None = None) -> None:
        """Advance by a multiple of the resolution; running in parts gives the same bits.

        Args:
            ms: how long.
            progress: whether to report progress on stderr: by a bar on a terminal, elsewhere a line every 10 s.
            out: a file to which what is recorded goes, as of `record_to`.

        Raises:
            ModelError: the network got a part since it was compiled, the time is no such multiple, a recording that is
                played is damaged, before which the run stops, or a state is NaN or infinite at the end: a numerical
                instability. Of models that cannot run away by themselves that is looked for when the time has doubled,
                and every 10,000 steps.
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
        """Refuse a run whose probes record more than memory, or the disk of the file that takes it, has room for.

        Args:
            steps: of the whole run; `run` may then be called for parts of it.

        Raises:
            ModelError: the bytes needed and those that are free, and the probe that needs most.
        """
        self._records.check_room(steps)

    def _refuse_changed(self) -> NoReturn:
        """Say which part the network got since it was compiled: a file would hold a network that did not run."""
        added = self._net.latest
        what = f"{added.word} '{added.name}' was" if isinstance(added, Part) else "trials were"
        where = getattr(added, "origin", self._net.trials_origin)
        message = f"network '{self._net.name}': {what} added after it was compiled, and has no effect here"
        raise ModelError(f"{message}: expected the network as it was", where=where, hint="compile the network again")

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
            live: let another process write the file, so that the run waits for no disk. Nothing is packed, and what was
                recorded goes there at the calls of `drain` and `commit` of what the block is given.

        Raises:
            ModelError: the file cannot be written, now or later, or the simulation records to a file already.
        """
        inner = self if self._turn is None else self._inner
        words = (path, threads, record, all_weights, live)
        with self._records.to_file(inner, *words, self._turn) as recording:
            yield recording

    @alone
    def spikes(
        self, of: Population | View | str, since: float | None = None, until: float | None = None
    ) -> tuple[Floats, Ints]:
        """Recorded spikes of a population or of some of its neurons.

        Args:
            of: the population, or a view of it.
            since: only those after this time in ms; all that are held if not given.
            until: only those up to this time in ms, so that `until` of one call is `since` of the next.

        Returns:
            times in ms and neurons, sorted by time, then neuron; several spikes of one neuron in one step are
            listed as often. Neurons are ids of the population, also of a view.

        Raises:
            ModelError: they are not recorded, or a time is asked of which they were forgotten, or are in a file only.
        """
        return self._records.spikes(self.handles.neurons(of), since, until)

    @alone
    def train(self, of: Population | View | str) -> tuple[Ints, Ints, Ints]:
        """Recorded spikes as `spikes` gives them, but several of one neuron in one step as one entry.

        Returns:
            steps, neurons, and how many spikes each entry has, sorted by step, then neuron.

        Raises:
            ModelError: as `spikes`.
        """
        return self._records.train(self.handles.neurons(of))[:3]

    @alone
    def payloads(
        self, of: Population | View | str, since: float | None = None, until: float | None = None
    ) -> tuple[Floats, Ints, Ints]:
        """Recorded spikes of a graded population, as `spikes` gives them, and the payload of each.

        Raises:
            ModelError: as `spikes`, or its spikes carry no payloads.
        """
        return self._records.payloads(self.handles.neurons(of), since, until)

    @alone
    def trace(self, of: Probe | str) -> tuple[Floats, Any]:
        """What a probe has recorded.

        Returns:
            times in ms, shape (times,), and what was recorded at them: of one quantity, a rate or a mean, shape
            (times,); of neurons or synapses (times, n), also of a single one, columns of a view or of chosen synapses
            in their order; of spikes the neurons, (times,). A list of states gives a dictionary of these by state. At
            pre spikes `pre`, `post` and the state by name, each (times,): an entry for each synapse and spike, by time,
            then synapse.
        """
        return self._records.trace(self.handles.probe(of))

    @property
    def held(self) -> float:
        """The time in ms after which spikes and traces are held: 0, or that up to which they were forgotten."""
        return self._records.held_ms

    @alone
    def forget(self, before: float) -> None:
        """Free the memory of spikes and traces recorded up to a time in ms.

        From then on `spikes` and `trace` give what came later; `spikes` refuses a `since` before it.
        """
        if self._signals is not None:  # they may depend on times of spikes that are forgotten now
            self._signals.listen()
        self._records.forget(before)
