"""Results of a run, in memory and as a self-describing HDF5 file. The file can be read while a run writes it.

```
/                   attributes: format "neuro results 3", network (name), backend, seed, threads, duration_ms,
                    resolution_ms, counts.* of the run, native.* (counts of the backend alone), the versions of neuro,
                    python, numpy and numba, finished (the run reached its end), and recording.NAME (path of the
                    recording of an event camera)
/network            the network as YAML text
/network_files/F    file F that the YAML reads, byte for byte
/populations/NAME   attributes: model, shape, recorded, emits, resolution_ms, counts.*
    steps           int64, sorted; a step times resolution_ms is its time in ms
    ids             int64
    multiplicity    int64, spikes of that neuron in that step
    payloads        int32, payload of each spike of a graded population
    spike_counts    int64, spikes of each neuron
    event_counts    int64, steps of each neuron with spikes
/projections/NAME   attributes: source, target, synapse, synapses, counts.*
    pre, post       int64; absent for a grid
    weight          float64 at the end; (maps, channels, height, width) for a grid
    delay_ms        float64 at the end, if the rule changes delays
/world              returns, lengths, steps of the episodes, rewards, actions of the last block of a closed loop
/traces/NAME        attributes: population or projection, state, unit, probe, mean
    times_ms        float64
    values          float64, (times, columns); (times,) for a rate or a mean and at pre spikes
    ids             int64, the neuron of each column; absent for all neurons
    pre, post       int64, the ends of the synapse of each column; at pre spikes of each time
```

A probe of several states has a trace NAME.STATE for each state. Spikes and weights without a record have no arrays. A
file that a run still writes (`neuro.run.collect`) gets the weights at the end. The counts of each neuron determine the
bill, so a report and the simulation have the same joules.
"""

from __future__ import annotations

import fcntl
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from itertools import takewhile
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import h5py
import numpy as np

from neuro.core.clock import Clock
from neuro.core.errors import ModelError, a, unknown
from neuro.core.growing import JournalReader
from neuro.core.hdf5 import check_tree, has_format, new_file
from neuro.core.inputs import existing, record_input
from neuro.core.outputs import Kind, kept_parts
from neuro.core.tables import Table, as_html, as_text
from neuro.files.finished_runs import RecordingSearch, native_counts, one_each, weights
from neuro.files.parts import Fed, Opener, Stored, Trace, Train, Weights, entries, spikes_in_ms, unread
from neuro.model.network import Network
from neuro.model.parts import Part
from neuro.model.views import NameAndShape, View, view_of_index
from neuro.program.counts import Counts, PopulationCounts, ProjectionCounts
from neuro.program.program import Floats, Ints

if TYPE_CHECKING:
    import neo

    from neuro.files.recorded import DataFrames

FORMAT = "neuro results 3"
SECTIONS = ("populations", "projections", "traces")
YAML = "network.yaml"
_LARGE = 10_000
_COUNT = "counts."
PACKED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
"""Options of `h5py` for compressed arrays."""

RECORDING = "recording."
"""Prefix of the attributes with the path of the recording of an event camera."""


KIND = Kind("a file of results", lambda path: has_format(path, FORMAT))


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Results of a run, with the methods of a simulation for spikes, traces and weights.

    A part of the network may be given by name, as the part itself, or as a view of the part. Arrays are read from the
    file on first access. For spikes in a window, only the window is read.

    Attributes:
        about: attributes of the file: network, backend, seed, threads, duration_ms, resolution_ms, counts, versions.
        files: files of the network by name; the YAML text is `network.yaml`.
        populations, projections, traces: parts by name.
        path: path of the file; None for results in memory.
        fed: spikes fed to event cameras during the run, by name; `sim.replay(results)` feeds them again.
        live: latencies, missed deadlines and drops of a run in real time, by name.
        world: values of a closed loop by name: returns, lengths and steps, (episodes,); rewards (steps, copies) and
            actions (steps, copies, ...) of the last block, whose spikes were recorded.
    """

    about: dict[str, Any]
    files: dict[str, bytes]
    populations: dict[str, Train]
    projections: dict[str, Weights]
    traces: dict[str, Trace]
    path: Path | None = None
    fed: dict[str, Fed] = field(default_factory=dict)
    live: dict[str, Any] = field(default_factory=dict)
    world: dict[str, Any] = field(default_factory=dict)

    @property
    def duration_ms(self) -> float:
        """Length of the run in ms."""
        return float(self.about["duration_ms"])

    def __repr__(self) -> str:
        name, backend = self.about["network"], self.about.get("backend", "")
        return f"Results({name!r}, backend={backend!r}, duration={self.duration_ms:g} ms)"

    def _repr_html_(self) -> str:
        return as_html(repr(self), self._tables())

    def __str__(self) -> str:
        return as_text(repr(self), self._tables())

    def _tables(self) -> list[Table]:
        """Return tables with a row for each population, projection and trace."""
        trains, weights, traces = self.populations.items(), self.projections.items(), self.traces.items()
        return [
            run_table(self.duration_ms, ((name, t.model, t.size, t.spikes) for name, t in trains)),
            projection_table((name, w.source, w.target, w.synapse_text, w.synapses) for name, w in weights),
            Table(
                "traces",
                ("name", "of", "state", ">columns", ">times"),
                tuple((name, t.of, t.state, f"{t.columns:,}", f"{t.times_ms.size:,}") for name, t in traces),
            ),
        ]

    def to_neo(self) -> neo.Block:
        """Return spikes and traces as a Neo block, see `neuro.files.recorded.to_neo`. Requires the extra `neo`."""
        from neuro.files.recorded import to_neo

        return to_neo(self)

    def to_pandas(self) -> DataFrames:
        """Return spikes, rates, traces and weights as data frames. Requires the extra `pandas`."""
        from neuro.files.recorded import to_pandas

        return to_pandas(self)

    @property
    def time(self) -> float:
        """End of the run in ms, as in a simulation."""
        return self.duration_ms

    @property
    def held(self) -> float:
        """Time in ms after which spikes and traces can be read, as in a simulation. Results always have 0."""
        return 0.0

    @property
    def finished(self) -> bool:
        """True if the run reached its end. Otherwise the results have the records up to `time`."""
        return bool(self.about["finished"])

    def spikes(self, of: Any, since: float | None = None, until: float | None = None) -> tuple[Floats, Ints]:
        """Return the recorded spikes of a population or a view.

        Args:
            of: the population, its name, or a view.
            since: begin in ms, excluded.
            until: end in ms, included.

        Returns:
            times in ms and neurons, sorted by time, then neuron. A neuron with several spikes in one step has as many
            entries. Neurons are ids of the population, also for a view.

        Raises:
            ModelError: the population does not exist, or its spikes were not recorded.
        """
        return self.spikes_of(*self._neurons(of), since, until)

    def spikes_of(self, name: str, ids: Ints | None, since: float | None, until: float | None) -> tuple[Floats, Ints]:
        """Return the spikes of the neurons `ids` of a population, or of all if `ids` is None, see `spikes`."""
        return self.graded_spikes_of(name, ids, since, until)[:2]

    def payloads(self, of: Any, since: float | None = None, until: float | None = None) -> tuple[Floats, Ints, Ints]:
        """Return the recorded spikes of a graded population: times in ms and neurons as in `spikes`, and payloads.

        Raises:
            ModelError: see `spikes`; or the spikes have no payloads.
        """
        name, ids = self._neurons(of)
        times, neurons, payloads = self.graded_spikes_of(name, ids, since, until)
        if payloads is None:
            raise ModelError(f"payloads of '{name}', {a(self.populations[name].model)}: its spikes have no payloads")
        return times, neurons, payloads

    def graded_spikes_of(
        self, name: str, ids: Ints | None, since: float | None, until: float | None
    ) -> tuple[Floats, Ints, Ints | None]:
        """Return the spikes of the neurons `ids` of a population, or of all, with payloads or None."""
        train = self.populations[name]
        if not train.recorded:
            hint = f"'neuro run --record {name}' records them" if train.emits == "spikes" else ""
            raise ModelError(f"spikes of '{name}', {a(train.model)}, are not recorded", hint=hint)
        clock = Clock(float(self.about["resolution_ms"]))
        after, to = clock.between(since, until)
        words = ("steps", "ids", "multiplicity", "payloads")
        columns = [getattr(train, word) if after <= 0 and until is None else unread(train, word) for word in words]
        is_selected = None if ids is None else np.isin(np.arange(train.size), ids)
        return spikes_in_ms(name, clock, *entries(columns, after, to, is_selected))

    def trace(self, of: Any) -> tuple[Floats, Any]:
        """Return the record of a probe, in the form of `Simulation.trace`.

        Raises:
            ModelError: the probe does not exist, or its spikes were not stored.
        """
        name = _name(of)
        if name in self.traces:
            return self.traces[name].times_ms, self.traces[name].read()
        matches = [trace for trace in self.traces.values() if trace.probe == name]
        if not matches:
            # A probe of spikes has times and neurons.
            probes = self.network(played=False).probes
            if name not in probes:
                raise unknown("probe", name, [*dict.fromkeys([*self.traces, *probes])])
            probe = probes[name]
            return self.spikes(probe.of if probe.view is None else probe.view)
        by_name: dict[str, Any] = {}
        for trace in matches:
            values = trace.read()
            by_name |= values if isinstance(values, dict) else {trace.state: values}
        return matches[0].times_ms, by_name

    def weights(self, part: Any, /, *, of: Any = None, pre: Any = None, post: Any = None, delays: bool = False) -> Any:
        """Return the weights of a projection at the end of the run, in the form of `Simulation.weights`.

        Args:
            part: the projection, or its name.
            of: pairs (source, target) of the synapses to return, in the order of the pairs.
            pre: source neurons of the synapses to return: a population, a view of it, or ids.
            post: target neurons of the synapses to return.
            delays: True to return the delays in ms, too. Delays that no rule changes follow from network and seed.

        Returns:
            (pre, post, weight), or with `delays` (pre, post, weight, delay). For a grid the kernels, or with `delays`
            (kernels, delay).

        Raises:
            ModelError: the projection does not exist, or its weights were not stored.
        """
        return weights(self, _name(part), of, pre, post, delays)

    def get(self, part: Any, /, what: Any, *, of: Any = None, pre: Any = None, post: Any = None) -> Any:
        """Return the "weight", or the "delay" in ms, of each synapse at the end of the run.

        The arguments `of`, `pre` and `post` are those of `weights`.

        Raises:
            ModelError: the value is a parameter or a state, which files of results do not have.
        """
        if isinstance(what, list):
            return {word: self.get(part, word, of=of, pre=pre, post=post) for word in what}
        name = _name(part)
        if not isinstance(part, View) and name in self.projections:
            return one_each(self, name, what, of, pre, post)
        name, _ = self._neurons(part)
        message = f"population '{name}': a file of results has no {what!r} of the end of the run"
        recorded = [word for word, trace in self.traces.items() if (trace.population, trace.state) == (name, what)]
        hint = f"net.probe('name', '{name}', {what!r}) records a state; neuro.compile(run.network()) has parameters"
        if recorded:
            hint = f"run.trace({recorded[0]!r}) returns the records"
        raise ModelError(message, hint=hint)

    def states(self, of: Any) -> list[str]:
        """Raise an error, because a file has only traces of recorded states.

        Raises:
            ModelError: always; the hint names the traces and the simulation.
        """
        name, _ = self._neurons(of)
        message = f"states of '{name}': a file of results has none: expected a simulation"
        raise ModelError(message, hint="run.traces has the recorded states, neuro.compile(run.network()) all states")

    def counts(self) -> Counts:
        """Return the counts of the run."""
        populations = {name: PopulationCounts(**part.counts) for name, part in self.populations.items()}
        projections = {name: ProjectionCounts(**part.counts) for name, part in self.projections.items()}
        return Counts(int(self.about[f"{_COUNT}steps"]), populations, projections, native_counts(self))

    def network(self, recordings: str | PathLike[str] | None = None, *, played: bool = True) -> Network:
        """Return the network as it was before the run.

        Args:
            recordings: folder with the recordings of event cameras. By default the folders of the run, of the results
                and the current folder are searched, in this order.
            played: if False, recordings may be missing, and the network can be inspected but not compiled.

        Raises:
            ModelError: a recording is missing (the message has the folders), or results and network have different
                populations.
        """
        from neuro.model.language import load
        from neuro.model.language.files import locate_recordings

        of_results = [] if self.path is None else [self.path.resolve().parent]
        of_run = [Path(str(path)).parent for word, path in self.about.items() if word.startswith(RECORDING)]
        folders = [*of_run, *of_results, Path.cwd()] if recordings is None else [Path(recordings)]
        search = RecordingSearch(dict.fromkeys(folders))
        with tempfile.TemporaryDirectory() as folder, locate_recordings(search.find):
            for name, content in self.files.items():
                (Path(folder) / name).write_bytes(content)
            net = load(Path(folder) / YAML)
        if differing := sorted(net.populations.keys() ^ self.populations.keys()):
            raise ModelError(f"damaged results: expected {differing[0]!r} both in the results and in their network")
        if played:
            search.check()
        return net

    def laid(self, name: str) -> NameAndShape:
        """Return the name and shape of a population, for views."""
        return NameAndShape(name, self.populations[name].shape)

    def _neurons(self, of: Any) -> tuple[str, Ints | None]:
        """Return the name of a population, and the ids of a view, or None for the whole population."""
        of = view_of_index(of, {name: self.laid(name) for name in self.populations})
        view = of if isinstance(of, View) else None
        name = _name(of if view is None else view.population)
        if name not in self.populations:
            raise unknown("population", name, self.populations)
        return name, None if view is None else view.within(self.populations[name].shape)[0]


def _name(of: Any) -> Any:
    return of.name if isinstance(of, (Part, NameAndShape)) else of


def write(results: Results, path: str | PathLike[str], weights: Iterable[tuple[str, Weights]] = ()) -> None:
    """Write results to a file, also in place of an existing file. Callers check the path with `outputs.output`.

    Args:
        results: results to write.
        path: path of the file.
        weights: names of projections and their weights, one projection at a time, if the results have no weights.
    """
    with new_file(Path(path), FORMAT) as file:
        write_results(file, results)
        for name, projection in weights:
            write_values(file["projections"][name], values_of(projection))


def write_results(
    file: h5py.File, results: Results, prepare: Callable[[h5py.Group, Any], None] = lambda group, part: None
) -> None:
    """Write results into an open, empty file.

    `prepare` is called with each group and its part of the results, before the part is written.
    """
    write_values(file, {"format": FORMAT, **results.about})
    file["network"] = results.files[YAML].decode()
    for name, content in results.files.items():
        if name != YAML:
            file[f"network_files/{name}"] = np.frombuffer(content, np.uint8)
    for section in SECTIONS:
        groups = file.create_group(section, track_order=True)
        for name, part in getattr(results, section).items():
            prepare(groups.create_group(name), part)
            write_values(groups[name], values_of(part))
    for name, values in results.world.items():
        file[f"world/{name}"] = np.asarray(values)
    if results.live:
        write_values(file.create_group("live"), results.live)


def read(path: str | PathLike[str]) -> Results:
    """Read the file of a finished or interrupted run. Arrays are read on first access.

    Raises:
        ModelError: the file does not exist, has another format, or is damaged.
    """
    path = Path(path)
    if not path.exists() and unfinished(path).exists():
        hint = f"{unfinished(path)} has the records of an unfinished run"
        raise ModelError(f"{path}: no such file", hint=hint)
    path = existing(path)
    record_input(path)
    return _opened(path)


def _opened(path: Path) -> Results:
    """Return the results in a file, with the errors of `read`."""
    try:
        reader = JournalReader(path, "a file of results, as 'neuro run' writes it", FORMAT)
        with reader.reading() as file:
            check_tree(file)
            return read_file(file, reader.reading, path)
    except ModelError:
        raise
    except (OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise ModelError(f"{path}: damaged: {error}") from None


def unfinished(path: Path) -> Path:
    """Return the latest partial file for the name `path`, or an unused name if there is no partial file."""
    parts = list(takewhile(Path.exists, kept_parts(path)))
    return max(parts, key=lambda part: part.stat().st_mtime_ns, default=next(kept_parts(path)))


def is_kept(part: Path) -> bool:
    """Return True if a partial file has a recording and no run is writing to the file."""
    try:
        with part.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return _opened(part).duration_ms > 0.0
    except (ModelError, OSError):
        return False


def recorded_in(part: Path) -> str:
    """Return a sentence with the end of the recording in a partial file; "" if the file cannot be read."""
    try:
        return f"{part} has the records up to {read(part).time:g} ms"
    except ModelError:
        return ""


def read_file(file: h5py.File, opener: Opener, path: Path | None = None) -> Results:
    """Return the results in an open file. `opener` opens the file again to read an array."""
    about = {name: _plain(value) for name, value in file.attrs.items() if name != "format"}
    files = {YAML: file["network"][()]}
    for name, item in file.get("network_files", {}).items():
        if name in ("", ".", "..") or Path(name).name != name:
            raise ValueError(f"{name!r} is not the name of a file of the network")
        files[name] = item[()].tobytes()
    return Results(
        about,
        files,
        {name: _read_part(Train, group, opener) for name, group in file["populations"].items()},
        {name: _read_part(Weights, group, opener) for name, group in file["projections"].items()},
        {name: _read_part(Trace, group, opener) for name, group in file["traces"].items()},
        path,
        {name: _read_part(Fed, group, opener) for name, group in file.get("fed", {}).items()},
        {name: _plain(value) for name, value in file["live"].attrs.items()} if "live" in file else {},
        {name: data[()] for name, data in file.get("world", {}).items()},
    )


P = TypeVar("P", Train, Weights, Trace, Fed)


def values_of(part: Any) -> dict[str, Any]:
    """Return the fields of a population, projection or trace by name."""
    return {f.name: getattr(part, f.name) for f in fields(part)}


def write_values(group: h5py.Group, values: Mapping[str, Any]) -> None:
    """Write values by name: arrays as data sets, and dictionaries of counts and other values as attributes.

    A value of None is not written.
    """
    for name, value in values.items():
        if isinstance(value, dict):
            group.attrs.update({_COUNT + count: number for count, number in value.items()})
        elif value is not None and not isinstance(value, np.ndarray):
            group.attrs[name] = value
        elif value is not None and name in group:
            group[name][...] = value
        elif value is not None:
            # Counts are rewritten during a run, and each rewrite of compressed data would enlarge the file.
            compresses = value.size > _LARGE and not name.endswith("_counts")
            group.create_dataset(name, data=value, **(PACKED if compresses else {}))


def _read_part(kind: type[P], group: h5py.Group, opener: Opener) -> P:
    values: dict[str, Any] = {f.name: _plain(group.attrs[f.name]) for f in fields(kind) if f.name in group.attrs}
    values |= {name: Stored(opener, f"{group.name}/{name}", len(data)) for name, data in group.items()}
    if any(f.name == "counts" for f in fields(kind)):
        counts = {name: value for name, value in group.attrs.items() if name.startswith(_COUNT)}
        values["counts"] = {name.removeprefix(_COUNT): int(value) for name, value in counts.items()}
    return kind(**values)


def _plain(value: Any) -> Any:
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else getattr(value, "item", lambda: value)()


def run_table(duration_ms: float, populations: Iterable[tuple[str, str, int, int | None]]) -> Table:
    """Return a table with a row for each population.

    Args:
        duration_ms: length of the run. There are no rates if it is 0.
        populations: name, model, number of neurons and number of spikes of each population. The number of spikes of a
            generator of currents is None.
    """
    rows = []
    for name, model, neurons, spikes in populations:
        rows.append((name, model, f"{neurons:,}", *spike_columns(spikes, neurons, duration_ms)))
    return Table("populations", ("name", "model", ">neurons", ">spikes", ">rate (Hz)"), tuple(rows))


def spike_columns(spikes: int | None, neurons: int, duration_ms: float) -> tuple[str, str]:
    """Return the number of spikes and the mean rate of a neuron in Hz as texts, "-" for an undefined number."""
    if spikes is None:
        return "-", "-"
    return f"{spikes:,}", f"{spikes / neurons / duration_ms * 1000.0:.2f}" if neurons and duration_ms else "-"


def projection_table(projections: Iterable[tuple[str, str, str, str, int]]) -> Table:
    """Return a table with name, source, target, synapse and number of synapses of each projection."""
    rows = tuple((*names, f"{synapses:,}") for *names, synapses in projections)
    return Table("projections", ("name", "from", "to", "synapse", ">synapses"), rows)
