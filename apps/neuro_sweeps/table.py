"""Tables of many runs: what they share, and that of a sweep, a row for each run in the order of its space."""

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

if TYPE_CHECKING:
    from pandas import DataFrame

LEFT = "left"
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


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
        more = f"the first {_SHOWN} of {len(rows):,} {self.many}" if len(rows) > _SHOWN else ""
        body = tuple(tuple(text(row[name], name) for name in names) for row in rows[:_SHOWN])
        return tables.Table(more, columns(names), body)

    def to_pandas(self, times: bool = False) -> DataFrame:
        """The rows as a data frame; needs the extra `pandas`.

        Raises:
            ModelError: the package pandas is not installed.
        """
        pandas = needed("pandas", "pandas", "to_pandas: the package pandas is not installed")
        frame: DataFrame = pandas.DataFrame(self.rows(times))
        return frame

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
        pyarrow, parquet = (
            needed(name, "parquet", f"{file}: the package pyarrow is not installed")
            for name in ("pyarrow", "pyarrow.parquet")
        )
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


def names_of(each: Iterable[Mapping[str, Any]]) -> list[str]:
    """The names of some mappings, each once, in order."""
    return list(dict.fromkeys(name for one in each for name in one))


def columns(names: Iterable[str]) -> tuple[str, ...]:
    """Names as the head of a table, numbers to the right."""
    return tuple(name if name in ("run", "outcome", "error") else f">{name}" for name in names)


def as_text(counts: Mapping[str, int]) -> str:
    """How many runs or trials came to what, in words; those that were pruned only if there are some."""
    return ", ".join(f"{n:,} {word}" for word, n in counts.items() if word != PRUNED or n)


def text(value: Any, name: str = "") -> str:
    """A value as tables for people show it."""
    if value is None:
        return "-"
    if name == "run":
        return str(value)[:10]
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def measured(value: Any, unit: str) -> str:
    """A value in three digits with its unit, joules with a prefix."""
    if unit == "J" and isinstance(value, float) and math.isfinite(value):
        return quantity(value, unit, 3)
    plain = curves.few(value) if isinstance(value, float) and math.isfinite(value) else text(value)
    return f"{plain} {unit}".rstrip()


@dataclass(frozen=True, slots=True, eq=False)
class SweepTable(RunRows):
    """A row for each run of a sweep; it is read from the folder each time, so it fills while others work.

    Attributes:
        path: the folder.
        name: of the sweep.
        parameters: names of the space, in order.
        seeded: whether runs have a seed.
        keys: hashes of all runs, in the order of the space.
        points: of each its values and its seed.
    """

    path: Path
    name: str
    parameters: tuple[str, ...]
    seeded: bool
    keys: tuple[str, ...]
    points: tuple[tuple[Mapping[str, Any], int | None], ...]

    def outcomes(self) -> dict[str, RunOutcome]:
        """What has come of the runs that are there, by their hashes."""
        return Folder(self.path).outcomes(self.keys)

    def counts(self) -> dict[str, int]:
        """How many runs are done, failed, under way and left, which has those under way."""
        found = self.outcomes()
        failed = sum(each.failed for each in found.values())
        folder = Folder(self.path)
        busy = set(claimed(folder.claims)) - set(found) if folder.claims.is_dir() else set()
        return {
            "done": len(found) - failed,
            "failed": failed,
            "under way": len(busy & set(self.keys)),
            "left": len(self.keys) - len(found),
        }

    def metrics(self) -> tuple[str, ...]:
        """Names of the metrics, in the order in which runs have them."""
        return tuple(names_of(each.metrics for each in self.outcomes().values()))

    def rows(self, times: bool = False) -> list[dict[str, Any]]:
        """A mapping for each run: run, outcome, the parameters, seed, the metrics and error.

        Args:
            times: whether also seconds and attempts, which are not the same each time.
        """
        return list(self._rows(self.outcomes(), times))

    def _rows(self, found: Mapping[str, RunOutcome], times: bool) -> Iterator[dict[str, Any]]:
        names = names_of(each.metrics for each in found.values())
        for key, (point, seed) in zip(self.keys, self.points, strict=True):
            ended = found.get(key)
            row: dict[str, Any] = {"run": key, "outcome": ended.outcome if ended else LEFT, **point}
            if self.seeded:
                row["seed"] = seed
            row |= {name: ended.metrics.get(name) if ended else None for name in names}
            if times:
                row |= {"seconds": ended.seconds if ended else None, "attempts": ended.attempts if ended else None}
            row["error"] = ended.error if ended else ""
            yield row

    def __len__(self) -> int:
        return len(self.keys)

    def __repr__(self) -> str:
        counts = self.counts()
        del counts["under way"]
        return f"SweepTable({self.name!r}, {len(self):,} runs: {as_text(counts)})"


def table_of(path: str | PathLike[str]) -> SweepTable:
    """The table of the sweep in a folder.

    Raises:
        ModelError: there is none.
    """
    folder = file_path(path, "path")
    content = Folder(folder, SWEEP).read()
    try:
        keys = tuple(key for key, _, _ in content["runs"])
        points = tuple((point, seed) for _, point, seed in content["runs"])
        seeded = any(seed is not None for _, seed in points)
        return SweepTable(folder, content["name"], tuple(content["parameters"]), seeded, keys, points)
    except (KeyError, TypeError, ValueError):
        raise ModelError(f"{folder / 'sweep.json'}: damaged: expected what 'neuro sweep run' wrote") from None


def reasons(outcomes: Mapping[str, RunOutcome]) -> list[list[RunOutcome]]:
    """What failed by why it did, numbers in the words of an error left out; the most frequent first."""
    found: dict[str, list[RunOutcome]] = {}
    for each in outcomes.values():
        if each.failed:
            found.setdefault(_NUMBER.sub("#", each.error), []).append(each)
    return sorted(found.values(), key=len, reverse=True)
