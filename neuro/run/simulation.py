"""The class `Simulation`, with methods to set, read, run and save a compiled network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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
from neuro.run.turn import exclusive

if TYPE_CHECKING:
    import neo
    from matplotlib.figure import Figure

    from neuro.chips.energy import Energy
    from neuro.chips.hosting import HostWork
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
    """A network in execution, made by `neuro.compile`.

    Times are in ms. Neurons are counted from 0 in C order of their population's shape. Values are in the units of their
    models. Methods take a part by name, or as the object that `net.population`, `net.connect` and similar methods
    returned. Neurons can also be given as a view such as `exc[:100]`: values are then in the order of the view, but ids
    are always ids of the population.

    Only one call is allowed at a time: a call from another thread or from a callback during a call is an error, except
    reading `time`. Several simulations may run in as many threads. A simulation cannot be copied or pickled; use `save`
    and `restore`.

    Attributes:
        backend: the name of the backend.
        program: the compiled network.
        handles: search for parts by name or object.
        steered: names of the calls that changed the simulation since compilation, in the order of first use.
        host_work: operations outside of the network, such as those of its world's encoders, for bills.
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
        message = "a simulation cannot be copied or pickled, because its kernels hold memory addresses"
        hint = "use sim.save(path), and restore(path) of another simulation of the network"
        raise ModelError(message, hint=hint)

    def __str__(self) -> str:
        return as_text(repr(self), self._tables())

    def _repr_html_(self) -> str:
        return as_html(repr(self), self._tables())

    def _tables(self) -> list[Table]:
        """Return a table of the populations and a table of the projections."""
        from neuro.files.parts import synapse_text
        from neuro.files.results import projection_table, run_table

        populations, counts = self.program.populations, self.counts().populations
        spikes = {part.name: None if part.kind == "current" else counts[part.name].spikes for part in populations}
        return [
            run_table(self.time, ((part.name, part.model_name, part.size, spikes[part.name]) for part in populations)),
            projection_table(
                (
                    part.name,
                    populations[part.source].name,
                    populations[part.target].name,
                    synapse_text(part.synapse.name, None if part.undrawn is None else self.backend),
                    part.size,
                )
                for part in self.program.projections
            ),
        ]

    @exclusive
    def reset(self, weights: bool = False) -> None:
        """Return to time 0 and the initial states, and with `weights` to the initial weights. Parameters stay."""
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
            self._trials.forget_samples()

    # parameters, states and weights

    @exclusive
    def set(
        self,
        part: Population | View | Projection | str,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        of: ArrayLike | None = None,
        pre: Side = None,
        post: Side = None,
        **keywords: Any,
    ) -> None:
        """Change parameters or states of neurons, or weights or parameters of the synapse model of a projection.

        The change acts from the next step on. A value is a number for all, or an array with a number for each
        neuron or synapse. For neurons a distribution is allowed, too; the draw of a neuron does not depend on the view.
        Values of synapses are in the order of `weights`. `weight` cannot be set together with other names. Parameters
        with a value per synapse may be set for chosen synapses.

        Args:
            part: the population, a view, or the projection.
            values: values by name, in addition to or instead of `keywords`.
            of: only the synapses of these pairs (source, target) of neurons, shape (n, 2).
            pre: only the synapses from these neurons: a population, a view of it, or ids.
            post: only the synapses onto these neurons, in the same forms.
            keywords: values by name, e.g. `V_m=-60.0`.

        Raises:
            ModelError: a name is unknown, a value is out of bounds, or no synapse is chosen.
        """
        self._values.set(part, values, keywords, of, pre, post)
        self.steered["set"] = None

    @exclusive
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
        """Return a state or parameter of neurons, or a state of synapses, in physical units.

        The result has one value for each neuron or synapse. A list of names returns a dictionary of arrays by name.

        Args:
            part: the population, a view, or the projection.
            what: name of a state or parameter, or a list of names. A projection has "weight", "delay" in ms, and the
                parameters and states of its synapses, where "K_plus" is the trace of a synapse's source and "n" the
                dopamine of its target.
            raw: whether to read a chip's registers instead.
            of: only the synapses of these pairs (source, target), in the order of the pairs; see `set`.
            pre: only the synapses from these neurons; `weights` returns their sources and targets.
            post: only the synapses onto these neurons.
        """
        return self._values.get(part, what, raw, of, pre, post)

    def states(self, of: Population | View | str) -> list[str]:
        """Return the names of a population's states that this backend can read, in the order of its model."""
        return self._cells.states(self.handles.neurons(of))

    @exclusive
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
        """Return the weights of a projection.

        Args:
            part: the projection.
            of: only the synapses of these pairs (source, target), in the order of the pairs; see `set`.
            pre: only the synapses from these neurons.
            post: only the synapses onto these neurons.
            delays: whether to return the delays in ms, too.

        Returns:
            (pre, post, weight), or with `delays` (pre, post, weight, delay), one entry per synapse, sorted by pre, then
            post. For a grid the kernels, shape (maps, channels, height, width), or with `delays` (kernels, delay).
            Weights are the stored values, as in NEST: a weight of `stdp` changes when a presynaptic spike is sent.

        Raises:
            ModelError: the projection does not exist, or a weight is NaN or infinite because its rule is unstable.
        """
        return self._values.weights(self.handles.projection(part), of, pre, post, delays)

    @exclusive
    def set_weights(self, of: Projection | str, weights: ArrayLike) -> None:
        """Replace the weights of a projection by a number for all, or an array in the form of `weights`."""
        self._synapses.set_weights(self.handles.projection(of), weights, None)
        self.steered["set_weights"] = None

    # input and output

    @exclusive
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
            times: times of the spikes in ms, on the grid of steps and later than `time`.
            ids: the neuron of each spike, as an id of the population. For a view, the ids must be in the view. Default:
                each neuron emits at all times.
            payloads: payload of each spike, a whole number; only for a graded_spike_train.
        """
        self._inputs.inject(self.handles.neurons(of), times, ids, payloads)
        self.steered["inject"] = None

    @exclusive
    def feed(self, of: Population | str, events: Any) -> None:
        """Add events to those of an event camera's recording, while the network runs.

        A file of `record_to` stores the events, so that `neuro rerun` can repeat the run.

        Args:
            of: the population, an `event_camera`.
            events: Events, a structured array with t, x, y and p, or an iterable of such arrays, in the order of time.
                Times have the origin of the recording; without a recording, `origin` or 0.

        Raises:
            ModelError: the events have another sensor size, or an event is too late: its step is not after the
                present step.
        """
        neurons = self.handles.neurons(of)
        steps, ids = self._inputs.feed(neurons, events)
        if self._records.recording is None:
            self.steered["feed"] = None
        else:
            self._records.recording.feed(neurons.part.name, steps, ids)

    @exclusive
    def replay(self, run: Results) -> None:
        """Feed the events of an earlier run to the event cameras, at the same steps, while this network runs.

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
            raise ModelError(f"{what}: a state cannot hold a replayed run: expected a simulation without 'replay'")

    @exclusive
    def silence(self, of: Population | View | str) -> None:
        """Set the weights of all synapses from some neurons to 0, from the next step on.

        The neurons still receive input, and their spikes are recorded. Spikes in flight arrive. `reset(weights=True)`
        undoes the call.

        Args:
            of: the population, or a view of it.

        Raises:
            ModelError: weights from these neurons learn, or some of the neurons share a kernel with others.
        """
        self._values.silence(of)
        self.steered["silence"] = None

    @exclusive
    def activate(self, of: Population | View | str, rate: ArrayLike) -> None:
        """Drive neurons by independent Poisson spikes, from the next step on.

        The spikes come from the `poisson_generator` that is connected one to one to the neurons, as by
        `net.wiring(drive=...)`, with the weight of that projection. Among several generators, the one with
        a described rate of 0 is used.

        Args:
            of: the population, or a view of it.
            rate: rate of the spikes in Hz, a number for all neurons or a number for each; 0 stops the spikes.

        Raises:
            ModelError: none or several such generators drive the neurons, or a rate is below 0.
        """
        self._values.activate(self.handles.neurons(of), rate)
        self.steered["activate"] = None

    @exclusive
    def signal(self, of: Signal | str, values: ArrayLike) -> None:
        """Set a signal from the next step on: a value for all neurons of its population, or a value for each."""
        self._inputs.signal(self.handles.signal(of), values)
        self.steered["signal"] = None

    @exclusive
    def port(self, of: Population | View | Projection | Signal | str, what: str | None = None) -> Port:
        """Return a port, which sets or reads one value at every step of a closed loop faster than `set` and `get`.

        Values and errors are those of `set`, `signal`, `get` and `spikes`.

        Args:
            of: the population, a view, the projection, or the signal.
            what: name of a parameter or state of neurons, or of a state of synapses such as "weight"; None for a
                signal. Neurons also have "spikes", the ids of the neurons that fired since the port was made or last
                read, and "counts", the number of spikes of each neuron since then. `reset` and `restore` reset both.

        Raises:
            ModelError: there is no such part, the part has no such value, or its spikes are not recorded.
        """
        from neuro.run.ports import Ports

        return Ports([self], self._calls).port(of, what)

    def stepper(
        self, ms: float, emit: Sequence[Population | str] = (), count: Sequence[Population | str] = ()
    ) -> Stepper:
        """Return a stepper for control steps of `ms`: spikes in, run, counts out, in one call; see `neuro.Stepper`.

        Args:
            ms: length of a control step.
            emit: populations of spike_generator that receive spikes at each control step.
            count: populations whose spikes are counted.

        Raises:
            ModelError: there is no such population, a population of `emit` is no spike_generator, or the network has
                probes.
        """
        from neuro.run.stepper import Joined, Stepper

        return Stepper(Joined(self._run, [self._engine], [self._watch]), ms, emit, count)

    @property
    @exclusive
    def traces(self) -> dict[str, Trace]:
        """Return the traces that probes of states have recorded so far, by name, with units, as in results."""
        return self._records.traces()

    def plot(self, of: Any = None, window: tuple[float, float] | None = None) -> Figure:
        """Draw raster, rates and traces of the run so far, as `neuro.plots.overview` does.

        Args:
            of: a population or a list of populations; default: everything that is recorded.
            window: begin and end in ms; default: the whole run.

        Raises:
            ModelError: no spikes of these populations were recorded.
        """
        from neuro.plots import overview

        return overview(self, of, window=window)

    def to_neo(self) -> neo.Block:
        """Return spikes and traces so far as a Neo block, see `neuro.files.recorded.to_neo`; needs the extra `neo`."""
        from neuro.files.recorded import to_neo

        return to_neo(self)

    def to_pandas(self) -> DataFrames:
        """Return spikes, rates, traces and weights so far as data frames; needs the extra `pandas`."""
        from neuro.files.recorded import to_pandas

        return to_pandas(self)

    # trials

    @cached_property
    def _trials(self) -> TrialLoop:
        from neuro.run.trials import TrialLoop

        return TrialLoop(self._run, self._tally)

    @exclusive
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
            times: times of the input spikes in ms from the start of their trial, 0 <= t < duration, on the grid of
                steps.
            ids: neuron of the trials' input for each time.
            offsets: index in `times` of the first spike of each trial, and the number of times at the end;
                shape (trials + 1,).
            labels: the correct label of each trial; optional for rules that are not supervised.
            learn: whether the network learns from the trials.
            samples: sample of each trial, for dropout; by default each trial has its own sample.
            epoch: number of earlier passes through the data, for the decay of dropout.

        Raises:
            ModelError: the network has no trials, the batch does not fit the trials, or a state is NaN or infinite at
                the end, as in `run`.
        """
        if self.program.trials is None:
            raise ModelError("the network has no section 'trials'", hint="net.trials(input=..., duration=...) adds one")
        self.steered["trials"] = None
        results = self._trials.run(times, ids, offsets, labels, learn, samples, epoch)
        self._watch.look()
        return results

    # accounts

    @exclusive
    def counts(self) -> Counts:
        """Return the counts of spikes, updates and synaptic operations since the start or the last reset."""
        return self._tally.between(None, self._engine.counts())

    @exclusive
    def taken(self) -> TrialCounts:
        """Return the counts since the start or the last reset, in a form for sums over several runs."""
        from neuro.run.trials import TrialCounts

        return TrialCounts(0, self._engine.counts(), self._tally)

    @exclusive
    def energy(
        self,
        target: str | PathLike[str],
        of: TrialResults | TrialCounts | None = None,
        *,
        step_s: float | None = None,
        chips: int | None = None,
        duration_s: float | None = None,
        host: Iterable[HostWork] = (),
    ) -> Energy:
        """Return the energy bill of the run on a chip: counts of any backend x published figures, plus static power.

        Args:
            target: "loihi", "spinnaker", "spinnaker2", "truenorth", "cpu", "gpu", or the path of a table file.
            of: a batch of trials, or the sum of several batches; by default the whole run since the start.
            step_s: duration of a step on the chip in s, e.g. 1e-3 for a step of 1 ms in real time; default: the chip's
                own time.
            chips: number of chips that are on, e.g. all of a board; default: the number that the network needs.
            duration_s: duration of the run in real time in s; default: the duration of its steps. Use the duration of
                the recordings if their frames are shown over more steps.
            host: operations outside of the network, in addition to those of its world.

        Returns:
            The bill: `total_j`, `dynamic_j`, `static_j`, `low_j` and `high_j`, `items` with count, joules per event
            and source, `missing`, `refused`, `extrapolated`; `per(n, what)` divides it; `str` prints it.

        Raises:
            ModelError: the target does not exist, has no published costs, or is too small for the network; or
                `step_s`, `chips` or `duration_s` is out of bounds.
        """
        from neuro.chips.pricing import bill

        counts = self._engine.counts() if of is None else of.raw_counts
        self.program.refuse_share("energy")
        options: Any = {"step_s": step_s, "chips": chips, "duration_s": duration_s, "ran_on": self.backend}
        options["host"] = (*self.host_work, *host)
        return bill(self.program, counts, target, **options)

    @exclusive
    def memory(self) -> dict[str, int]:
        """Return the size of the engine in bytes, by content."""
        return self._engine.memory()

    @exclusive
    def network(self, frozen: bool = False) -> Network:
        """Return the network with the learnt weights, to be saved or compiled for another backend.

        Args:
            frozen: whether to remove learning: synapses become static, and signals are dropped.
        """
        self._synapses.check()
        from neuro.run.saved import learnt_network

        net = learnt_network(self._run)
        return net.frozen() if check(_FLAG, frozen, "network: frozen") else net

    @exclusive
    def doctor(
        self,
        ms: float = 1000.0,
        *,
        chip: str | None = None,
        train: bool = False,
        drive: float = 0.0,
        reward_after: float | None = None,
    ) -> Diagnosis:
        """Diagnose why the network in its present state does not work, see `neuro.doctor`. Nothing is changed.

        A copy runs from time 0, with the present weights and parameters, on `event` or on the emulated chip. Its inputs
        repeat the spikes that they emitted in this simulation. Values of signals are not repeated.

        Args:
            ms: length of the run, rounded up to whole steps.
            chip: name of a chip on which the network is checked, too.
            train: whether to check the gradients of training with surrogates, too.
            drive: rate in Hz of Poisson spikes for inputs that have not emitted any; 0: these inputs stay silent.
            reward_after: delay of a reward after the spikes that caused it, in ms.

        Raises:
            ModelError: an argument has a wrong type or value.
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
            diagnosis: Diagnosis = doctor.diagnose_errors(self.program.name, [error])
        else:
            diagnosis = doctor.examine(present(self._run, self.steered), options)
        return diagnosis

    # files

    @cached_property
    def _saved(self) -> Saved:
        from neuro.run.saved import Saved

        return Saved(self._run, self._records, None if self._inflow is None else self._inflow.own, self._signals)

    @exclusive
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

    @exclusive
    def restore(self, path: str | PathLike[str]) -> None:
        """Continue bit for bit from a file of `save` for the same network, backend and seed.

        Raises:
            ModelError: the file does not belong to this network, backend and seed; the simulation does not change.
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
