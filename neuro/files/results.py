"""What a run leaves behind, as one HDF5 file that explains itself; it may be read while parts of it are still to come.

```
/                   attributes: format "neuro results 3", network (its name), backend, seed, threads, duration_ms,
                    resolution_ms, counts.* of the run, native.* (what only its backend counts), the versions of
                    neuro, python, numpy and numba, finished: whether the run came to its end, and recording.NAME:
                    where that of an event camera lay
/network            the network as YAML text
/network_files/F    file F that the YAML reads, byte for byte
/populations/NAME   attributes: model, shape, recorded, emits, resolution_ms, counts.*
    steps           int64, sorted; a step times resolution_ms is its time in ms
    ids             int64
    multiplicity    int64, spikes of that neuron in that step
    payloads        int32, of a graded population what each spike carries
    spike_counts    int64, spikes of each neuron
    event_counts    int64, steps of each neuron with spikes
/projections/NAME   attributes: source, target, synapse, synapses, counts.*
    pre, post       int64; not of a grid
    weight          float64 as stored at the end; of a grid (maps, channels, height, width)
    delay_ms        float64 at the end, of rules that change delays
/world              of a closed loop: returns, lengths, steps (of the episodes), rewards, actions (of the last block)
/traces/NAME        attributes: population or projection, state, unit, probe, mean
    times_ms        float64
    values          float64, (times, columns); of a rate or a mean, and at pre spikes, (times,)
    ids             int64, the neuron of each column; not where it is all of them
    pre, post       int64, the ends of the synapse of each column; at pre spikes of each time
```

A probe of several states has a trace NAME.STATE for each. Spikes and weights that were not kept have no arrays, and
what is written while it runs (`neuro.run.collect`) has weights when it is finished. The bill of a run follows from
the counts of each neuron, so a report prices what the simulation would.
"""

from __future__ import annotations

import fcntl
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from itertools import takewhile
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import h5py
import numpy as np

from neuro.core.checks import check_span
from neuro.core.clock import Clock
from neuro.core.errors import ModelError, a, unknown
from neuro.core.growing import JournalReader
from neuro.core.hdf5 import check_tree, has_format, new_file
from neuro.core.inputs import existing, record_input
from neuro.core.outputs import Kind, kept_parts
from neuro.core.tables import Table, as_html, as_text
from neuro.files.finished_runs import Sought, native_counts, one_each, weights
from neuro.files.parts import Fed, Opener, Stored, Trace, Train, Weights, kept, span
from neuro.model.network import Network
from neuro.model.parts import Part
from neuro.model.views import Shaped, View, named
from neuro.program.counts import Counts, PopulationCounts, ProjectionCounts
from neuro.program.program import Floats, Ints
from neuro.program.spikes import one_by_one

if TYPE_CHECKING:
    import neo

    from neuro.files.recorded import DataFrames

FORMAT = "neuro results 3"
SECTIONS = ("populations", "projections", "traces")
YAML = "network.yaml"
_LARGE = 10_000
_COUNT = "counts."
RECORDING = "recording."
"""Attributes of this name and that of an event camera say where its recording lay."""


KIND = Kind("a file of results", lambda path: has_format(path, FORMAT))


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A run; its spikes, traces and weights are asked for as of a simulation.

    Parts are named by their names, or by parts and views of the network. Arrays are read from the file when they are
    asked for, spikes of a time only as far as these reach.

    Attributes:
        about: attributes of the file: network, backend, seed, threads, duration_ms, resolution_ms, counts, versions.
        files: the network's files by name, the YAML text among them as `network.yaml`.
        populations, projections, traces: the parts by name.
        path: of the file, None of what is in memory only.
        fed: what event cameras were fed while the run was recorded, by name; `sim.replay(results)` feeds it again.
        live: of a run in real time its latencies, misses and drops, by name.
        world: of a closed loop by name: returns, lengths and steps, (episodes,), and of the last block, whose spikes
            these are, rewards (steps, copies) and actions (steps, copies, ...).
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
        """How long the run was."""
        return float(self.about["duration_ms"])

    def __repr__(self) -> str:
        name, backend = self.about["network"], self.about.get("backend", "")
        return f"Results({name!r}, backend={backend!r}, duration={self.duration_ms:g} ms)"

    def _repr_html_(self) -> str:
        return as_html(repr(self), self._tables())

    def __str__(self) -> str:
        return as_text(repr(self), self._tables())

    def _tables(self) -> list[Table]:
        """A row for each population, projection and trace."""
        trains, weights, traces = self.populations.items(), self.projections.items(), self.traces.items()
        return [
            run_table(self.duration_ms, ((name, t.model, t.size, t.spikes) for name, t in trains)),
            projection_table((name, w.source, w.target, w.said, w.synapses) for name, w in weights),
            Table(
                "traces",
                ("name", "of", "state", ">columns", ">times"),
                tuple(
                    (name, t.projection or t.population, t.state, f"{t.columns:,}", f"{t.times_ms.size:,}")
                    for name, t in traces
                ),
            ),
        ]

    def to_neo(self) -> neo.Block:
        """Spikes and traces as a block of Neo, see `neuro.files.recorded.to_neo`; needs the extra `neo`."""
        from neuro.files.recorded import to_neo

        return to_neo(self)

    def to_pandas(self) -> DataFrames:
        """Spikes, rates, traces and weights as data frames; needs the extra `pandas`."""
        from neuro.files.recorded import to_pandas

        return to_pandas(self)

    @property
    def time(self) -> float:
        """The end of the run in ms, as of a simulation."""
        return self.duration_ms

    @property
    def held(self) -> float:
        """The time in ms after which spikes and traces are held, as of a simulation: all of them are."""
        return 0.0

    @property
    def finished(self) -> bool:
        """Whether the run came to its end; if not, all is there that was recorded up to `time`."""
        return bool(self.about["finished"])

    def spikes(self, of: Any, since: float | None = None, until: float | None = None) -> tuple[Floats, Ints]:
        """Recorded spikes of a population or of a view.

        Args:
            of: the population, or its name, or a view.
            since: only those after this time in ms.
            until: only those up to this time in ms.

        Returns:
            times in ms and neurons, sorted by time, then neuron; several spikes of one neuron in one step are
            listed as often. Neurons are ids of the population, also of a view.

        Raises:
            ModelError: there is no such population, or its spikes were not recorded.
        """
        return self.spikes_of(*self._neurons(of), since, until)

    def spikes_of(self, name: str, ids: Ints | None, since: float | None, until: float | None) -> tuple[Floats, Ints]:
        """Likewise of some neurons of a population, all if None."""
        return self.graded_spikes_of(name, ids, since, until)[:2]

    def payloads(self, of: Any, since: float | None = None, until: float | None = None) -> tuple[Floats, Ints, Ints]:
        """Recorded spikes of a graded population, as `spikes` gives them, and the payload of each.

        Raises:
            ModelError: as `spikes`, or its spikes carry no payloads.
        """
        name, ids = self._neurons(of)
        times, neurons, payloads = self.graded_spikes_of(name, ids, since, until)
        if payloads is None:
            raise ModelError(f"payloads of '{name}', {a(self.populations[name].model)}: its spikes carry none")
        return times, neurons, payloads

    def graded_spikes_of(
        self, name: str, ids: Ints | None, since: float | None, until: float | None
    ) -> tuple[Floats, Ints, Ints | None]:
        """Likewise of some neurons of a population, with payloads where they have some."""
        train = self.populations[name]
        if not train.recorded:
            raise ModelError(f"spikes of '{name}', {a(train.model)}, are not recorded")
        clock = Clock(float(self.about["resolution_ms"]))
        bounds = (-1.0 if since is None else since, np.inf if until is None else until)
        after, to = (clock.floor(t, word) for t, word in zip(bounds, ("since", "until"), strict=True))
        check_span(after, to, since, until)
        part = span(kept(train, "steps"), after, to)
        steps, neurons, multiplicity = (kept(train, word)[part] for word in ("steps", "ids", "multiplicity"))
        payloads = None if kept(train, "payloads") is None else kept(train, "payloads")[part].astype(np.int64)
        if ids is not None:
            some = np.isin(neurons, ids)
            steps, neurons, multiplicity = steps[some], neurons[some], multiplicity[some]
            payloads = None if payloads is None else payloads[some]
        steps, neurons = one_by_one(name, multiplicity, steps, neurons)
        return clock.array_ms(steps), neurons, payloads

    def trace(self, of: Any) -> tuple[Floats, Any]:
        """What a probe has recorded, as `Simulation.trace` gives it.

        Raises:
            ModelError: there is no such probe, or the spikes that it recorded were not kept.
        """
        name = _name(of)
        if name in self.traces:
            return self.traces[name].times_ms, self.traces[name].read()
        several = [trace for trace in self.traces.values() if trace.probe == name]
        if not several:
            # What a probe of spikes has recorded: their times, and the neuron of each.
            probes = self.network(played=False).probes
            if name not in probes:
                raise unknown("probe", name, [*dict.fromkeys([*self.traces, *probes])])
            probe = probes[name]
            return self.spikes(probe.of if probe.view is None else probe.view)
        by_name: dict[str, Any] = {}
        for trace in several:
            found = trace.read()
            by_name |= found if isinstance(found, dict) else {trace.state: found}
        return several[0].times_ms, by_name

    def weights(self, part: Any, /, *, of: Any = None, pre: Any = None, post: Any = None, delays: bool = False) -> Any:
        """The weights of a projection at the end, as `Simulation.weights` gives them.

        Args:
            part: the projection, or its name.
            of: only of the synapses of these pairs (source, target), in their order.
            pre: only of the synapses from these neurons: a population, a view of it, or ids.
            post: only of the synapses onto these neurons.
            delays: whether to give the delays in ms, too; those that no rule changes follow from network and seed.

        Returns:
            (pre, post, weight), with `delays` a fourth row; of a grid its kernels, with `delays` (kernels, delay).

        Raises:
            ModelError: there is no such projection, or its weights were not kept.
        """
        return weights(self, _name(part), of, pre, post, delays)

    def get(self, part: Any, /, what: Any, *, of: Any = None, pre: Any = None, post: Any = None) -> Any:
        """The "weight" or the "delay" in ms of each synapse at the end, chosen as of `weights`.

        Raises:
            ModelError: a file does not have what is asked for: parameters, or a state, of which a probe records traces.
        """
        if isinstance(what, list):
            return {word: self.get(part, word, of=of, pre=pre, post=post) for word in what}
        name = _name(part)
        if not isinstance(part, View) and name in self.projections:
            return one_each(self, name, what, of, pre, post)
        name, _ = self._neurons(part)
        message = f"population '{name}': a file of results has no {what!r} of the end of the run"
        recorded = [word for word, trace in self.traces.items() if (trace.population, trace.state) == (name, what)]
        again = f"net.probe('name', '{name}', {what!r}) records a state; neuro.compile(run.network()) has parameters"
        hint = f"run.trace({recorded[0]!r}) is what was recorded" if recorded else again
        raise ModelError(message, hint=hint)

    def states(self, of: Any) -> list[str]:
        """A simulation has states; a file has the traces of those that were recorded.

        Raises:
            ModelError: always; it names what to ask instead.
        """
        name, _ = self._neurons(of)
        message = f"states of '{name}': a file of results has none: expected a simulation"
        raise ModelError(message, hint="run.traces has what was recorded, neuro.compile(run.network()) the states")

    def counts(self) -> Counts:
        """What happened in the run."""
        populations = {name: PopulationCounts(**part.counts) for name, part in self.populations.items()}
        projections = {name: ProjectionCounts(**part.counts) for name, part in self.projections.items()}
        return Counts(int(self.about[f"{_COUNT}steps"]), populations, projections, native_counts(self))

    def network(self, recordings: str | PathLike[str] | None = None, *, played: bool = True) -> Network:
        """The network as it was before the run.

        Args:
            recordings: the folder in which the recordings of event cameras lie. If not given, they are looked for where
                the run found them, then beside the file of results, then in the current folder.
            played: whether they must be there. Without them the network can be looked at, and not compiled.

        Raises:
            ModelError: a recording is not found, and the message says where it was looked for; or the results are of
                other populations than their network has.
        """
        from neuro.model.language import load
        from neuro.model.language.files import elsewhere

        beside = [] if self.path is None else [self.path.resolve().parent]
        lay = [Path(str(path)).parent for word, path in self.about.items() if word.startswith(RECORDING)]
        folders = [*lay, *beside, Path.cwd()] if recordings is None else [Path(recordings)]
        sought = Sought(dict.fromkeys(folders))
        with tempfile.TemporaryDirectory() as folder, elsewhere(sought.find):
            for name, content in self.files.items():
                (Path(folder) / name).write_bytes(content)
            net = load(Path(folder) / YAML)
        if differing := sorted(net.populations.keys() ^ self.populations.keys()):
            raise ModelError(f"damaged results: expected {differing[0]!r} both in them and in their network")
        if played:
            sought.check()
        return net

    def laid(self, name: str) -> Shaped:
        """A population as something of which there may be views."""
        return Shaped(name, self.populations[name].shape)

    def _neurons(self, of: Any) -> tuple[str, Ints | None]:
        """The name of a population, and the neurons of a view."""
        of = named(of, {name: self.laid(name) for name in self.populations})
        view = of if isinstance(of, View) else None
        name = _name(of if view is None else view.population)
        if name not in self.populations:
            raise unknown("population", name, self.populations)
        return name, None if view is None else view.within(self.populations[name].shape)[0]


def _name(of: Any) -> Any:
    return of.name if isinstance(of, (Part, Shaped)) else of


def write(results: Results, path: str | PathLike[str], weights: Iterable[tuple[str, Weights]] = ()) -> None:
    """Write the file in the place of any other; the caller asks before, with `neuro.core.outputs.output` and `KIND`.

    Args:
        results: what is written.
        path: of the file.
        weights: of projections by name, one after the other, where the results are without.
    """
    with new_file(Path(path), FORMAT) as file:
        write_head(file, results.about, results.files)
        for section in SECTIONS:
            for name, part in getattr(results, section).items():
                write_part(file[section].create_group(name), part)
        for name, projection in weights:
            write_part(file["projections"][name], projection)
        for name, values in results.world.items():
            file[f"world/{name}"] = np.asarray(values)
        if results.live:
            file.create_group("live").attrs.update(results.live)


def write_head(file: h5py.File, about: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
    """Write what a run is of, and make room for its parts."""
    file.attrs["format"] = FORMAT
    file.attrs.update(about)
    file["network"] = files[YAML].decode()
    for name, content in files.items():
        if name != YAML:
            file[f"network_files/{name}"] = np.frombuffer(content, np.uint8)
    for section in SECTIONS:
        file.create_group(section, track_order=True)


def read(path: str | PathLike[str]) -> Results:
    """Read the file of a run, also of one that was ended while it wrote; arrays when they are asked for.

    Raises:
        ModelError: there is no such file, it is none of this format, or not what was written.
    """
    path = Path(path)
    if not path.exists() and unfinished(path).exists():
        hint = f"{unfinished(path)} has what a run recorded that did not come to its end"
        raise ModelError(f"{path}: there is no such file", hint=hint)
    path = existing(path)
    record_input(path)
    return _opened(path)


def _opened(path: Path) -> Results:
    """The results in a file; errors as of `read`."""
    try:
        held = JournalReader(path, "a file of results, as 'neuro run' writes it", FORMAT)
        with held.reading() as file:
            check_tree(file)
            return read_file(file, held.reading, path)
    except ModelError:
        raise
    except (OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise ModelError(f"{path}: damaged: {error}") from None


def unfinished(path: Path) -> Path:
    """The part that the last run left which was to have the name `path`; a name that no file has if there is none."""
    parts = list(takewhile(Path.exists, kept_parts(path)))
    return max(parts, key=lambda part: part.stat().st_mtime_ns, default=next(kept_parts(path)))


def is_kept(part: Path) -> bool:
    """Return whether an earlier run left a recording in a part; a run that still writes it has left none."""
    try:
        with part.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return _opened(part).duration_ms > 0.0
    except (ModelError, OSError):
        return False


def recorded_in(part: Path) -> str:
    """A sentence that says up to which time an unfinished file was recorded; "" of a file that cannot be read."""
    try:
        return f"{part} has what was recorded up to {read(part).time:g} ms"
    except ModelError:
        return ""


def read_file(file: h5py.File, opener: Opener, path: Path | None = None) -> Results:
    """The results in an open file; `opener` opens it again for arrays that are asked for later."""
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


def write_part(group: h5py.Group, part: Any) -> None:
    """Write the arrays and attributes of a part that are not there yet."""
    for each in fields(part):
        value = getattr(part, each.name)
        if each.name in group:
            continue
        if isinstance(value, np.ndarray):
            # Counts are written anew while a run goes on: packed, each time would take new room in the file.
            packed = value.size > _LARGE and not each.name.endswith("_counts")
            packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if packed else {}
            group.create_dataset(each.name, data=value, **packing)
        elif isinstance(value, dict):
            group.attrs.update({_COUNT + name: number for name, number in value.items()})
        elif value is not None:
            group.attrs[each.name] = value


def _read_part(kind: type[P], group: h5py.Group, opener: Opener) -> P:
    words: dict[str, Any] = {
        each.name: _plain(group.attrs[each.name]) for each in fields(kind) if each.name in group.attrs
    }
    words |= {name: Stored(opener, f"{group.name}/{name}", len(data)) for name, data in group.items()}
    if any(each.name == "counts" for each in fields(kind)):
        counts = {name: value for name, value in group.attrs.items() if name.startswith(_COUNT)}
        words["counts"] = {name.removeprefix(_COUNT): int(value) for name, value in counts.items()}
    return kind(**words)


def _plain(value: Any) -> Any:
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else getattr(value, "item", lambda: value)()


def run_table(duration_ms: float, populations: Iterable[tuple[str, str, int, int | None]]) -> Table:
    """A row for each population.

    Args:
        duration_ms: how long it ran; without a time there are no rates.
        populations: of each its name, model, neurons and spikes, None of those that emit a current.
    """
    rows = []
    for name, model, neurons, spikes in populations:
        rows.append((name, model, f"{neurons:,}", *spike_columns(spikes, neurons, duration_ms)))
    return Table("populations", ("name", "model", ">neurons", ">spikes", ">rate (Hz)"), tuple(rows))


def spike_columns(spikes: int | None, neurons: int, duration_ms: float) -> tuple[str, str]:
    """Spikes and the mean rate of a neuron in Hz as text; a dash where there can be none."""
    if spikes is None:
        return "-", "-"
    return f"{spikes:,}", f"{spikes / neurons / duration_ms * 1000.0:.2f}" if neurons and duration_ms else "-"


def projection_table(projections: Iterable[tuple[str, str, str, str, int]]) -> Table:
    """A row for each projection: its name, source, target, synapse and number of synapses."""
    rows = tuple((*words, f"{synapses:,}") for *words, synapses in projections)
    return Table("projections", ("name", "from", "to", "synapse", ">synapses"), rows)
