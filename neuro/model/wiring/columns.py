"""Tables in files as columns, a piece at a time, with errors that name file, row and column."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, unknown
from neuro.core.values import shown

ROWS = 1 << 20
"""Rows that a piece has where the format does not decide it."""

NUMBER, INT64, UINT64, TEXT, ANY = "number", "int64", "uint64", "text", "any"
"""What a column is asked for as; `ANY` is as the file has it, of a CSV text."""

MATRIX: tuple[str, ...] = ("pre", "post", "weight")
"""The columns of a matrix, whose entries other than 0 are its rows."""

_EXPECTED = {NUMBER: "finite numbers", INT64: "whole numbers of 64 bits", UINT64: "whole numbers from 0 to 2^64 - 1"}


@dataclass(frozen=True, slots=True, eq=False)
class Texts:
    """A column of text: of each row the place of its word among the words; an empty cell is the word ""."""

    codes: NDArray[np.int64]
    words: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    def each(self, values: NDArray[Any]) -> NDArray[Any]:
        """The value of each row, from that of each word."""
        return values[self.codes]


Column: TypeAlias = NDArray[Any] | Texts


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Some rows of a table.

    Attributes:
        first: the number of the first, as messages count them.
        columns: by name.
        alone: whether all are entries of one row, of a matrix.
    """

    first: int
    columns: dict[str, Column]
    alone: bool = False

    def row(self, at: int) -> int:
        """The number of a row."""
        return self.first + (0 if self.alone else at)


class Table(Protocol):
    """A table in a file.

    Attributes:
        path: of the file.
        names: of the columns.
        first: the number of the first row: 2 where a header is the first line.
    """

    path: Path
    names: tuple[str, ...]
    first: int

    @property
    def places(self) -> tuple[int, ...] | None:
        """The shape of a matrix whose `pre` and `post` are places in the order of the neurons; None: they are ids."""

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """The columns of these names, asked for as a kind each; all rows, in order."""


def rows(table: Table, kinds: Mapping[str, str]) -> Iterator[Piece]:
    """The checked pieces of a table.

    Raises:
        ModelError: a column is not there, or a cell is not what is asked for; the first such is named.
    """
    for name in kinds:
        if name not in table.names:
            raise unknown("column", name, table.names).at(None, str(table.path))
    for piece in table.pieces(kinds):
        for name, kind in kinds.items():
            piece.columns[name] = _checked(table, piece, name, kind)
        yield piece


def cell(table: Table, row: int, name: str, found: object, expected: str, hint: str = "") -> ModelError:
    """The error for one cell."""
    message = f"{table.path}: row {row}, column '{name}': found {shown(found)}: expected {expected}"
    return ModelError(message, hint=hint, kind="cell", path=(name,))


def _checked(table: Table, piece: Piece, name: str, kind: str) -> Column:
    """A column as it was asked for."""
    column = piece.columns[name]
    is_text = isinstance(column, Texts)
    if kind == ANY or (kind == TEXT and is_text):
        return column
    if isinstance(column, Texts) or kind == TEXT:
        found = "text" if is_text else "numbers"
        raise ModelError(
            f"{table.path}: column '{name}' holds {found}: expected {_EXPECTED.get(kind, 'text')}", path=(name,)
        )
    if kind == NUMBER:
        values = column.astype(np.float64, copy=False)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise cell(table, piece.row(int(bad[0])), name, float(values[bad[0]]), "a finite number")
        return values
    if column.dtype.kind not in "iu":
        raise ModelError(
            f"{table.path}: column '{name}' holds {column.dtype}: expected {_EXPECTED[kind]}", path=(name,)
        )
    # One past the end of the other kind has no neuron: the value is reported, never wrapped round.
    beyond = column < 0 if kind == UINT64 and column.dtype.kind == "i" else None
    if kind == INT64 and column.dtype == np.uint64:
        beyond = column > np.uint64(2**63 - 1)
    if beyond is not None and beyond.any():
        at = int(np.flatnonzero(beyond)[0])
        raise cell(table, piece.row(at), name, int(column[at]), "the id of a neuron")
    return column.astype(kind, copy=False)
