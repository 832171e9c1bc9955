"""Wiring diagrams from files: the same network from each format, and from YAML; views by type and side."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.sparse import coo_array, save_npz

import neuro

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

IDS = [720575940596125868, 7, 2**62, 11]
TABLE = {
    "id": IDS,
    "type": ["KC", "KC", "MBON", "APL"],
    "side": ["left", "right", "left", "left"],
    "nt": ["ach", "ach", "glut", "gaba"],
}
# A pair that is listed twice, an autapse, and edges that are not sorted.
PRE, POST = [3, 0, 0, 1, 2, 1], [1, 2, 2, 1, 3, 0]
SYNAPSES, DELAY = [4, 9, 5, 7, 6, 1], [0.5, 1.0, 2.0, 0.24, 0.0, 3.0]
NT = [TABLE["nt"][k] for k in PRE]
SIGNS = {"ach": 1, "gaba": -1, "glut": -1}
EDGES = {"pre": [IDS[k] for k in PRE], "post": [IDS[k] for k in POST], "synapses": SYNAPSES, "delay": DELAY, "nt": NT}


def csv(path: Path, columns: dict[str, list[Any]]) -> Path:
    rows = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(rows) + "\n")
    return path


def sonata(path: Path, columns: dict[str, list[Any]]) -> Path:
    text = h5py.string_dtype()
    with h5py.File(path, "w") as file:
        group = file.create_group("edges/chemical")
        for name, own in (("source_node_id", "pre"), ("target_node_id", "post")):
            group[name] = np.array(columns[own], dtype=np.uint64)
        group["edge_type_id"] = np.zeros(len(PRE), dtype=np.int64)
        group["0/synapses"], group["0/delay"] = columns["synapses"], columns["delay"]
        group["0"].create_dataset("nt", data=np.array(columns["nt"], dtype=object), dtype=text)
    return path


def as_npz(path: Path, columns: dict[str, list[Any]]) -> Path:
    np.savez(path, **{name: np.array(values) for name, values in columns.items()})
    return path


def as_parquet(path: Path, columns: dict[str, list[Any]]) -> Path:
    parquet.write_table(pyarrow.table(columns), path)
    return path


WRITERS: dict[str, Callable[[Path, dict[str, list[Any]]], Path]] = {
    "edges.csv": csv,
    "edges.parquet": as_parquet,
    "edges.npz": as_npz,
    "edges.h5": sonata,
}


def diagram(folder: Path, edges: neuro.from_file, **more: Any) -> neuro.Network:
    table = neuro.neuron_table(csv(folder / "neurons.csv", TABLE), id="id")
    net = neuro.Network()
    net.wiring(neurons=table, edges=edges, model=neuro.iaf_psc_exp(), **more)
    return net


def synapses(net: neuro.Network, name: str = "brain_brain") -> list[tuple[int, int, float, float]]:
    sim = neuro.compile(net, backend="reference")
    return list(zip(*(row.tolist() for row in sim.weights(name, delays=True)), strict=True))


def expected(kept: list[int], weight: float, sign: dict[str, int] = SIGNS) -> list[tuple[int, int, float, float]]:
    """By source, then target; a pair that is listed twice in the order of the file."""
    steps = [max(1, round(2.0 * d / 0.1)) * 0.1 for d in DELAY]
    found = [(PRE[k], POST[k], weight * SYNAPSES[k] * sign[NT[k]], steps[k]) for k in kept]
    return sorted(found, key=lambda edge: edge[:2])


@pytest.mark.parametrize("name", WRITERS)
def test_each_format_gives_the_same_synapses(tmp_path: Path, name: str) -> None:
    file = WRITERS[name](tmp_path / name, EDGES)
    rule = neuro.from_file(file, weight="synapses", delay="delay", transmitter="nt", signs=SIGNS, where="synapses >= 5")
    found = synapses(diagram(tmp_path, rule, weight=0.25, delay=2.0))
    np.testing.assert_allclose(found, expected([1, 2, 3, 4], 0.25), rtol=1e-12)


def test_dale_takes_the_transmitter_of_the_source(tmp_path: Path) -> None:
    columns = {name: EDGES[name] for name in ("pre", "post", "synapses", "delay")}
    file = csv(tmp_path / "edges.csv", columns)
    rule = neuro.from_file(file, weight="synapses", delay="delay", transmitter="nt", signs=SIGNS, dale=True)
    np.testing.assert_allclose(synapses(diagram(tmp_path, rule, delay=2.0)), expected([0, 1, 2, 3, 4, 5], 1.0))


def test_a_transmitter_of_sign_0_leaves_its_edges_out(tmp_path: Path) -> None:
    file = csv(tmp_path / "edges.csv", EDGES)
    rule = neuro.from_file(file, transmitter="nt", signs={"ach": 1, "gaba": 0, "glut": 0})
    assert [edge[:3] for edge in synapses(diagram(tmp_path, rule))] == [
        (0, 2, 1.0),
        (0, 2, 1.0),
        (1, 0, 1.0),
        (1, 1, 1.0),
    ]


@pytest.mark.parametrize("kind", ["csv", "npy", "npz"])
def test_matrices_have_an_edge_for_each_entry(tmp_path: Path, kind: str) -> None:
    matrix = np.array([[0, 2, 0, 1], [0, 0, 0, 0], [5, 0, 3, 0], [0, 0, 0, -4]])
    if kind == "csv":
        lines = [
            ",".join(map(str, ("", *IDS))),
            *(",".join(map(str, (i, *row))) for i, row in zip(IDS, matrix, strict=True)),
        ]
        (tmp_path / "m.csv").write_text("\n".join(lines))
        rule = neuro.from_file(tmp_path / "m.csv", layout="matrix")
    elif kind == "npy":
        np.save(tmp_path / "m.npy", matrix)
        rule = neuro.from_file(tmp_path / "m.npy")
    else:
        save_npz(tmp_path / "m.npz", coo_array(matrix))
        rule = neuro.from_file(tmp_path / "m.npz")
    found = [edge[:3] for edge in synapses(diagram(tmp_path, rule))]
    assert found == [
        (i, j, float(matrix[i, j])) for i, j in zip(*map(np.ndarray.tolist, np.nonzero(matrix)), strict=True)
    ]


def test_views_are_chosen_by_columns(tmp_path: Path) -> None:
    net = diagram(tmp_path, neuro.from_file(csv(tmp_path / "edges.csv", EDGES)))
    brain = net.populations["brain"]
    assert brain.where(type="KC").ids.tolist() == [0, 1]
    assert brain.where(type=["KC", "APL"], side="left").ids.tolist() == [0, 3]
    assert brain.where(id=11).ids.tolist() == [3]
    sim = neuro.compile(net)
    sim.set("brain[type=KC, side=left]", V_m=-60.0)
    assert sim.get("brain", "V_m").tolist() == [-60.0, -70.0, -70.0, -70.0]
    with pytest.raises(neuro.ModelError, match=r"unknown value of column 'type' 'MBONs'") as error:
        brain.where(type="MBONs")
    assert error.value.suggestion == "MBON"
    with pytest.raises(neuro.ModelError, match="unknown column 'tipe'"):
        brain.where(tipe="KC")


YAML = """
populations:
  kc: {model: iaf_psc_exp, neurons: {file: neurons.csv, id: id, only: {type: KC}}}
  rest: {model: iaf_psc_delta, shape: 2, neurons: {file: neurons.csv, id: id, only: {type: [MBON, APL]}}}
  brain: {model: iaf_psc_exp, neurons: {file: neurons.csv, id: id}}
projections:
  out: {from: kc, to: rest, rule: {from_file: {file: sub/edges.csv, weight: synapses}}, weight: 0.5}
  in: {from: {brain: {type: [MBON, APL]}}, to: {brain: {side: right}}, rule: {from_file: {file: sub/edges.csv}}}
probes:
  seen: {of: {brain: {type: KC}}, record: V_m}
"""


def test_populations_and_views_in_yaml_take_the_edges_between_them(tmp_path: Path) -> None:
    csv(tmp_path / "neurons.csv", TABLE)
    (tmp_path / "sub").mkdir()
    csv(tmp_path / "sub" / "edges.csv", EDGES)
    (tmp_path / "net.yaml").write_text(YAML)
    net = neuro.load(tmp_path / "net.yaml")
    assert net.populations["kc"].shape == (2,)
    assert [edge[:3] for edge in synapses(net, "out")] == [(0, 0, 4.5), (0, 0, 2.5)]
    assert [edge[:3] for edge in synapses(net, "in")] == [(3, 1, 1.0)]
    assert {Path(name).name for name in net.inputs} == {"net.yaml", "neurons.csv", "edges.csv"}
    net.save(tmp_path / "again.yaml")
    assert neuro.load(tmp_path / "again.yaml") == net
    with pytest.raises(neuro.ModelError, match="expected a file in the folder of the description"):
        net.save(tmp_path / "sub" / "again.yaml")


def test_results_hold_the_description_and_can_be_made_again(tmp_path: Path) -> None:
    from neuro.results import read

    csv(tmp_path / "neurons.csv", TABLE)
    (tmp_path / "sub").mkdir()
    csv(tmp_path / "sub" / "edges.csv", EDGES)
    (tmp_path / "net.yaml").write_text(YAML)
    sim = neuro.compile(neuro.load(tmp_path / "net.yaml"), seed=3)
    sim.run(5.0, out=tmp_path / "run.h5")
    assert read(tmp_path / "run.h5").network().populations["kc"].neurons is not None


def test_edges_of_a_population_without_table_count_from_0(tmp_path: Path) -> None:
    columns = {"pre": PRE, "post": POST, "synapses": SYNAPSES}
    net = neuro.Network()
    net.population("a", 4, neuro.iaf_psc_exp())
    net.connect("a", "a", neuro.from_file(csv(tmp_path / "e.csv", columns), weight="synapses"))
    assert [edge[:2] for edge in synapses(net, "a_a")] == sorted(zip(PRE, POST, strict=True))


def test_text_is_an_id_too(tmp_path: Path) -> None:
    table = neuro.neuron_table(csv(tmp_path / "n.csv", {"name": ["AVAL", "AVAR", "007"]}), id="name")
    net = neuro.Network()
    columns = {"pre": ["AVAR", "007"], "post": ["AVAL", "AVAR"], "n": [2, 3]}
    net.wiring(
        neurons=table, edges=neuro.from_file(csv(tmp_path / "e.csv", columns), weight="n"), model=neuro.iaf_psc_exp()
    )
    assert [edge[:3] for edge in synapses(net)] == [(1, 0, 2.0), (2, 1, 3.0)]


def test_ids_beyond_63_bits_stay_apart(tmp_path: Path) -> None:
    ids = [2**64 - 1, 2**64 - 2, 2**53 + 1, 2**53]
    table = neuro.neuron_table(csv(tmp_path / "n.csv", {"id": ids}), id="id")
    net = neuro.Network()
    columns = {"pre": [ids[1], ids[3]], "post": [ids[0], ids[2]]}
    net.wiring(neurons=table, edges=csv(tmp_path / "e.csv", columns), model=neuro.iaf_psc_exp())
    assert [edge[:2] for edge in synapses(net)] == [(1, 0), (3, 2)]
