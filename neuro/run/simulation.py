"""The class that users hold: what can be set, read, told and saved of a network that runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, NoReturn, SupportsIndex

from numpy.typing import ArrayLike

from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.core.inputs import file_path
from neuro.core.quantities import Quantity
from neuro.core.tables import Table, as_html, as_text
from neuro.model.network import Network
from neuro.model.parts import Population, Projection, Side, Signal
from neuro.model.views import View
from neuro.run.running import RunningNetwork
from neuro.run.turn import alone

if TYPE_CHECKING:
    import neo
    from matplotlib.figure import Figure

    from neuro.chips.energy import Energy
    from neuro.files.parts import Trace
    from neuro.files.recorded import DataFrames
    from neuro.files.results import Results
    from neuro.program.counts import Counts, Tally
    from neuro.run.inputs import InputFeeder
    from neuro.run.ports import Port
    from neuro.run.saved import Saved
    from neuro.run.stepper import Stepper
    from neuro.run.trials import TrialCounts, TrialLoop, TrialResults
    from neuro.run.values import NeuronValues, SynapseValues, Values
    from neuro_doctor.diagnosis import Diagnosis

_FLAG = Quantity(kind="boolean")


class Simulation(RunningNetwork):
    """A network in execution; made by `neuro.compile`.

    Times are in ms, neurons are counted from 0 in C order of their population's shape, values are in the units
    of their models. A part is named by its name, or by what `net.population`, `net.connect` and others returned; where
    neurons are asked for, also by a view such as `exc[:100]`. Values of a view are in its order; ids are always those
    of the population.

    One call at a time: while one is under way, others of another thread or of a callback are refused, and only `time`
    can be read. Several simulations may run in as many threads. A simulation is not copied or pickled: `save` and
    `restore` take its state to another.

    Attributes:
        backend: the name of the backend.
        program: the resolved network.
        handles: finds its parts by what names them.
        steered: the calls by which it was changed since it was compiled, in the order of the first of each.
    """

    @cached_property
    def _values(self) -> Values:
        from neuro.run.values import Values

        return Values(self._run)

    @property
    def _synapses(self) -> SynapseValues:
        return self._values.synapses

    @property
    def _cells(self) -> NeuronValues:
        return self._values.cells

    @cached_property
    def _inputs(self) -> InputFeeder:
        from neuro.run.inputs import InputFeeder

        return InputFeeder(self._run)

    @cached_property
    def _tally(self) -> Tally:
        from neuro.program.counts import Tally

        return Tally(self.program)

    def __repr__(self) -> str:
        return f"Simulation({self.program.name!r}, backend={self.backend!r}, time={self.time:g} ms)"

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        message = "a simulation cannot be copied or pickled, as its kernels know where its memory lies"
        hint = "sim.save(path), and restore(path) of another that was compiled from the network"
        raise ModelError(message, hint=hint)

    def __str__(self) -> str:
        return as_text(repr(self), self._tables())

    def _repr_html_(self) -> str:
        return as_html(repr(self), self._tables())

    def _tables(self) -> list[Table]:
        """A row for each population and projection."""
        from neuro.files.parts import synapse_text
        from neuro.files.results import projection_table, run_table

        populations, counts = self.program.populations, self.counts().populations
        spikes = {p.name: None if p.kind == "current" else counts[p.name].spikes for p in populations}
        return [
            run_table(self.time, ((p.name, p.said, p.size, spikes[p.name]) for p in populations)),
            projection_table(
                (
                    p.name,
                    populations[p.source].name,
                    populations[p.target].name,
                    synapse_text(p.synapse.name, None if p.undrawn is None else self.backend),
                    p.size,
                )
                for p in self.program.projections
            ),
        ]

    @alone
    def reset(self, weights: bool = False) -> None:
        """Back to time 0 and the initial states; weights only if asked. Parameters that were set stay."""
        self._records.refuse_while_recording("reset")
        weights = check(_FLAG, weights, "reset: weights")
        if self._inflow is not None:
            self._inflow.own.check_again("reset")
        self.steered["reset"] = None
        self._engine.reset(weights)
        self._watch.begin()
        if self._inflow is not None:
            self._inflow.rewind()
        if self._signals is not None:
            self._signals.begin()
        self._records.clear()
        for port in self._ports:
            port.begin()
        if self.program.trials is not None:
            self._trials.start_anew()

    # parameters, states and weights

    @alone
    def set(
        self,
        part: Population | View | Projection | str,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        of: ArrayLike | None = None,
        pre: Side = None,
        post: Side = None,
        **named: Any,
    ) -> None:
        """Change parameters or states of neurons, or weights or parameters of the synapse model of a projection.

        The change acts from the next step on. A value is one for all or one for each: for neurons also a distribution,
        of which a neuron draws the same value in whatever view; for synapses in the order in which `weights` gives
        them. `weight` stands alone; parameters of which synapses have their own may be set of chosen ones.

        Args:
            part: the population, a view, or the projection.
            values: by name, beside or instead of `named`.
            of: of a projection only the synapses of these pairs (source, target) of neurons, shape (n, 2).
            pre: only the synapses from these neurons: a population, a view of it, or ids.
            post: likewise those onto these neurons.
            named: the values by name, e.g. `V_m=-60.0`.

        Raises:
            ModelError: a name is unknown, a value is out of bounds, or no synapse is chosen.
        """
        self._values.set(part, values, named, of, pre, post)
        self.steered["set"] = None

    @alone
    def get(
        self,
        part: Population | View | Projection | str,
        /,
        what: str | list[str],
        raw: bool = False,
        *,
        of: ArrayLike | None = None,
        pre: Side = None,
        post: Side = None,
    ) -> Any:
        """A state or parameter of neurons, or a state of synapses, in physical units; one value each, in a row.

        A list of names gives a dictionary of these by name.

        Args:
            part: the population, a view, or the projection.
            what: a state or parameter of a population's model; of a projection "weight", "delay" in ms, a parameter or
                a state of its synapses, where "K_plus" is the trace of each synapse's source and "n" the dopamine of
                its target.
            raw: read a chip's registers instead.
            of: of a projection only the synapses of these pairs (source, target), in their order, as of `set`.
            pre: only those from these neurons; `weights` says which they are.
            post: likewise those onto these neurons.
        """
        return self._values.get(part, what, raw, of, pre, post)

    def states(self, of: Population | View | str) -> list[str]:
        """The states of a population's neurons that this backend shows, in the order of its model."""
        return self._cells.states(self.handles.neurons(of))

    @alone
    def weights(
        self,
        part: Projection | str,
        /,
        *,
        of: ArrayLike | None = None,
        pre: Side = None,
        post: Side = None,
        delays: bool = False,
    ) -> Any:
        """The weights of a projection.

        Args:
            part: the projection.
            of: only of the synapses of these pairs (source, target), in their order, as of `set`.
            pre: only of the synapses from these neurons.
            post: only of the synapses onto these neurons.
            delays: whether to give the delays in ms, too.

        Returns:
            (pre, post, weight), one entry a synapse, sorted by pre, then post, and with `delays` a fourth row; of a
            grid its kernels, shape (maps, channels, height, width), with `delays` (kernels, delay). The weights are
            those stored, as in NEST: that of `stdp` changes when a pre spike is sent.

        Raises:
            ModelError: there is no such projection, or a weight is NaN or infinite: its rule is unstable.
        """
        return self._values.weights(self.handles.projection(part), of, pre, post, delays)

    @alone
    def set_weights(self, of: Projection | str, weights: ArrayLike) -> None:
        """Replace the weights of a projection: one for all, or an array in the form that `weights` gives."""
        self._synapses.set_weights(self.handles.projection(of), weights, None)
        self.steered["set_weights"] = None

    # input and output

    @alone
    def inject(
        self,
        of: Population | View | str,
        times: ArrayLike,
        ids: ArrayLike | None = None,
        payloads: ArrayLike | None = None,
    ) -> None:
        """Add spikes to a spike_generator.

        Args:
            of: the population, or a view of it.
            times: in ms, on the grid of steps and later than `time`.
            ids: its neurons, one for each time; of a view these are ids of the population, too, and must be among
                those of the view. If not given, each neuron emits at all times.
            payloads: of a graded_spike_train, whole numbers, one for each time.
        """
        self._inputs.inject(self.handles.neurons(of), times, ids, payloads)
        self.steered["inject"] = None

    @alone
    def feed(self, of: Population | str, events: Any) -> None:
        """Let an event camera emit more events than those of its recording, while it runs.

        A file of `record_to` keeps them, so that `neuro rerun` makes the run again.

        Args:
            of: the population, an `event_camera`.
            events: Events, a structured array with t, x, y and p, or an iterable of such, in the order of time. Their
                times count as those of the recording do; without one from `origin`, or from 0.

        Raises:
            ModelError: they are of another sensor, or one comes too late: its step is not after the present.
        """
        neurons = self.handles.neurons(of)
        steps, ids = self._inputs.feed(neurons, events)
        if self._records.recording is None:
            self.steered["feed"] = None
        else:
            self._records.recording.feed(neurons.part.name, steps, ids)

    @alone
    def replay(self, run: Results) -> None:
        """Feed event cameras what they were fed in a run, at the same steps, while this one runs.

        Args:
            run: results of the same network that were recorded to a file.

        Raises:
            ModelError: the network has no such camera.
        """
        for name, fed in run.fed.items():
            index = self.handles.neurons(name).index
            self._inflow = self._inflow or self._new_inflow()
            self._inflow.fed.play(index, fed)
            self.steered["replay"] = None

    def _refuse_replaying(self, what: str) -> None:
        if self._inflow is not None and self._inflow.fed.plays:
            raise ModelError(f"{what}: a run is replayed, which no state keeps: expected a simulation without 'replay'")

    @alone
    def silence(self, of: Population | View | str) -> None:
        """Cut neurons off: the weights of all synapses from them become 0, from the next step on.

        They still receive, and what they fire is recorded; spikes under way arrive. `reset(weights=True)` undoes it.

        Args:
            of: the population, or a view of it.

        Raises:
            ModelError: weights from them learn, or they are some of the neurons that share a kernel.
        """
        self._values.silence(of)
        self.steered["silence"] = None

    @alone
    def activate(self, of: Population | View | str, rate: ArrayLike) -> None:
        """Drive neurons by independent Poisson spikes, from the next step on.

        The spikes are those of the `poisson_generator` that is connected to them one to one, as of
        `net.wiring(drive=...)`, with the weight of that projection. Of several generators it is the one whose rate is
        described as 0.

        Args:
            of: the population, or a view of it.
            rate: in Hz, one for all or one for each; 0 ends it.

        Raises:
            ModelError: no such generator drives them, or several do, or a rate is below 0.
        """
        self._values.activate(self.handles.neurons(of), rate)
        self.steered["activate"] = None

    @alone
    def signal(self, of: Signal | str, values: ArrayLike) -> None:
        """Set a signal: one value for all neurons of its population or one for each; acts from the next step on."""
        self._inputs.signal(self.handles.signal(of), values)
        self.steered["signal"] = None

    @alone
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
        from neuro.run.ports import Ports

        return Ports([self], self._calls).port(of, what)

    def stepper(
        self, ms: float, emit: Sequence[Population | str] = (), count: Sequence[Population | str] = ()
    ) -> Stepper:
        """Control steps of `ms`, each of which is one call: spikes in, run, counts out; see `neuro.Stepper`.

        Args:
            ms: the length of a control step.
            emit: populations of spike_generator that are given spikes at each.
            count: populations whose spikes are counted.

        Raises:
            ModelError: there is no such population, one of `emit` is another model, or the network has probes.
        """
        from neuro.run.stepper import Joined, Stepper

        return Stepper(Joined(self._run, [self._engine], [self._watch]), ms, emit, count)

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
        """Spikes and traces so far as a block of Neo, see `neuro.files.recorded.to_neo`; needs the extra `neo`."""
        from neuro.files.recorded import to_neo

        return to_neo(self)

    def to_pandas(self) -> DataFrames:
        """Spikes, rates, traces and weights so far as data frames; needs the extra `pandas`."""
        from neuro.files.recorded import to_pandas

        return to_pandas(self)

    # trials

    @cached_property
    def _trials(self) -> TrialLoop:
        from neuro.run.trials import TrialLoop

        return TrialLoop(self._run, self._tally)

    @alone
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
            ModelError: the network has no trials, the batch does not fit them, or a state is NaN or infinite at the
                end, as of `run`.
        """
        if self.program.trials is None:
            raise ModelError("the network has no section 'trials'", hint="net.trials(input=..., duration=...) adds one")
        self.steered["trials"] = None
        results = self._trials.run(times, ids, offsets, labels, learn, samples, epoch)
        self._watch.look()
        return results

    # accounts

    @alone
    def counts(self) -> Counts:
        """What has happened since the start or the last reset."""
        return self._tally.between(None, self._engine.counts())

    @alone
    def taken(self) -> TrialCounts:
        """What has happened since the start or the last reset, to be added up over several runs for one bill."""
        from neuro.run.trials import TrialCounts

        return TrialCounts(0, self._engine.counts(), self._tally)

    @alone
    def energy(
        self,
        target: str | PathLike[str],
        of: TrialResults | TrialCounts | None = None,
        *,
        step_s: float | None = None,
        chips: int | None = None,
        duration_s: float | None = None,
    ) -> Energy:
        """What the run would take on a chip: the counts of any backend x published figures, and static power.

        Args:
            target: "loihi", "spinnaker", "spinnaker2", "truenorth", "cpu", "gpu", or a table file of your own.
            of: a batch of trials to price instead of all since the start, or what several took together.
            step_s: how long a step takes on the chip in s, e.g. 1e-3 for a step of 1 ms in real time; the chip's own
                time if not given.
            chips: that are on, e.g. all of a board; those that the network needs if not given.
            duration_s: how long the run lasts in real time in s, if not as long as its steps, e.g. the time of
                recordings whose frames are shown over more steps.

        Returns:
            the bill: `total_j`, `dynamic_j`, `static_j`, `low_j` and `high_j`, `items` with count, joules each and
            source, `missing`, `refused`, `extrapolated`; `per(n, what)` divides it; `str` prints it.

        Raises:
            ModelError: there is no such target, the network does not fit on it, it has no published costs, or
                `step_s`, `chips` or `duration_s` cannot be.
        """
        from neuro.chips.pricing import bill

        counts = self._engine.counts() if of is None else of.raw_counts
        self.program.refuse_share("energy")
        words: Any = {"step_s": step_s, "chips": chips, "duration_s": duration_s, "ran_on": self.backend}
        return bill(self.program, counts, target, **words)

    @alone
    def memory(self) -> dict[str, int]:
        """Bytes of the engine by what they hold."""
        return self._engine.memory()

    @alone
    def network(self, frozen: bool = False) -> Network:
        """The network with what it has learnt: save it, or compile it for another backend.

        Args:
            frozen: whether nothing learns there: synapses are static, and there are no signals.
        """
        self._synapses.check()
        from neuro.run.saved import learnt_network

        net = learnt_network(self._run)
        return net.frozen() if check(_FLAG, frozen, "network: frozen") else net

    @alone
    def doctor(
        self,
        ms: float = 1000.0,
        *,
        chip: str | None = None,
        train: bool = False,
        drive: float = 0.0,
        reward_after: float | None = None,
    ) -> Diagnosis:
        """Find out why the network does not work as it is now, see `neuro.doctor`; nothing of the simulation changes.

        A copy runs from time 0, with the present weights and parameters, on `event` or on the emulated chip. Its inputs
        emit what they have emitted here. What signals were set to is not repeated.

        Args:
            ms: length of the run, to be rounded up to whole steps.
            chip: also judge what becomes of the network on this chip.
            train: also judge the gradients that training with surrogates would see.
            drive: rate in Hz of Poisson spikes for inputs that have not emitted any; 0: these stay silent.
            reward_after: how long after the spikes that earned it a reward comes, in ms.

        Raises:
            ModelError: an argument is not as described.
        """
        self.program.refuse_share("doctor")
        from neuro.core.extras import app
        from neuro.run.saved import present

        doctor = app("neuro_doctor.doctor", "sim.doctor")
        options = doctor.options_of(
            ms=ms,
            backend=doctor.backend_of_copy(self.backend),
            chip=chip,
            train=train,
            drive=drive,
            reward_after=reward_after,
            ran=self.time,
            steered="signal" in self.steered,
        )
        try:
            self._synapses.check()
        except ModelError as error:
            diagnosis: Diagnosis = doctor.refused(self.program.name, [error])
        else:
            diagnosis = doctor.examine(present(self._run, self.steered), options)
        return diagnosis

    # files

    @cached_property
    def _saved(self) -> Saved:
        from neuro.run.saved import Saved

        return Saved(self._run, self._records, None if self._inflow is None else self._inflow.own, self._signals)

    @alone
    def save(self, path: str | PathLike[str]) -> None:
        """Write the whole state to an HDF5 file.

        Raises:
            ModelError: the file cannot be written, or a weight is NaN or infinite: its rule is unstable.
        """
        self._synapses.check()
        self._refuse_replaying("save")
        from neuro.run.collect import files_of, record_of

        run = {"backend": self.backend, "seed": self.program.seed, "network": self._saved.fingerprint}
        record = record_of(self._net, **run) | {"steered": list(self.steered), "time_ms": self.time}
        trials = None if self.program.trials is None else self._trials
        self._saved.write(file_path(path, "path"), trials, record, files_of(self._net))

    @alone
    def restore(self, path: str | PathLike[str]) -> None:
        """Continue from a file that `save` wrote for the same network, backend and seed, bit for bit.

        Raises:
            ModelError: the file is of something else; the simulation stays as it is.
        """
        self._records.refuse_while_recording("restore")
        self._refuse_replaying("restore")
        self.steered["restore"] = None
        if self._inflow is not None:
            self._inflow.own.check_again("restore")
        self._saved.read(file_path(path, "path"), None if self.program.trials is None else self._trials)
        self._watch.begin()
        for port in self._ports:
            port.begin()
