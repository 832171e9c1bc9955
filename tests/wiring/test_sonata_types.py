"""Edges and nodes of SONATA with several groups and attributes of types, as the Developer Guide has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import neuro
from golden_messages import Messages
from refused import refusals_of

PRE, POST = [0, 1, 2, 3, 0, 2], [1, 2, 3, 0, 2, 1]
EDGE_TYPES = (
    'edge_type_id syn_weight delay model_template "dynamics params"\n'
    '100 2.5 1.0 exp2syn "AMPA fast.json"\n'
    "7 -4.0 2.0 exp2syn GABA.json\n"
    "300 NULL 3.0 NULL NULL\n"
)


def edges(path: Path, **more: Any) -> Path:
    """Two groups: the first has weights, the second has delays; what they have not is that of the type."""
    data = {
        "source_node_id": np.array(PRE, dtype=np.uint64),
        "target_node_id": np.array(POST, dtype=np.uint64),
        "edge_type_id": np.array([100, 7, 100, 7, 300, 100]),
        "edge_group_id": np.array([0, 1, 0, 1, 0, 1], dtype=np.uint16),
        "edge_group_index": np.array([2, 0, 1, 1, 0, 2], dtype=np.uint32),
        "0/syn_weight": [30.0, 20.0, 10.0],
        "1/delay": [5.0, 6.0, 7.0],
        **more,
    }
    with h5py.File(path, "w") as file:
        for name, values in data.items():
            if values is not None:
                file[f"edges/a_to_a/{name}"] = values
    return path


def synapses(folder: Path, types: str | None = EDGE_TYPES, weight: str = "syn_weight", **more: Any) -> list[Any]:
    file, path = edges(folder / "edges.h5", **more), None
    if types is not None:
        path = folder / "edge_types.csv"
        path.write_text(types, encoding="utf-8")
    net = neuro.Network()
    net.population("a", 4, neuro.iaf_psc_exp())
    net.connect("a", "a", neuro.from_file(file, weight=weight, delay="delay", types=path), name="wires")
    sim = neuro.compile(net, backend="reference")
    return sorted(zip(*(row.tolist() for row in sim.weights("wires", delays=True)), strict=True))


def test_an_edge_has_what_its_group_has_and_else_what_its_type_has(tmp_path: Path) -> None:
    found = synapses(tmp_path)
    expected = [(0, 1, 10.0, 1.0), (0, 2, 30.0, 3.0), (1, 2, -4.0, 5.0), (2, 1, 2.5, 7.0), (2, 3, 20.0, 1.0)]
    np.testing.assert_allclose(found, sorted([*expected, (3, 0, -4.0, 6.0)]))


def test_all_attributes_of_types(tmp_path: Path) -> None:
    types = EDGE_TYPES.replace("300 NULL", "300 9.0")
    plain = dict.fromkeys(("edge_group_id", "edge_group_index", "0/syn_weight", "1/delay"))
    found = synapses(tmp_path, types, **plain)
    assert [edge[2:] for edge in found] == [(2.5, 1.0), (9.0, 3.0), (-4.0, 2.0), (2.5, 1.0), (2.5, 1.0), (-4.0, 2.0)]


def test_what_types_lack(tmp_path: Path, messages: Messages) -> None:
    messages(refusals_of(messages.cases, globals() | locals(), folder=tmp_path))


def test_types_are_those_of_a_file_of_sonata(tmp_path: Path) -> None:
    (tmp_path / "edges.csv").write_text("pre,post\n0,1\n")
    (tmp_path / "edge_types.csv").write_text(EDGE_TYPES)
    net = neuro.Network()
    net.population("a", 4, neuro.iaf_psc_exp())
    net.connect("a", "a", neuro.from_file(tmp_path / "edges.csv", types=tmp_path / "edge_types.csv"))
    with pytest.raises(neuro.ModelError, match=r"types = .*: expected none, only HDF5 has types"):
        neuro.compile(net)


def test_neurons_are_found_by_attributes_of_their_types(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "nodes.h5", "w") as file:
        group = file.create_group("nodes/v1")
        group["node_id"], group["node_type_id"] = np.arange(4), [2, 1, 2, 1]
        group["node_group_id"], group["node_group_index"] = [0, 0, 1, 1], [0, 1, 0, 1]
        group["0/layer"], group["1/layer"] = [4, 5], [6, 4]
    (tmp_path / "node_types.csv").write_text("node_type_id pop_name ei\n1 Pvalb i\n2 Scnn1a e\n")
    table = neuro.neuron_table(tmp_path / "nodes.h5", types=tmp_path / "node_types.csv")
    brain = neuro.Network().population("v1", "auto", neuro.iaf_psc_exp(), neurons=table)
    assert (brain.where(ei="e").ids.tolist(), brain.where(pop_name="Pvalb", layer=4).ids.tolist()) == ([0, 2], [3])


def test_the_types_are_saved_by_name_and_are_inputs(tmp_path: Path) -> None:
    edges(tmp_path / "edges.h5")
    (tmp_path / "edge_types.csv").write_text(EDGE_TYPES)
    (tmp_path / "net.yaml").write_text(
        "neuro: 1\nname: net\npopulations:\n  a: {model: iaf_psc_exp, shape: 4}\nprojections:\n  wires:\n"
        "    from: a\n    to: a\n    rule: {from_file: {file: edges.h5, types: edge_types.csv, weight: syn_weight, "
        "delay: delay}}\n"
    )
    neuro.load(tmp_path / "net.yaml").save(tmp_path / "again.yaml")
    assert "types: edge_types.csv" in (tmp_path / "again.yaml").read_text()
    assert neuro.compile(neuro.load(tmp_path / "again.yaml")).weights("wires")[2].size == 6
