"""What has come of running a script of PyNN: networks in files, and a report, gathered in the script's process."""

from __future__ import annotations

from pathlib import Path

from neuro.core.errors import Where
from neuro.exchange.pynn.gathered import Gathered
from neuro.exchange.pynn.report import LONGEST, Built, Failure, Remark, Report
from neuro.exchange.pynn.session import SESSION, Experiment


class Outcome:
    """Gathers the networks of a script while it runs.

    Args:
        folder: for the networks.
        script: its file.
        beside: the folder in which it runs; lines of modules there are the script's, too.
    """

    def __init__(self, folder: Path, script: Path, beside: Path) -> None:
        self._folder, self._name = folder, script.stem
        self._networks: list[tuple[Experiment, Gathered]] = []
        self._saved: list[str] = []
        self._failure: Failure | None = None
        SESSION.files, SESSION.script = (str(script), f"{beside}/"), script.name
        SESSION.finish, SESSION.close = self._add, self._close

    def _add(self, experiment: Experiment) -> None:
        self._close()
        self._networks.append((experiment, Gathered(experiment, self._name)))

    def _close(self) -> None:
        """Save the last network, unless it cannot come."""
        if len(self._saved) == len(self._networks):
            return
        experiment, gathered = self._networks[-1]
        self._saved.append("" if experiment.problems else f"{len(self._saved)}.yaml")
        if self._saved[-1]:
            gathered.close().save(self._folder / self._saved[-1])

    def fail(self, message: str, line: int, kind: str = "raised") -> None:
        """The script ends by a mistake; what it does with results that are empty here is none."""
        harmless = kind == "raised" and SESSION.read and bool(self._networks)
        self._failure = Failure(message, line, harmless, kind)

    def end(self) -> None:
        """The script has ended."""
        if self._failure is None or self._failure.harmless:
            SESSION.capture()
        self._close()

    def report(self) -> Report:
        """The report."""
        networks = tuple(
            Built(
                file,
                _remarks(experiment.problems),
                _remarks(experiment.notes),
                tuple(experiment.runs),
                experiment.where.line if experiment.where else 0,
            )
            for (experiment, _), file in zip(self._networks, self._saved, strict=True)
        )
        return Report(networks, self._failure)


def _remarks(entries: list[tuple[Where | None, str]]) -> tuple[Remark, ...]:
    return tuple(
        Remark(where.file if where else "", where.line if where else 0, message[:LONGEST]) for where, message in entries
    )
