"""What a run left behind, as one HDF5 file that explains itself.

```
/                   attributes: format "neuro results 1", network (its name), backend, seed, threads, duration_ms,
                    resolution_ms, counts.* of the run, and the versions of neuro, python, numpy and numba
/network            the network as YAML text
/network_files/F    file F that the YAML reads, byte for byte
/populations/NAME   attributes: model, shape, recorded, counts.*
    times_ms        float64, sorted
    ids             int64
    multiplicity    int32, spikes of that neuron in that step
/projections/NAME   attributes: source, target, synapse, synapses, counts.*
    pre, post       int64; not of a grid
    weight          float64 as stored at the end; of a grid (maps, channels, height, width)
    delay_ms        float64 at the end, of rules that change delays
/traces/NAME        attributes: population, state, unit
    times_ms        float64
    values          float64, (times, neurons)
    ids             int64, the neurons, of a probe of a view
```

Spikes and weights that were not kept have no arrays.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.hdf5 import kind, new_file
from neuro.core.paths import existing
from neuro.core.tables import Table, as_html, as_text
from neuro.files.run_tables import projection_table, run_table
from neuro.model.network import Network
from neuro.program.program import Floats, Ints

if TYPE_CHECKING:
    import neo

    from neuro.files.frames import Frames

FORMAT = "neuro results 1"
KIND = kind(FORMAT, "a file of results")
YAML = "network.yaml"
_LARGE = 10_000
_COUNT = "counts."


@dataclass(frozen=True, slots=True, eq=False)
class Train:
    """Spikes of one population, by time, then neuron.

    Attributes:
        model: the name of its model.
        shape: its shape.
        counts: of the run, by name.
        recorded: whether its spikes were kept; if not the arrays are empty.
        times_ms, ids, multiplicity: one entry for each neuron and step with spikes.
    """

    model: str
    shape: tuple[int, ...]
    counts: dict[str, int]
    recorded: bool
    times_ms: Floats
    ids: Ints
    multiplicity: NDArray[np.int32]

    @property
    def size(self) -> int:
        """Number of neurons."""
        return int(np.prod(self.shape))


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """Weights of one projection at the end of a run, and its delays where these learn.

    Attributes:
        source, target: names of the populations.
        synapse: the name of its model.
        synapses: their number.
        counts: of the run, by name.
        pre, post: the ends of each synapse; None for a grid or where weights were not kept.
        weight: one for each; kernels of a grid; None where weights were not kept.
        delay_ms: one for each, of a rule that changes delays; None of others.
    """

    source: str
    target: str
    synapse: str
    synapses: int
    counts: dict[str, int]
    pre: Ints | None = None
    post: Ints | None = None
    weight: Floats | None = None
    delay_ms: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """What a probe of a state recorded: `values` has the shape (times, neurons); of a view, `ids` are its neurons."""

    population: str
    state: str
    unit: str
    times_ms: Floats
    values: Floats
    ids: Ints | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A run.

    Attributes:
        about: attributes of the file: network, backend, seed, threads, duration_ms, resolution_ms, counts, versions.
        files: the network's files by name, the YAML text among them as `network.yaml`.
        populations, projections, traces: the parts by name.
    """

    about: dict[str, Any]
    files: dict[str, bytes]
    populations: dict[str, Train]
    projections: dict[str, Weights]
    traces: dict[str, Trace]

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
            run_table(self.duration_ms, ((name, t.model, t.size, t.counts["spikes"]) for name, t in trains)),
            projection_table((name, w.source, w.target, w.synapse, w.synapses) for name, w in weights),
            Table(
                "traces",
                ("name", "of", "state", ">neurons", ">times"),
                tuple(
                    (name, t.population, t.state, f"{t.values.shape[1]:,}", f"{t.times_ms.size:,}")
                    for name, t in traces
                ),
            ),
        ]

    def to_neo(self) -> neo.Block:
        """Spikes and traces as a block of Neo, see `neuro.files.neo_block.to_neo`; needs the extra `neo`."""
        from neuro.files.neo_block import to_neo

        return to_neo(self)

    def to_pandas(self) -> Frames:
        """Spikes, rates, traces and weights as data frames; needs the extra `pandas`."""
        from neuro.files.frames import to_pandas

        return to_pandas(self)

    def network(self) -> Network:
        """The network as it was before the run."""
        from neuro.model.language import load

        with tempfile.TemporaryDirectory() as folder:
            for name, content in self.files.items():
                (Path(folder) / name).write_bytes(content)
            return load(Path(folder) / YAML)


def write(results: Results, path: str | PathLike[str]) -> None:
    """Write the file in the place of any other; the caller asks before, with `neuro.core.outputs.output` and `KIND`."""
    with new_file(Path(path)) as file:
        file.attrs["format"] = FORMAT
        file.attrs.update(results.about)
        file["network"] = results.files[YAML].decode()
        for name, content in results.files.items():
            if name != YAML:
                file[f"network_files/{name}"] = np.frombuffer(content, np.uint8)
        for section in ("populations", "projections", "traces"):
            group = file.create_group(section, track_order=True)
            for name, part in getattr(results, section).items():
                _write_part(group.create_group(name), part)


def read(path: str | PathLike[str]) -> Results:
    """Read the file.

    Raises:
        ModelError: there is no such file, or it is none of this format.
    """
    path = existing(path)
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") == FORMAT:
                return _read(file)
    except OSError:
        pass
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelError(f"{path}: damaged: {error}") from None
    raise ModelError(f"{path}: not a file of results, as 'neuro run' writes it")


def _read(file: h5py.File) -> Results:
    about = {name: _plain(value) for name, value in file.attrs.items() if name != "format"}
    files = {YAML: file["network"][()]}
    for name, item in file.get("network_files", {}).items():
        if name in ("", ".", "..") or Path(name).name != name:
            raise ValueError(f"{name!r} is not the name of a file of the network")
        files[name] = item[()].tobytes()
    return Results(
        about,
        files,
        {name: _read_part(Train, group) for name, group in file["populations"].items()},
        {name: _read_part(Weights, group) for name, group in file["projections"].items()},
        {name: _read_part(Trace, group) for name, group in file["traces"].items()},
    )


P = TypeVar("P", Train, Weights, Trace)


def _write_part(group: h5py.Group, part: Any) -> None:
    for field in fields(part):
        value = getattr(part, field.name)
        if isinstance(value, np.ndarray):
            packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if value.size > _LARGE else {}
            group.create_dataset(field.name, data=value, **packing)
        elif isinstance(value, dict):
            group.attrs.update({_COUNT + name: number for name, number in value.items()})
        elif value is not None:
            group.attrs[field.name] = value


def _read_part(kind: type[P], group: h5py.Group) -> P:
    words: dict[str, Any] = {
        field.name: _plain(group.attrs[field.name]) for field in fields(kind) if field.name in group.attrs
    }
    words |= {name: item[()] for name, item in group.items()}
    if any(field.name == "counts" for field in fields(kind)):
        counts = {name: value for name, value in group.attrs.items() if name.startswith(_COUNT)}
        words["counts"] = {name.removeprefix(_COUNT): int(value) for name, value in counts.items()}
    return kind(**words)


def _plain(value: Any) -> Any:
    return tuple(value.tolist()) if isinstance(value, np.ndarray) else getattr(value, "item", lambda: value)()
