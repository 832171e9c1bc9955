"""Arrays of NumPy as tables: npz of columns, npz of a sparse matrix as SciPy saves it, npy of a dense matrix."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.model.wiring.columns import MATRIX, ROWS, Column, Piece, Table, Texts

_FAILURES = (OSError, ValueError, EOFError, KeyError, MemoryError, SyntaxError, zipfile.BadZipFile, zlib.error)
_SPARSE = {"format", "shape", "data"}
"""Names that only a sparse matrix of SciPy has together."""


def open_arrays(path: Path) -> Table:
    """The table in an npz or npy file. Arrays of Python objects are refused: to read them may run code."""
    try:
        with path.open("rb") as file:
            if file.read(2) != b"PK":
                return _Dense(path, np.load(path, allow_pickle=False, mmap_mode="r"))
            file.seek(0)
            with np.load(file, allow_pickle=False) as found:
                names = tuple(found.files)
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
    return ModelError(f"{path}: no npz or npy file that can be read: {type(error).__name__}: {error!s:.150}")


class _Columns:
    places, first = None, 1

    def __init__(self, path: Path, names: tuple[str, ...]) -> None:
        self.path, self.names = path, names

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """The arrays, some rows at a time."""
        try:
            with self.path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                columns = {name: _column(file[name], f"{self.path}: column '{name}'") for name in kinds}
        except _FAILURES as error:
            raise _damaged(self.path, error) from None
        sizes = {name: len(column) for name, column in columns.items()}
        if len(set(sizes.values())) > 1:
            raise ModelError(f"{self.path}: arrays of different lengths, {sizes}: expected as many rows in each")
        for begin in range(0, max(sizes.values(), default=0), ROWS):
            yield Piece(begin + 1, {name: _part(column, begin) for name, column in columns.items()})


def _column(array: NDArray[Any], what: str) -> Column:
    if array.ndim != 1:
        raise ModelError(f"{what}: an array of shape {list(array.shape)}: expected one value for each row")
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
    """A matrix; row k and column k are of the k-th neuron."""

    first, names = 1, MATRIX

    def __init__(self, path: Path, matrix: NDArray[Any]) -> None:
        if matrix.ndim != 2 or matrix.dtype.kind not in "iuf":
            found = f"{matrix.dtype} of shape {list(matrix.shape)}"
            raise ModelError(f"{path}: an array of {found}: expected a matrix of numbers, (sources, targets)")
        self.path, self._matrix, self.places = path, matrix, matrix.shape

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """The entries that are not 0, row by row."""
        for row in range(self._matrix.shape[0]):
            weights = self._matrix[row]
            post = np.flatnonzero(weights)
            columns = {"pre": np.full(post.size, row), "post": post, "weight": weights[post]}
            yield Piece(row + 1, columns, alone=True)


class _Sparse:
    """A sparse matrix, likewise."""

    first, names = 1, MATRIX

    def __init__(self, path: Path, matrix: Any) -> None:
        self.path, self._matrix, self.places = path, matrix, matrix.shape

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """The stored entries."""
        columns = {"pre": self._matrix.row, "post": self._matrix.col, "weight": self._matrix.data}
        for begin in range(0, self._matrix.nnz, ROWS):
            yield Piece(begin + 1, {name: column[begin : begin + ROWS] for name, column in columns.items()})
