"""PyNN's projections: their synapses are kept as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyNN import common, connectors
from pyNN.parameters import LazyArray

from neuro.exchange.pynn.clock import SIMULATOR
from neuro.exchange.pynn.session import SESSION
from neuro.exchange.pynn.standard import SYNAPSES, present

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
