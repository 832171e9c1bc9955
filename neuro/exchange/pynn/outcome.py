"""What has come of running a script of PyNN: networks in files, and a report, written by the script's process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from neuro.core.errors import Where
from neuro.exchange.pynn.gathered import network
from neuro.exchange.pynn.recorder import SESSION, Experiment


class Outcome:
    """Gathers the networks of a script while it runs.

    Args:
        folder: for the networks.
        script: its file.
        beside: the folder in which it runs; lines of modules there are the script's, too.
    """

    def __init__(self, folder: Path, script: Path, beside: Path) -> None:
        self._folder, self._name = folder, script.stem
        self._networks: list[tuple[Experiment, dict[str, Any]]] = []
        self._failure: dict[str, Any] | None = None
        SESSION.files, SESSION.script = (str(script), f"{beside}/"), script.name
        SESSION.finish = self._add

    def _add(self, experiment: Experiment) -> None:
        net = network(experiment, self._name)
        found: dict[str, Any] = {}
        if not experiment.problems:
            found["file"] = f"{len(self._networks)}.yaml"
            net.save(self._folder / found["file"])
        self._networks.append((experiment, found))

    def fail(self, message: str, line: int, kind: str = "raised") -> None:
        """The script ends by a mistake; what it does with results that are empty here is none."""
        harmless = kind == "raised" and SESSION.read and bool(self._networks)
        self._failure = {"message": message, "line": line, "harmless": harmless, "kind": kind}

    def end(self) -> None:
        """The script has ended."""
        if self._failure is None or self._failure["harmless"]:
            SESSION.capture()

    def write(self, path: Path) -> None:
        """Write the report."""
        networks = []
        for experiment, found in self._networks:
            about = {
                "problems": [_entry(one) for one in experiment.problems],
                "notes": [_entry(one) for one in experiment.notes],
                "runs": experiment.runs,
                "line": experiment.where.line if experiment.where else 0,
            }
            networks.append(found | about)
        path.write_text(json.dumps({"networks": networks, "failure": self._failure}), "utf-8")


def _entry(one: tuple[Where | None, str]) -> list[Any]:
    where, message = one
    return [where.file if where else "", where.line if where else 0, message]
