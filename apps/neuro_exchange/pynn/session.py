"""What a script of PyNN builds, kept line by line while it runs: a simulator that only passes time.

Also the functions of PyNN that a simulator has: `setup`, `run`, `reset` and `end`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from pyNN import common
from pyNN.mock import simulator as mock_simulator

from neuro.apps import Where
from neuro_exchange.pynn.report import LONGEST, Built, Failure, Remark, Report

MOST_SAMPLES = 1_000_000
"""Of a recorded signal that a script reads; a longer one is read as constant at its first so many samples."""

Remarks = dict[tuple[Where | None, str], None]
"""Messages with the line that each is about, each once, in order."""


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
    problems: Remarks = field(default_factory=dict)
    notes: Remarks = field(default_factory=dict)

    def built(self, file: str) -> Built:
        """Return the entry of a report; `file` has the network, "" if it cannot come."""
        problems, notes = (
            tuple(
                Remark(where.file if where else "", where.line if where else 0, message[:LONGEST])
                for where, message in remarks
            )
            for remarks in (self.problems, self.notes)
        )
        return Built(file, problems, notes, tuple(self.runs), self.where.line if self.where else 0)


class Session(mock_simulator.State):
    """The run of one script, and the clock of its simulator.

    Attributes:
        files: beginnings of names of files whose lines are the script's.
        experiment: the network that is being built.
        read: whether the script has read results.
        networks: what was built until it ran, with its network here; files of those are in `saved`.
    """

    min_delay: Any

    def __init__(self) -> None:
        super().__init__()
        self.files: tuple[str, ...] = ()
        self.script, self.folder = Path(), Path()
        self.experiment = Experiment()
        self.captured = self.read = False
        self.networks: list[tuple[Experiment, Any]] = []
        self.saved: list[str] = []
        self.failure: Failure | None = None

    def begin(self, folder: Path, script: Path, beside: Path, gather: Callable[[Experiment, str], Any]) -> None:
        """Begin a script.

        Args:
            folder: for the networks.
            script: its file.
            beside: the folder in which it runs; lines of modules there are the script's, too.
            gather: makes a network of this name of what was built.
        """
        self.folder, self.script, self.files, self.gather = folder, script, (str(script), f"{beside}/"), gather

    def where(self) -> Where | None:
        """The line of the script that is being run."""
        frame: Any = sys._getframe(1)
        while frame is not None:
            name = frame.f_code.co_filename
            if name.startswith(self.files):
                return Where(self.script.name if name == self.files[0] else name.rpartition("/")[2], frame.f_lineno)
            frame = frame.f_back
        return None

    def problem(self, message: str) -> None:
        """What cannot come, at the line that is being run."""
        self.experiment.problems.setdefault((self.where(), message))

    def note(self, message: str) -> None:
        """What is otherwise here, at the line that is being run."""
        self.experiment.notes.setdefault((self.where(), message))

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
            self.close()
            self.networks.append((self.experiment, self.gather(self.experiment, self.script.stem)))

    def close(self) -> None:
        """Save the last network, unless it cannot come."""
        if len(self.saved) == len(self.networks):
            return
        experiment, gathered = self.networks[-1]
        self.saved.append("" if experiment.problems else f"{len(self.saved)}.yaml")
        if self.saved[-1]:
            gathered.close().save(self.folder / self.saved[-1])

    def fail(self, message: str, line: int, kind: str = "raised") -> None:
        """The script ends by a mistake; what it does with results that are empty here is none."""
        harmless = kind == "raised" and self.read and bool(self.networks)
        self.failure = Failure(message, line, harmless, kind)

    def report(self) -> Report:
        """End the script, and return its networks and how it failed."""
        if self.failure is None or self.failure.harmless:
            self.capture()
        self.close()
        pairs = zip(self.networks, self.saved, strict=True)
        return Report(tuple(experiment.built(file) for (experiment, _), file in pairs), self.failure)

    def run(self, simtime: float) -> None:
        """Pass time."""
        self.run_until(self.t + simtime)

    def run_until(self, tstop: float) -> None:
        """Pass time; what the script has changed since it ran cannot be part of a network."""
        experiment = self.experiment
        self.capture()
        if self.min_delay == "auto":
            delays = [one.column("delay").min() for one in experiment.projections if len(one)]
            self.min_delay = min(delays, default=self.dt)
        if tstop > self.t:
            for where, what in experiment.live:
                experiment.problems.setdefault((where, f"{what} while the network runs"))
            experiment.live.clear()
            experiment.runs.append(tstop - self.t)
        super().run_until(tstop)

    def written_for_spinnaker(self) -> None:
        """The script imports sPyNNaker, whose steps last 1 ms unless it says so."""
        experiment = self.experiment
        if not experiment.spinnaker:
            experiment.spinnaker, experiment.timestep, experiment.min_delay = True, 1.0, 1.0
            self.dt = 1.0


SESSION = Session()
SIMULATOR = SimpleNamespace(state=SESSION, ID=mock_simulator.ID, name="neuro")


def setup(timestep: Any = None, min_delay: Any = "auto", **extra: Any) -> int:
    """PyNN's `setup`: a network begins."""
    SESSION.capture()
    SESSION.close()
    before = SESSION.experiment
    step = float((1.0 if before.spinnaker else 0.1) if timestep is None else timestep)
    smallest = step if min_delay in ("auto", None) else float(min_delay)
    common.setup(step, min_delay if min_delay is not None else "auto", **extra)
    SESSION.experiment = Experiment(SESSION.where(), step, max(smallest, step), before.spinnaker)
    if not before.populations:
        SESSION.experiment.problems, SESSION.experiment.notes = before.problems, before.notes
    SESSION.captured = False
    SESSION.clear()
    SESSION.dt, SESSION.min_delay, SESSION.max_delay = step, min_delay, extra.get("max_delay", "auto")
    return 0


def end(compatible_output: bool = True) -> None:
    """PyNN's `end`."""
    SESSION.capture()


def _until(time: Any) -> bool:
    if time is not None and np.isfinite(time):
        return False
    SESSION.capture()
    SESSION.note("runs without an end")
    return True


_run, _run_until = common.build_run(SIMULATOR)


def run(simtime: Any, callbacks: Any = None) -> float:
    """PyNN's `run`."""
    return float(SESSION.t if _until(simtime) else _run(simtime, callbacks))


def run_until(time_point: Any, callbacks: Any = None) -> float:
    """PyNN's `run_until`."""
    return float(SESSION.t if _until(time_point) else _run_until(time_point, callbacks))


_reset = common.build_reset(SIMULATOR)


def reset(annotations: Any = None) -> None:
    """PyNN's `reset`: the network begins anew, and what is changed from now on makes another one."""
    _reset(annotations or {})
    SESSION.close()
    was = SESSION.experiment
    SESSION.experiment = replace(was, where=SESSION.where(), runs=[], live=[])
    SESSION.captured = SESSION.captured and not was.live
