"""Collection of the `Results` of a simulation: at the end of a run, or in a file while the network runs."""

from __future__ import annotations

import json
import os
import platform
import tempfile
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.extension import extensions
from neuro.core.inputs import file_path
from neuro.core.outputs import check_output, free_part
from neuro.core.provenance import ATTRIBUTE, provenance
from neuro.core.version import VERSION
from neuro.files.parts import Train, Weights
from neuro.files.recorded import SMALL
from neuro.files.results import KIND, RECORDING, YAML, Results, is_kept, values_of
from neuro.files.state import fingerprint
from neuro.model.language import save
from neuro.model.network import Network
from neuro.program.counts import Counts
from neuro.program.program import Ints, Population, Projection
from neuro.run.results_file import RemoteFile, ResultsFile


def collect(
    sim: Any,
    net: Network,
    *,
    threads: int = 1,
    record: Collection[str] = (),
    all_weights: bool = False,
    weights: bool = True,
    records: bool = True,
) -> Results:
    """Return the results of a simulation.

    Args:
        sim: a simulation that has run.
        net: the network it was compiled from.
        threads: number of threads of the run.
        record: names of the populations whose spikes are included; empty: all recorded populations.
        all_weights: whether to include the weights of static projections above a million synapses, too. They follow
            from network and seed.
        weights: whether to include weights at all; `all_weights_of` yields them one projection after the other.
        records: whether to include spikes and traces; without them the arrays are empty.
    """
    program, counts, raw = sim.program, sim.counts(), sim.taken().raw_counts
    included = record or [part.name for part in program.populations]
    return Results(
        {
            **about(sim, threads),
            **recordings_of(net),
            ATTRIBUTE: origin(sim, net, threads, record, all_weights),
            "finished": records,
        },
        files_of(net),
        {
            p.name: replace(
                train_of(sim, p, p.name in included, counts, records), spike_counts=spikes, event_counts=events
            )
            for p, spikes, events in zip(program.populations, raw.spikes, raw.events, strict=True)
        },
        {
            p.name: weights_of(sim, p, counts, all_weights=all_weights, includes_weights=weights)
            for p in program.projections
        },
        sim.traces if records else sim._records.empty_traces(),
    )


def about(sim: Any, threads: int) -> dict[str, Any]:
    """Return the attributes of a run: network, backend, seed, versions, duration and counts."""
    program, counts = sim.program, sim.counts()
    totals = ("steps", "spikes", "neuron_updates", "neuron_updates_active", "synaptic_ops", "learning_updates")
    return {
        "network": program.name,
        "backend": sim.backend,
        "seed": program.seed,
        "threads": threads,
        "duration_ms": sim.time,
        "resolution_ms": program.resolution,
        "neuro": VERSION,
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "numba")},
        **{f"counts.{name}": getattr(counts, name) for name in totals},
        **{f"native.{name}": count for name, count in counts.native.items()},
        **({"host_work": json.dumps([part.as_list() for part in sim.host_work])} if sim.host_work else {}),
    }


def origin(sim: Any, net: Network, threads: int, record: Collection[str], all_weights: bool) -> str:
    """Return the provenance of a run as JSON, see `neuro.core.provenance`, with its options and `steered`."""
    about_run = record_of(
        net, backend=sim.backend, threads=threads, seed=sim.program.seed, network=fingerprint(sim.program)
    )
    return json.dumps({**about_run, "record": list(record), "all_weights": all_weights, "steered": list(sim.steered)})


def steered_since(record: str, sim: Any) -> str:
    """Return the record of `origin` with the present list of calls that changed the simulation."""
    return json.dumps({**json.loads(record), "steered": list(sim.steered)})


def record_of(net: Network, **of_a_run: Any) -> dict[str, Any]:
    """Return the provenance of a result that is made with a network now."""
    return provenance((*net.inputs, *recordings_of(net).values(), *extensions()), **of_a_run)


def recordings_of(net: Network) -> dict[str, str]:
    """Return the paths of event camera recordings and wiring diagrams, as attributes of results."""
    files = {name: getattr(part.model, "file", None) for name, part in net.populations.items()}
    tables = ((name, part.neurons) for name, part in net.populations.items())
    files |= {f"{name}.neurons": table.file for name, table in tables if table is not None}
    files |= {f"{name}.edges": getattr(part.rule, "file", None) for name, part in net.projections.items()}
    return {f"{RECORDING}{name}": os.path.abspath(file) for name, file in files.items() if isinstance(file, Path)}


def files_of(net: Network) -> dict[str, bytes]:
    """Return the files that `net.save` writes, by name. Recordings are referenced, not copied."""
    with tempfile.TemporaryDirectory() as folder:
        save(net, Path(folder) / YAML, anywhere=True)
        return {file.name: file.read_bytes() for file in sorted(Path(folder).iterdir())}


def train_of(sim: Any, part: Population, includes_spikes: bool, counts: Counts, records: bool = True) -> Train:
    """Return the results of a population, without spike counts.

    The population counts as recorded if `includes_spikes` is true. Without `records` it has no spikes yet.
    """
    none, zeros = np.zeros(0, np.int64), np.zeros(part.size, np.int64)
    is_recorded = includes_spikes and part.records
    fields = (part.model_name, part.shape, asdict(counts.populations[part.name]), is_recorded)
    steps, ids, multiplicity, payloads = none, none, none, none if part.model.graded else None
    if is_recorded and records:
        steps, ids, multiplicity, payloads = sim._records.train(sim.handles.neurons(part.name))
    payloads = None if payloads is None else payloads.astype(np.int32)
    emits = "current" if part.kind == "current" else "spikes"
    return Train(*fields, sim.program.resolution, steps, ids, multiplicity, zeros, zeros, emits, payloads)


def weights_of(
    sim: Any, part: Projection, counts: Counts, *, all_weights: bool = False, includes_weights: bool = True
) -> Weights:
    """Return the results of a projection, with weights if `includes_weights` is true."""
    names = [population.name for population in sim.program.populations]
    first_fields = (names[part.source], names[part.target], part.synapse.name, part.size)
    fields = (*first_fields, asdict(counts.projections[part.name]))
    if (
        part.undrawn is not None
        or not includes_weights
        or not (all_weights or part.synapse.learns or part.size <= SMALL)
    ):
        return Weights(*fields, drawn_by=None if part.undrawn is None else sim.backend)
    if part.grid is not None:
        return Weights(*fields, weight=sim.weights(part.name))
    delay = sim.get(part.name, "delay") if part.synapse.delays else None
    pre, post, weight = sim.weights(part.name)
    return Weights(*fields, pre, post, weight, delay)


def all_weights_of(sim: Any, all_weights: bool) -> Iterator[tuple[str, Weights]]:
    """Yield the projections by name, with weights, one after the other."""
    counts = sim.counts()
    for part in sim.program.projections:
        yield part.name, weights_of(sim, part, counts, all_weights=all_weights)


COMMIT_S = 1.0
"""Seconds between commits. A run that is killed loses the records after the last commit."""

STRETCH_S = 0.25
"""Approximate duration in seconds of one part of a run. Between two parts a commit is possible."""

_FIRST = np.ones(1, dtype=np.bool_)


class ResultsWriter:
    """A file of results that grows during a run, and gets its final name at the end.

    Args:
        sim: the simulation, which calls `run`.
        path: the final path. The first free `.part` file beside it is written, so that no recording of an earlier run
            is lost.
        threads: number of threads of the run.
        record: names of the populations whose spikes are stored; empty: all recorded populations.
        all_weights: whether to store the weights of static projections above a million synapses, too.
        live: whether another process writes the file, so that the run never waits for the disk.

    Attributes:
        drained: the step up to which records have been moved out of memory.

    Raises:
        Unwritable: the file cannot be written, or another run writes it.
    """

    def __init__(
        self,
        sim: Any,
        path: str | os.PathLike[str],
        *,
        threads: int = 1,
        record: Collection[str] = (),
        all_weights: bool = False,
        live: bool = False,
    ) -> None:
        self._sim, self._engine, self._recorder = sim, sim._engine, sim._records.recorder
        self._threads, self._all_weights = threads, all_weights
        self.path = Path(os.path.realpath(file_path(path, "path")))
        self.part = free_part(self.path, is_kept)
        for output in (self.path, self.part):
            check_output(output, KIND)
        results = collect(
            sim, sim._net, threads=threads, record=record, all_weights=all_weights, weights=False, records=False
        )
        self._origin = results.about[ATTRIBUTE]
        self._recorded = [
            index for index, part in enumerate(sim.program.populations) if results.populations[part.name].recorded
        ]
        self.live, self.drained, self._finished = live, self._engine.step, False
        self._file: ResultsFile | RemoteFile = RemoteFile(self.part) if live else ResultsFile(self.part)
        self._fed: dict[str, list[tuple[Ints, Ints, NDArray[np.uint32]]]] = {}
        self._stretch = 1
        try:
            self._file.do("begin", results, not live)  # compression would take processor time from a live run
            self.commit(wait=True)
        except BaseException:
            self._file.close()
            raise

    def feed(self, population: str, steps: Ints, ids: Ints) -> None:
        """Store the events that an event camera was fed, so that the run can be repeated."""
        if steps.size:
            firsts = np.flatnonzero(np.concatenate([_FIRST, steps[1:] != steps[:-1]]))
            sizes = np.diff(firsts, append=steps.size)
            self._fed.setdefault(population, []).append((steps[firsts], sizes, ids.astype(np.uint32)))

    def run(self, steps: int) -> None:
        """Advance the simulation and commit about once a second. A live run commits only when `commit` is called."""
        finished = 0
        while finished < steps:
            stretch = min(self._stretch, steps - finished)
            begin = time.perf_counter()
            self._recorder.run(stretch)
            end = time.perf_counter()
            finished += stretch
            self._stretch = max(1, int(stretch * min(10.0, STRETCH_S / max(end - begin, 1e-9))))
            if end - self._committed >= COMMIT_S and not self.live:
                self.commit()

    def drain(self) -> None:
        """Move the records from memory to the file."""
        step = self._engine.step
        for index in self._recorded:
            recorded_spikes = self._engine.spikes(index, -1)
            end = int(np.searchsorted(recorded_spikes.steps, step, side="right"))
            spikes: dict[str, NDArray[Any]] = {"steps": recorded_spikes.steps[:end], "ids": recorded_spikes.ids[:end]}
            spikes["multiplicity"] = recorded_spikes.multiplicity[:end]
            if recorded_spikes.payloads is not None:
                spikes["payloads"] = recorded_spikes.payloads[:end]
            self._append(f"populations/{self._sim.program.populations[index].name}", spikes)
        if self._sim._signals is not None:
            self._sim._signals.listen()
        self._engine.forget(step)
        self.drained = step
        for name, trace in self._recorder.take():
            self._append(f"traces/{name}", trace)
        for name, batches in self._fed.items():
            if batches:
                columns = (np.concatenate(column) for column in zip(*batches, strict=True))
                self._append(f"fed/{name}", dict(zip(("steps", "sizes", "ids"), columns, strict=True)))
                batches.clear()

    def _append(self, group: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        if any(len(array) for array in arrays.values()):
            self._file.do("append", group, arrays)

    def commit(self, wait: bool = False) -> None:
        """Write all records to disk, where they survive a crash of this process.

        Args:
            wait: whether to wait until another process has written them.

        Raises:
            Unwritable: the file cannot be written.
        """
        self.drain()
        self._write_counts()
        self._file.do("commit", wait=wait)
        self._committed = time.perf_counter()

    def _write_counts(self, **more: Any) -> None:
        """Write the present time and counts, and further attributes of the file."""
        program, counts, raw = self._sim.program, self._sim.counts(), self._engine.counts()
        about_run = about(self._sim, self._threads) | {ATTRIBUTE: steered_since(self._origin, self._sim)} | more
        values: dict[str, dict[str, Any]] = {"/": about_run}
        for section, counted in (("populations", counts.populations), ("projections", counts.projections)):
            values |= {f"{section}/{name}": {"counts": asdict(numbers)} for name, numbers in counted.items()}
        for population, spikes, events in zip(program.populations, raw.spikes, raw.events, strict=True):
            values[f"populations/{population.name}"] |= {"spike_counts": spikes, "event_counts": events}
        self._file.do("update", values)

    @property
    def results(self) -> Results:
        """Results so far."""
        self.drain()
        if self.live:
            self._write_counts()
        return self._file.results

    def note(self, place: str, numbers: Mapping[str, Any]) -> None:
        """Write additional numbers as attributes of a group."""
        self._file.do("update", {place: numbers})

    def finish(self) -> None:
        """Write the weights, and give the file its final name.

        Raises:
            Unwritable: the file cannot be written.
        """
        for name, weights in all_weights_of(self._sim, self._all_weights):
            self._file.do("update", {f"projections/{name}": values_of(weights)})
        self.drain()
        self._write_counts(finished=True)
        self._file.do("finish", self.path, wait=True)
        self._finished = True

    def close(self) -> None:
        """Close the file. After an unfinished run, the `.part` file holds the records so far."""
        with suppress(ModelError, OSError, RuntimeError):  # an earlier error is the one to report
            if not self._finished:
                self.commit()
        self._file.close()
