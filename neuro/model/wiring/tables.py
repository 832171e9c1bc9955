"""Tables that are read column by column in pieces, and conditions on columns. Errors name file, row and column."""

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
"""Number of rows in a piece, unless the format decides."""

NUMBER, INT64, UINT64, TEXT, ANY = "number", "int64", "uint64", "text", "any"
"""Requested types of a column. `ANY` is the type in the file, or text for CSV."""

MATRIX: tuple[str, ...] = ("pre", "post", "weight")
"""Names of the columns of a table that is stored as a matrix. The table has a row per entry other than 0."""

_EXPECTED = {NUMBER: "finite numbers", INT64: "whole numbers of 64 bits", UINT64: "whole numbers from 0 to 2^64 - 1"}


@dataclass(frozen=True, slots=True, eq=False)
class Texts:
    """A column of text. Each row has a code, which is an index into the words. An empty cell has the word ""."""

    codes: NDArray[np.int64]
    words: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    def each(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return one value per row. `values` has a value per word: with the codes [0, 0, 1], [5, 7] gives [5, 5, 7]."""
        return values[self.codes]


Column: TypeAlias = NDArray[Any] | Texts


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Some rows of a table.

    Attributes:
        first: number of the first row in messages.
        columns: columns by name.
        is_one_row: whether all rows are entries of one row of a matrix.
    """

    first: int
    columns: dict[str, Column]
    is_one_row: bool = False

    def row(self, at: int) -> int:
        """Return the number in messages of the row at index `at`."""
        return self.first + (0 if self.is_one_row else at)


class Table(Protocol):
    """Protocol of a table in a file.

    Attributes:
        path: path of the file.
        names: names of the columns.
        first: number of the first row, which is 2 after a header.
    """

    path: Path
    names: tuple[str, ...]
    first: int

    @property
    def places(self) -> tuple[int, ...] | None:
        """Shape of a matrix if the columns `pre` and `post` are indices of neurons; None if they are ids."""

    def pieces(self, kinds: Mapping[str, str]) -> Iterator[Piece]:
        """Yield all rows of some columns in order. `kinds` has the requested type of each column."""


def rows(table: Table, kinds: Mapping[str, str]) -> Iterator[Piece]:
    """Yield the pieces of a table after a check of all cells.

    Raises:
        ModelError: a column does not exist, or a cell has another type. The message names the first such cell.
    """
    for name in kinds:
        if name not in table.names:
            raise unknown("column", name, table.names).at(None, str(table.path))
    for piece in table.pieces(kinds):
        for name, kind in kinds.items():
            piece.columns[name] = _check_column(table, piece, name, kind)
        yield piece


def cell(table: Table, row: int, name: str, value: object, expected: str, hint: str = "") -> ModelError:
    """Return the error for one cell."""
    message = f"{table.path}: row {row}, column '{name}': found {shown(value)}: expected {expected}"
    return ModelError(message, hint=hint, kind="cell", path=(name,))


def _check_column(table: Table, piece: Piece, name: str, kind: str) -> Column:
    """Return a column in the requested type."""
    column = piece.columns[name]
    is_text = isinstance(column, Texts)
    if kind == ANY or (kind == TEXT and is_text):
        return column
    if isinstance(column, Texts) or kind == TEXT:
        content = "text" if is_text else "numbers"
        raise ModelError(
            f"{table.path}: column '{name}' holds {content}: expected {_EXPECTED.get(kind, 'text')}", path=(name,)
        )
    if kind == NUMBER:
        values = column.astype(np.float64, copy=False)
        bad_rows = np.flatnonzero(~np.isfinite(values))
        if bad_rows.size:
            raise cell(table, piece.row(int(bad_rows[0])), name, float(values[bad_rows[0]]), "a finite number")
        return values
    if column.dtype.kind not in "iu":
        raise ModelError(
            f"{table.path}: column '{name}' holds {column.dtype}: expected {_EXPECTED[kind]}", path=(name,)
        )
    # A number beyond the range of the requested type is reported instead of wrapping around.
    is_beyond = column < 0 if kind == UINT64 and column.dtype.kind == "i" else None
    if kind == INT64 and column.dtype == np.uint64:
        is_beyond = column > np.uint64(2**63 - 1)
    if is_beyond is not None and is_beyond.any():
        at = int(np.flatnonzero(is_beyond)[0])
        raise cell(table, piece.row(at), name, int(column[at]), "the id of a neuron")
    return column.astype(kind, copy=False)


_SIGNS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "^": np.power}
_COMPARISONS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}
_FUNCTIONS = {"sqrt": np.sqrt, "exp": np.exp, "log": np.log, "round": np.rint, "min": np.minimum, "max": np.maximum}
_HINTS = Hints({"$": "write columns without $", "=": "compare with < <= > or >="})


class Condition:
    """A comparison of columns and numbers.

    Args:
        text: the comparison.

    Raises:
        ModelError: the text is not a comparison.
    """

    def __init__(self, text: str) -> None:
        try:
            self._expression: Expression = parse(text, _HINTS)
            tree = self._expression.tree
            if not isinstance(tree, Binary) or tree.sign not in COMPARISONS:
                raise self._expression.mistake(tree.at, "found no comparison: expected one such as synapses >= 5")
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
                    raise self._expression.mistake(tree.at, f"unknown function '{name}'", nearest(name, _FUNCTIONS))
                needs = 2 if name in ("min", "max") else 1
                if len(arguments) != needs:
                    raise self._expression.mistake(tree.at, f"{name}: found {len(arguments)} values: expected {needs}")
                for argument in arguments:
                    yield from self._names(argument)
            case Number(_, unit) if unit:
                raise self._expression.mistake(tree.at, f"found the unit '{unit}': expected a number without one")

    def holds(self, columns: Mapping[str, Any]) -> NDArray[np.bool_]:
        """Return a boolean per row, true where the condition holds. Undefined values such as 0 / 0 give false."""
        tree = self._expression.tree
        assert isinstance(tree, Binary)
        with np.errstate(all="ignore"):
            holds: NDArray[np.bool_] = _COMPARISONS[tree.sign](
                self._value(tree.left, columns), self._value(tree.right, columns)
            )
        if not np.ndim(holds):
            raise ModelError(f"where: '{self._expression.text}' names no column: expected one")
        return holds

    def _value(self, tree: Tree, columns: Mapping[str, Any]) -> Any:
        match tree:
            case Number(value, _):
                return value
            case Name(name):
                return columns[name]
            case Negative(of):
                return -self._value(of, columns)
            case Call(name, arguments):
                return _FUNCTIONS[name](*(self._value(argument, columns) for argument in arguments))
            case Binary(sign, left, right):
                return (_SIGNS | _COMPARISONS)[sign](self._value(left, columns), self._value(right, columns))
