"""What has come of a sweep so far: a row for each run, in the order of its space."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.paths import file_path
from neuro.sweeps.claims import claimed
from neuro.sweeps.folder import SWEEP, Folder, RunOutcome
from neuro.sweeps.rows import RunRows

LEFT = "left"
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


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
        found = Folder(self.path).outcomes(self.keys)
        return found

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
        return tuple(dict.fromkeys(name for each in self.outcomes().values() for name in each.metrics))

    def rows(self, times: bool = False) -> list[dict[str, Any]]:
        """A mapping for each run: run, outcome, the parameters, seed, the metrics and error.

        Args:
            times: whether also seconds and attempts, which are not the same each time.
        """
        return list(self._rows(self.outcomes(), times))

    def _rows(self, found: Mapping[str, RunOutcome], times: bool) -> Iterator[dict[str, Any]]:
        names = tuple(dict.fromkeys(name for each in found.values() for name in each.metrics))
        for key, (point, seed) in zip(self.keys, self.points, strict=True):
            told = found.get(key)
            row: dict[str, Any] = {"run": key, "outcome": told.outcome if told else LEFT, **point}
            if self.seeded:
                row["seed"] = seed
            row |= {name: told.metrics.get(name) if told else None for name in names}
            if times:
                row |= {"seconds": told.seconds if told else None, "attempts": told.attempts if told else None}
            row["error"] = told.error if told else ""
            yield row

    def __len__(self) -> int:
        return len(self.keys)

    def __repr__(self) -> str:
        counts = self.counts()
        told = ", ".join(f"{counts[word]:,} {word}" for word in ("done", "failed", "left"))
        return f"SweepTable({self.name!r}, {len(self):,} runs: {told})"


def table_of(path: str | PathLike[str]) -> SweepTable:
    """The table of the sweep in a folder.

    Raises:
        ModelError: there is none.
    """
    folder = file_path(path, "path")
    told = Folder(folder, SWEEP).read()
    try:
        keys = tuple(key for key, _, _ in told["runs"])
        points = tuple((point, seed) for _, point, seed in told["runs"])
        seeded = any(seed is not None for _, seed in points)
        return SweepTable(folder, told["name"], tuple(told["parameters"]), seeded, keys, points)
    except (KeyError, TypeError, ValueError):
        raise ModelError(f"{folder / 'sweep.json'}: damaged: expected what 'neuro sweep run' wrote") from None


def reasons(outcomes: Mapping[str, RunOutcome]) -> list[list[RunOutcome]]:
    """What failed by why it did, numbers in the words of an error left out; the most frequent first."""
    found: dict[str, list[RunOutcome]] = {}
    for each in outcomes.values():
        if each.failed:
            found.setdefault(_NUMBER.sub("#", each.error), []).append(each)
    return sorted(found.values(), key=len, reverse=True)
