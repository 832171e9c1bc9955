"""Write networks and spikes as SONATA: nodes, edges and spikes in HDF5, types in CSV, and a configuration in JSON.

Source: the SONATA Developer Guide, AllenInstitute/sonata. The tests read the files with libsonata 0.2.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro import ModelError
from neuro.apps import Kind, file_path, hdf5, marked, output
from neuro.extend import Population, Projection
from neuro_exchange.verdict import APPROXIMATE, EXACT, REFUSED, Verdict, Verdicts

if TYPE_CHECKING:
    from neuro import Simulation

MAGIC, VERSION = 0x0A7A, (0, 1)
_MARK = '"written_by": "neuro"'
_CONFIG = marked("a SONATA configuration of neuro", _MARK)
_TYPES = "SONATA types of neuro"
_NODE_TYPES = "node_type_id model_type model_template population"
_EDGE_TYPES = "edge_type_id model_template edge_population"
_SORTING = {"none": 0, "by_id": 1, "by_time": 2}


def save_sonata(sim: Simulation, path: str | PathLike[str]) -> Verdicts:
    """Write the network of a simulation with its present weights, and the recorded spikes.

    The configuration `net.json` names the files `net_nodes.h5`, `net_node_types.csv`, `net_edges.h5` and
    `net_edge_types.csv`. Recorded spikes are in `net_spikes.h5`. The attributes of a node are the parameters and
    initial states of the neuron. The attributes of an edge are `syn_weight`, in the unit of the target's model, and
    `delay` in ms. Nodes are counted from 0.

    Args:
        sim: the simulation.
        path: name of the configuration, which ends in `.json`.

    Returns:
        A verdict for each population and projection.

    Raises:
        ModelError: a projection has a kernel that all its neurons share, or a file cannot be written.
    """
    if not hasattr(sim, "program"):
        raise ModelError(f"save_sonata: found {sim!r:.60}: expected a Simulation", hint="neuro.compile(net)")
    file = file_path(path, "path")
    if file.suffix != ".json":
        raise ModelError(f"{file}: cannot be written: expected a name ending in .json")
    table = verdicts(sim)
    table.check()
    populations, projections = sim.program.populations, sim.program.projections

    def sibling(what: str) -> Path:
        return file.with_name(f"{file.stem}_{what}")

    # The files belong together: all get their names after the last file is written, the configuration as the last.
    with ExitStack() as files:

        def add_text(path: Path, lines: list[str], kind: Kind) -> None:
            files.enter_context(output(path, kind)).write_text("\n".join([*lines, ""]), "utf-8")

        def add_hdf5(what: str) -> AbstractContextManager[Any]:
            return _hdf5(files.enter_context(output(sibling(what), _HDF5)))

        add_text(file, [json.dumps(_config(sim, file.stem), indent=1)], _CONFIG)
        rows = [f"{k} {_kind(part)} neuro:{part.model_name} {part.name}" for k, part in enumerate(populations)]
        add_text(sibling("node_types.csv"), [_NODE_TYPES, *rows], marked(_TYPES, _NODE_TYPES))
        rows = [f"{k} {part.synapse.name} {part.name}" for k, part in enumerate(projections)]
        add_text(sibling("edge_types.csv"), [_EDGE_TYPES, *rows], marked(_TYPES, _EDGE_TYPES))
        with add_hdf5("nodes.h5") as nodes:
            for number, part in enumerate(populations):
                group = nodes.create_group(f"nodes/{part.name}")
                ids = np.arange(part.size, dtype=np.uint64)
                group["node_id"], group["node_group_index"] = ids, ids
                group["node_type_id"] = np.full(part.size, number, dtype=np.int64)
                group["node_group_id"] = np.zeros(part.size, dtype=np.int64)
                attributes = group.create_group("0")
                for word, values in {**part.parameters, **part.initial}.items():
                    attributes[word] = np.broadcast_to(values, part.size)
        with add_hdf5("edges.h5") as edges:
            for number, synapses in enumerate(projections):
                _write_edges(edges, sim, synapses, number)
        recorded = [part.name for part in populations if part.records]
        if recorded:
            with add_hdf5("spikes.h5") as spikes:
                for name in recorded:
                    _write_spikes(spikes, sim, name)
    return table


def verdicts(sim: Simulation) -> Verdicts:
    """Return a verdict for each population and projection of a network in SONATA."""
    parts = [_node_verdict(sim, part) for part in sim.program.populations]
    for part in sim.program.projections:
        if part.grid is not None:
            reason = "its neurons share a kernel, and SONATA has a weight for each edge"
            parts.append(Verdict(part.name, "grid", REFUSED, reason, "neuro.pairs lists the synapses"))
        elif part.synapse.learns:
            note = f"the present weights; SONATA has no {part.synapse.name}"
            measured = "not measured: SONATA has no learning"
            parts.append(Verdict(part.name, part.synapse.name, APPROXIMATE, note, measured=measured))
        else:
            parts.append(Verdict(part.name, part.synapse.name, EXACT, "weights and delays are attributes"))
    return Verdicts(f"{sim.program.name} to SONATA", tuple(parts))


def _node_verdict(sim: Simulation, part: Population) -> Verdict:
    has_spikes_left = part.spike_steps.size and int(part.spike_steps[-1]) * sim.program.resolution > sim.time
    if has_spikes_left or part.stream is not None:
        note = "parameters are attributes; the listed spikes up to the present time are written"
        return Verdict(
            part.name, part.model_name, APPROXIMATE, note, measured="not measured: a longer run has more spikes"
        )
    if part.model.graded:
        note = "parameters and initial states are attributes; spikes are written without payloads"
        return Verdict(part.name, part.model_name, APPROXIMATE, note, measured="not measured: SONATA has no payloads")
    return Verdict(part.name, part.model_name, EXACT, "parameters and initial states are attributes")


def _is_ours(path: Path) -> bool:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("written_by", "") == "neuro")
    except OSError:
        return False


_HDF5 = Kind("a SONATA file of neuro", _is_ours)


@contextmanager
def _hdf5(path: Path) -> Iterator[Any]:
    """Create a SONATA file."""
    with hdf5.new_file(path) as file:
        file.attrs["magic"] = np.uint32(MAGIC)
        file.attrs["version"] = np.array(VERSION, dtype=np.uint32)
        file.attrs["written_by"] = "neuro"
        yield file


def _write_edges(file: Any, sim: Simulation, part: Projection, number: int) -> None:
    pre, post, weight, delay = sim.weights(part.name, delays=True)
    source, target = sim.program.populations[part.source], sim.program.populations[part.target]
    group = file.create_group(f"edges/{part.name}")
    for word, ids, population in (("source", pre, source), ("target", post, target)):
        data = group.create_dataset(f"{word}_node_id", data=ids.astype(np.uint64))
        data.attrs["node_population"] = population.name
    size = len(weight)
    group["edge_type_id"] = np.full(size, number, dtype=np.int64)
    group["edge_group_id"] = np.zeros(size, dtype=np.int64)
    group["edge_group_index"] = np.arange(size, dtype=np.uint64)
    group["0/syn_weight"], group["0/delay"] = weight, np.broadcast_to(delay, size)


def _write_spikes(file: Any, sim: Simulation, name: str) -> None:
    import h5py

    times, ids = sim.spikes(name)
    group = file.create_group(f"spikes/{name}")
    group.attrs.create("sorting", _SORTING["by_time"], dtype=h5py.enum_dtype(_SORTING, basetype="u1"))
    group.create_dataset("timestamps", data=times).attrs["units"] = "ms"
    group["node_ids"] = ids.astype(np.uint64)


def _kind(part: Population) -> str:
    return "point_neuron" if part.kind == "neuron" else "virtual"


def _config(sim: Simulation, stem: str) -> dict[str, Any]:
    base = f"$BASE_DIR/{stem}"
    # libsonata reads only the populations that the configuration names.
    nodes = {part.name: {"type": _kind(part)} for part in sim.program.populations}
    edges = {part.name: {"type": "chemical"} for part in sim.program.projections}
    node_files = {"nodes_file": f"{base}_nodes.h5", "node_types_file": f"{base}_node_types.csv"}
    edge_files = {"edges_file": f"{base}_edges.h5", "edge_types_file": f"{base}_edge_types.csv"}
    return {
        "manifest": {"$BASE_DIR": "./"},
        "metadata": {"written_by": "neuro"},
        "networks": {
            "nodes": [{**node_files, "populations": nodes}],
            "edges": [{**edge_files, "populations": edges}],
        },
    }
