"""Tables of many runs: the base class, and the table of a sweep with a row per run, in the order of the space."""

from __future__ import annotations

import csv
import io
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neuro import ModelError
from neuro.apps import Kind, curves, file_path, marked, needed, output, quantity, tables, unknown
from neuro_sweeps.folder import PRUNED, SWEEP, Folder, RunOutcome, claimed
from neuro_sweeps.space import RunItem

if TYPE_CHECKING:
    from pandas import DataFrame

LEFT = "left"
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


_PREVIEW = 20
"""Number of rows in the printed table."""


def _is_parquet(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(4)
        file.seek(-min(path.stat().st_size, 1 << 16), 2)
        return head == b"PAR1" and b"neuro sweep" in file.read()


PARQUET = Kind("a table of a sweep", _is_parquet)


class RunRows(ABC):
    """Base class of tables.

    Class attributes:
        kind: kind of a CSV file of the table, known by the first columns.
        many: plural noun for the rows, e.g. "runs".
    """

    __slots__ = ()
    kind = marked("a table of a sweep", "run,outcome,")
    many = "runs"
    name: str

    @abstractmethod
    def rows(self, times: bool = False) -> list[dict[str, Any]]:
        """Return a mapping for each row, all with the same keys.

        Args:
            times: add the durations of the runs.
        """

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of rows."""

    def column(self, name: str) -> list[Any]:
        """Return a column, with None for missing values.

        Raises:
            ModelError: there is no such column.
        """
        rows = self.rows()
        if name not in (names := _column_names(rows)):
            raise unknown("column", name, names)
        return [row[name] for row in rows]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(self.rows())

    def __str__(self) -> str:
        return tables.as_text(repr(self), [self._preview()])

    def _repr_html_(self) -> str:
        return tables.as_html(repr(self), [self._preview()])

    def _preview(self) -> tables.Table:
        rows = self.rows()
        names = [name for name in _column_names(rows) if name not in ("run", "error") or any(row[name] for row in rows)]
        note = f"the first {_PREVIEW} of {len(rows):,} {self.many}" if len(rows) > _PREVIEW else ""
        body = tuple(tuple(text(row[name], name) for name in names) for row in rows[:_PREVIEW])
        return tables.Table(note, columns(names), body)

    def to_pandas(self, times: bool = False) -> DataFrame:
        """Return the rows as a data frame; needs the extra `pandas`.

        Raises:
            ModelError: the package pandas is not installed.
        """
        pandas = needed("pandas", "pandas", "to_pandas: the package pandas is not installed")
        frame: DataFrame = pandas.DataFrame(self.rows(times))
        return frame

    def save(self, path: str | PathLike[str], times: bool = False) -> None:
        """Write the rows to a file .csv or .parquet, which needs the extra `parquet`.

        Raises:
            ModelError: the name has another ending, the file cannot be written, or pyarrow is not installed.
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
        """Return the rows as CSV, with all digits of numbers and empty fields for missing values."""
        rows = self.rows(times)
        out = io.StringIO()
        writer = csv.DictWriter(out, _column_names(rows), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return out.getvalue()

    def _save_parquet(self, file: Path, times: bool) -> None:
        pyarrow, parquet = (
            needed(name, "parquet", f"{file}: the package pyarrow is not installed")
            for name in ("pyarrow", "pyarrow.parquet")
        )
        try:
            frame = pyarrow.Table.from_pylist(self.rows(times), metadata={"neuro sweep": self.name})
        except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError, OverflowError) as error:
            kinds = "whole numbers of more than 64 bits" if isinstance(error, OverflowError) else "several kinds"
            message = f"{file}: a column has values of {kinds}: {error}"
            raise ModelError(message, hint="write a CSV file instead") from None
        with output(file, PARQUET) as part:
            parquet.write_table(frame, part)


def _column_names(rows: list[dict[str, Any]]) -> list[str]:
    return list(rows[0]) if rows else []


def names_of(mappings: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the unique keys of some mappings, in order."""
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))


def columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the heading of a table, with ">" before the names of columns of numbers, which are right-aligned."""
    return tuple(name if name in ("run", "outcome", "error") else f">{name}" for name in names)


def as_text(counts: Mapping[str, int]) -> str:
    """Return numbers of runs or trials by outcome as text, e.g. "3 done, 0 failed, 2 left". No 0 for pruned ones."""
    return ", ".join(f"{n:,} {word}" for word, n in counts.items() if word != PRUNED or n)


def text(value: Any, name: str = "") -> str:
    """Return a value as text for a printed table."""
    if value is None:
        return "-"
    if name == "run":
        return str(value)[:10]
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def with_unit(value: Any, unit: str) -> str:
    """Return a value with three digits and its unit, e.g. "1.23 mJ"."""
    if unit == "J" and isinstance(value, float) and math.isfinite(value):
        return quantity(value, unit, 3)
    plain = curves.few(value) if isinstance(value, float) and math.isfinite(value) else text(value)
    return f"{plain} {unit}".rstrip()


@dataclass(frozen=True, slots=True, eq=False)
class SweepTable(RunRows):
    """The table of a sweep, with a row per run. Each access reads the folder, so the table grows during a sweep.

    Attributes:
        path: folder of the sweep.
        name: name of the sweep.
        parameters: names of the parameters, in order.
        items: all runs, in the order of the space.
    """

    path: Path
    name: str
    parameters: tuple[str, ...]
    items: tuple[RunItem, ...]

    @property
    def keys(self) -> tuple[str, ...]:
        """Hashes of all runs, in the order of the space."""
        return tuple(item.key for item in self.items)

    def outcomes(self) -> dict[str, RunOutcome]:
        """Return the outcomes of all kept runs by hash."""
        return Folder(self.path).outcomes(self.keys)

    def counts(self) -> dict[str, int]:
        """Return the numbers of runs that are done, failed, under way and left. Runs under way count as left, too."""
        outcomes = self.outcomes()
        failed = sum(outcome.failed for outcome in outcomes.values())
        folder = Folder(self.path)
        running_keys = set(claimed(folder.claims)) - set(outcomes) if folder.claims.is_dir() else set()
        return {
            "done": len(outcomes) - failed,
            "failed": failed,
            "under way": len(running_keys & set(self.keys)),
            "left": len(self) - len(outcomes),
        }

    def metrics(self) -> tuple[str, ...]:
        """Return the names of the metrics, in the order of the runs."""
        return tuple(names_of(outcome.metrics for outcome in self.outcomes().values()))

    def rows(self, times: bool = False) -> list[dict[str, Any]]:
        """Return a mapping for each run: run, outcome, the parameters, seed, the metrics and error.

        Args:
            times: add seconds and attempts, which differ between sweeps of the same space.
        """
        return list(self._rows(self.outcomes(), times))

    def _rows(self, outcomes: Mapping[str, RunOutcome], times: bool) -> Iterator[dict[str, Any]]:
        names = names_of(outcome.metrics for outcome in outcomes.values())
        has_seeds = any(item.seed is not None for item in self.items)
        for item in self.items:
            run = outcomes.get(item.key)
            row: dict[str, Any] = {"run": item.key, "outcome": run.outcome if run else LEFT, **item.point}
            if has_seeds:
                row["seed"] = item.seed
            row |= {name: run.metrics.get(name) if run else None for name in names}
            if times:
                row |= {"seconds": run.seconds if run else None, "attempts": run.attempts if run else None}
            row["error"] = run.error if run else ""
            yield row

    def __len__(self) -> int:
        return len(self.items)

    def __repr__(self) -> str:
        counts = self.counts()
        del counts["under way"]
        return f"SweepTable({self.name!r}, {len(self):,} runs: {as_text(counts)})"


def table_of(path: str | PathLike[str]) -> SweepTable:
    """Return the table of the sweep in a folder.

    Raises:
        ModelError: the folder has no sweep.
    """
    folder = file_path(path, "path")
    content = Folder(folder, SWEEP).read()
    try:
        items = tuple(RunItem(key, point, seed) for key, point, seed in content["runs"])
        return SweepTable(folder, content["name"], tuple(content["parameters"]), items)
    except (KeyError, TypeError, ValueError):
        raise ModelError(f"{folder / 'sweep.json'}: damaged: expected the file that 'neuro sweep run' wrote") from None


def failures_by_reason(outcomes: Mapping[str, RunOutcome]) -> list[list[RunOutcome]]:
    """Group failed runs by error message, most frequent first. Messages that differ only in numbers are one group."""
    groups: dict[str, list[RunOutcome]] = {}
    for outcome in outcomes.values():
        if outcome.failed:
            groups.setdefault(_NUMBER.sub("#", outcome.error), []).append(outcome)
    return sorted(groups.values(), key=len, reverse=True)
