"""A simulator of PyNN that simulates nothing: it keeps what a script builds, and answers as if no neuron had fired.

It subclasses PyNN's own common classes, so names, checks, connectors and random numbers are PyNN's. Only the process of
the script imports it, see `confined`.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyNN import common, connectors, core, errors, random, recording, space, standardmodels
from pyNN.mock import populations as mock_populations, simulator as mock_simulator
from pyNN.network import Network
from pyNN.parameters import ArrayParameter, LazyArray, ParameterSpace, simplify
from pyNN.standardmodels import build_translations, cells, electrodes, synapses

from neuro.core.errors import Where

Ints = NDArray[np.int64]
_MOST_SAMPLES = 1_000_000
"""Of a recorded signal that a script reads; a longer one is read as constant at its first so many samples."""
_ANSWERS = ("get_data", "get_spike_counts", "mean_spike_count", "spinnaker_get_data")


@dataclass
class Experiment:
    """What a script builds between two calls of `setup`.

    Attributes:
        where: of `setup`.
        timestep, min_delay: ms.
        spinnaker: whether it is written for sPyNNaker, where weights have no sign.
        runs: ms, one for each call of `run`.
        live: what the script did since it ran; if it runs on, this belongs to no network.
        problems: what cannot come, by line.
        notes: what is otherwise here, by line.
    """

    where: Where | None = None
    timestep: float = 0.1
    min_delay: float = 0.1
    spinnaker: bool = False
    populations: list[Any] = field(default_factory=list)
    projections: list[Any] = field(default_factory=list)
    currents: list[tuple[Any, list[int], Where | None]] = field(default_factory=list)
    runs: list[float] = field(default_factory=list)
    live: list[tuple[Where | None, str]] = field(default_factory=list)
    problems: list[tuple[Where | None, str]] = field(default_factory=list)
    notes: list[tuple[Where | None, str]] = field(default_factory=list)


class Session:
    """The run of one script.

    Attributes:
        files: beginnings of names of files whose lines are the script's.
        experiment: what is being built.
        finish: is called with an experiment that begins to run.
        close: is called when it has run.
        read: whether the script has read results.
    """

    def __init__(self) -> None:
        self.files: tuple[str, ...] = ()
        self.script = ""
        self.experiment = Experiment()
        self.finish: Callable[[Experiment], None] = lambda experiment: None
        self.close: Callable[[], None] = lambda: None
        self.captured = False
        self.read = False

    def where(self) -> Where | None:
        """The line of the script that is being run."""
        frame: Any = sys._getframe(1)
        while frame is not None:
            name = frame.f_code.co_filename
            if name.startswith(self.files):
                return Where(self.script if name == self.files[0] else name.rpartition("/")[2], frame.f_lineno)
            frame = frame.f_back
        return None

    def problem(self, message: str) -> None:
        """What cannot come, at the line that is being run."""
        entry = (self.where(), message)
        if entry not in self.experiment.problems:
            self.experiment.problems.append(entry)

    def note(self, message: str) -> None:
        """What is otherwise here, at the line that is being run."""
        entry = (self.where(), message)
        if entry not in self.experiment.notes:
            self.experiment.notes.append(entry)

    def changed(self, what: str) -> None:
        """The script changes the network: after a run this is a live change, before it another network."""
        if self.experiment.runs:
            self.experiment.live.append((self.where(), what))
        else:
            self.captured = False

    def capture(self) -> None:
        """The network is complete: it runs, or another one begins."""
        if not self.captured and self.experiment.populations:
            self.captured = True
            self.finish(self.experiment)


SESSION = Session()


_by_column = LazyArray.by_column


def _columns(self: Any, mask: Any = None) -> Iterator[Any]:
    """A column of one row is an array, too: PyNN 0.13 asks it for indices, which NumPy 2.4 refuses of a number."""
    return (column if column is True else np.atleast_1d(column) for column in _by_column(self, mask))


LazyArray.by_column = _columns


class Absent:
    """What a simulator has and this language has not."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __call__(self, *args: Any, **words: Any) -> Absent:
        """Note the line that uses it."""
        SESSION.problem(f"{self._name} has no counterpart")
        return self

    def __getattr__(self, name: str) -> Absent:
        if name.startswith("__"):
            raise AttributeError(name)
        return Absent(f"{self._name}.{name}")

    def __iter__(self) -> Iterator[Any]:
        return iter(())


def present(part: Any, instead: Any) -> Any:
    """The part, or another so that the script goes on; that it is absent is a problem."""
    return instead() if isinstance(part, Absent) and part() else part


class State(mock_simulator.State):
    """The clock of the simulator."""

    def run(self, simtime: float) -> None:
        """Pass time."""
        self.run_until(self.t + simtime)

    def run_until(self, tstop: float) -> None:
        """Pass time; what the script has changed since it ran cannot be part of a network."""
        experiment = SESSION.experiment
        SESSION.capture()
        if STATE.min_delay == "auto":
            delays = [one.column("delay").min() for one in experiment.projections if len(one)]
            STATE.min_delay = min(delays, default=self.dt)
        if tstop > self.t:
            live = ((where, f"{what} while the network runs") for where, what in experiment.live)
            experiment.problems += [one for one in dict.fromkeys(live) if one not in experiment.problems]
            experiment.live.clear()
            experiment.runs.append(tstop - self.t)
        super().run_until(tstop)

    def written_for_spinnaker(self) -> None:
        """The script imports sPyNNaker, whose steps last 1 ms unless it says so."""
        experiment = SESSION.experiment
        if not experiment.spinnaker:
            experiment.spinnaker, experiment.timestep, experiment.min_delay = True, 1.0, 1.0
            self.dt = 1.0


STATE: Any = State()
SIMULATOR = SimpleNamespace(state=STATE, ID=mock_simulator.ID, name="neuro")


def setup(timestep: Any = None, min_delay: Any = "auto", **extra: Any) -> int:
    """PyNN's `setup`: a network begins."""
    SESSION.capture()
    SESSION.close()
    spinnaker = SESSION.experiment.spinnaker
    step = float((1.0 if spinnaker else 0.1) if timestep is None else timestep)
    smallest = step if min_delay in ("auto", None) else float(min_delay)
    common.setup(step, min_delay if min_delay is not None else "auto", **extra)
    before = SESSION.experiment
    SESSION.experiment = Experiment(SESSION.where(), step, max(smallest, step), spinnaker)
    if not before.populations:
        SESSION.experiment.problems, SESSION.experiment.notes = before.problems, before.notes
    SESSION.captured = False
    STATE.clear()
    STATE.dt, STATE.min_delay, STATE.max_delay = step, min_delay, extra.get("max_delay", "auto")
    return 0


def end(compatible_output: bool = True) -> None:
    """PyNN's `end`."""
    SESSION.capture()


def _until(time: Any) -> bool:
    if time is not None and np.isfinite(time):
        return False
    SESSION.capture()
    SESSION.note("runs without an end")
    return True


_run, _run_until = common.build_run(SIMULATOR)


def run(simtime: Any, callbacks: Any = None) -> float:
    """PyNN's `run`."""
    return float(STATE.t if _until(simtime) else _run(simtime, callbacks))


def run_until(time_point: Any, callbacks: Any = None) -> float:
    """PyNN's `run_until`."""
    return float(STATE.t if _until(time_point) else _run_until(time_point, callbacks))


_reset = common.build_reset(SIMULATOR)


def reset(annotations: Any = None) -> None:
    """PyNN's `reset`: the network begins anew, and what is changed from now on makes another one."""
    _reset(annotations or {})
    SESSION.close()
    was = SESSION.experiment
    SESSION.experiment = replace(was, where=SESSION.where(), runs=[], live=[])
    SESSION.captured = SESSION.captured and not was.live


# -- cells, synapses and sources -------------------------------------------------------------------------------------


def _as_it_is(kind: Any, **words: Any) -> Any:
    """A class of PyNN's whose parameters keep PyNN's names and units."""
    names = build_translations(*((word, word) for word in kind.default_parameters))
    return type(kind.__name__, (kind,), {"translations": names, "standard_receptor_type": True, **words})


def _standard(module: Any, base: Any) -> dict[str, Any]:
    found = (kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, base))
    return {kind.__name__: kind for kind in found if getattr(kind, "default_parameters", None)}


CELLS = {name: _as_it_is(kind) for name, kind in _standard(cells, standardmodels.StandardCellType).items()}
PLACEHOLDER = type(
    "Placeholder",
    (CELLS["IF_curr_exp"],),
    {
        "can_record": lambda self, *variable: True,
        "units": defaultdict(lambda: "mV"),
        "receptor_types": ("excitatory", "inhibitory", "reward", "punishment"),
    },
)
"""Stands for cells that are absent, so that the script goes on."""
CELLS = {name: kind for name, kind in CELLS.items() if name not in ("PointNeuron", "MultiCompartmentNeuron")}


class Delayed:
    """A synapse without a delay has the smallest."""

    def _get_minimum_delay(self) -> float:
        return SESSION.experiment.min_delay


_PLAIN = {
    name: kind
    for name, kind in _standard(synapses, standardmodels.StandardSynapseType).items()
    if name != "STDPMechanism"
}
SYNAPSES = {name: _as_it_is(type(name, (Delayed, kind), {})) for name, kind in _PLAIN.items()}
_BASES = (standardmodels.STDPWeightDependence, standardmodels.STDPTimingDependence)
DEPENDENCES = {name: _as_it_is(kind) for base in _BASES for name, kind in _standard(synapses, base).items()}


class STDPMechanism(Delayed, synapses.STDPMechanism):
    """PyNN's STDP."""

    base_translations = build_translations(*((word, word) for word in ("weight", "delay", "dendritic_delay_fraction")))

    def __init__(self, timing_dependence: Any = None, weight_dependence: Any = None, *args: Any, **words: Any) -> None:
        if not words.pop("backprop_delay", True):  # sPyNNaker's
            SESSION.problem("'backprop_delay' is False: here a delay is dendritic")
        timing = present(timing_dependence, DEPENDENCES["SpikePairRule"])
        weight = present(weight_dependence, DEPENDENCES["AdditiveWeightDependence"])
        super().__init__(timing, weight, *args, **words)

    def _build_translations(self) -> None:
        self.translations = dict(self.base_translations)
        for component in (self.timing_dependence, self.weight_dependence):
            self.translations.update(component.translations if component else {})


class _Source:
    def __init__(self, **parameters: Any) -> None:
        parameters.pop("rng", None)
        times = np.asarray(parameters.get("times", ()), dtype=float)
        if np.any(np.diff(times, prepend=-np.finfo(float).tiny) <= 0) or np.any(times < 0):
            raise ValueError("Step current timestamps should be monotonically increasing, and not negative.")
        space = ParameterSpace(self.default_parameters, self.get_schema(), shape=(1,))  # type: ignore[attr-defined]
        space.update(**parameters)
        object.__setattr__(self, "_kept", space)

    def inject_into(self, cells: Any) -> None:
        """Keep which neurons receive it."""
        if any(not cell.celltype.injectable for cell in cells):
            raise TypeError("Can't inject current into a spike source.")
        SESSION.changed("a current is injected")
        SESSION.experiment.currents.append((self, [int(cell) for cell in cells], SESSION.where()))

    def set_native_parameters(self, parameters: Any) -> None:
        """Change its parameters."""
        SESSION.changed("a current is changed")
        self._kept.update(**dict(parameters.items()))  # type: ignore[attr-defined]

    def get_native_parameters(self) -> Any:
        """Its parameters."""
        return self._kept  # type: ignore[attr-defined]

    def record(self) -> None:
        """Record nothing."""

    def _get_data(self) -> tuple[Any, Any]:
        SESSION.read = True
        times = np.arange(min(_MOST_SAMPLES, round(STATE.t / STATE.dt) + 1)) * STATE.dt
        return times, np.zeros(times.size)

    def values(self) -> dict[str, Any]:
        """Its parameters, numbers and arrays."""
        self._kept.evaluate(simplify=True)  # type: ignore[attr-defined]
        found = self._kept.as_dict()  # type: ignore[attr-defined]
        return {name: getattr(value, "value", value) for name, value in found.items()}


SOURCES = {
    name: _as_it_is(type(name, (_Source, kind), {}))
    for name, kind in _standard(electrodes, standardmodels.StandardCurrentSource).items()
}


# -- populations -----------------------------------------------------------------------------------------------------


class Recorder(recording.Recorder):
    """Keeps what is recorded, and reads as if no neuron had fired and no state had changed."""

    _simulator = SIMULATOR

    def _record(self, variable: Any, new_ids: Any, sampling_interval: Any = None) -> None:
        if sampling_interval is not None:
            self.sampling_interval = sampling_interval

    def write(self, *args: Any, **words: Any) -> None:
        """Write no file of results, since there are none."""
        SESSION.read = True

    def _get_spiketimes(self, id: Any, clear: bool = False) -> dict[int, Any]:
        SESSION.read = True
        return {}

    def _get_all_signals(self, variable: Any, ids: Any, clear: bool = False) -> tuple[Any, None]:
        SESSION.read = True
        samples = max(1, min(round(STATE.t / self.sampling_interval) + 1, _MOST_SAMPLES // max(1, len(ids))))
        kept = self.population.initial.get(variable.name)
        index = self.population.id_to_index(np.array(ids, dtype=int))
        start = np.zeros(len(ids)) if kept is None else kept[index]
        return np.tile(start, (samples, 1)), None

    def _local_count(self, variable: Any, filter_ids: Any = None) -> dict[int, int]:
        SESSION.read = True
        return {int(id): 0 for id in self.filter_recorded(variable, filter_ids)}

    def _clear_simulator(self) -> None:
        pass

    def _reset(self) -> None:
        pass


def _each(value: Any, size: int) -> NDArray[Any]:
    """One value for each neuron; a sequence of times is one value."""
    if not isinstance(value, ArrayParameter):
        return np.array(np.broadcast_to(value, size))
    found = np.empty(size, dtype=object)
    found[:] = [value] * size
    return found


def _check_times(values: Iterable[Any]) -> None:
    if any(np.any(np.diff(one.value) < 0) for one in values):
        raise errors.InvalidParameterValueError("Spike times given to SpikeSourceArray must be in increasing order")


class Assembly(common.Assembly):
    """PyNN's assembly."""

    _simulator = SIMULATOR

    @property
    def receptor_types(self) -> list[str]:
        """The receptors that all have, in their order; PyNN's is that of a set, which differs from run to run."""
        others = [set(part.celltype.receptor_types) for part in self.populations]
        return [one for one in self.populations[0].celltype.receptor_types if all(one in each for each in others)]


class _Neurons:
    """What a population and a view of one have in common; values lie with the population."""

    def _whole(self) -> tuple[Any, Any]:
        """The population, and which of its neurons are meant."""
        raise NotImplementedError

    def _get_parameters(self, *names: str) -> Any:
        whole, chosen = self._whole()
        known = whole.values
        for name in names:
            if name not in known:
                raise errors.NonExistentParameterError(name, whole.celltype.__class__.__name__, list(known))
        return ParameterSpace({name: simplify(known[name][chosen]) for name in names}, shape=(self.size,))

    _get_native_parameters = _get_parameters

    def _set_parameters(self, parameter_space: Any) -> None:
        whole, chosen = self._whole()
        parameter_space.evaluate(simplify=False)
        given = {name: _each(value, self.size) for name, value in parameter_space.items()}
        scheduled = SESSION.experiment.runs and type(whole.celltype).__name__ == "SpikeSourcePoisson"
        if not (scheduled and given.keys() == {"rate"}):
            SESSION.changed(f"parameters of population '{whole.label}' are set")
        _check_times(given.get("spike_times", ()))
        for name, value in given.items():
            whole.values[name][chosen] = value
        if scheduled:
            whole.rates.append((STATE.t, whole.values["rate"].copy()))

    def _set_initial_value_array(self, variable: str, initial_values: Any) -> None:
        whole, chosen = self._whole()
        SESSION.changed(f"states of population '{whole.label}' are set")
        kept = whole.initial.setdefault(variable, np.full(whole.size, np.nan))
        kept[chosen] = initial_values.evaluate(simplify=False)

    def _get_view(self, selector: Any, label: Any = None) -> Any:
        return PopulationView(self, selector, label)

    def record(self, variables: Any, *args: Any, **words: Any) -> None:
        """PyNN's `record`; "all" is sPyNNaker's."""
        if isinstance(variables, str) and variables == "all":
            variables = list(self.celltype.recordable)
        super().record(variables, *args, **words)  # type: ignore[misc]

    def __getattr__(self, name: str) -> Any:
        """What only sPyNNaker's populations have."""
        if name.startswith(("_", "grandparent", "parent")) or not SESSION.experiment.spinnaker:
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
        if name == "spinnaker_get_data":
            SESSION.read = True
            return lambda variable, *args, **words: np.empty((0, 2 if variable == "spikes" else 3))
        if name.startswith(("set_", "add_", "get_")) or name in ("requires_mapping",):
            return lambda *args, **words: None
        raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")


class PopulationView(_Neurons, mock_populations.PopulationView):
    """PyNN's view."""

    _simulator = SIMULATOR
    _assembly_class = Assembly
    initial_values: dict[str, Any] = {}
    """PyNN's own raises an error, also where a view is initialised."""

    def _whole(self) -> tuple[Any, Any]:
        return self.grandparent, self.index_in_grandparent(np.arange(self.size))


class Population(_Neurons, mock_populations.Population):
    """PyNN's population.

    Attributes:
        values: by parameter, one value for each neuron, in PyNN's units.
        initial: by state, likewise.
        rates: of a Poisson source, those that are set while it runs, each with the time.
        where: the line of the script that makes it.
        named: whether the script gives it a label.
    """

    _simulator = SIMULATOR
    _recorder_class = Recorder
    _assembly_class = Assembly

    def __init__(
        self,
        size: Any,
        cellclass: Any,
        cellparams: Any = None,
        structure: Any = None,
        initial_values: Any = None,
        label: str | None = None,
        **words: Any,
    ) -> None:
        if words and not SESSION.experiment.spinnaker:
            raise TypeError(f"Population.__init__() got an unexpected keyword argument '{next(iter(words))}'")
        SESSION.changed("a population is added")
        self.where, self.named = SESSION.where(), label is not None
        self.values: dict[str, Any] = {}
        self.initial: dict[str, Any] = {}
        self.rates: list[tuple[float, Any]] = []
        if SESSION.experiment.spinnaker and isinstance(size, float):
            size = int(np.ceil(size))
        if isinstance(cellclass, type):
            cellclass, cellparams = cellclass(**(cellparams or {})), None
        cellclass = present(cellclass, PLACEHOLDER)
        super().__init__(size, cellclass, cellparams, structure, initial_values or {}, label)
        self.laid_out = structure is not None or isinstance(size, tuple)
        SESSION.experiment.populations.append(self)

    def _whole(self) -> tuple[Any, Any]:
        return self, slice(None)

    def _create_cells(self) -> None:
        ids = range(STATE.id_counter, STATE.id_counter + self.size)
        self.all_cells = np.array([mock_simulator.ID(id) for id in ids], dtype=mock_simulator.ID)
        self._mask_local = np.ones(self.size, dtype=bool)
        for id in self.all_cells:
            id.parent = self
        STATE.id_counter += self.size
        parameters = self.celltype.native_parameters
        parameters.shape = (self.size,)
        parameters.evaluate(simplify=False)
        self.values = {name: _each(value, self.size) for name, value in parameters.as_dict().items()}
        _check_times(self.values.get("spike_times", ()))


# -- projections -----------------------------------------------------------------------------------------------------


class Connection(common.Connection):
    """One synapse, as PyNN shows it."""

    def __init__(self, projection: Projection, index: int) -> None:
        object.__setattr__(self, "_at", (projection, index))

    def __getattr__(self, name: str) -> Any:
        projection, index = self._at
        if name in ("presynaptic_index", "postsynaptic_index"):
            return int(projection.ends()[name == "postsynaptic_index"][index])
        if name in ("presynaptic_cell", "source"):
            return projection.pre.all_cells[self.presynaptic_index]
        if name in ("postsynaptic_cell", "target"):
            return projection.post.all_cells[self.postsynaptic_index]
        if name not in projection.numbers():
            raise AttributeError(name)
        return float(projection.column(name)[index])

    def __setattr__(self, name: str, value: Any) -> None:
        projection, index = self._at
        SESSION.changed(f"a synapse of projection '{projection.label}' is set")
        projection.column(name)[index] = value

    def as_tuple(self, *names: str) -> tuple[Any, ...]:
        """Its attributes."""
        return tuple(getattr(self, name) for name in names)


class Projection(common.Projection):
    """PyNN's projection; synapses are kept as arrays.

    Attributes:
        where: the line of the script that makes it.
        named: whether the script gives it a label.
    """

    _simulator = SIMULATOR
    _static_synapse_class = SYNAPSES["StaticSynapse"]

    def __init__(self, pre: Any, post: Any, connector: Any, synapse_type: Any = None, *args: Any, **words: Any) -> None:
        SESSION.changed("a projection is added")
        self.where, self.named = SESSION.where(), words.get("label") is not None
        self._made: list[tuple[Ints, int, dict[str, Any]]] = []
        self._ends: tuple[Ints, Ints] | None = None
        self._columns: dict[str, NDArray[np.float64]] = {}
        words.pop("partition", None)
        connector = present(connector, lambda: connectors.FixedProbabilityConnector(0.0))
        synapse_type = present(synapse_type, SYNAPSES["StaticSynapse"])
        super().__init__(pre, post, connector, synapse_type, *args, **words)
        connector.connect(self)
        SESSION.experiment.projections.append(self)

    def _convergent_connect(self, presynaptic_indices: Any, postsynaptic_index: Any, **parameters: Any) -> None:
        parameters.pop("location_selector", None)
        sources = np.asarray(presynaptic_indices, dtype=np.int64)
        if sources.dtype == bool:
            sources = np.flatnonzero(sources)
        self._made.append((np.atleast_1d(sources), int(postsynaptic_index), parameters))
        self._ends = None

    def ends(self) -> tuple[Ints, Ints]:
        """Of each synapse its places in `pre` and in `post`."""
        if self._ends is None:
            sources = [made[0] for made in self._made]
            counts = [len(one) for one in sources]
            targets = np.repeat(np.array([made[1] for made in self._made], dtype=np.int64), counts)
            self._ends = np.concatenate(sources) if sources else np.empty(0, dtype=np.int64), targets
        return self._ends

    def numbers(self) -> Iterable[str]:
        """The parameters of its synapses."""
        return self._made[0][2] if self._made else ()

    def column(self, name: str) -> NDArray[np.float64]:
        """A parameter of all synapses, in PyNN's unit; what is written into it stays."""
        found = self._columns.get(name)
        if found is None or found.size != len(self):
            parts = [np.broadcast_to(np.asarray(p[name], dtype=float), len(s)) for s, _, p in self._made]
            self._columns[name] = found = np.concatenate(parts) if parts else np.empty(0)
        return found

    def __len__(self) -> int:
        return int(self.ends()[0].size)

    def __getitem__(self, i: Any) -> Any:
        if isinstance(i, slice):
            return [Connection(self, k) for k in range(*i.indices(len(self)))]
        if not -len(self) <= i < len(self):
            raise IndexError(i)
        return Connection(self, i % len(self))

    @property
    def connections(self) -> Iterable[Connection]:
        """Its synapses one by one."""
        return (Connection(self, k) for k in range(len(self)))

    def _set_attributes(self, parameter_space: Any) -> None:
        SESSION.changed(f"synapses of projection '{self.label}' are set")
        pre, post = self.ends()
        parameter_space.evaluate(simplify=False)
        for name, value in parameter_space.as_dict().items():
            self.column(name)[:] = value[pre, post]

    def _set_initial_value_array(self, variable: str, value: Any) -> None:
        SESSION.problem(f"projection '{self.label}': the state '{variable}' of its synapses is set")

    def _get_attributes_as_list(self, names: Any) -> list[tuple[Any, ...]]:
        SESSION.read = SESSION.read or bool(SESSION.experiment.runs)
        ends = dict(zip(("presynaptic_index", "postsynaptic_index"), self.ends(), strict=True))
        columns = [ends[name] if name in ends else self.column(self._named(name)) for name in names]
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def _get_attributes_as_arrays(self, names: Any, multiple_synapses: str = "sum") -> list[Any]:
        SESSION.read = SESSION.read or bool(SESSION.experiment.runs)
        found = []
        for name in names:
            values, (pre, post) = np.full(self.shape, np.nan), self.ends()
            column = self.column(self._named(name))
            if multiple_synapses == "last":
                values[pre, post] = column
            elif multiple_synapses == "first":
                values[pre[::-1], post[::-1]] = column[::-1]
            else:
                at = {"sum": np.add, "min": np.minimum, "max": np.maximum}[multiple_synapses]
                values[pre, post] = {"sum": 0.0, "min": np.inf, "max": -np.inf}[multiple_synapses]
                at.at(values, (pre, post), column)
            found.append(values)
        return found

    def _named(self, name: str) -> str:
        """The parameter of a name, which old scripts write in the plural."""
        known = set(self.synapse_type.get_parameter_names())
        return name[:-1] if name not in known and name[:-1] in known else name


# -- the module ------------------------------------------------------------------------------------------------------


def list_standard_models() -> list[str]:
    """Names of the cells."""
    return list(CELLS)


def public_names() -> dict[str, Any]:
    """What a module of PyNN for one simulator offers, by name."""
    queries = common.build_state_queries(SIMULATOR)
    words = ("get_current_time", "get_time_step", "get_min_delay", "get_max_delay", "num_processes", "rank")
    kinds = {name: kind for name, kind in vars(connectors).items() if name.endswith("Connector")}
    ours = (
        *(setup, end, run, run_until, reset, list_standard_models),
        *(STDPMechanism, Population, PopulationView, Assembly, Projection),
    )
    return {
        **kinds,
        **{one.__name__: one for one in ours},
        **dict(zip(words, queries, strict=True)),
        **{"run_for": run, "initialize": common.initialize, "set": common.set},
        "create": common.build_create(Population),
        "connect": common.build_connect(Projection, connectors.FixedProbabilityConnector, SYNAPSES["StaticSynapse"]),
        "record": (record := common.build_record(SIMULATOR)),
        "record_v": lambda source, filename: record(["v"], source, filename),
        "record_gsyn": lambda source, filename: record(["gsyn_exc", "gsyn_inh"], source, filename),
        **CELLS,
        **SYNAPSES,
        **DEPENDENCES,
        **SOURCES,
        **{"space": space, "random": random, "errors": errors, "core": core, "Space": space.Space},
        **{"NumpyRNG": random.NumpyRNG, "GSLRNG": random.GSLRNG, "RandomDistribution": random.RandomDistribution},
        **{"NativeRNG": random.NumpyRNG, "StandardCellType": standardmodels.StandardCellType},
        **{"Line": space.Line, "Grid2D": space.Grid2D, "Grid3D": space.Grid3D},
        **{"state": STATE, "Network": Network},
    }
