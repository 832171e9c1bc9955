"""What a script of PyNN builds, kept line by line while it runs."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from neuro.core.errors import Where


@dataclass
class Experiment:
    """What a script builds between two calls of `setup`.

    Attributes:
        where: of `setup`.
        timestep, min_delay: ms.
        spinnaker: whether it is written for sPyNNaker, where weights have no sign.
        runs: ms, one for each call of `run`.
        live: what the script did since it ran; if it runs on, this belongs to no network.
        problems: what cannot come, by line.
        notes: what is otherwise here, by line.
    """

    where: Where | None = None
    timestep: float = 0.1
    min_delay: float = 0.1
    spinnaker: bool = False
    populations: list[Any] = field(default_factory=list)
    projections: list[Any] = field(default_factory=list)
    currents: list[tuple[Any, list[int], Where | None]] = field(default_factory=list)
    runs: list[float] = field(default_factory=list)
    live: list[tuple[Where | None, str]] = field(default_factory=list)
    problems: list[tuple[Where | None, str]] = field(default_factory=list)
    notes: list[tuple[Where | None, str]] = field(default_factory=list)


class Session:
    """The run of one script.

    Attributes:
        files: beginnings of names of files whose lines are the script's.
        experiment: what is being built.
        finish: is called with an experiment that begins to run.
        close: is called when it has run.
        read: whether the script has read results.
    """

    def __init__(self) -> None:
        self.files: tuple[str, ...] = ()
        self.script = ""
        self.experiment = Experiment()
        self.finish: Callable[[Experiment], None] = lambda experiment: None
        self.close: Callable[[], None] = lambda: None
        self.captured = False
        self.read = False

    def where(self) -> Where | None:
        """The line of the script that is being run."""
        frame: Any = sys._getframe(1)
        while frame is not None:
            name = frame.f_code.co_filename
            if name.startswith(self.files):
                return Where(self.script if name == self.files[0] else name.rpartition("/")[2], frame.f_lineno)
            frame = frame.f_back
        return None

    def problem(self, message: str) -> None:
        """What cannot come, at the line that is being run."""
        entry = (self.where(), message)
        if entry not in self.experiment.problems:
            self.experiment.problems.append(entry)

    def note(self, message: str) -> None:
        """What is otherwise here, at the line that is being run."""
        entry = (self.where(), message)
        if entry not in self.experiment.notes:
            self.experiment.notes.append(entry)

    def changed(self, what: str) -> None:
        """The script changes the network: after a run this is a live change, before it another network."""
        if self.experiment.runs:
            self.experiment.live.append((self.where(), what))
        else:
            self.captured = False

    def capture(self) -> None:
        """The network is complete: it runs, or another one begins."""
        if not self.captured and self.experiment.populations:
            self.captured = True
            self.finish(self.experiment)


SESSION = Session()
