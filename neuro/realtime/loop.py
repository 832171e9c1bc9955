"""A network in real time: in each tick it receives events, runs and acts."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from contextlib import nullcontext
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from neuro.core.checks import argument
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError
from neuro.core.interrupts import ending_by
from neuro.realtime.pace import LATE, Pace, punctual
from neuro.realtime.report import Histogram, LiveRun
from neuro.realtime.sources import Inlet, Source
from neuro.run.simulation import Simulation

if TYPE_CHECKING:
    from neuro.run.collect import ResultsWriter


DRAIN_S, COMMIT_S = 0.02, 10.0
"""Time after which records are sent to the file, and time after which the file is committed, s."""

Act = Callable[[float], object]


class Loop:
    """A loop of events -> network -> action, once per tick, in real time.

    An event received in one tick acts in the network in the next tick, at the same time within the tick. After that
    tick the loop calls `act`, which reads the network by ports and acts on the world. The network's time is the clock's
    time since the begin, minus skipped ticks. `act` can read spikes and traces of the tick. Afterwards they are written
    to the file, or forgotten.

    Args:
        sim: the simulation.
        tick: length of a tick in ms, a multiple of the network's resolution.
        inputs: sources of events by the names of event cameras, see `Source`: from `neuro.events.listen`, or a
            `Player`.
        act: function of the network's time in ms, called after each tick.
        late: reaction to an action after the next tick is due: "catch_up" runs the overdue ticks without waiting,
            "skip" leaves them out, drops their events and lets the network's time stand still, "stop" ends the run.
        watch: function called after each action, before the recording is forgotten, like `neuro.live.Page.tick`;
            its time is not part of latencies, but can delay the next tick.

    Raises:
        ModelError: the tick is no multiple of the resolution, a population does not exist, its sensor has another
            size, or an argument has another type.
    """

    def __init__(
        self,
        sim: Simulation,
        *,
        tick: float,
        inputs: Mapping[str, Source] | None = None,
        act: Act | None = None,
        late: str = "catch_up",
        watch: Callable[[], object] | None = None,
    ) -> None:
        if not isinstance(sim, Simulation):
            raise ModelError(f"Loop: found {sim!r:.60}: expected a Simulation")
        if inputs is not None and not isinstance(inputs, Mapping):
            raise ModelError(f"inputs = {inputs!r:.60}: expected sources by the names of event cameras")
        late = argument("late", late, words=LATE)
        if act is not None and not callable(act):
            raise ModelError(f"act = {act!r:.60}: expected a function of the time in ms")
        if watch is not None and not callable(watch):
            raise ModelError(f"watch = {watch!r:.60}: expected a function without arguments")
        self._clock = Clock(sim.program.resolution)
        self._steps = self._clock.step(tick, "tick")
        if not 0 < self._steps < NEVER:
            raise ModelError(f"tick = {_written(tick)}: expected a finite time > 0 ms")
        self._sim, self._act, self._late, self._watch = sim, act, late, watch
        self._inlets = [Inlet(sim, name, source) for name, source in (inputs or {}).items()]
        self._stopped = ""

    def stop(self, why: str = "stopped") -> None:
        """Let a run end after the present tick, from any thread."""
        self._stopped = why

    def run(
        self,
        ms: float,
        *,
        out: str | PathLike[str] | None = None,
        record: Collection[str] = (),
        threads: int = 1,
        report: Callable[[LiveRun], object] | None = None,
    ) -> LiveRun:
        """Run in real time. Ctrl-C or SIGTERM ends the run after the present tick; the recording is then complete.

        The first tick is run before the clock starts, without events, so that all code and data are in memory.

        Args:
            ms: duration of the run, a multiple of the tick.
            out: path of a file of results. It also stores the events of cameras, so that `neuro rerun` can repeat the
                run. Another process writes the file. After a kill, PATH.part has all but the last ten seconds.
            record: names of the populations whose spikes are stored; empty: all recorded populations.
            threads: number of threads of the network, stored in the file.
            report: function called about once per second with the account so far.

        Returns:
            The account of the run: latencies, misses and drops.

        Raises:
            ModelError: the time is no multiple of the tick, the file cannot be written, or the network fails. An error
                of a source or of `act` ends the run, and is raised after the file is complete.
        """
        if report is not None and not callable(report):
            raise ModelError(f"report = {report!r:.60}: expected a function of the account")
        threads = int(argument("threads", threads, kind="integer", at_least=1))
        steps = self._clock.step(ms, "run")
        if not 0 < steps < NEVER:
            raise ModelError(f"run = {_written(ms)}: expected a finite time > 0 ms")
        ticks, remainder = divmod(steps, self._steps)
        if remainder:
            raise ModelError(
                f"run = {_written(ms)}: expected a multiple of the tick, {self._clock.ms(self._steps):g} ms"
            )
        self._stopped = ""
        run, sim = LiveRun(self._clock.ms(self._steps)), self._sim
        recorded = sim.record_to(out, record=record, threads=threads, live=True) if out is not None else nullcontext()
        failure: Exception | None = None
        with recorded as recording:
            chores = _Chores(recording, report)
            with ending_by(lambda: self.stop("interrupted")), punctual():
                try:
                    self._run_first(recording)
                    self._run_ticks(Pace(run, self._late), ticks - 1, chores)
                except Exception as error:
                    failure = error
                    run.ended = f"{type(error).__name__}: {error}"
            run.inputs = {inlet.name: self._counts(inlet) for inlet in self._inlets}
            if recording is not None:
                recording.note("live", run.as_attributes())
        if failure is not None:
            raise failure
        return run

    @staticmethod
    def _counts(inlet: Inlet) -> dict[str, int]:
        return {"taken": inlet.taken, "fed": inlet.fed, "dropped": inlet.dropped, **inlet.counts}

    def _run_first(self, recording: ResultsWriter | None) -> None:
        """Run a tick before the clock starts."""
        for inlet in self._inlets:
            inlet.rehearse()
        self._sim.run(self._clock.ms(self._steps))
        if recording is not None:
            recording.drain()
        self._forget(recording)
        Histogram().add_since(np.zeros(0, dtype=np.int64), 0)

    def _forget(self, recording: ResultsWriter | None) -> None:
        """Forget the records of a run without a file."""
        if recording is None:
            self._sim.forget(self._sim.time)

    def _run_ticks(self, pace: Pace, ticks: int, chores: _Chores) -> None:
        """Run ticks at their times."""
        for inlet in self._inlets:
            inlet.begin()
        run = pace.account
        pace.begin()
        while run.ticks + run.skipped < ticks and not self._stopped:
            pace.wait()
            self._run_tick(pace)
            if self._watch is not None:
                self._watch()
            self._forget(chores.recording)
            if reason := pace.end(ticks):
                self.stop(reason)
            if chores.is_due(pace.acted):
                run.inputs = {inlet.name: self._counts(inlet) for inlet in self._inlets}
                chores.do(run, pace.acted)
        run.ended = self._stopped

    def _run_tick(self, pace: Pace) -> None:
        """Run a tick with the events received before it."""
        sim, step = self._sim, self._clock.step(self._sim.time, "time")
        arrivals = [(inlet, *inlet.take(pace.since, pace.due)) for inlet in self._inlets]
        pace.mark()
        for inlet, events, received in arrivals:
            if events is not None:
                inlet.feed(events, received, pace.due - pace.tick, step, self._steps)
        pace.mark()
        sim.run(self._clock.ms(self._steps))
        pace.mark()
        if self._act is not None:
            self._act(sim.time)
        pace.mark()
        for _, _, received in arrivals:
            pace.account.latency.add_since(received, pace.acted)


def _written(ms: float | str) -> str:
    """Return a time as the user wrote it."""
    return ms if isinstance(ms, str) else f"{ms:g} ms"


class _Chores:
    """Maintenance between ticks."""

    def __init__(self, recording: ResultsWriter | None, report: Callable[[LiveRun], object] | None) -> None:
        self.recording, self._report = recording, report
        now = time.monotonic_ns()
        self._drained = self._looked = self._committed = now

    def is_due(self, time_s: int) -> bool:
        return time_s - self._drained > DRAIN_S * 1e9

    def do(self, run: LiveRun, time_s: int) -> None:
        self._drained = time_s
        recording = self.recording
        if recording is not None:
            recording.drain()
            if time_s - self._committed > COMMIT_S * 1e9:
                self._committed = time_s
                recording.commit()
        if time_s - self._looked > 1e9:
            self._looked = time_s
            if self._report is not None:
                self._report(run)
