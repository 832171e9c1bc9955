"""PyNN's populations, views, assemblies and projections, which store their values and have empty recordings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyNN import common, connectors, errors, recording
from pyNN.mock import populations as mock_populations, simulator as mock_simulator
from pyNN.parameters import ArrayParameter, LazyArray, ParameterSpace, simplify

from neuro_exchange.pynn.session import MOST_SAMPLES, SESSION, SIMULATOR
from neuro_exchange.pynn.standard import PLACEHOLDER, SYNAPSES, present


class Recorder(recording.Recorder):
    """PyNN's recorder, with results in which no neuron spikes and all states keep their initial values."""

    _simulator = SIMULATOR

    def _record(self, variable: Any, new_ids: Any, sampling_interval: Any = None) -> None:
        if sampling_interval is not None:
            self.sampling_interval = sampling_interval

    def write(self, *args: Any, **options: Any) -> None:
        """Do nothing, since there are no results."""
        SESSION.read = True

    def _get_spiketimes(self, id: Any, clear: bool = False) -> dict[int, Any]:
        SESSION.read = True
        return {}

    def _get_all_signals(self, variable: Any, ids: Any, clear: bool = False) -> tuple[Any, None]:
        SESSION.read = True
        samples = max(1, min(round(SESSION.t / self.sampling_interval) + 1, MOST_SAMPLES // max(1, len(ids))))
        initial = self.population.initial.get(variable.name)
        index = self.population.id_to_index(np.array(ids, dtype=int))
        start = np.zeros(len(ids)) if initial is None else initial[index]
        return np.tile(start, (samples, 1)), None

    def _local_count(self, variable: Any, filter_ids: Any = None) -> dict[int, int]:
        SESSION.read = True
        return {int(id): 0 for id in self.filter_recorded(variable, filter_ids)}

    def _clear_simulator(self) -> None:
        pass

    def _reset(self) -> None:
        pass


def _per_neuron(value: Any, size: int) -> NDArray[Any]:
    """Return an array with one value per neuron. A sequence of spike times is one value, which all neurons share."""
    if not isinstance(value, ArrayParameter):
        return np.array(np.broadcast_to(value, size))
    values = np.empty(size, dtype=object)
    values[:] = [value] * size
    return values


def _check_times(values: Iterable[Any]) -> None:
    if any(np.any(np.diff(sequence.value) < 0) for sequence in values):
        raise errors.InvalidParameterValueError("Spike times given to SpikeSourceArray must be in increasing order")


class Assembly(common.Assembly):
    """PyNN's assembly."""

    _simulator = SIMULATOR

    @property
    def receptor_types(self) -> list[str]:
        """The receptors that all populations have, in a fixed order; PyNN's order differs from run to run."""
        types = [set(part.celltype.receptor_types) for part in self.populations]
        return [name for name in self.populations[0].celltype.receptor_types if all(name in names for names in types)]


class _Neurons:
    """Base class of populations and views. Values are stored in the population."""

    def _selection(self) -> tuple[Any, Any]:
        """Return the population and the indices of the neurons."""
        raise NotImplementedError

    def _get_parameters(self, *names: str) -> Any:
        population, neurons = self._selection()
        values = population.values
        for name in names:
            if name not in values:
                raise errors.NonExistentParameterError(name, population.celltype.__class__.__name__, list(values))
        return ParameterSpace({name: simplify(values[name][neurons]) for name in names}, shape=(self.size,))

    _get_native_parameters = _get_parameters

    def _set_parameters(self, parameter_space: Any) -> None:
        population, neurons = self._selection()
        parameter_space.evaluate(simplify=False)
        values = {name: _per_neuron(value, self.size) for name, value in parameter_space.items()}
        is_live_source = SESSION.experiment.runs and type(population.celltype).__name__ == "SpikeSourcePoisson"
        if not (is_live_source and values.keys() == {"rate"}):
            SESSION.changed(f"parameters of population '{population.label}' are set")
        _check_times(values.get("spike_times", ()))
        for name, value in values.items():
            population.values[name][neurons] = value
        if is_live_source:
            population.rates.append((SESSION.t, population.values["rate"].copy()))

    def _set_initial_value_array(self, variable: str, initial_values: Any) -> None:
        population, neurons = self._selection()
        SESSION.changed(f"states of population '{population.label}' are set")
        initial = population.initial.setdefault(variable, np.full(population.size, np.nan))
        initial[neurons] = initial_values.evaluate(simplify=False)

    def _get_view(self, selector: Any, label: Any = None) -> Any:
        return PopulationView(self, selector, label)

    def record(self, variables: Any, *args: Any, **options: Any) -> None:
        """PyNN's `record`, with sPyNNaker's "all"."""
        if isinstance(variables, str) and variables == "all":
            variables = list(self.celltype.recordable)
        super().record(variables, *args, **options)  # type: ignore[misc]

    def __getattr__(self, name: str) -> Any:
        """Return a method of sPyNNaker's populations that does nothing."""
        if name.startswith(("_", "grandparent", "parent")) or not SESSION.experiment.spinnaker:
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
        if name == "spinnaker_get_data":
            SESSION.read = True
            return lambda variable, *args, **options: np.empty((0, 2 if variable == "spikes" else 3))
        if name.startswith(("set_", "add_", "get_")) or name in ("requires_mapping",):
            return lambda *args, **options: None
        raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")


class PopulationView(_Neurons, mock_populations.PopulationView):
    """PyNN's view."""

    _simulator = SIMULATOR
    _assembly_class = Assembly
    initial_values: dict[str, Any] = {}
    """Replaces PyNN's property, which raises an error when a view is initialised."""

    def _selection(self) -> tuple[Any, Any]:
        return self.grandparent, self.index_in_grandparent(np.arange(self.size))


class Population(_Neurons, mock_populations.Population):
    """PyNN's population.

    Attributes:
        values: values of the parameters per neuron, in PyNN's units.
        initial: initial values of the states per neuron, in PyNN's units.
        rates: times in ms at which the script sets the rates of a running Poisson source, and the rates in Hz.
        where: line of the script that makes the population.
        named: whether the script names the population.
        laid_out: whether the script sets positions of the neurons.
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
        **extra: Any,
    ) -> None:
        if extra and not SESSION.experiment.spinnaker:
            raise TypeError(f"Population.__init__() got an unexpected keyword argument '{next(iter(extra))}'")
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

    def _selection(self) -> tuple[Any, Any]:
        return self, slice(None)

    def _create_cells(self) -> None:
        ids = range(SESSION.id_counter, SESSION.id_counter + self.size)
        self.all_cells = np.array([mock_simulator.ID(id) for id in ids], dtype=mock_simulator.ID)
        self._mask_local = np.ones(self.size, dtype=bool)
        for id in self.all_cells:
            id.parent = self
        SESSION.id_counter += self.size
        parameters = self.celltype.native_parameters
        parameters.shape = (self.size,)
        parameters.evaluate(simplify=False)
        self.values = {name: _per_neuron(value, self.size) for name, value in parameters.as_dict().items()}
        _check_times(self.values.get("spike_times", ()))


Ints = NDArray[np.int64]


_by_column = LazyArray.by_column


def _columns(self: Any, mask: Any = None) -> Iterator[Any]:
    """Yield each column as an array. PyNN 0.13 indexes columns, but gives plain numbers for a single row."""
    return (column if column is True else np.atleast_1d(column) for column in _by_column(self, mask))


LazyArray.by_column = _columns


class Connection(common.Connection):
    """PyNN's view of a single synapse."""

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
        """Return attributes of the synapse."""
        return tuple(getattr(self, name) for name in names)


class Projection(common.Projection):
    """PyNN's projection, with synapses as arrays.

    Attributes:
        where: line of the script that makes the projection.
        named: whether the script names the projection.
    """

    _simulator = SIMULATOR
    _static_synapse_class = SYNAPSES["StaticSynapse"]

    def __init__(self, pre: Any, post: Any, connector: Any, synapse_type: Any = None, *args: Any, **extra: Any) -> None:
        SESSION.changed("a projection is added")
        self.where, self.named = SESSION.where(), extra.get("label") is not None
        self._synapses: list[tuple[Ints, int, dict[str, Any]]] = []
        self._ends: tuple[Ints, Ints] | None = None
        self._columns: dict[str, NDArray[np.float64]] = {}
        extra.pop("partition", None)
        connector = present(connector, lambda: connectors.FixedProbabilityConnector(0.0))
        synapse_type = present(synapse_type, SYNAPSES["StaticSynapse"])
        super().__init__(pre, post, connector, synapse_type, *args, **extra)
        connector.connect(self)
        SESSION.experiment.projections.append(self)

    def _convergent_connect(self, presynaptic_indices: Any, postsynaptic_index: Any, **parameters: Any) -> None:
        parameters.pop("location_selector", None)
        sources = np.asarray(presynaptic_indices, dtype=np.int64)
        if sources.dtype == bool:
            sources = np.flatnonzero(sources)
        self._synapses.append((np.atleast_1d(sources), int(postsynaptic_index), parameters))
        self._ends = None

    def ends(self) -> tuple[Ints, Ints]:
        """Return the indices of the synapses' neurons in `pre` and in `post`."""
        if self._ends is None:
            sources = [indices for indices, _, _ in self._synapses]
            counts = [len(indices) for indices in sources]
            targets = np.repeat(np.array([target for _, target, _ in self._synapses], dtype=np.int64), counts)
            self._ends = np.concatenate(sources) if sources else np.empty(0, dtype=np.int64), targets
        return self._ends

    def numbers(self) -> Iterable[str]:
        """Return the names of the synapses' parameters."""
        return self._synapses[0][2] if self._synapses else ()

    def column(self, name: str) -> NDArray[np.float64]:
        """Return a parameter of all synapses in PyNN's unit. The array can be changed in place."""
        column = self._columns.get(name)
        if column is None or column.size != len(self):
            parts = [np.broadcast_to(np.asarray(p[name], dtype=float), len(s)) for s, _, p in self._synapses]
            self._columns[name] = column = np.concatenate(parts) if parts else np.empty(0)
        return column

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
        """Iterator of the single synapses."""
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
        columns = [ends[name] if name in ends else self.column(self._parameter_name(name)) for name in names]
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def _get_attributes_as_arrays(self, names: Any, multiple_synapses: str = "sum") -> list[Any]:
        SESSION.read = SESSION.read or bool(SESSION.experiment.runs)
        arrays = []
        for name in names:
            values, (pre, post) = np.full(self.shape, np.nan), self.ends()
            column = self.column(self._parameter_name(name))
            if multiple_synapses == "last":
                values[pre, post] = column
            elif multiple_synapses == "first":
                values[pre[::-1], post[::-1]] = column[::-1]
            else:
                ufunc = {"sum": np.add, "min": np.minimum, "max": np.maximum}[multiple_synapses]
                values[pre, post] = {"sum": 0.0, "min": np.inf, "max": -np.inf}[multiple_synapses]
                ufunc.at(values, (pre, post), column)
            arrays.append(values)
        return arrays

    def _parameter_name(self, name: str) -> str:
        """Return the name of a parameter. Old scripts use the plural, e.g. "weights"."""
        names = set(self.synapse_type.get_parameter_names())
        return name[:-1] if name not in names and name[:-1] in names else name
