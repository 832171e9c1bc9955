"""Access to recorded spikes and traces, in memory or in a file that is written while the network runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.errors import ModelError, a
from neuro.core.quantities import in_ms
from neuro.files.parts import Trace, entries, spikes_in_ms
from neuro.model.neurons import Generator
from neuro.model.parts import Probe
from neuro.program.program import Floats, Ints
from neuro.run.handles import Neurons, Run
from neuro.run.turn import Turn, hold

if TYPE_CHECKING:
    from neuro.files.results import Results
    from neuro.run.collect import ResultsWriter
    from neuro.run.recorder import Recorder

UNGRADED = "sim.spikes returns times and neurons; 'neuro models' lists the graded models"


class Records:
    """Runs a network and reads its records.

    Args:
        run: the network in execution.

    Attributes:
        recording: the file that receives all records, None while records stay in memory.
        held: step after which spikes and traces are in memory. Earlier records were forgotten, or are in a file.
    """

    def __init__(self, run: Run) -> None:
        self._engine, self._clock, self._handles = run.engine, run.clock, run.handles
        self._program = run.program
        self._probed = bool(run.program.synapse_probes) or any(p.record != "spikes" for p in run.program.probes)
        self.recording: ResultsWriter | None = None
        self.held = 0
        self._finished_file: tuple[int, Path] | None = None

    @cached_property
    def recorder(self) -> Recorder:
        """Recorder of the probes, made at first use."""
        from neuro.run.recorder import Recorder

        return Recorder(self._program, self._engine, self._handles.ends)

    @property
    def held_ms(self) -> float:
        """Time in ms after which spikes and traces can be read."""
        self._update_held()
        return 0.0 if self._in_file else self._clock.ms(self.held)

    def check_room(self, steps: int) -> None:
        """Refuse a run whose records do not fit into memory, or onto the disk of the present file."""
        if self._probed and steps > self.recorder.few_steps:
            self.recorder.check_room(steps, None if self.recording is None else self.recording.path)

    def run(self, steps: int) -> None:
        """Advance the engine and record."""
        if self.recording is not None:
            self.recording.run(steps)
        elif self._probed:
            self.recorder.run(steps)
        else:
            self._engine.run(steps)

    @contextmanager
    def to_file(
        self, sim: Any, path: str | PathLike[str], turn: Turn | None, **options: Any
    ) -> Iterator[ResultsWriter]:
        """Write records to a file of results within the block, instead of storing them in memory.

        Args:
            sim: the simulation.
            path: path of the file.
            turn: the turn of the simulation's calls, None within a call.
            options: further arguments of `ResultsWriter`.
        """
        from neuro.run.collect import ResultsWriter

        with hold(turn, "record_to"):
            self.refuse_while_recording("record_to")
            self.recording = recording = ResultsWriter(sim, path, **options)
        try:
            yield recording
            with hold(turn, "record_to", wait=True):
                recording.finish()
                self._finished_file = self._engine.step, recording.path
        finally:
            with hold(turn, "record_to", wait=True):
                self.recording = None
                recording.close()
                self.held = self._engine.step

    def refuse_while_recording(self, what: str) -> None:
        """Refuse a call that would set back the time while a file is written."""
        if self.recording is not None:
            path = self.recording.part
            raise ModelError(f"{what}: found a simulation that records to {path}: expected the end of 'record_to'")

    def clear(self) -> None:
        """Forget all records."""
        self.recorder.clear()
        self._finished_file, self.held = None, 0

    def restore(self, probes: Mapping[str, NDArray[Any]], held: int) -> None:
        """Replace the records by those of a saved state.

        Args:
            probes: a snapshot of the recorder.
            held: step after which spikes and traces are in memory.
        """
        self.recorder.restore(probes)
        self._finished_file, self.held = None, held

    def forget(self, before: float) -> None:
        """Free the memory of the records up to a time in ms."""
        step = min(self._clock.floor(before, "forget"), self._engine.step)
        self._engine.forget(step)
        self.recorder.forget(step)
        self.held = max(self.held, step)

    def spikes(self, of: Neurons, since: float | None, until: float | None) -> tuple[Floats, Ints]:
        """Return times in ms and neurons, sorted by time, then neuron."""
        return self._spikes(of, since, until)[:2]

    def payloads(self, of: Neurons, since: float | None, until: float | None) -> tuple[Floats, Ints, Ints]:
        """Return times in ms, neurons and payloads of a graded population, sorted by time, then neuron."""
        times, ids, payloads = self._spikes(of, since, until)
        if payloads is None:
            raise ModelError(
                f"payloads of '{of.part.name}', {a(of.part.model_name)}: its spikes have no payloads", hint=UNGRADED
            )
        return times, ids, payloads

    def _spikes(self, of: Neurons, since: float | None, until: float | None) -> tuple[Floats, Ints, Ints | None]:
        if (results := self._results_in_file()) is not None and of.part.records:
            return results.graded_spikes_of(of.part.name, of.ids, since, until)
        return spikes_in_ms(of.part.name, self._clock, *self.train(of, since, until))

    def train(self, of: Neurons, since: float | None = None, until: float | None = None) -> tuple[Any, ...]:
        """Return steps, neurons, multiplicities and payloads or None of the spikes in memory, by step, then neuron."""
        part = of.part
        if not part.records:
            hint = f"net.probe('name', '{part.name}') records them" if isinstance(part.model, Generator) else ""
            raise ModelError(f"spikes of '{part.name}', {a(part.model_name)}, are not recorded", hint=hint)
        self._update_held()
        after, to = self._clock.between(since, until)
        self._check_held(part.name, since, until)
        spikes = self._engine.spikes(of.index, after)
        columns = (spikes.steps, spikes.ids, spikes.multiplicity, spikes.payloads)
        return entries(columns, after, to, None if of.ids is None else of.mask())

    def _update_held(self) -> None:
        """Advance `held` by the records that a live run has sent to its file."""
        if self.recording is not None and self.recording.live:
            self.held = self.recording.drained

    def _check_held(self, name: str, since: float | None, until: float | None) -> None:
        """Refuse a time whose spikes are not in memory any more."""
        if not self.held:
            return
        for word, ms in (("since", since), ("until", until)):
            if ms is None or self._clock.floor(ms, word) >= self.held + (word == "until"):
                continue
            oldest = f"{self._clock.ms(self.held):g} ms"
            subject = f"spikes of '{name}': {word} = {in_ms(ms, word):g} ms"
            expected = f"expected {word} {'>=' if word == 'since' else '>'} {oldest}"
            if self._finished_file is not None and self._finished_file[0] == self.held:
                path = str(self._finished_file[1])
                hint = f"neuro.results.read({path!r}).spikes('{name}') reads them"
                raise ModelError(f"{subject}: spikes up to {oldest} are in {path}: {expected}", hint=hint)
            hint = f"sim.spikes('{name}') returns all spikes in memory"
            raise ModelError(f"{subject}: spikes up to {oldest} were forgotten: {expected}", hint=hint)

    def trace(self, probe: Probe) -> tuple[Floats, Any]:
        """Return the records of a probe; of several states, a dictionary by state."""
        traces = {state: self.one_trace(name) for state, name in probe.traces().items()}
        times, values = next(iter(traces.values()))
        if isinstance(probe.record, str):
            return times, values
        by_name: dict[str, Any] = {}
        for state, (_, values_of_state) in traces.items():
            by_name |= values_of_state if isinstance(values_of_state, dict) else {state: values_of_state}
        return times, by_name

    def one_trace(self, name: str) -> tuple[Floats, Any]:
        """Return the records of one state, or the spikes."""
        if name not in self.recorder.records:
            return self.spikes(self._handles.recorded(self._handles.recording(name)), None, None)
        if (results := self._results_in_file()) is not None:
            return results.trace(name)
        arrays = self.recorder.records[name].arrays()
        times, values = arrays.pop("times_ms"), arrays.pop("values")
        return times, {**arrays, self.recorder.probes[name].record: values} if arrays else values

    def traces(self) -> dict[str, Trace]:
        """Return all traces by name, in the order of the program."""
        if (results := self._results_in_file()) is not None:
            return {name: replace(trace) for name, trace in results.traces.items()}  # reads the open file now
        return self._traces_after(-1)

    def empty_traces(self) -> dict[str, Trace]:
        """Return the traces without records."""
        return self._traces_after(NEVER)

    def _traces_after(self, step: int) -> dict[str, Trace]:
        names = self.recorder.probes
        return {name: self.recorder.trace_after(name, step, self._handles.probe_name(name)) for name in names}

    @property
    def _in_file(self) -> bool:
        if self.recording is not None:
            return not self.recording.live
        return self._finished_file is not None and self._finished_file[0] == self._engine.step

    def _results_in_file(self) -> Results | None:
        """Return the results in a file: while the file is written, and afterwards until the network runs again.

        A live run does not wait for its file, so only the records in memory can be read.
        """
        if not self._in_file:
            return None
        if self.recording is not None:
            return self.recording.results
        assert self._finished_file is not None
        from neuro.files.results import read

        return read(self._finished_file[1])
