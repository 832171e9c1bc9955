"""What tables of many runs share: columns, pictures of themselves, files."""

from __future__ import annotations

import csv
import io
from abc import ABC, abstractmethod
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro.core import tables
from neuro.core.errors import ModelError, unknown
from neuro.core.extras import install
from neuro.core.outputs import Kind, marked, output
from neuro.core.paths import file_path

if TYPE_CHECKING:
    from pandas import DataFrame

_SHOWN = 20


def _is_parquet(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(4)
        file.seek(-min(path.stat().st_size, 1 << 16), 2)
        return head == b"PAR1" and b"neuro sweep" in file.read()


PARQUET = Kind("a table of a sweep", _is_parquet)


class RunRows(ABC):
    """Base of these tables.

    Class attributes:
        kind: what a file of rows is, by its first names.
        many: what rows are of.
    """

    __slots__ = ()
    kind = marked("a table of a sweep", "run,outcome,")
    many = "runs"
    name: str

    @abstractmethod
    def rows(self, times: bool = False) -> list[dict[str, Any]]:
        """A mapping for each row, all with the same names.

        Args:
            times: whether also how long it took.
        """

    @abstractmethod
    def __len__(self) -> int:
        """How many rows there are."""

    def column(self, name: str) -> list[Any]:
        """One column, an entry for each run; None where there is none yet.

        Raises:
            ModelError: there is no such column.
        """
        rows = self.rows()
        if name not in (head := _head(rows)):
            raise unknown("column", name, head)
        return [row[name] for row in rows]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(self.rows())

    def __str__(self) -> str:
        return tables.as_text(repr(self), [self._shown()])

    def _repr_html_(self) -> str:
        return tables.as_html(repr(self), [self._shown()])

    def _shown(self) -> tables.Table:
        rows = self.rows()
        names = [name for name in _head(rows) if name not in ("run", "error") or any(row[name] for row in rows)]
        head = tuple(name if name in ("run", "outcome", "error") else f">{name}" for name in names)
        more = f"the first {_SHOWN} of {len(rows):,} {self.many}" if len(rows) > _SHOWN else ""
        body = tuple(tuple(text(row[name], name) for name in names) for row in rows[:_SHOWN])
        return tables.Table(more, head, body)

    def to_pandas(self, times: bool = False) -> DataFrame:
        """The rows as a data frame; needs the extra `pandas`.

        Raises:
            ModelError: the package pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise ModelError("to_pandas: the package pandas is not installed", hint=install("pandas")) from None
        return pandas.DataFrame(self.rows(times))

    def save(self, path: str | PathLike[str], times: bool = False) -> None:
        """Write the rows to a file: CSV, or parquet where its name ends so, which needs the extra `parquet`.

        Raises:
            ModelError: it ends otherwise, cannot be written, or the package pyarrow is not installed.
        """
        file = file_path(path, "path")
        if file.suffix == ".parquet":
            self._save_parquet(file, times)
        elif file.suffix == ".csv" or not file.suffix or (file.exists() and not file.is_file()):
            with output(file, self.kind) as part, part.open("w", encoding="utf-8", newline="") as out:
                out.write(self.csv(times))
        else:
            raise ModelError(f"{file}: expected a name that ends in .csv or .parquet")

    def csv(self, times: bool = False) -> str:
        """The rows as CSV: numbers with all their digits, nothing where there is none."""
        rows = self.rows(times)
        out = io.StringIO()
        writer = csv.DictWriter(out, _head(rows), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return out.getvalue()

    def _save_parquet(self, file: Path, times: bool) -> None:
        try:
            import pyarrow
            from pyarrow import parquet
        except ImportError:
            message = f"{file}: the package pyarrow is not installed"
            raise ModelError(message, hint=install("parquet")) from None
        try:
            frame = pyarrow.Table.from_pylist(self.rows(times), metadata={"neuro sweep": self.name})
        except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError, OverflowError) as error:
            kinds = "whole numbers of more than 64 bits" if isinstance(error, OverflowError) else "several kinds"
            message = f"{file}: a column has values of {kinds}: {error}"
            raise ModelError(message, hint="a CSV file takes them") from None
        with output(file, PARQUET) as part:
            parquet.write_table(frame, part)


def _head(rows: list[dict[str, Any]]) -> list[str]:
    return list(rows[0]) if rows else []


def text(value: Any, name: str = "") -> str:
    """A value as tables for people show it."""
    if value is None:
        return "-"
    if name == "run":
        return str(value)[:10]
    return f"{value:.6g}" if isinstance(value, float) else str(value)
