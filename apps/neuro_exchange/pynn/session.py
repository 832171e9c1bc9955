"""The session of a script of PyNN: a clock in place of a simulator, and the parts that the script builds, by line.

The module also has the functions of a PyNN simulator: `setup`, `run`, `reset` and `end`.
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
from neuro_exchange.pynn.report import LONGEST, BuiltNetwork, Failure, Remark, Report

MOST_SAMPLES = 1_000_000
"""Largest number of samples in a recorded signal that a script reads. Longer signals are cut."""

Remarks = dict[tuple[Where | None, str], None]
"""Unique messages with their lines, in order."""


@dataclass
class Experiment:
    """The network that a script builds between two calls of `setup`.

    Attributes:
        where: line of `setup`.
        timestep: length of a step in ms.
        min_delay: shortest delay in ms.
        spinnaker: whether the script is written for sPyNNaker, where weights have no sign.
        populations: populations in the order of their creation.
        projections: projections in the order of their creation.
        currents: current sources, ids of the neurons that receive them, and lines.
        runs: duration of each call of `run` in ms.
        live: changes since the last run. If the script runs again, these changes are problems.
        problems: parts that cannot be converted, by line.
        notes: differences between PyNN and here, by line.
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

    def to_report(self, file: str) -> BuiltNetwork:
        """Return the entry of the report. `file` names the network's file; "" if the network cannot be converted."""
        problems, notes = (
            tuple(
                Remark(place.file if place else "", place.line if place else 0, message[:LONGEST])
                for place, message in remarks
            )
            for remarks in (self.problems, self.notes)
        )
        return BuiltNetwork(file, problems, notes, tuple(self.runs), self.where.line if self.where else 0)


class Session(mock_simulator.State):
    """The state of a running script, and the clock of its simulator.

    Attributes:
        files: prefixes of the names of files that belong to the script.
        script: the script's file.
        folder: folder for the networks.
        experiment: the network that is being built.
        captured: whether the present network is in `networks`.
        read: whether the script has read results.
        networks: experiments that ran, each with the builder of its network.
        saved: names of the networks' files; "" for a network that cannot be converted.
        failure: the error of the script, if any.
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

    def begin(self, folder: Path, script: Path, run_folder: Path, gather: Callable[[Experiment, str], Any]) -> None:
        """Start the session of a script.

        Args:
            folder: folder for the networks.
            script: the script's file.
            run_folder: folder in which the script runs. Modules in the folder belong to the script.
            gather: function that returns the builder of a network from an experiment and a name.
        """
        self.folder, self.script, self.files, self.gather = folder, script, (str(script), f"{run_folder}/"), gather

    def where(self) -> Where | None:
        """Return the line of the script that is running, or None."""
        frame: Any = sys._getframe(1)
        while frame is not None:
            name = frame.f_code.co_filename
            if name.startswith(self.files):
                return Where(self.script.name if name == self.files[0] else name.rpartition("/")[2], frame.f_lineno)
            frame = frame.f_back
        return None

    def problem(self, message: str) -> None:
        """Add a part that cannot be converted, with the line that is running."""
        self.experiment.problems.setdefault((self.where(), message))

    def note(self, message: str) -> None:
        """Add a difference between PyNN and here, with the line that is running."""
        self.experiment.notes.setdefault((self.where(), message))

    def changed(self, what: str) -> None:
        """Register a change. A change before the first run belongs to the network; a later change is a live change."""
        if self.experiment.runs:
            self.experiment.live.append((self.where(), what))
        else:
            self.captured = False

    def capture(self) -> None:
        """Convert the present network, which is complete when its run starts or the next network begins."""
        if not self.captured and self.experiment.populations:
            self.captured = True
            self.close()
            self.networks.append((self.experiment, self.gather(self.experiment, self.script.stem)))

    def close(self) -> None:
        """Save the last network, unless it cannot be converted."""
        if len(self.saved) == len(self.networks):
            return
        experiment, builder = self.networks[-1]
        self.saved.append("" if experiment.problems else f"{len(self.saved)}.yaml")
        if self.saved[-1]:
            builder.close().save(self.folder / self.saved[-1])

    def fail(self, message: str, line: int, kind: str = "raised") -> None:
        """Register an error of the script. An error after reading results, which are empty here, is harmless."""
        harmless = kind == "raised" and self.read and bool(self.networks)
        self.failure = Failure(message, line, harmless, kind)

    def report(self) -> Report:
        """End the session, and return the networks and the error of the script."""
        if self.failure is None or self.failure.harmless:
            self.capture()
        self.close()
        pairs = zip(self.networks, self.saved, strict=True)
        return Report(tuple(experiment.to_report(file) for (experiment, _), file in pairs), self.failure)

    def run(self, simtime: float) -> None:
        """Advance the clock by a time in ms."""
        self.run_until(self.t + simtime)

    def run_until(self, tstop: float) -> None:
        """Advance the clock to a time in ms. Changes since the last run become problems."""
        experiment = self.experiment
        self.capture()
        if self.min_delay == "auto":
            delays = [part.column("delay").min() for part in experiment.projections if len(part)]
            self.min_delay = min(delays, default=self.dt)
        if tstop > self.t:
            for place, call in experiment.live:
                experiment.problems.setdefault((place, f"{call} while the network runs"))
            experiment.live.clear()
            experiment.runs.append(tstop - self.t)
        super().run_until(tstop)

    def written_for_spinnaker(self) -> None:
        """Register that the script imports sPyNNaker, whose default step is 1 ms."""
        experiment = self.experiment
        if not experiment.spinnaker:
            experiment.spinnaker, experiment.timestep, experiment.min_delay = True, 1.0, 1.0
            self.dt = 1.0


SESSION = Session()
SIMULATOR = SimpleNamespace(state=SESSION, ID=mock_simulator.ID, name="neuro")


def setup(timestep: Any = None, min_delay: Any = "auto", **extra: Any) -> int:
    """PyNN's `setup`, which begins a network."""
    SESSION.capture()
    SESSION.close()
    previous = SESSION.experiment
    step = float((1.0 if previous.spinnaker else 0.1) if timestep is None else timestep)
    smallest = step if min_delay in ("auto", None) else float(min_delay)
    common.setup(step, min_delay if min_delay is not None else "auto", **extra)
    SESSION.experiment = Experiment(SESSION.where(), step, max(smallest, step), previous.spinnaker)
    if not previous.populations:
        SESSION.experiment.problems, SESSION.experiment.notes = previous.problems, previous.notes
    SESSION.captured = False
    SESSION.clear()
    SESSION.dt, SESSION.min_delay, SESSION.max_delay = step, min_delay, extra.get("max_delay", "auto")
    return 0


def end(compatible_output: bool = True) -> None:
    """PyNN's `end`."""
    SESSION.capture()


def _is_endless(time: Any) -> bool:
    """Return whether a run has no end. Of an endless run only the network is converted, and a note is added."""
    if time is not None and np.isfinite(time):
        return False
    SESSION.capture()
    SESSION.note("runs without an end")
    return True


_run, _run_until = common.build_run(SIMULATOR)


def run(simtime: Any, callbacks: Any = None) -> float:
    """PyNN's `run`."""
    return float(SESSION.t if _is_endless(simtime) else _run(simtime, callbacks))


def run_until(time_point: Any, callbacks: Any = None) -> float:
    """PyNN's `run_until`."""
    return float(SESSION.t if _is_endless(time_point) else _run_until(time_point, callbacks))


_reset = common.build_reset(SIMULATOR)


def reset(annotations: Any = None) -> None:
    """PyNN's `reset`, which restarts the network. Changes after a reset make another network."""
    _reset(annotations or {})
    SESSION.close()
    previous = SESSION.experiment
    SESSION.experiment = replace(previous, where=SESSION.where(), runs=[], live=[])
    SESSION.captured = SESSION.captured and not previous.live
