"""Tables of the neurons of a wiring diagram, with ids and attributes such as type and side."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core.choice import Choice
from neuro.core.errors import ModelError, unknown
from neuro.core.quantities import quantity
from neuro.core.values import shown
from neuro.model.wiring.formats import open_table
from neuro.model.wiring.tables import ANY, INT64, TEXT, UINT64, Column, Table, Texts, cell, rows

OUTSIDE_POPULATION, NOT_IN_TABLE = -1, -2
"""Values in place of the index of a neuron: for a neuron of the table that is not in the population, and for an id that
is not in the table."""

_WHOLE_NUMBER = re.compile(r"[-+]?\d+")


@dataclass(frozen=True, eq=False)
class neuron_table(Choice):
    """Neurons listed in a file, one per row: CSV with a header, Parquet, SONATA nodes, or NPZ with an array per column.

    A population created from the table has a neuron per row, in the same order, and views by columns:
    `brain.where(type="KC", side=["left", "right"])`.
    """

    kind: ClassVar[str] = "neuron_table"
    file: Any = quantity(None, "", "file of the table", kind="file")
    id: str | None = quantity(
        None,
        "",
        "column of the ids, 64-bit whole numbers or text; by default ids are counted from 0",
        kind="name",
    )
    only: Any = quantity(None, "", "rows to use: for each column a value, or a list of values", kind="words")
    key: str | None = quantity(None, "", "population of nodes in an HDF5 file", kind="name")
    types: Any = quantity(None, "", "CSV file with the attributes of SONATA node types", kind="file")

    @cached_property
    def neurons(self) -> Neurons:
        """Content of the table, read at the first access.

        Raises:
            ModelError: the table cannot be read, an id occurs twice, or no row is used.
        """
        if self.file is None:
            raise ModelError("neuron_table needs 'file': expected the name of a file", missing="file")
        return Neurons(self)


class Ids:
    """Map from ids to neurons.

    Args:
        ids: the id of each neuron, in order. None stands for ids that are counted from 0.
        n: number of neurons.
        what: name of the table or population, for messages.
    """

    def __init__(self, ids: Column | None, n: int, what: str) -> None:
        self.what, self.n = what, n
        self.kind = TEXT if isinstance(ids, Texts) else INT64 if ids is None else str(ids.dtype)
        self._words = {} if not isinstance(ids, Texts) else {ids.words[c]: k for k, c in enumerate(ids.codes.tolist())}
        self._are_consecutive = ids is None or (not isinstance(ids, Texts) and np.array_equal(ids, np.arange(n)))
        if not self._are_consecutive and not isinstance(ids, Texts):
            assert ids is not None
            self._order = np.argsort(ids, kind="stable")
            self._sorted = ids[self._order]

    def find(self, ids: Column) -> NDArray[np.int64]:
        """Return the index of the neuron with each id, or `NOT_IN_TABLE` for an unknown id."""
        if isinstance(ids, Texts):
            return ids.each(np.array([self._words.get(word, NOT_IN_TABLE) for word in ids.words], dtype=np.int64))
        if self._are_consecutive:
            return _find_consecutive(ids, self.n)
        at = np.searchsorted(self._sorted, ids)
        at[at == self.n] = 0
        neurons: NDArray[np.int64] = np.where(self._sorted[at] == ids, self._order[at], NOT_IN_TABLE)
        return neurons


def _find_consecutive(ids: Any, n: int) -> NDArray[np.int64]:
    """Return the index of the neuron with each id, for ids that are counted from 0."""
    return np.where((ids >= 0) & (ids < n), ids, NOT_IN_TABLE).astype(np.int64)


class Neurons:
    """Content of a table of neurons.

    Attributes:
        ids: map from ids to rows.
        population_rows: row in the table of each neuron of the population, shape (neurons,).
    """

    def __init__(self, definition: neuron_table) -> None:
        self._definition = definition
        self._columns: dict[str, Column] = {}
        self._table: Table = open_table(definition.file, definition.key, types=definition.types)
        if self._table.places:
            raise ModelError(f"{definition.file}: found a matrix: expected a table with a row per neuron")
        default_id = "node_id" if "node_id" in self._table.names else None
        self._id = definition.id or default_id
        first = self.column(self._id or self._table.names[0])
        if (n := len(first)) == 0:
            raise ModelError(f"{definition.file}: found no neuron: expected a row per neuron")
        column = None if self._id is None else self._as_ids(first)
        self.ids = Ids(column, n, str(definition.file))
        self._column = column
        self.population_rows = self._rows_of(definition.only or {})
        self._places = np.full(n, OUTSIDE_POPULATION, dtype=np.int64)
        self._places[self.population_rows] = np.arange(self.population_rows.size)

    @property
    def size(self) -> int:
        """Number of neurons in the population."""
        return int(self.population_rows.size)

    def find(self, ids: Column, places: bool) -> NDArray[np.int64]:
        """Return the index in the population of the neuron with each id, or `OUTSIDE_POPULATION` or `NOT_IN_TABLE`.

        Args:
            ids: ids from the rows of a file.
            places: whether `ids` are indices in the population already.
        """
        if places:
            return _find_consecutive(ids, self.size)
        table_rows = self.ids.find(ids)
        return np.where(table_rows >= 0, self._places[table_rows], NOT_IN_TABLE)

    def column(self, name: str) -> Column:
        """Return a column of the table, with all rows."""
        if name not in self._table.names:
            raise unknown("column", name, self._table.names).at(None, str(self._definition.file))
        if name not in self._columns:
            self._columns[name] = _concatenate([piece.columns[name] for piece in rows(self._table, {name: ANY})])
        return self._columns[name]

    def where(self, only: Mapping[str, Any]) -> NDArray[np.int64]:
        """Return the indices of the neurons of the population with these values in the columns.

        Raises:
            ModelError: the column, the value or a matching neuron does not exist.
        """
        is_match = np.zeros(self.ids.n, dtype=bool)
        is_match[self._rows_of(only)] = True
        neurons: NDArray[np.int64] = np.flatnonzero(is_match[self.population_rows])
        if not neurons.size:
            raise ModelError(f"{self._definition.file}: no neuron with {shown(dict(only))}: expected at least one")
        return neurons

    def shown_id(self, neuron: int) -> object:
        """Return the id of a neuron of the population, for messages."""
        row = int(self.population_rows[neuron])
        if self._column is None:
            return row
        return (
            self._column.words[self._column.codes[row]] if isinstance(self._column, Texts) else int(self._column[row])
        )

    def _rows_of(self, only: Mapping[str, Any]) -> NDArray[np.int64]:
        is_match = np.ones(self.ids.n, dtype=bool)
        for name, values in only.items():
            column = self.column(name)
            has_value = np.zeros(self.ids.n, dtype=bool)
            for value in values if isinstance(values, (list, tuple)) else (values,):
                equals_value = _equal(column, value)
                if not equals_value.any():
                    values_of_column = (
                        column.words if isinstance(column, Texts) else map(str, np.unique(column)[:1000].tolist())
                    )
                    error = unknown(f"value of column '{name}'", value, filter(None, values_of_column))
                    raise error.at(None, str(self._definition.file))
                has_value |= equals_value
            is_match &= has_value
        if not is_match.any():
            raise ModelError(f"{self._definition.file}: no neuron with {shown(dict(only))}: expected at least one")
        return np.flatnonzero(is_match)

    def _as_ids(self, column: Column) -> Column:
        """Return ids as 64-bit numbers if all are whole numbers, else as text.

        Raises:
            ModelError: an id is empty, beyond 64 bits, or occurs twice.
        """
        name, first = str(self._id), self._table.first
        if isinstance(column, Texts):
            empty = np.flatnonzero(column.each(np.array([not word for word in column.words])))
            if empty.size:
                raise cell(self._table, first + int(empty[0]), name, "", "an id")
            if all(_WHOLE_NUMBER.fullmatch(column.words[code]) for code in np.unique(column.codes).tolist()):
                numbers = [int(word) if word else 0 for word in column.words]
                low, high = min(numbers), max(numbers)
                if low < -(2**63) or high >= 2**64 or (low < 0 and high >= 2**63):
                    bad_number = low if low < -(2**63) else high
                    row = int(np.flatnonzero(column.each(np.array([number == bad_number for number in numbers])))[0])
                    raise cell(self._table, self._table.first + row, name, bad_number, "a whole number of 64 bits")
                column = column.each(np.array(numbers, dtype=INT64 if high < 2**63 else UINT64))
        elif column.dtype.kind not in "iu":
            message = f"{self._definition.file}: column '{name}' holds {column.dtype}: expected whole numbers or text"
            raise ModelError(message, path=("id",))
        else:
            column = column.astype(UINT64 if column.dtype == np.uint64 else INT64)
        values = column.codes if isinstance(column, Texts) else column
        order = np.argsort(values, kind="stable")
        repeats = np.flatnonzero(values[order][1:] == values[order][:-1])
        if repeats.size:
            first_row, second_row = (int(order[repeats[0] + k]) for k in (0, 1))
            repeated_id = (
                column.words[column.codes[second_row]] if isinstance(column, Texts) else int(column[second_row])
            )
            expected = f"another id than that of row {first + first_row}"
            raise cell(self._table, first + second_row, name, repeated_id, expected)
        return column


def _concatenate(pieces: list[Column]) -> Column:
    """Join the pieces of a column. Equal words get the same code."""
    texts = [piece for piece in pieces if isinstance(piece, Texts)]
    if not texts:
        return np.concatenate([np.asarray(piece) for piece in pieces] or [np.zeros(0)])
    codes: dict[str, int] = {}
    parts = []
    for piece in texts:
        parts.append(piece.each(np.array([codes.setdefault(word, len(codes)) for word in piece.words], dtype=np.int64)))
    return Texts(np.concatenate(parts), tuple(codes))


def _equal(column: Column, value: Any) -> NDArray[np.bool_]:
    """Return a boolean per row, true where the column has the value. Columns of text compare a number as text."""
    if isinstance(column, Texts):
        return column.each(np.array([word == str(value) for word in column.words]))
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return column == value if is_number else np.zeros(len(column), dtype=bool)
