"""Formats of tables: CSV and Parquet by Arrow, NPZ and NPY. SONATA has a module of its own."""

from __future__ import annotations

import csv
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.extras import needed
from neuro.core.hdf5 import is_hdf5
from neuro.core.inputs import existing, record_input
from neuro.core.values import shown
from neuro.model.wiring.sonata import SonataTable
from neuro.model.wiring.tables import ANY, MATRIX, NUMBER, ROWS, TEXT, Column, Piece, Table, Texts, cell

_FAILURES = (OSError, ValueError, EOFError, KeyError, MemoryError, SyntaxError, zipfile.BadZipFile, zlib.error)
_SPARSE = {"format", "shape", "data"}
"""Names of arrays by which a sparse matrix of SciPy is recognised."""


def open_arrays(path: Path) -> Table:
    """Return the table in an NPZ or NPY file.

    Arrays of Python objects are refused, because reading them may run code.
    """
    try:
        with path.open("rb") as file:
            if file.read(2) != b"PK":
                return _Dense(path, np.load(path, allow_pickle=False, mmap_mode="r"))
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                names = tuple(archive.files)
            if set(names) >= _SPARSE:
                from scipy.sparse import load_npz

                file.seek(0)
                matrix = load_npz(file)
                if hasattr(matrix, "check_format"):
                    matrix.check_format(full_check=True)
                return _Sparse(path, matrix.tocoo())
            return _Columns(path, names)
    except _FAILURES as error:
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> ModelError:
    if isinstance(error, ModelError):
        return error
    if "pickle" in str(error):
        return ModelError(f"{path}: holds Python objects, which may run code: expected arrays of numbers or text")
    return ModelError(f"{path}: not a readable npz or npy file: {type(error).__name__}: {error!s:.150}")


class _Columns:
    """An NPZ file with an array per column."""

    places, first = None, 1

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self.path, self.names = path, names

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield the arrays in pieces of rows."""
        try:
            with self.path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                columns = {name: _array_column(file[name], f"{self.path}: column '{name}'") for name in kinds}
        except _FAILURES as error:
            raise _damaged(self.path, error) from None
        sizes = {name: len(column) for name, column in columns.items()}
        if len(set(sizes.values())) > 1:
            raise ModelError(f"{self.path}: arrays of different lengths, {sizes}: expected equal lengths")
        for begin in range(0, max(sizes.values(), default=0), ROWS):
            yield Piece(begin + 1, {name: _part(column, begin) for name, column in columns.items()})


def _array_column(array: NDArray[Any], what: str) -> Column:
    if array.ndim != 1:
        raise ModelError(f"{what}: an array of shape {list(array.shape)}: expected one value per row")
    if array.dtype.kind == "U":
        words, codes = np.unique(array, return_inverse=True)
        return Texts(codes.astype(np.int64), tuple(words.tolist()))
    if array.dtype.kind not in "iufb":
        raise ModelError(f"{what}: an array of {array.dtype}: expected numbers or text")
    return array


def _part(column: Column, begin: int) -> Column:
    if isinstance(column, Texts):
        return Texts(column.codes[begin : begin + ROWS], column.words)
    return column[begin : begin + ROWS]


class _Dense:
    """A dense matrix. Row k belongs to source neuron k, and column k to target neuron k."""

    first, names = 1, MATRIX

    def __init__(self, path: Path, matrix: NDArray[Any]) -> None:
        if matrix.ndim != 2 or matrix.dtype.kind not in "iuf":
            kind = f"{matrix.dtype} of shape {list(matrix.shape)}"
            raise ModelError(f"{path}: an array of {kind}: expected a matrix of numbers, (sources, targets)")
        self.path, self._matrix, self.places = path, matrix, matrix.shape

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield the entries other than 0, row by row."""
        for row in range(self._matrix.shape[0]):
            weights = self._matrix[row]
            post = np.flatnonzero(weights)
            columns = {"pre": np.full(post.size, row), "post": post, "weight": weights[post]}
            yield Piece(row + 1, columns, is_one_row=True)


class _Sparse:
    """A sparse matrix. Row k belongs to source neuron k, and column k to target neuron k."""

    first, names = 1, MATRIX

    def __init__(self, path: Path, matrix: Any) -> None:
        self.path, self._matrix, self.places = path, matrix, matrix.shape

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield the stored entries in pieces."""
        columns = {"pre": self._matrix.row, "post": self._matrix.col, "weight": self._matrix.data}
        for begin in range(0, self._matrix.nnz, ROWS):
            yield Piece(begin + 1, {name: column[begin : begin + ROWS] for name, column in columns.items()})


_BLOCK = 1 << 24
"""Number of bytes that are read from a CSV file at once."""

_BAD_CELL = re.compile(r"column #(?P<column>\d+): Row #(?P<row>\d+): .* invalid value '(?P<value>.*)'", re.DOTALL)
_EXPECTED = {
    NUMBER: "a number",
    "int64": "a whole number of 64 bits",
    "uint64": "a whole number from 0 to 2^64 - 1",
}


def _arrow(path: Path, module: str) -> Any:
    message = f"{path}: the package pyarrow, which reads CSV and parquet, is missing"
    return needed(f"pyarrow{module}", "parquet", message)


class CsvTable:
    """A CSV file with a header. The header is row 1, so the number of a row is the number of its line."""

    places, first = None, 2

    def __init__(self, path: Path) -> None:
        self.path = path
        self.names = _header(path)

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield the columns block by block."""
        try:
            yield from self._pieces(kinds, True)
        except (_arrow(self.path, "").ArrowException, KeyError, OSError) as error:
            raise self._locate_error(error, kinds) from None

    def _pieces(self, kinds: Mapping[str, str], threads: bool) -> Iterator[Piece]:
        arrow, reader = _arrow(self.path, ""), _arrow(self.path, ".csv")
        types = {NUMBER: arrow.float64(), "int64": arrow.int64(), "uint64": arrow.uint64()}
        text = arrow.dictionary(arrow.int32(), arrow.string())
        conversion = reader.ConvertOptions(
            column_types={name: types.get(kind, text) for name, kind in kinds.items()},
            include_columns=list(kinds),
            null_values=[""],
            strings_can_be_null=True,
        )
        options = reader.ReadOptions(block_size=_BLOCK, use_threads=threads)
        first = self.first
        for batch in reader.open_csv(self.path, read_options=options, convert_options=conversion):
            yield Piece(
                first, {name: _arrow_column(self, first, name, batch.column(name), kinds[name]) for name in kinds}
            )
            first += batch.num_rows

    def _locate_error(self, error: Exception, kinds: Mapping[str, str]) -> ModelError:
        """Return Arrow's error with row and column. Arrow reports them only if a single thread reads the file."""
        try:
            for _ in self._pieces(kinds, False):
                pass
        except (_arrow(self.path, "").ArrowException, KeyError, OSError) as located:
            error = located
        if match := _BAD_CELL.search(str(error)):
            name = self.names[int(match["column"])] if int(match["column"]) < len(self.names) else match["column"]
            return cell(self, int(match["row"]), name, match["value"], _EXPECTED.get(kinds.get(name, ""), "text"))
        return ModelError(f"{self.path}: not a readable CSV file: {str(error).splitlines()[0]:.200}")


def _header(path: Path) -> tuple[str, ...]:
    """Return the names in the first line.

    Raises:
        ModelError: there is no header, the file is not text, or a name occurs twice.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            names = tuple(next(csv.reader([file.readline(1 << 24)]), ()))
    except (UnicodeDecodeError, csv.Error):
        raise ModelError(f"{path}: found binary data: expected CSV, parquet, SONATA (HDF5), npz or npy") from None
    if not any(names):
        raise ModelError(f"{path}: found no header: expected the names of the columns in the first line")
    if repeats := [name for k, name in enumerate(names) if name in names[:k]]:
        raise ModelError(f"{path}: row 1: column '{repeats[0]}' occurs twice: expected each once")
    return names


def _arrow_column(table: Table, first: int, name: str, values: Any, kind: str) -> Column:
    """Return an Arrow array as a column. Empty cells are errors except in text columns."""
    pyarrow = _arrow(table.path, "")
    kinds = pyarrow.types
    value_type = values.type.value_type if kinds.is_dictionary(values.type) else values.type
    if kinds.is_string(value_type) or kinds.is_large_string(value_type):
        encoded = values if kinds.is_dictionary(values.type) else values.dictionary_encode()
        words = [word if word is not None else "" for word in encoded.dictionary.to_pylist()]
        codes = encoded.indices.fill_null(len(words)).to_numpy(zero_copy_only=False).astype(np.int64)
        return Texts(codes, (*words, ""))
    if values.null_count:
        empty_row = int(np.flatnonzero(values.is_null().to_numpy(zero_copy_only=False))[0])
        raise cell(table, first + empty_row, name, "", _EXPECTED.get(kind, "a value"))
    if not (kinds.is_integer(value_type) or kinds.is_floating(value_type) or kinds.is_boolean(value_type)):
        expected = "text" if kind == TEXT else "numbers or text" if kind == ANY else _EXPECTED[kind]
        raise ModelError(f"{table.path}: column '{name}' holds {value_type}: expected {expected}", path=(name,))
    numbers: Column = values.to_numpy(zero_copy_only=False)
    return numbers


class ParquetTable:
    """A Parquet file. Rows are counted from 1."""

    places, first = None, 1

    def __init__(self, path: Path) -> None:
        self.path = path
        self._errors = (_arrow(path, "").ArrowException, OSError, ValueError)
        try:
            self.names = tuple(_arrow(path, ".parquet").read_schema(path).names)
        except self._errors as error:
            raise self._damaged(error) from None

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield the columns in groups of rows."""
        first = self.first
        for batch in self._batches(list(kinds)):
            yield Piece(
                first, {name: _arrow_column(self, first, name, batch.column(name), kinds[name]) for name in kinds}
            )
            first += batch.num_rows

    def _batches(self, names: list[str]) -> Iterator[Any]:
        try:
            with _arrow(self.path, ".parquet").ParquetFile(self.path) as file:
                yield from file.iter_batches(batch_size=ROWS, columns=names)
        except self._errors as error:
            raise self._damaged(error) from None

    def _damaged(self, error: Exception) -> ModelError:
        return ModelError(f"{self.path}: not a readable Parquet file: {str(error).splitlines()[0]:.200}")


class CsvMatrix:
    """A CSV file with the ids of the targets in the first line.

    Each later line has the id of a source, and a weight for each target.
    """

    places, first, names = None, 2, MATRIX

    def __init__(self, path: Path) -> None:
        self.path = path
        self._posts = _header(path)[1:]

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield the entries other than 0, line by line. The row of an entry is the row of the source."""
        with self.path.open(encoding="utf-8-sig", newline="") as file:
            lines, row_of_id = self._lines(file), dict[str, int]()
            next(lines)
            for row, line in enumerate(lines, 2):
                if not line:
                    continue
                if row_of_id.setdefault(line[0], row) != row:
                    raise cell(self, row, "pre", line[0], f"another id than that of row {row_of_id[line[0]]}")
                if len(line) - 1 != len(self._posts):
                    message = f"{self.path}: row {row}: found {len(line) - 1} weights: expected {len(self._posts)}"
                    raise ModelError(f"{message}, the number of ids in row 1")
                try:
                    weights = np.array(line[1:], dtype=np.float64)
                except ValueError:
                    weights = np.full(len(self._posts), np.nan)
                if not np.isfinite(weights).all():
                    bad_column = next(k for k, text in enumerate(line[1:]) if not _is_finite(text))
                    raise cell(self, row, self._posts[bad_column], line[1 + bad_column], "a finite number")
                nonzero = np.flatnonzero(weights)
                ids_by_column = {"pre": [line[0]] * nonzero.size, "post": [self._posts[k] for k in nonzero.tolist()]}
                columns = {
                    name: self._ids(row, name, ids, kinds[name]) for name, ids in ids_by_column.items() if name in kinds
                }
                yield Piece(row, {**columns, "weight": weights[nonzero]}, is_one_row=True)

    def _lines(self, file: Any) -> Iterator[list[str]]:
        try:
            yield from csv.reader(file)
        except (UnicodeDecodeError, csv.Error) as error:
            raise ModelError(f"{self.path}: not a readable CSV file: {error!s:.150}") from None

    def _ids(self, row: int, name: str, ids: list[str], kind: str) -> Column:
        if kind == TEXT:
            words = tuple(dict.fromkeys(ids))
            return Texts(np.array([words.index(word) for word in ids], dtype=np.int64), words)
        try:
            return np.array([int(text) for text in ids], dtype=kind)
        except (ValueError, OverflowError):
            bad_id = next(text for text in ids if not re.fullmatch(r"[-+]?\d{1,20}", text.strip()))
            raise cell(self, row, name, bad_id, _EXPECTED[kind]) from None


def _is_finite(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def open_table(path: Path, key: str | None = None, matrix: bool = False, types: Path | None = None) -> Table:
    """Open the table in a file. The first bytes decide the format. A file without a known signature is read as CSV.

    Args:
        path: CSV, Parquet, SONATA (HDF5), NPZ or NPY.
        key: for HDF5, the population of edges or nodes.
        matrix: whether a CSV is a matrix with ids in its first row and column.
        types: for HDF5, the CSV with the attributes of edge or node types.

    Raises:
        ModelError: the file does not exist, or has another format.
    """
    table = _open(path, key, matrix, types)
    if matrix and table.names != MATRIX:
        raise ModelError(f"{path}: layout: matrix: found a list of edges: expected a matrix", path=("layout",))
    return table


def _open(path: Path, key: str | None, matrix: bool, types: Path | None) -> Table:
    existing(path)
    record_input(path)
    with path.open("rb") as file:
        head = file.read(8)
    for word, value in (("key", key), ("types", types)):
        if value is not None and not is_hdf5(head):
            raise ModelError(f"{path}: {word} = {shown(value)}: expected none, only HDF5 has {word}", path=(word,))
    if is_hdf5(head):
        return SonataTable(path, key, types)
    if head.startswith((b"PK\x03\x04", b"PK\x05\x06", b"\x93NUMPY")):
        return open_arrays(path)
    if head.startswith(b"PAR1"):
        return ParquetTable(path)
    return CsvMatrix(path) if matrix else CsvTable(path)
