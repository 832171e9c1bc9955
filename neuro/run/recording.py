"""What a simulation records, written to a file while it runs."""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.core.outputs import check_output, free_part
from neuro.core.paths import file_path
from neuro.core.provenance import ATTRIBUTE
from neuro.files.results import KIND, Results, is_kept
from neuro.model.network import Network
from neuro.program.backend import Engine
from neuro.program.program import Ints, Probe, SynapseProbe
from neuro.run import collect
from neuro.run.recorder import Recorder
from neuro.run.results_file import ResultsFile
from neuro.run.writer_process import RemoteFile

COMMIT_S = 1.0
"""Seconds after which what was recorded is committed; a kill loses what came after the last commit."""

STRETCH_S = 0.25
"""About how long a stretch of a run takes, between which it is seen whether to commit."""

_FIRST = np.ones(1, dtype=np.bool_)


class ResultsWriter:
    """A file of results that grows with a run, and takes its name when it ends.

    Args:
        sim: the simulation, which asks it to run.
        net: the network it was made of.
        engine: that of the simulation.
        recorder: that of the simulation.
        path: of the file; it is written beside, to the first part that keeps no recording of an earlier run.
        threads: that it runs on.
        record: the populations whose spikes to keep; all that are recorded if empty.
        all_weights: as of `neuro.run.collect.collect`.
        live: whether another process writes the file, so that the run waits for no disk.

    Attributes:
        drained: the step up to which what was recorded has been moved out of memory.

    Raises:
        Unwritable: the file cannot be written, or another run writes it.
    """

    def __init__(
        self,
        sim: collect.RunSource,
        net: Network,
        engine: Engine,
        recorder: Recorder,
        path: str | os.PathLike[str],
        *,
        threads: int = 1,
        record: Collection[str] = (),
        all_weights: bool = False,
        live: bool = False,
    ) -> None:
        self._sim, self._engine, self._recorder = sim, engine, recorder
        self._clock = Clock(sim.program.resolution)
        probed = {probe.projection for probe in sim.program.synapse_probes if not probe.every}
        self._ends = {index: sim.program.connections(index) for index in probed}
        self._threads, self._all_weights = threads, all_weights
        self.path = Path(os.path.realpath(file_path(path, "path")))
        self.part = free_part(self.path, is_kept)
        for each in (self.path, self.part):
            check_output(each, KIND)
        files = collect.files_of(net)
        self.live, self.drained, self._finished = live, engine.step, False
        self._file: ResultsFile | RemoteFile = RemoteFile(self.part) if live else ResultsFile(self.part)
        self._origin = collect.origin(sim, net, threads, record, all_weights)
        head = {**collect.about(sim, threads), **collect.recordings_of(net), ATTRIBUTE: self._origin}
        self._kept = [
            index
            for index, part in enumerate(sim.program.populations)
            if part.records and (not record or part.name in record)
        ]
        self._fed: dict[str, list[tuple[Ints, Ints, NDArray[np.uint32]]]] = {}
        self._stretch = 1
        try:
            self._file.begin({**head, "finished": False}, files)
            self._make_room()
            self.commit()
            if isinstance(self._file, RemoteFile):
                self._file.wait()
        except BaseException:
            self._file.close()
            raise

    def _make_room(self) -> None:
        """The parts of the file, still without content."""
        program, counts = self._sim.program, self._sim.counts()
        for index, part in enumerate(program.populations):
            train, kept = collect.no_spikes(self._sim, part, index in self._kept, counts), index in self._kept
            grows = ("steps", "ids", "multiplicity", *(("payloads",) if part.model.graded else ()))
            self._file.add(f"populations/{part.name}", train, grows, kept)
        for projection in program.projections:
            weights = collect.weights_of(self._sim, projection, counts, kept=False)
            self._file.add(f"projections/{projection.name}", weights, ())
        probes: list[Probe | SynapseProbe] = [*program.probes, *program.synapse_probes]
        for probe in probes:
            if probe.record != "spikes":
                at_pre = ("pre", "post") if probe.every == 0 else ()
                trace = collect.trace_of(self._sim, probe)
                self._file.add(f"traces/{probe.name}", trace, ("times_ms", "values", *at_pre))

    def feed(self, population: str, steps: Ints, ids: Ints) -> None:
        """Keep what an event camera was fed, so that the run can be made again."""
        if steps.size:
            firsts = np.flatnonzero(np.concatenate([_FIRST, steps[1:] != steps[:-1]]))
            sizes = np.diff(firsts, append=steps.size)
            self._fed.setdefault(population, []).append((steps[firsts], sizes, ids.astype(np.uint32)))

    def run(self, steps: int) -> None:
        """Advance the simulation, committing about once a second; what is live commits when it is asked to."""
        done = 0
        while done < steps:
            stretch = min(self._stretch, steps - done)
            began = time.perf_counter()
            self._recorder.run(stretch)
            now = time.perf_counter()
            done += stretch
            self._stretch = max(1, int(stretch * min(10.0, STRETCH_S / max(now - began, 1e-9))))
            if now - self._committed >= COMMIT_S and not self.live:
                self.commit()

    def drain(self) -> None:
        """Move what has been recorded to the file; it is not kept in memory."""
        clock, now = self._clock, self._engine.step
        for index in self._kept:
            found = self._engine.spikes(index, -1)
            end = int(np.searchsorted(found.steps, now, side="right"))
            spikes: dict[str, NDArray[Any]] = {"steps": found.steps[:end], "ids": found.ids[:end]}
            spikes["multiplicity"] = found.multiplicity[:end]
            if found.payloads is not None:
                spikes["payloads"] = found.payloads[:end]
            self._append(f"populations/{self._sim.program.populations[index].name}", spikes)
        self._engine.forget(now)
        self.drained = now
        for name, series in self._recorder.series.items():
            steps, values = series.take()
            self._append(f"traces/{name}", {"times_ms": clock.array_ms(steps), "values": values})
        for name, recorded in self._recorder.pre_spikes.items():
            sent, (pre, post) = recorded.take(), self._ends[recorded.probe.projection]
            ends = {"pre": pre[sent.synapses], "post": post[sent.synapses]}
            sent_at: dict[str, NDArray[Any]] = {"times_ms": clock.array_ms(sent.steps), "values": sent.values}
            self._append(f"traces/{name}", sent_at | ends)
        for name, fed in self._fed.items():
            if fed:
                columns = (np.concatenate(column) for column in zip(*fed, strict=True))
                self._append(f"fed/{name}", dict(zip(("steps", "sizes", "ids"), columns, strict=True)))
                fed.clear()

    def _append(self, place: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        if any(len(array) for array in arrays.values()):
            self._file.append(place, arrays)

    def commit(self) -> None:
        """Move what has been recorded to the disk, where it stays whatever happens to this process.

        Raises:
            Unwritable: it cannot be written.
        """
        self.drain()
        self._count()
        self._file.commit()
        self._committed = time.perf_counter()

    def _count(self) -> None:
        """Write the time and the counts of now."""
        program, counts, raw = self._sim.program, self._sim.counts(), self._engine.counts()
        origin = collect.steered_since(self._origin, self._sim)
        attributes: dict[str, dict[str, Any]] = {"/": {**collect.about(self._sim, self._threads), ATTRIBUTE: origin}}
        for section, counted in (("populations", counts.populations), ("projections", counts.projections)):
            attributes |= {f"{section}/{name}": collect.counts_of(numbers) for name, numbers in counted.items()}
        arrays = {
            f"populations/{population.name}": {"spike_counts": spikes, "event_counts": events}
            for population, spikes, events in zip(program.populations, raw.spikes, raw.events, strict=True)
        }
        self._file.update(attributes, arrays)

    @property
    def results(self) -> Results:
        """All that has been recorded."""
        self.drain()
        if self.live:
            self._count()
        return self._file.results

    def note(self, place: str, numbers: Mapping[str, Any]) -> None:
        """Write what else is to be kept, as attributes of a group."""
        self._file.update({place: numbers}, {})

    def finish(self) -> None:
        """Write the weights, and give the file its name.

        Raises:
            Unwritable: it cannot be written.
        """
        counts = self._sim.counts()
        for part in self._sim.program.projections:
            weights = collect.weights_of(self._sim, part, counts, all_weights=self._all_weights)
            self._file.complete(f"projections/{part.name}", weights)
        self.drain()
        self._count()
        self._file.update({"/": {"finished": True}}, {})
        self._file.finish(self.path)
        self._finished = True

    def close(self) -> None:
        """Let go of the file; a run that did not end stays in `part` as far as it was recorded."""
        with suppress(ModelError, OSError, RuntimeError):  # after another error, which is the one to report
            if not self._finished:
                self.commit()
        self._file.close()
