"""The table of the neurons of a wiring diagram: which id, type and side each has."""

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

ELSEWHERE, NOWHERE = -1, -2
"""In place of a neuron: one of the table that is not in the population; none of the table."""

_WHOLE = re.compile(r"[-+]?\d+")


@dataclass(frozen=True, eq=False)
class neuron_table(Choice):
    """Neurons listed in a file, a row for each: CSV with a header, parquet, nodes of SONATA, or npz with a column each.

    A population made from it has a neuron for each row, in their order, and views by its columns:
    `brain.where(type="KC", side=["left", "right"])`.
    """

    kind: ClassVar[str] = "neuron_table"
    file: Any = quantity(None, "", "the table", kind="file")
    id: str | None = quantity(
        None,
        "",
        "column of the ids, whole numbers of 64 bits or text; counted from 0 if not given",
        kind="name",
    )
    only: Any = quantity(None, "", "column: value, or a list of values: the rows that are taken", kind="words")
    key: str | None = quantity(None, "", "of HDF5: the population of nodes", kind="name")
    types: Any = quantity(None, "", "of SONATA: the CSV with the attributes of node types", kind="file")

    @cached_property
    def neurons(self) -> Neurons:
        """The table, read once.

        Raises:
            ModelError: it cannot be read, an id stands there twice, or nothing is taken.
        """
        if self.file is None:
            raise ModelError("neuron_table needs 'file': expected the name of a file", missing="file")
        return Neurons(self)


class Ids:
    """Neurons by their ids.

    Args:
        ids: of each neuron, in order; None: they are counted from 0.
        n: how many there are.
        what: has them, for messages.
    """

    def __init__(self, ids: Column | None, n: int, what: str) -> None:
        self.what, self.n = what, n
        self.kind = TEXT if isinstance(ids, Texts) else INT64 if ids is None else str(ids.dtype)
        self._words = {} if not isinstance(ids, Texts) else {ids.words[c]: k for k, c in enumerate(ids.codes.tolist())}
        self._counted = ids is None or (not isinstance(ids, Texts) and np.array_equal(ids, np.arange(n)))
        if not self._counted and not isinstance(ids, Texts):
            assert ids is not None
            self._order = np.argsort(ids, kind="stable")
            self._sorted = ids[self._order]

    def find(self, ids: Column) -> NDArray[np.int64]:
        """The neuron of each id, `NOWHERE` where there is none."""
        if isinstance(ids, Texts):
            return ids.each(np.array([self._words.get(word, NOWHERE) for word in ids.words], dtype=np.int64))
        if self._counted:
            return _counted(ids, self.n)
        at = np.searchsorted(self._sorted, ids)
        at[at == self.n] = 0
        found: NDArray[np.int64] = np.where(self._sorted[at] == ids, self._order[at], NOWHERE)
        return found


def _counted(ids: Any, n: int) -> NDArray[np.int64]:
    """The neuron of each id, where ids count from 0."""
    return np.where((ids >= 0) & (ids < n), ids, NOWHERE).astype(np.int64)


class Neurons:
    """What a table of neurons holds.

    Attributes:
        ids: finds the row of an id.
        taken: the rows that are neurons of the population, in order.
    """

    def __init__(self, said: neuron_table) -> None:
        self._said = said
        self._columns: dict[str, Column] = {}
        self._table: Table = open_table(said.file, said.key, types=said.types)
        if self._table.places:
            raise ModelError(f"{said.file}: a matrix: expected a table of neurons, a row for each")
        by_default = "node_id" if "node_id" in self._table.names else None
        self._id = said.id or by_default
        first = self.column(self._id or self._table.names[0])
        if (n := len(first)) == 0:
            raise ModelError(f"{said.file}: found no neuron: expected a row for each")
        column = None if self._id is None else self._as_ids(first)
        self.ids = Ids(column, n, str(said.file))
        self._column = column
        self.taken = self._rows_of(said.only or {})
        self._places = np.full(n, ELSEWHERE, dtype=np.int64)
        self._places[self.taken] = np.arange(self.taken.size)

    @property
    def size(self) -> int:
        """How many neurons the population has."""
        return int(self.taken.size)

    def find(self, ids: Column, places: bool) -> NDArray[np.int64]:
        """The neuron of the population with each id, `ELSEWHERE` or `NOWHERE` where it has none.

        Args:
            ids: of the rows of a file.
            places: whether they are places among the neurons of the population instead.
        """
        if places:
            return _counted(ids, self.size)
        rows_ = self.ids.find(ids)
        return np.where(rows_ >= 0, self._places[rows_], NOWHERE)

    def column(self, name: str) -> Column:
        """A column of all rows."""
        if name not in self._table.names:
            raise unknown("column", name, self._table.names).at(None, str(self._said.file))
        if name not in self._columns:
            self._columns[name] = _joined([piece.columns[name] for piece in rows(self._table, {name: ANY})])
        return self._columns[name]

    def where(self, only: Mapping[str, Any]) -> NDArray[np.int64]:
        """The neurons of the population whose columns have these values.

        Raises:
            ModelError: there is no such column or value, or no such neuron.
        """
        among = np.zeros(self.ids.n, dtype=bool)
        among[self._rows_of(only)] = True
        found: NDArray[np.int64] = np.flatnonzero(among[self.taken])
        if not found.size:
            raise ModelError(f"{self._said.file}: no neuron with {shown(dict(only))}: expected at least one")
        return found

    def shown_id(self, neuron: int) -> object:
        """The id of a neuron of the population, for messages."""
        row = int(self.taken[neuron])
        if self._column is None:
            return row
        return (
            self._column.words[self._column.codes[row]] if isinstance(self._column, Texts) else int(self._column[row])
        )

    def _rows_of(self, only: Mapping[str, Any]) -> NDArray[np.int64]:
        chosen = np.ones(self.ids.n, dtype=bool)
        for name, values in only.items():
            column = self.column(name)
            hit = np.zeros(self.ids.n, dtype=bool)
            for value in values if isinstance(values, (list, tuple)) else (values,):
                is_it = _equal(column, value)
                if not is_it.any():
                    known = column.words if isinstance(column, Texts) else map(str, np.unique(column)[:1000].tolist())
                    error = unknown(f"value of column '{name}'", value, filter(None, known))
                    raise error.at(None, str(self._said.file))
                hit |= is_it
            chosen &= hit
        if not chosen.any():
            raise ModelError(f"{self._said.file}: no neuron with {shown(dict(only))}: expected at least one")
        return np.flatnonzero(chosen)

    def _as_ids(self, column: Column) -> Column:
        """Ids as 64 bits where all are whole numbers, else as text; each once."""
        name, first = str(self._id), self._table.first
        if isinstance(column, Texts):
            empty = np.flatnonzero(column.each(np.array([not word for word in column.words])))
            if empty.size:
                raise cell(self._table, first + int(empty[0]), name, "", "an id")
            if all(_WHOLE.fullmatch(column.words[code]) for code in np.unique(column.codes).tolist()):
                whole = [int(word) if word else 0 for word in column.words]
                low, high = min(whole), max(whole)
                if low < -(2**63) or high >= 2**64 or (low < 0 and high >= 2**63):
                    bad = low if low < -(2**63) else high
                    row = int(np.flatnonzero(column.each(np.array([number == bad for number in whole])))[0])
                    raise cell(self._table, self._table.first + row, name, bad, "a whole number of 64 bits")
                column = column.each(np.array(whole, dtype=INT64 if high < 2**63 else UINT64))
        elif column.dtype.kind not in "iu":
            message = f"{self._said.file}: column '{name}' holds {column.dtype}: expected whole numbers or text"
            raise ModelError(message, path=("id",))
        else:
            column = column.astype(UINT64 if column.dtype == np.uint64 else INT64)
        values = column.codes if isinstance(column, Texts) else column
        order = np.argsort(values, kind="stable")
        twice = np.flatnonzero(values[order][1:] == values[order][:-1])
        if twice.size:
            before, again = (int(order[twice[0] + k]) for k in (0, 1))
            found = column.words[column.codes[again]] if isinstance(column, Texts) else int(column[again])
            expected = f"another id than that of row {first + before}"
            raise cell(self._table, first + again, name, found, expected)
        return column


def _joined(pieces: list[Column]) -> Column:
    """One column of several; equal words have one code."""
    texts = [piece for piece in pieces if isinstance(piece, Texts)]
    if not texts:
        return np.concatenate([np.asarray(piece) for piece in pieces] or [np.zeros(0)])
    codes: dict[str, int] = {}
    parts = []
    for piece in texts:
        parts.append(piece.each(np.array([codes.setdefault(word, len(codes)) for word in piece.words], dtype=np.int64)))
    return Texts(np.concatenate(parts), tuple(codes))


def _equal(column: Column, value: Any) -> NDArray[np.bool_]:
    """Of each row whether it has a value; numbers in a CSV are compared as they are written."""
    if isinstance(column, Texts):
        return column.each(np.array([word == str(value) for word in column.words]))
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return column == value if is_number else np.zeros(len(column), dtype=bool)
