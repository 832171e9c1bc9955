"""What a simulation records, written to a file while it runs."""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock
from neuro.core.errors import ModelError
from neuro.core.growing import JournaledFile
from neuro.core.hdf5 import FRONT
from neuro.core.outputs import Unwritable, check_output
from neuro.core.paths import file_path
from neuro.core.provenance import ATTRIBUTE
from neuro.files.results import FORMAT, KIND, Results, read_file, unfinished, write_head, write_part
from neuro.model.network import Network
from neuro.program.backend import Engine
from neuro.program.program import Probe, SynapseProbe
from neuro.run import collect
from neuro.run.recorder import Recorder

COMMIT_S = 1.0
"""Seconds after which what was recorded is committed; a kill loses what came after the last commit."""

STRETCH_S = 0.25
"""About how long a stretch of a run takes, between which it is seen whether to commit."""

_CHUNK = 1 << 16


class ResultsWriter:
    """A file of results that grows with a run, and takes its name when it ends.

    Args:
        sim: the simulation, which asks it to run.
        net: the network it was made of.
        engine: that of the simulation.
        recorder: that of the simulation.
        path: of the file; it is written beside, see `neuro.files.results.unfinished`.
        threads: that it runs on.
        record: the populations whose spikes to keep; all that are recorded if empty.
        all_weights: as of `neuro.run.collect.collect`.

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
    ) -> None:
        self._sim, self._engine, self._recorder = sim, engine, recorder
        self._clock = Clock(sim.program.resolution)
        probed = {probe.projection for probe in sim.program.synapse_probes if not probe.every}
        self._ends = {index: sim.program.connections(index) for index in probed}
        self._threads, self._all_weights = threads, all_weights
        self.path = Path(os.path.realpath(file_path(path, "path")))
        self.part = unfinished(self.path)
        for each in (self.path, self.part):
            check_output(each, KIND)
        files = collect.files_of(net)
        with self._unwritable_as_error():
            self._disk = JournaledFile(self.part, FORMAT)
        self._file = h5py.File(self._disk, "w", userblock_size=FRONT)
        self._origin = partial(collect.origin, sim, net, threads, record, all_weights)
        head = {**collect.about(sim, threads), **collect.recordings_of(net), ATTRIBUTE: self._origin()}
        write_head(self._file, {**head, "finished": False}, files)
        self._kept = [
            index
            for index, part in enumerate(sim.program.populations)
            if part.records and (not record or part.name in record)
        ]
        self._make_room()
        self._stretch = 1
        self.commit()

    def _make_room(self) -> None:
        """The parts of the file, still without content."""
        program, counts = self._sim.program, self._sim.counts()
        for index, part in enumerate(program.populations):
            train = collect.no_spikes(self._sim, part, index in self._kept, counts)
            self._add("populations", part.name, train, ("steps", "ids", "multiplicity"), gzip=index in self._kept)
        for projection in program.projections:
            self._add("projections", projection.name, collect.weights_of(self._sim, projection, counts, kept=False), ())
        probes: list[Probe | SynapseProbe] = [*program.probes, *program.synapse_probes]
        for probe in probes:
            if probe.record != "spikes":
                trace = collect.trace_of(self._sim, probe)
                at_pre = ("pre", "post") if probe.every == 0 else ()
                self._add("traces", probe.name, trace, ("times_ms", "values", *at_pre))

    def _add(self, section: str, name: str, part: Any, growing: tuple[str, ...], gzip: bool = False) -> None:
        group = self._file[section].create_group(name)
        for word in growing:
            empty: NDArray[Any] = getattr(part, word)
            chunk = (max(1, _CHUNK // max(1, int(np.prod(empty.shape[1:])))), *empty.shape[1:])
            packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if gzip else {}
            group.create_dataset(
                word, shape=empty.shape, maxshape=(None, *empty.shape[1:]), chunks=chunk, dtype=empty.dtype, **packing
            )
        write_part(group, part)

    def run(self, steps: int) -> None:
        """Advance the simulation, committing about once a second."""
        done = 0
        while done < steps:
            stretch = min(self._stretch, steps - done)
            began = time.perf_counter()
            self._recorder.run(stretch)
            now = time.perf_counter()
            done += stretch
            self._stretch = max(1, int(stretch * min(10.0, STRETCH_S / max(now - began, 1e-9))))
            if now - self._committed >= COMMIT_S:
                self.commit()

    def drain(self) -> None:
        """Move what has been recorded to the file; it is not kept in memory."""
        clock, now = self._clock, self._engine.step
        for index in self._kept:
            found = self._engine.spikes(index, -1)
            end = int(np.searchsorted(found.steps, now, side="right"))
            group = self._file["populations"][self._sim.program.populations[index].name]
            _append(group["steps"], found.steps[:end])
            _append(group["ids"], found.ids[:end])
            _append(group["multiplicity"], found.multiplicity[:end])
        self._engine.forget(now)
        for name, series in self._recorder.series.items():
            steps, values = series.take()
            _append(self._file["traces"][name]["times_ms"], clock.array_ms(steps))
            _append(self._file["traces"][name]["values"], values)
        for name, recorded in self._recorder.pre_spikes.items():
            sent, (pre, post) = recorded.take(), self._ends[recorded.probe.projection]
            group = self._file["traces"][name]
            _append(group["times_ms"], clock.array_ms(sent.steps))
            _append(group["values"], sent.values)
            _append(group["pre"], pre[sent.synapses])
            _append(group["post"], post[sent.synapses])

    def commit(self) -> None:
        """Move what has been recorded to the disk, where it stays whatever happens to this process.

        Raises:
            Unwritable: it cannot be written.
        """
        self.drain()
        self._count()
        with self._unwritable_as_error():
            self._file.flush()
            self._disk.commit()
        self._committed = time.perf_counter()

    def _count(self) -> None:
        """Write the time and the counts of now."""
        self._file.attrs.update(collect.about(self._sim, self._threads))
        counts = self._sim.counts()
        for section, counted in (("populations", counts.populations), ("projections", counts.projections)):
            for name, numbers in counted.items():
                self._file[section][name].attrs.update(collect.counts_of(numbers))
        raw = self._engine.counts()
        for population, spikes, events in zip(self._sim.program.populations, raw.spikes, raw.events, strict=True):
            group = self._file["populations"][population.name]
            group["spike_counts"][...], group["event_counts"][...] = spikes, events

    @property
    def results(self) -> Results:
        """All that has been recorded."""
        self.drain()
        return read_file(self._file, lambda: nullcontext(self._file))

    def finish(self) -> None:
        """Write the weights, and give the file its name.

        Raises:
            Unwritable: it cannot be written.
        """
        counts = self._sim.counts()
        for part in self._sim.program.projections:
            weights = collect.weights_of(self._sim, part, counts, all_weights=self._all_weights)
            write_part(self._file["projections"][part.name], weights)
        self._file.attrs[ATTRIBUTE] = self._origin()
        self._file.attrs["finished"] = True
        self.commit()
        with self._unwritable_as_error():
            self._file.close()
            self._disk.commit()
            self.part.replace(self.path)

    def close(self) -> None:
        """Let go of the file; a run that did not end stays in `part` as far as it was recorded."""
        with suppress(ModelError, OSError, RuntimeError):  # after another error, which is the one to report
            if self._file and self._disk.error is None:
                self.commit()
        with suppress(OSError, RuntimeError):
            self._file.close()
        self._disk.close()

    @contextmanager
    def _unwritable_as_error(self) -> Iterator[None]:
        try:
            yield
        except BlockingIOError:
            raise Unwritable(self.part, "another run writes it: expected another name") from None
        except OSError as error:
            raise Unwritable(self.part, f"cannot be written: {error.strerror or error}") from None


def _append(data: Any, array: NDArray[Any]) -> None:
    if len(array):
        n = data.shape[0]
        data.resize(n + len(array), axis=0)
        data[n:] = array
