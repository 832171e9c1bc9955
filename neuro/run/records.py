"""What has been recorded: in memory, or in a file to which it goes while the network runs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import check_span
from neuro.core.clock import NEVER
from neuro.core.errors import ModelError, a
from neuro.model.neurons import Generator
from neuro.model.parts import Probe
from neuro.program.program import Floats, Ints
from neuro.program.spikes import one_by_one
from neuro.run.handles import Neurons, Run
from neuro.run.turn import Turn, held

if TYPE_CHECKING:
    from neuro.files.results import Results
    from neuro.run.collect import ResultsWriter
    from neuro.run.recorder import Recorder

UNGRADED = "'neuro models' says which neurons are graded; sim.spikes gives times and neurons of all"


class Records:
    """Runs a network and reads what was recorded of it.

    Args:
        run: the network in execution.

    Attributes:
        recording: the file to which all goes now, None where it stays in memory.
        held: the step after which spikes and traces are held; those up to it were forgotten, or are in `file`.
    """

    def __init__(self, run: Run) -> None:
        self._net, self._engine, self._clock, self._handles = run.net, run.engine, run.clock, run.handles
        self._program = run.program
        self._probed = bool(run.program.synapse_probes) or any(p.record != "spikes" for p in run.program.probes)
        self.recording: ResultsWriter | None = None
        self.held = 0
        self._left: tuple[int, Path] | None = None

    @cached_property
    def recorder(self) -> Recorder:
        """Keeps what probes record; made when there is something to keep."""
        from neuro.run.recorder import Recorder

        return Recorder(self._program, self._engine)

    @property
    def held_ms(self) -> float:
        """The time after which spikes and traces can be read."""
        self._notice_drained()
        return 0.0 if self._in_file else self._clock.ms(self.held)

    def check_room(self, steps: int) -> None:
        """Refuse a run that records more than memory, or the disk of the file that takes it, has room for."""
        if self._probed and steps > self.recorder.few_steps:
            self.recorder.check_room(steps, None if self.recording is None else self.recording.path)

    def run(self, steps: int) -> None:
        """Advance the engine, recording on the way."""
        if self.recording is not None:
            self.recording.run(steps)
        elif self._probed:
            self.recorder.run(steps)
        else:
            self._engine.run(steps)

    @contextmanager
    def to_file(
        self,
        sim: Any,
        path: str | PathLike[str],
        threads: int,
        record: Collection[str],
        all_weights: bool,
        live: bool,
        turn: Turn | None,
    ) -> Iterator[ResultsWriter]:
        """Write what is recorded to a file of results within the block, and keep none of it."""
        from neuro.run.collect import ResultsWriter

        with held(turn, "record_to"):
            self.refuse_while_recording("record_to")
            parts = (sim, self._net, self._engine, self.recorder)
            recording = ResultsWriter(*parts, path, threads=threads, record=record, all_weights=all_weights, live=live)
            self.recording = recording
        try:
            yield recording
            with held(turn, "record_to", wait=True):
                recording.finish()
                self._left = self._engine.step, recording.path
        finally:
            with held(turn, "record_to", wait=True):
                self.recording = None
                recording.close()
                self.held = self._engine.step

    def refuse_while_recording(self, what: str) -> None:
        """Refuse what would turn back the time of a file that is being written."""
        if self.recording is not None:
            path = self.recording.part
            raise ModelError(f"{what}: found a simulation that records to {path}: expected the end of 'record_to'")

    def clear(self) -> None:
        """Forget everything."""
        self.recorder.clear()
        self._left, self.held = None, 0

    def restore(self, probes: Mapping[str, NDArray[Any]], held: int) -> None:
        """Take over what had been recorded when a state was saved.

        Args:
            probes: a snapshot of the recorder.
            held: the step after which it was held.
        """
        self.recorder.restore(probes)
        self._left, self.held = None, held

    def forget(self, before: float) -> None:
        """Free the memory of what was recorded up to a time in ms."""
        step = min(self._clock.floor(before, "forget"), self._engine.step)
        self._engine.forget(step)
        self.recorder.forget(step)
        self.held = max(self.held, step)

    def spikes(self, of: Neurons, since: float | None, until: float | None) -> tuple[Floats, Ints]:
        """Times in ms and neurons, sorted by time, then neuron."""
        return self._spikes(of, since, until)[:2]

    def payloads(self, of: Neurons, since: float | None, until: float | None) -> tuple[Floats, Ints, Ints]:
        """Likewise of a graded population, with the payload of each spike."""
        times, ids, payloads = self._spikes(of, since, until)
        if payloads is None:
            raise ModelError(f"payloads of '{of.part.name}', {a(of.part.said)}: its spikes carry none", hint=UNGRADED)
        return times, ids, payloads

    def _spikes(self, of: Neurons, since: float | None, until: float | None) -> tuple[Floats, Ints, Ints | None]:
        if (results := self._file()) is not None and of.part.records:
            return results.graded_spikes_of(of.part.name, of.ids, since, until)
        steps, ids, multiplicity, payloads = self.train(of, since, until)
        steps, ids = one_by_one(of.part.name, multiplicity, steps, ids)
        return self._clock.array_ms(steps), ids, payloads

    def train(
        self, of: Neurons, since: float | None = None, until: float | None = None
    ) -> tuple[Ints, Ints, Ints, Ints | None]:
        """Steps, neurons, multiplicities and payloads of the spikes that are held, sorted by step, then neuron."""
        part = of.part
        if not part.records:
            hint = f"net.probe('name', '{part.name}') records them" if isinstance(part.model, Generator) else ""
            raise ModelError(f"spikes of '{part.name}', {a(part.said)}, are not recorded", hint=hint)
        self._notice_drained()
        after = -1 if since is None else self._clock.floor(since, "since")
        to = NEVER if until is None else self._clock.floor(until, "until")
        check_span(after, to, since, until)
        self._check_held(part.name, since, until)
        found = self._engine.spikes(of.index, after)
        end = None if until is None else np.searchsorted(found.steps, to, side="right")
        steps, ids, multiplicity = found.steps[:end], found.ids[:end], found.multiplicity[:end]
        payloads = None if found.payloads is None else found.payloads[:end].astype(np.int64)
        if of.ids is not None:
            kept = of.among()[ids]
            steps, ids, multiplicity = steps[kept], ids[kept], multiplicity[kept]
            payloads = None if payloads is None else payloads[kept]
        return steps, ids, multiplicity, payloads

    def _notice_drained(self) -> None:
        """What a live run has sent to its file is held no longer."""
        if self.recording is not None and self.recording.live:
            self.held = self.recording.drained

    def _check_held(self, name: str, since: float | None, until: float | None) -> None:
        """Refuse a time of which spikes are not held any more."""
        if not self.held:
            return
        for word, ms in (("since", since), ("until", until)):
            if ms is None or self._clock.floor(ms, word) >= self.held + (word == "until"):
                continue
            held, what = f"{self._clock.ms(self.held):g} ms", f"spikes of '{name}': {word} = {ms:g} ms"
            expected = f"expected {word} {'>=' if word == 'since' else '>'} {held}"
            if self._left is not None and self._left[0] == self.held:
                path = str(self._left[1])
                hint = f"neuro.results.read({path!r}).spikes('{name}') reads them"
                raise ModelError(f"{what}: those up to {held} are in {path}: {expected}", hint=hint)
            hint = f"sim.spikes('{name}') gives all that are held"
            raise ModelError(f"{what}: those up to {held} were forgotten: {expected}", hint=hint)

    def trace(self, probe: Probe) -> tuple[Floats, Any]:
        """What a probe has recorded, of several states by state."""
        traces = {state: self.one_trace(name) for state, name in probe.traces().items()}
        times, values = next(iter(traces.values()))
        if isinstance(probe.record, str):
            return times, values
        by_name: dict[str, Any] = {}
        for state, (_, found) in traces.items():
            by_name |= found if isinstance(found, dict) else {state: found}
        return times, by_name

    def one_trace(self, name: str) -> tuple[Floats, Any]:
        """What was recorded of one state, or the spikes."""
        series, at_pre = self.recorder.series, self.recorder.pre_spikes
        if (name in series or name in at_pre) and (results := self._file()) is not None:
            return results.trace(name)
        if name in series:
            steps, values = series[name].recorded()
            return self._clock.array_ms(steps), values
        if name in at_pre:
            recorded = at_pre[name]
            sent, (pre, post) = recorded.read(), self._handles.ends(recorded.probe.projection)
            ends = {"pre": pre[sent.synapses], "post": post[sent.synapses]}
            return self._clock.array_ms(sent.steps), {**ends, recorded.probe.record: sent.values}
        return self.spikes(self._handles.recorded(self._handles.recording(name)), None, None)

    @property
    def _in_file(self) -> bool:
        if self.recording is not None:
            return not self.recording.live
        return self._left is not None and self._left[0] == self._engine.step

    def _file(self) -> Results | None:
        """What was recorded, where that is in a file: while it is written, and after that until the network runs on.

        A live run does not wait for its file, so what is in memory is all that can be read.
        """
        if not self._in_file:
            return None
        if self.recording is not None:
            return self.recording.results
        assert self._left is not None
        from neuro.files.results import read

        return read(self._left[1])
