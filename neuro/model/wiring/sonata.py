"""Edges and nodes of SONATA in HDF5: ids and types beside the attributes of the group "0".

Source: the SONATA Developer Guide, AllenInstitute/sonata.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core import hdf5
from neuro.core.errors import ModelError, unknown
from neuro.model.wiring.columns import ROWS, Column, Piece, Texts

_FAILURES = (OSError, ValueError, KeyError, RuntimeError, TypeError, MemoryError)
_IDS = {"edges": ("source_node_id", "target_node_id", "edge_type_id"), "nodes": ("node_id", "node_type_id")}


class SonataTable:
    """One population of edges or of nodes.

    Args:
        path: of the file.
        key: the name of the population; the only one if not given.
    """

    places, first = False, 1

    def __init__(self, path: Path, key: str | None) -> None:
        self.path, self._columns = path, {}
        with self._opened() as file:
            kind = next((kind for kind in _IDS if kind in file), None)
            if kind is None:
                raise ModelError(f"{path}: found {sorted(file)}: expected SONATA, a group 'edges' or 'nodes'")
            known = sorted(file[kind])
            if key is None and len(known) != 1:
                raise ModelError(f"{path}: populations of {kind} {known}: expected 'key', which one", path=("key",))
            chosen = known[0] if key is None else key
            if chosen not in known:
                raise unknown(f"population of {kind}", chosen, known, path=("key",)).at(None, str(path))
            place = f"{kind}/{chosen}"
            self._columns = {name: f"{place}/{name}" for name in _IDS[kind] if name in file[place]}
            groups = sorted(name for name in file[place] if name.isdecimal())
            if len(groups) > 1:
                raise ModelError(f"{path}: '{place}' has the groups {groups}: expected one group, '0'")
            self._group = f"{place}/{groups[0]}" if groups else ""
            self._order = f"{place}/{kind[:-1]}_group_index"
            if groups:
                own = (name for name in file[self._group] if name not in ("@library", "dynamics_params"))
                self._columns |= {name: f"{self._group}/{name}" for name in own}
            self._size = self._rows(file, kind, place)
        self.names = tuple(self._columns)

    def _rows(self, file: Any, kind: str, place: str) -> int:
        ids = "target_node_id" if kind == "edges" else "node_type_id"
        if ids not in self._columns:
            raise ModelError(f"{self.path}: '{place}' has no '{ids}': expected {', '.join(_IDS[kind])}")
        return int(self._dataset(file, self._columns[ids]).shape[0])

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        import h5py

        try:
            hdf5.check(self.path)
            with h5py.File(self.path, "r") as file:
                yield file
        except ModelError:
            raise
        except _FAILURES as error:
            raise ModelError(f"{self.path}: no HDF5 file that can be read: {error!s:.150}") from None

    def _dataset(self, file: Any, place: str) -> Any:
        """A data set of the file itself; a link or a virtual one would read other files."""
        import h5py

        data = file
        for part in place.split("/"):
            link = data.get(part, getlink=True) if isinstance(data, h5py.Group) else None
            if not isinstance(link, h5py.HardLink):
                raise ModelError(f"{self.path}: '{place}': expected a data set of the file itself")
            data = data[part]
        if not isinstance(data, h5py.Dataset) or data.is_virtual or data.external or len(data.shape) != 1:
            raise ModelError(f"{self.path}: '{place}': expected a row of values in the file itself")
        return data

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """The data sets, some rows at a time."""
        with self._opened() as file:
            data = {name: self._dataset(file, self._columns[name]) for name in kinds}
            order = self._dataset(file, self._order) if self._order in file else None
            for begin in range(0, self._size, ROWS):
                end = min(begin + ROWS, self._size)
                place = slice(begin, end) if order is None else _places(order[begin:end], begin)
                columns = {}
                for name, values in data.items():
                    in_group = bool(self._group) and self._columns[name].startswith(f"{self._group}/")
                    columns[name] = self._read(file, name, values, place if in_group else slice(begin, end), end)
                yield Piece(begin + 1, columns)

    def _read(self, file: Any, name: str, data: Any, place: slice | NDArray[Any], end: int) -> Column:
        last = end - 1 if isinstance(place, slice) else int(place.max(initial=0))
        if last >= data.shape[0]:
            message = f"{self.path}: '{self._columns[name]}' has {data.shape[0]} values: expected one for each of"
            raise ModelError(f"{message} {self._size} rows")
        words = f"{self._group}/@library/{name}"
        is_text = data.dtype.kind in "OS"
        values = (data.asstr() if is_text else data)[place if isinstance(place, slice) else slice(None)]
        values = values if isinstance(place, slice) else values[place]
        if is_text:
            known, codes = np.unique(values.astype(str), return_inverse=True)
            return Texts(codes.astype(np.int64), tuple(known.tolist()))
        if self._group and words in file:
            library = tuple(str(word) for word in self._dataset(file, words).asstr()[()])
            if values.size and not 0 <= values.min() <= values.max() < len(library):
                raise ModelError(f"{self.path}: '{name}' holds codes beyond its {len(library)} words in @library")
            return Texts(values.astype(np.int64), library)
        found: NDArray[Any] = values
        return found


def _places(index: NDArray[Any], begin: int) -> slice | NDArray[Any]:
    """Where the attributes of some rows lie in their group."""
    in_order = np.array_equal(index, np.arange(begin, begin + index.size))
    return slice(begin, begin + index.size) if in_order else index.astype(np.int64)
