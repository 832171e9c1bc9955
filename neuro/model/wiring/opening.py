"""Which table a file holds."""

from __future__ import annotations

from pathlib import Path

from neuro.core.errors import ModelError
from neuro.core.hdf5 import is_hdf5
from neuro.core.inputs import record_input
from neuro.core.paths import existing
from neuro.core.values import shown
from neuro.model.wiring.arrays import open_arrays
from neuro.model.wiring.arrow import CsvMatrix, CsvTable, ParquetTable
from neuro.model.wiring.columns import MATRIX, Table
from neuro.model.wiring.sonata import SonataTable


def open_table(path: Path, key: str | None = None, matrix: bool = False, types: Path | None = None) -> Table:
    """The table in a file, whose format is found by its signature; what has none is CSV.

    Args:
        path: CSV, parquet, HDF5 of SONATA, npz or npy.
        key: in HDF5 the population of edges or of nodes.
        matrix: whether a CSV is a matrix with ids in its first row and column.
        types: in HDF5 the CSV with the attributes of types of edges or of nodes.

    Raises:
        ModelError: there is no such file, or it is none of these.
    """
    table = _opened(path, key, matrix, types)
    if matrix and table.names != MATRIX:
        raise ModelError(f"{path}: layout: matrix: found a list of edges: expected a matrix", path=("layout",))
    return table


def _opened(path: Path, key: str | None, matrix: bool, types: Path | None) -> Table:
    existing(path)
    record_input(path)
    with path.open("rb") as file:
        head = file.read(8)
    for word, said in (("key", key), ("types", types)):
        if said is not None and not is_hdf5(head):
            raise ModelError(f"{path}: {word} = {shown(said)}: expected none, only HDF5 has {word}", path=(word,))
    if is_hdf5(head):
        return SonataTable(path, key, types)
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06", b"\x93NUMPY")):
        return open_arrays(path)
    if head.startswith(b"PAR1"):
        return ParquetTable(path)
    return CsvMatrix(path) if matrix else CsvTable(path)
