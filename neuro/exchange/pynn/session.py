"""What a script of PyNN builds, kept line by line while it runs, and a clock that only passes time."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from pyNN import common
from pyNN.mock import simulator as mock_simulator

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


MOST_SAMPLES = 1_000_000
"""Of a recorded signal that a script reads; a longer one is read as constant at its first so many samples."""


class State(mock_simulator.State):
    """The clock of the simulator."""

    def run(self, simtime: float) -> None:
        """Pass time."""
        self.run_until(self.t + simtime)

    def run_until(self, tstop: float) -> None:
        """Pass time; what the script has changed since it ran cannot be part of a network."""
        experiment = SESSION.experiment
        SESSION.capture()
        if STATE.min_delay == "auto":
            delays = [one.column("delay").min() for one in experiment.projections if len(one)]
            STATE.min_delay = min(delays, default=self.dt)
        if tstop > self.t:
            live = ((where, f"{what} while the network runs") for where, what in experiment.live)
            experiment.problems += [one for one in dict.fromkeys(live) if one not in experiment.problems]
            experiment.live.clear()
            experiment.runs.append(tstop - self.t)
        super().run_until(tstop)

    def written_for_spinnaker(self) -> None:
        """The script imports sPyNNaker, whose steps last 1 ms unless it says so."""
        experiment = SESSION.experiment
        if not experiment.spinnaker:
            experiment.spinnaker, experiment.timestep, experiment.min_delay = True, 1.0, 1.0
            self.dt = 1.0


STATE: Any = State()
SIMULATOR = SimpleNamespace(state=STATE, ID=mock_simulator.ID, name="neuro")


def setup(timestep: Any = None, min_delay: Any = "auto", **extra: Any) -> int:
    """PyNN's `setup`: a network begins."""
    SESSION.capture()
    SESSION.close()
    spinnaker = SESSION.experiment.spinnaker
    step = float((1.0 if spinnaker else 0.1) if timestep is None else timestep)
    smallest = step if min_delay in ("auto", None) else float(min_delay)
    common.setup(step, min_delay if min_delay is not None else "auto", **extra)
    before = SESSION.experiment
    SESSION.experiment = Experiment(SESSION.where(), step, max(smallest, step), spinnaker)
    if not before.populations:
        SESSION.experiment.problems, SESSION.experiment.notes = before.problems, before.notes
    SESSION.captured = False
    STATE.clear()
    STATE.dt, STATE.min_delay, STATE.max_delay = step, min_delay, extra.get("max_delay", "auto")
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
    return float(STATE.t if _until(simtime) else _run(simtime, callbacks))


def run_until(time_point: Any, callbacks: Any = None) -> float:
    """PyNN's `run_until`."""
    return float(STATE.t if _until(time_point) else _run_until(time_point, callbacks))


_reset = common.build_reset(SIMULATOR)


def reset(annotations: Any = None) -> None:
    """PyNN's `reset`: the network begins anew, and what is changed from now on makes another one."""
    _reset(annotations or {})
    SESSION.close()
    was = SESSION.experiment
    SESSION.experiment = replace(was, where=SESSION.where(), runs=[], live=[])
    SESSION.captured = SESSION.captured and not was.live
