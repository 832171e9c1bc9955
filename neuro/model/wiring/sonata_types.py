"""The attributes that SONATA gives to types of edges or of nodes: a CSV of words between single spaces.

Source: the SONATA Developer Guide, AllenInstitute/sonata. NULL stands for no value.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.inputs import record_input
from neuro.core.paths import existing
from neuro.core.values import shown
from neuro.model.wiring.columns import Column, Texts

NULL = "NULL"


class Types:
    """A table of types.

    Args:
        path: of the CSV.
        id: the column of the ids, "edge_type_id" or "node_type_id".

    Attributes:
        names: of the attributes.

    Raises:
        ModelError: it cannot be read, or a type stands there twice.
    """

    def __init__(self, path: Path, id: str) -> None:
        self.path = existing(path)
        record_input(path)
        header, *lines = self._lines()
        if id not in header:
            raise ModelError(f"{path}: row 1: found {header}: expected a column '{id}'", path=("types",))
        if twice := [name for k, name in enumerate(header) if name in header[:k]]:
            raise ModelError(f"{path}: row 1: column '{twice[0]}' stands there twice: expected each once")
        for row, line in enumerate(lines, 2):
            if len(line) != len(header):
                raise ModelError(f"{path}: row {row}: found {len(line)} words: expected {len(header)}, as in row 1")
        columns = dict(zip(header, zip(*lines, strict=True) if lines else [()] * len(header), strict=True))
        ids = self._ids(id, columns.pop(id))
        self._order = np.argsort(ids, kind="stable")
        self._ids_sorted = ids[self._order]
        self.names = tuple(columns)
        self._columns = {name: self._column(cells) for name, cells in columns.items()}

    def _lines(self) -> list[list[str]]:
        try:
            with self.path.open(encoding="utf-8-sig", newline="") as file:
                found = [line for line in csv.reader(file, delimiter=" ", skipinitialspace=True) if any(line)]
        except (UnicodeDecodeError, csv.Error) as error:
            raise ModelError(f"{self.path}: no CSV of types that can be read: {error!s:.150}") from None
        if not found:
            raise ModelError(f"{self.path}: found no header: expected the names of the columns in the first line")
        return found

    def _ids(self, id: str, cells: tuple[str, ...]) -> NDArray[np.int64]:
        found: dict[int, int] = {}
        for row, text in enumerate(cells, 2):
            place = f"{self.path}: row {row}, column '{id}': found {shown(text)}: expected"
            try:
                number = int(text)
            except ValueError:
                raise ModelError(f"{place} a whole number") from None
            if not 0 <= number < 2**63:
                raise ModelError(f"{place} a whole number from 0 to 2^63 - 1")
            if number in found:
                raise ModelError(f"{place} another type than that of row {found[number]}")
            found[number] = row
        return np.array(list(found), dtype=np.int64)

    def _column(self, cells: tuple[str, ...]) -> tuple[Column, NDArray[np.bool_]]:
        """A value for each type, numbers where all are, and which types have one."""
        has = np.array([cell not in (NULL, "") for cell in cells], dtype=bool)
        try:
            numbers = np.array([float(cell) if there else math.nan for cell, there in zip(cells, has, strict=True)])
        except ValueError:
            words = tuple(dict.fromkeys(cells))
            return Texts(np.array([words.index(cell) for cell in cells], dtype=np.int64), words), has
        return numbers, has

    def places(self, ids: NDArray[Any]) -> NDArray[np.int64]:
        """Of each id of a type its place in the table, -1 where it is none."""
        if not self._order.size:
            return np.full(ids.size, -1, dtype=np.int64)
        at = np.minimum(np.searchsorted(self._ids_sorted, ids), self._order.size - 1)
        return np.where(self._ids_sorted[at] == ids, self._order[at], -1)

    def values(self, name: str, places: NDArray[np.int64]) -> tuple[Column, NDArray[np.bool_]]:
        """An attribute of the types at some places, and which of them have it."""
        column, has = self._columns[name]
        if isinstance(column, Texts):
            return Texts(column.codes[places], column.words), has[places]
        return column[places], has[places]
