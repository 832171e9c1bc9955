"""A network at the pace of the clock: the events of a tick, the network, the action."""

from __future__ import annotations

import ctypes
import gc
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from neuro.core.checks import argument
from neuro.core.clock import NEVER, Clock
from neuro.core.errors import ModelError
from neuro.core.interrupts import ending_by
from neuro.core.memory import free_memory
from neuro.realtime.report import PHASES, Cost, Histogram, LiveRun
from neuro.realtime.sources import Inlet, Source
from neuro.run.simulation import Simulation

if TYPE_CHECKING:
    from neuro.run.collect import ResultsWriter


SPIN_NS = 60_000
"""Before a moment so much time is spent awake: a sleep may end later than asked for."""

_SET_TIMER_SLACK = 29
_POPULATE_WRITE = 23


def wait_until(due_ns: int) -> int:
    """Sleep until shortly before a moment of `time.monotonic_ns`, then look at the clock; the moment of return, ns."""
    now = time.monotonic_ns()
    if due_ns - now > SPIN_NS:
        time.sleep((due_ns - now - SPIN_NS) / 1e9)
    while now < due_ns:
        now = time.monotonic_ns()
    return now


@contextmanager
def punctual() -> Iterator[None]:
    """Let sleeps of this thread end on time, and no garbage be collected unasked, within the block.

    What is in memory already is left out of collections, so that those of the loop are short. Memory that was asked for
    and never written is fetched before.
    """
    was_on = gc.isenabled()
    gc.collect()
    _fetch_memory()
    gc.freeze()
    gc.disable()
    _timer_slack(1)
    try:
        yield
    finally:
        _timer_slack(0)
        gc.unfreeze()
        if was_on:
            gc.enable()


def _timer_slack(ns: int) -> None:
    """How late Linux may wake this thread so as to wake several at once, 0.05 ms unless set; 0 sets that again."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SET_TIMER_SLACK, ns, 0, 0, 0)


def _fetch_memory() -> None:
    """Let all memory of this process be there: the first write to a huge page, of 2 MB, may wait 5 ms for it.

    Where that would take more than half of what is free, and on systems before Linux 5.14, nothing is done.
    """
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return
    places = []
    for line in maps.read_text().splitlines():
        span, access, _, _, inode, *path = line.split(maxsplit=5)
        if access == "rw-p" and inode == "0" and path in ([], ["[heap]"]):
            first, end = (int(each, 16) for each in span.split("-"))
            places.append((first, end - first))
    free = free_memory()
    if free is None or sum(size for _, size in places) < free // 2:
        madvise = ctypes.CDLL(None).madvise
        for first, size in places:
            madvise(ctypes.c_void_p(first), ctypes.c_size_t(size), _POPULATE_WRITE)


def empty_loop(tick_ms: float, ms: float) -> Histogram:
    """What a loop takes that does nothing: from the moment of each tick to its action.

    Args:
        tick_ms: the length of a tick.
        ms: how long.

    Raises:
        ModelError: one of them is not a number > 0.
    """
    tick_ms, ms = argument("tick_ms", tick_ms, above=0), argument("ms", ms, above=0)
    found, tick = Histogram(), round(tick_ms * 1e6)
    with punctual():
        due = time.monotonic_ns()
        for _ in range(max(1, round(ms / tick_ms))):
            due += tick
            found.add(wait_until(due) - due)
    return found


LATE = ("catch_up", "skip", "stop")
"""What to do when a tick's action comes too late."""

DRAIN_S, COMMIT_S = 0.02, 10.0
"""Seconds after which what was recorded is sent to the file, and after which the file keeps it."""

Act = Callable[[float], object]


class Loop:
    """Events -> network -> action, once a tick, at the clock's pace.

    An event that is received in one tick acts in the network in the next, at the same place within it. After that tick
    `act` is called, which reads the network by ports and moves what there is to move. The network's time is that of the
    clock from the begin on, less what was skipped. Spikes and traces of a tick can be read in its `act`; then they go
    to the file, or are forgotten.

    Args:
        sim: the simulation.
        tick: the length of a tick in ms, a multiple of the network's resolution.
        inputs: sources of events by the names of event cameras, see `Source`: what `neuro.events.listen` gives, or a
            `Player`.
        act: called after each tick with the network's time in ms.
        late: where an action comes after the next tick is due: "catch_up" runs the ticks that are due without waiting,
            "skip" leaves out those that are past, drops their events and lets the network's time stand still, "stop"
            ends the run.
        watch: called after each action, before what was recorded is forgotten, like `neuro.live.Page.tick`; no latency
            has the time that it takes, but the next tick may come late by it.

    Raises:
        ModelError: the tick is no such multiple, there is no such population, its sensor is another, or an argument is
            something else.
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
            raise ModelError(f"tick = {_said(tick)}: expected a finite time > 0 ms")
        self._tick = round(self._clock.ms(self._steps) * 1e6)
        self._sim, self._act, self._late, self._watch = sim, act, late, watch
        self._inlets = [Inlet(sim, name, source) for name, source in (inputs or {}).items()]
        self._stopped, self._since = "", 0

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
        """Run in real time. Ctrl-C or SIGTERM ends it after the present tick; what was recorded is then whole.

        The first tick of the network is run before the clock starts, without events, so that all is in memory.

        Args:
            ms: how long, a multiple of the tick.
            out: a file of results that also keeps what cameras were fed, so that `neuro rerun` makes the run again. It
                is written by another process; of one that is killed all but the last ten seconds are in PATH.part.
            record: names of the populations whose spikes to keep; all that are recorded if empty.
            threads: that the network runs on, to be written there.
            report: called about once a second with the account so far.

        Returns:
            The account: latencies, misses, drops.

        Raises:
            ModelError: the time is no multiple, the file cannot be written, or the network fails. An error of a source
                or of `act` ends the run, and is raised when the file is whole.
        """
        if report is not None and not callable(report):
            raise ModelError(f"report = {report!r:.60}: expected a function of the account")
        threads = int(argument("threads", threads, kind="integer", at_least=1))
        steps = self._clock.step(ms, "run")
        if not 0 < steps < NEVER:
            raise ModelError(f"run = {_said(ms)}: expected a finite time > 0 ms")
        ticks, rest = divmod(steps, self._steps)
        if rest:
            raise ModelError(f"run = {_said(ms)}: expected a multiple of the tick, {self._clock.ms(self._steps):g} ms")
        self._stopped = ""
        run, sim = LiveRun(self._clock.ms(self._steps)), self._sim
        recorded = sim.record_to(out, record=record, threads=threads, live=True) if out is not None else nullcontext()
        failure: Exception | None = None
        with recorded as recording:
            chores = _Chores(recording, report)
            with ending_by(lambda: self.stop("interrupted")), punctual():
                try:
                    self._first(recording)
                    self._go(run, ticks - 1, chores)
                except Exception as error:
                    failure = error
                    run.ended = f"{type(error).__name__}: {error}"
            run.inputs = {each.name: self._counts(each) for each in self._inlets}
            if recording is not None:
                recording.note("live", run.kept())
        if failure is not None:
            raise failure
        return run

    @staticmethod
    def _counts(inlet: Inlet) -> dict[str, int]:
        return {"taken": inlet.taken, "fed": inlet.fed, "dropped": inlet.dropped, **inlet.counts}

    def _first(self, recording: ResultsWriter | None) -> None:
        """Run a tick before the clock starts."""
        for inlet in self._inlets:
            inlet.rehearse()
        self._sim.run(self._clock.ms(self._steps))
        if recording is not None:
            recording.drain()
        self._forget(recording)
        Histogram().add_since(np.zeros(0, dtype=np.int64), 0)

    def _forget(self, recording: ResultsWriter | None) -> None:
        """Keep nothing in memory of what was recorded and goes to no file."""
        if recording is None:
            self._sim.forget(self._sim.time)

    def _go(self, run: LiveRun, ticks: int, chores: _Chores) -> None:
        """Run ticks at their times."""
        for inlet in self._inlets:
            inlet.begin()
        tick, late, self._since = self._tick, self._late, 0
        due, number = time.monotonic_ns() + tick, 0
        began = before = Cost.now()
        while number < ticks:
            number += 1
            if time.monotonic_ns() < due:
                run.empty.add(wait_until(due) - due)
            done = self._one(run, due, number)
            if self._watch is not None:
                self._watch()
            self._forget(chores.recording)
            run.ticks += 1
            due += tick
            after = Cost.now()
            if done > due:
                run.misses += 1
                run.missed_cost = run.missed_cost.plus(after.since(before))
                if late == "stop":
                    self.stop(f"the action of tick {number} was {(done - due) / 1e6:.3f} ms late")
                elif late == "skip" and (past := min((done - due) // tick, ticks - number)):
                    run.skipped += past
                    number += past
                    due += past * tick
                    self._since = due - tick
            before = after
            if self._stopped:
                run.ended = self._stopped
                break
            if chores.due(done):
                run.cost = after.since(began)
                run.inputs = {each.name: self._counts(each) for each in self._inlets}
                chores.do(run, done)
        run.cost = Cost.now().since(began)

    def _one(self, run: LiveRun, due: int, number: int) -> int:
        """One tick, that of the events that were received before it was due; when its action was done, ns."""
        sim, step = self._sim, self._clock.step(self._sim.time, "time")
        start = time.monotonic_ns()
        found = [(inlet, *inlet.take(self._since, due)) for inlet in self._inlets]
        taken = time.monotonic_ns()
        for inlet, events, received in found:
            if events is not None:
                inlet.feed(events, received, due - self._tick, step, self._steps)
        fed = time.monotonic_ns()
        sim.run(self._clock.ms(self._steps))
        ran = time.monotonic_ns()
        if self._act is not None:
            self._act(sim.time)
        done = time.monotonic_ns()
        for word, ns in zip(PHASES, (taken - start, fed - taken, ran - fed, done - ran), strict=True):
            run.phases[word].add(ns)
        for _, _, received in found:
            run.latency.add_since(received, done)
        if done - due > run.response.largest_ns:
            marks = (start, taken, fed, ran, done)
            phases = {w: (b - a) / 1e6 for w, a, b in zip(PHASES, marks, marks[1:], strict=False)}
            run.largest_tick = number, phases
        run.response.add(done - due)
        return done


def _said(ms: float | str) -> str:
    """A time as it was given."""
    return ms if isinstance(ms, str) else f"{ms:g} ms"


class _Chores:
    """What is done between ticks, now and then."""

    def __init__(self, recording: ResultsWriter | None, report: Callable[[LiveRun], object] | None) -> None:
        self.recording, self._report = recording, report
        now = time.monotonic_ns()
        self._drained = self._looked = self._committed = now

    def due(self, now: int) -> bool:
        return now - self._drained > DRAIN_S * 1e9

    def do(self, run: LiveRun, now: int) -> None:
        self._drained = now
        recording = self.recording
        if recording is not None:
            recording.drain()
            if now - self._committed > COMMIT_S * 1e9:
                self._committed = now
                recording.commit()
        if now - self._looked > 1e9:
            self._looked = now
            gc.collect()
            if self._report is not None:
                self._report(run)
