"""SONATA edges and nodes in HDF5. Each row has an id, a type and a group.

The attributes of rows are stored in the groups "0", "1", ... of the file, and attributes of types in a CSV file. An
attribute is read from the group of the row, or from the type of the row if the group lacks the attribute.
Source: the SONATA Developer Guide, AllenInstitute/sonata.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core import hdf5
from neuro.core.errors import ModelError, unknown
from neuro.core.hdf5 import Texts as Heaps
from neuro.core.inputs import existing, record_input
from neuro.core.values import shown
from neuro.model.wiring.tables import ROWS, Column, Piece, Texts, cell

NULL = "NULL"


class Types:
    """A table of edge or node types.

    Args:
        path: path of the CSV file.
        id: name of the column of ids, "edge_type_id" or "node_type_id".

    Attributes:
        names: names of the attributes.

    Raises:
        ModelError: the file cannot be read, or a type occurs twice.
    """

    def __init__(self, path: Path, id: str) -> None:
        self.path = existing(path)
        record_input(path)
        try:
            with self.path.open(encoding="utf-8-sig", newline="") as file:
                table_lines = [line for line in csv.reader(file, delimiter=" ", skipinitialspace=True) if any(line)]
        except (UnicodeDecodeError, csv.Error) as error:
            raise ModelError(f"{self.path}: not a readable CSV of types: {error!s:.150}") from None
        if not table_lines:
            raise ModelError(f"{self.path}: found no header: expected the names of the columns in the first line")
        header, *lines = table_lines
        if id not in header:
            raise ModelError(f"{path}: row 1: found {header}: expected a column '{id}'", path=("types",))
        if repeats := [name for k, name in enumerate(header) if name in header[:k]]:
            raise ModelError(f"{path}: row 1: column '{repeats[0]}' occurs twice: expected each once")
        for row, line in enumerate(lines, 2):
            if len(line) != len(header):
                raise ModelError(f"{path}: row {row}: found {len(line)} words: expected {len(header)}, as in row 1")
        columns = dict(zip(header, zip(*lines, strict=True) if lines else [()] * len(header), strict=True))
        ids = self._ids(id, columns.pop(id))
        self._order = np.argsort(ids, kind="stable")
        self._ids_sorted = ids[self._order]
        self.names = tuple(columns)
        self._columns = {name: self._column(cells) for name, cells in columns.items()}

    def _ids(self, id: str, cells: tuple[str, ...]) -> NDArray[np.int64]:
        row_of_id: dict[int, int] = {}
        for row, text in enumerate(cells, 2):
            place = f"{self.path}: row {row}, column '{id}': found {shown(text)}: expected"
            try:
                number = int(text)
            except ValueError:
                raise ModelError(f"{place} a whole number") from None
            if not 0 <= number < 2**63:
                raise ModelError(f"{place} a whole number from 0 to 2^63 - 1")
            if number in row_of_id:
                raise ModelError(f"{place} another type than that of row {row_of_id[number]}")
            row_of_id[number] = row
        return np.array(list(row_of_id), dtype=np.int64)

    def _column(self, cells: tuple[str, ...]) -> tuple[Column, NDArray[np.bool_]]:
        """Return the attribute of each type, as numbers if possible, and a boolean per type, true if it has a value."""
        has_value = np.array([cell not in (NULL, "") for cell in cells], dtype=bool)
        try:
            numbers = np.array([float(cell) if has else math.nan for cell, has in zip(cells, has_value, strict=True)])
        except ValueError:
            words = tuple(dict.fromkeys(cells))
            return Texts(np.array([words.index(cell) for cell in cells], dtype=np.int64), words), has_value
        return numbers, has_value

    def places(self, ids: NDArray[Any]) -> NDArray[np.int64]:
        """Return the index of each type id in the table, or -1."""
        if not self._order.size:
            return np.full(ids.size, -1, dtype=np.int64)
        at = np.minimum(np.searchsorted(self._ids_sorted, ids), self._order.size - 1)
        return np.where(self._ids_sorted[at] == ids, self._order[at], -1)

    def values(self, name: str, places: NDArray[np.int64]) -> tuple[Column, NDArray[np.bool_]]:
        """Return an attribute of the types at some indices, and a boolean per index, true if the type has it."""
        column, has_value = self._columns[name]
        if isinstance(column, Texts):
            return Texts(column.codes[places], column.words), has_value[places]
        return column[places], has_value[places]


_FAILURES = (OSError, ValueError, KeyError, RuntimeError, TypeError, MemoryError, AttributeError)
_LARGEST_CHECKED = 1 << 24
"""Largest size in bytes of a file whose texts are checked."""

_IDS = {"edges": ("source_node_id", "target_node_id", "edge_type_id"), "nodes": ("node_id", "node_type_id")}


Places = slice | NDArray[np.int64]
"""Indices of rows. Consecutive indices are a slice."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Some rows of a population.

    Attributes:
        begin, end: range of the rows.
        members: for each group with some of the rows: the name of the group, the indices of these rows counted from
            `begin`, and the indices of the same rows in the group.
        type: type id of each row, or None if types are not needed.
    """

    begin: int
    end: int
    members: tuple[tuple[str, Places, Places], ...]
    type: NDArray[np.int64] | None

    @property
    def size(self) -> int:
        return self.end - self.begin


class SonataTable:
    """A population of edges or nodes.

    Args:
        path: path of the file.
        key: name of the population. None stands for the only population in the file.
        types: CSV file with the attributes of types, or None.
    """

    places, first = None, 1

    def __init__(self, path: Path, key: str | None, types: Path | None = None) -> None:
        self.path = path
        with self._open() as file:
            kind = next((kind for kind in _IDS if kind in file), None)
            if kind is None:
                raise ModelError(f"{path}: found {sorted(file)}: expected SONATA, a group 'edges' or 'nodes'")
            population_names = sorted(file[kind])
            if key is None and len(population_names) != 1:
                raise ModelError(
                    f"{path}: populations of {kind} {population_names}: expected 'key', one of these", path=("key",)
                )
            population = population_names[0] if key is None else key
            if population not in population_names:
                raise unknown(f"population of {kind}", population, population_names, path=("key",)).at(None, str(path))
            self._place, self._word = f"{kind}/{population}", kind[:-1]
            self._ids = tuple(name for name in _IDS[kind] if name in file[self._place])
            self._groups = sorted((name for name in file[self._place] if name.isdecimal()), key=int)
            groups_of_attribute = {
                name: [g for g in self._groups if name in file[self._place][g]] for name in self._attribute_names(file)
            }
            self._in_groups = {name: groups for name, groups in groups_of_attribute.items() if name not in self._ids}
            self._types = None if types is None else Types(types, f"{self._word}_type_id")
            ids = "target_node_id" if kind == "edges" else "node_type_id"
            if ids not in self._ids:
                raise ModelError(f"{self.path}: '{self._place}' has no '{ids}': expected {', '.join(_IDS[kind])}")
            self._size = int(self._dataset(file, f"{self._place}/{ids}").shape[0])
        shared = () if self._types is None else self._types.names
        self.names = tuple(dict.fromkeys((*self._ids, *self._in_groups, *shared)))

    def _attribute_names(self, file: Any) -> list[str]:
        names = (name for group in self._groups for name in file[self._place][group])
        return [name for name in dict.fromkeys(names) if name not in ("@library", "dynamics_params")]

    @contextmanager
    def _open(self) -> Iterator[Any]:
        import h5py

        try:
            hdf5.check(self.path)
            with h5py.File(self.path, "r") as file:
                yield file
        except ModelError:
            raise
        except _FAILURES as error:
            raise ModelError(f"{self.path}: not a readable HDF5 file: {error!s:.150}") from None

    def _dataset(self, file: Any, place: str) -> Any:
        """Return a data set of the file.

        Links and virtual data sets are refused, because they would read other files.
        """
        import h5py

        data = file
        for part in place.split("/"):
            link = data.get(part, getlink=True) if isinstance(data, h5py.Group) else None
            if not isinstance(link, h5py.HardLink):
                raise ModelError(f"{self.path}: '{place}': expected a data set of the file itself")
            data = data[part]
        readable = isinstance(data, h5py.Dataset) and not (data.is_virtual or data.external) and len(data.shape) == 1
        if not readable or (data.dtype.kind not in "iufbS" and not self._has_texts(data)):
            raise ModelError(f"{self.path}: '{place}': expected a row of values in the file itself")
        return data

    def _has_texts(self, data: Any) -> bool:
        """Return whether a data set holds texts that are stored in the file.

        For large files only the type is checked.
        """
        import h5py

        if self.path.stat().st_size > _LARGEST_CHECKED:
            return h5py.check_string_dtype(data.dtype) is not None
        heaps = Heaps(self.path.read_bytes())
        return heaps.whole and heaps.has(data)

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield columns in pieces of rows."""
        attributes = [name for name in kinds if name not in self._ids]
        words = {
            "group": f"{self._word}_group_id",
            "place": f"{self._word}_group_index",
            "type": f"{self._word}_type_id",
        }
        with self._open() as file:
            id_data = {name: self._row_data(file, name) for name in kinds if name in self._ids}
            is_needed = {
                "group": bool(attributes and self._groups),
                "place": bool(attributes and self._groups),
                "type": self._types is not None and any(name in self._types.names for name in attributes),
            }
            index_data = {word: self._row_data(file, name) for word, name in words.items() if is_needed[word]}
            for word, name in (("group", "group_id"), ("place", "group_index")):
                if len(self._groups) > 1 and index_data.get(word, 0) is None:
                    groups = f"the groups {', '.join(self._groups)}"
                    raise ModelError(f"{self.path}: '{self._place}' has {groups} and no '{self._word}_{name}'")
            for data in index_data.values():
                if data is not None and data.dtype.kind not in "iu":
                    raise ModelError(
                        f"{self.path}: '{data.name.lstrip('/')}' holds {data.dtype}: expected whole numbers"
                    )
            if index_data.get("type", 0) is None:
                raise ModelError(
                    f"{self.path}: '{self._place}' has no '{self._word}_type_id': expected one for 'types'"
                )
            for begin in range(0, self._size, ROWS):
                end = min(begin + ROWS, self._size)
                index_values = {word: None if data is None else data[begin:end] for word, data in index_data.items()}
                members = self._members(begin, end, index_values.get("group"), index_values.get("place"))
                rows = _Rows(begin, end, tuple(members), index_values.get("type"))
                columns: dict[str, Column] = {name: data[begin:end] for name, data in id_data.items()}
                columns |= {name: self._attribute(file, name, rows) for name in attributes}
                yield Piece(begin + 1, columns)

    def _row_data(self, file: Any, name: str) -> Any:
        """Return a data set with a value per row, or None if it does not exist."""
        place = f"{self._place}/{name}"
        if name not in file[self._place]:
            return None
        data = self._dataset(file, place)
        if data.shape[0] != self._size:
            raise ModelError(f"{self.path}: '{place}' has {data.shape[0]} values: expected {self._size}, one per row")
        return data

    def _attribute(self, file: Any, name: str, rows: _Rows) -> Column:
        """Return an attribute of some rows, from the group if possible, otherwise from the type."""
        parts: list[tuple[Places, Column]] = []
        is_missing = np.ones(rows.size, dtype=bool)
        for group, row_indices, group_indices in rows.members:
            if group in self._in_groups.get(name, ()):
                is_missing[row_indices] = False
                parts.append((row_indices, self._group_attribute(file, name, group, rows, row_indices, group_indices)))
        if self._types is not None and name in self._types.names and is_missing.any():
            parts.append((np.flatnonzero(is_missing), self._type_attribute(name, rows, np.flatnonzero(is_missing))))
            is_missing[:] = False
        if is_missing.any():
            at = int(np.flatnonzero(is_missing)[0])
            raise ModelError(f"{self.path}: row {rows.begin + at + 1}: its group has no '{name}'", path=(name,))
        return _join_parts(parts, rows.size, f"{self.path}: column '{name}'")

    def _members(
        self, begin: int, end: int, group: NDArray[Any] | None, place: NDArray[Any] | None
    ) -> Iterator[tuple[str, Places, Places]]:
        """Yield for each group the name, and the indices of its rows, counted from `begin` and in the group."""
        if group is not None and self._groups:
            is_known = np.logical_or.reduce([group == int(name) for name in self._groups])
            if not is_known.all():
                at = int(np.flatnonzero(~is_known)[0])
                expected = f"one of the groups {', '.join(self._groups)}"
                raise cell(self, begin + at + 1, f"{self._word}_group_id", int(group[at]), expected)
        for name in self._groups:
            row_indices: Places = slice(0, end - begin)
            if group is not None and len(self._groups) > 1:
                row_indices = np.flatnonzero(group == int(name))
            if isinstance(row_indices, slice) or row_indices.size:
                yield name, row_indices, slice(begin, end) if place is None else _as_slice(place[row_indices])

    def _group_attribute(
        self, file: Any, name: str, group: str, rows: _Rows, row_indices: Places, place: Places
    ) -> Column:
        """Return an attribute of the rows that are in a group."""
        where = f"{self._place}/{group}/{name}"
        data = self._dataset(file, where)
        if f"{self._word}_group_index" not in file[self._place] and data.shape[0] != self._size:
            message = f"{self.path}: '{where}' has {data.shape[0]} values: expected {self._size}, one per row"
            raise ModelError(message)
        low, high = (place.start, place.stop) if isinstance(place, slice) else (int(place.min()), int(place.max()) + 1)
        if low < 0 or high > data.shape[0]:
            index = np.arange(low, high) if isinstance(place, slice) else place
            at = int(np.flatnonzero((index < 0) | (index >= data.shape[0]))[0])
            row = rows.begin + int(np.arange(rows.size)[row_indices][at]) + 1
            expected = f"the place of one of the {data.shape[0]} values of '{where}'"
            raise cell(self, row, f"{self._word}_group_index", int(index[at]), expected)
        column = self._read(file, group, name, data, slice(low, high))
        if isinstance(place, slice):
            return column
        return Texts(column.codes[place - low], column.words) if isinstance(column, Texts) else column[place - low]

    def _read(self, file: Any, group: str, name: str, data: Any, place: slice) -> Column:
        """Read values of a group. Numbers are codes if the group has words for the attribute in @library."""
        words = f"{self._place}/{group}/@library/{name}"
        if data.dtype.kind in "OS":
            unique_words, codes = np.unique(data.asstr()[place].astype(str), return_inverse=True)
            return Texts(codes.astype(np.int64), tuple(unique_words.tolist()))
        values: NDArray[Any] = data[place]
        if words not in file:
            return values
        library = tuple(str(word) for word in self._dataset(file, words).asstr()[()])
        if values.size and not 0 <= values.min() <= values.max() < len(library):
            raise ModelError(f"{self.path}: '{name}' holds codes beyond its {len(library)} words in @library")
        return Texts(values.astype(np.int64), library)

    def _type_attribute(self, name: str, rows: _Rows, at: NDArray[np.int64]) -> Column:
        """Return an attribute of the types of some rows."""
        assert self._types is not None
        assert rows.type is not None
        places = self._types.places(rows.type[at])
        unknown_types = np.flatnonzero(places < 0)
        if unknown_types.size:
            row = int(at[unknown_types[0]])
            expected = f"a type of {self._types.path}"
            raise cell(self, rows.begin + row + 1, f"{self._word}_type_id", int(rows.type[row]), expected)
        column, has_value = self._types.values(name, places)
        if not has_value.all():
            row = int(at[np.flatnonzero(~has_value)[0]])
            message = f"{self.path}: row {rows.begin + row + 1}: type {int(rows.type[row])} of {self._types.path}"
            raise ModelError(f"{message} has no '{name}'", path=(name,))
        return column


def _as_slice(index: NDArray[Any]) -> Places:
    """Return indices as a slice if they are consecutive."""
    if index.dtype == np.uint64 and index.max(initial=0) >= 2**63:
        index = np.minimum(index, 2**63 - 1)  # larger than every group
    first = int(index[0])
    if np.array_equal(index, np.arange(first, first + index.size)):
        return slice(first, first + index.size)
    return index.astype(np.int64)


def _join_parts(parts: list[tuple[Places, Column]], size: int, what: str) -> Column:
    """Join parts of a column. Each part comes with the indices of its rows."""
    if len(parts) == 1 and len(parts[0][1]) == size:
        return parts[0][1]
    texts = [(row_indices, part) for row_indices, part in parts if isinstance(part, Texts)]
    numbers = [(row_indices, part) for row_indices, part in parts if not isinstance(part, Texts)]
    if texts and numbers:
        raise ModelError(f"{what} holds text in some groups, and numbers in others")
    if not texts:
        column = np.zeros(size, dtype=np.result_type(*(values.dtype for _, values in numbers)))
        for row_indices, values in numbers:
            column[row_indices] = values
        return column
    words: dict[str, int] = {}
    codes = np.zeros(size, dtype=np.int64)
    for row_indices, text in texts:
        codes[row_indices] = text.each(
            np.array([words.setdefault(word, len(words)) for word in text.words], dtype=np.int64)
        )
    return Texts(codes, tuple(words))
