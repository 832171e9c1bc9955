"""Tables as columns, a piece at a time, with errors that name file, row and column, and conditions on columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError, nearest, unknown
from neuro.core.grammar import (
    COMPARISONS,
    Binary,
    Call,
    Expression,
    Hints,
    Misread,
    Name,
    Negative,
    Number,
    Tree,
    parse,
)
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


_SIGNS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power}
_ORDERS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}
_FUNCTIONS = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log, "round": np.rint, "min": np.minimum, "max": np.maximum}
_HINTS = Hints({"$": "columns stand without $", "=": "a comparison is one of < <= > >="})


class Condition:
    """One comparison of columns and numbers.

    Args:
        text: the comparison.

    Raises:
        ModelError: it is none.
    """

    def __init__(self, text: str) -> None:
        try:
            self._whole: Expression = parse(text, _HINTS)
            tree = self._whole.tree
            if not isinstance(tree, Binary) or tree.sign not in COMPARISONS:
                raise self._whole.mistake(tree.at, "found no comparison: expected one such as synapses >= 5")
            self.names = tuple(dict.fromkeys(self._names(tree)))
        except Misread as error:
            raise error.at(None, "where") from None

    def _names(self, tree: Tree) -> Iterator[str]:
        match tree:
            case Name(name):
                yield name
            case Negative(of):
                yield from self._names(of)
            case Binary(_, left, right):
                yield from self._names(left)
                yield from self._names(right)
            case Call(name, arguments):
                if name not in _FUNCTIONS:
                    raise self._whole.mistake(tree.at, f"unknown function '{name}'", nearest(name, _FUNCTIONS))
                needs = 2 if name in ("min", "max") else 1
                if len(arguments) != needs:
                    raise self._whole.mistake(tree.at, f"{name}: found {len(arguments)} values: expected {needs}")
                for argument in arguments:
                    yield from self._names(argument)
            case Number(_, unit) if unit:
                raise self._whole.mistake(tree.at, f"found the unit '{unit}': expected a number without one")

    def holds(self, columns: Mapping[str, Any]) -> NDArray[np.bool_]:
        """Of each row whether it holds; where it has no value, as 0 / 0, it does not."""
        tree = self._whole.tree
        assert isinstance(tree, Binary)
        with np.errstate(all="ignore"):
            found: NDArray[np.bool_] = _ORDERS[tree.sign](self._of(tree.left, columns), self._of(tree.right, columns))
        if not np.ndim(found):
            raise ModelError(f"where: '{self._whole.text}' names no column: expected one")
        return found

    def _of(self, tree: Tree, columns: Mapping[str, Any]) -> Any:
        match tree:
            case Number(value, _):
                return value
            case Name(name):
                return columns[name]
            case Negative(of):
                return -self._of(of, columns)
            case Call(name, arguments):
                return _FUNCTIONS[name](*(self._of(argument, columns) for argument in arguments))
            case Binary(sign, left, right):
                return (_SIGNS | _ORDERS)[sign](self._of(left, columns), self._of(right, columns))
