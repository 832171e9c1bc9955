"""PyNN's populations, views, assemblies and projections: their values are kept, and their recordings are empty."""

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

_ANSWERS = ("get_data", "get_spike_counts", "mean_spike_count", "spinnaker_get_data")


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
        samples = max(1, min(round(SESSION.t / self.sampling_interval) + 1, MOST_SAMPLES // max(1, len(ids))))
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
            whole.rates.append((SESSION.t, whole.values["rate"].copy()))

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
        ids = range(SESSION.id_counter, SESSION.id_counter + self.size)
        self.all_cells = np.array([mock_simulator.ID(id) for id in ids], dtype=mock_simulator.ID)
        self._mask_local = np.ones(self.size, dtype=bool)
        for id in self.all_cells:
            id.parent = self
        SESSION.id_counter += self.size
        parameters = self.celltype.native_parameters
        parameters.shape = (self.size,)
        parameters.evaluate(simplify=False)
        self.values = {name: _each(value, self.size) for name, value in parameters.as_dict().items()}
        _check_times(self.values.get("spike_times", ()))


Ints = NDArray[np.int64]


_by_column = LazyArray.by_column


def _columns(self: Any, mask: Any = None) -> Iterator[Any]:
    """A column of one row is an array, too: PyNN 0.13 asks it for indices, which NumPy 2.4 refuses of a number."""
    return (column if column is True else np.atleast_1d(column) for column in _by_column(self, mask))


LazyArray.by_column = _columns


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
