"""Wiring diagrams from files: the same network from each format, and from YAML; views by type and side."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.sparse import coo_array, save_npz

import neuro
from golden_messages import Messages
from refused import error_of, refusals_of, refused

pyarrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

IDS = [720575940596125868, 7, 2**62, 11]
TABLE = {"id": IDS, "type": ["KC", "KC", "MBON", "APL"], "side": ["left", "right", "left", "left"]}
TABLE["nt"] = ["ach", "ach", "glut", "gaba"]
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


WRITERS = {"edges.csv": csv, "edges.parquet": as_parquet, "edges.npz": as_npz, "edges.h5": sonata}


def diagram(folder: Path, edges: neuro.from_file, **more: Any) -> neuro.Network:
    table, net = neuro.neuron_table(csv(folder / "neurons.csv", TABLE), id="id"), neuro.Network()
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


def test_signs_and_weights_of_edges(tmp_path):
    columns = {name: EDGES[name] for name in ("pre", "post", "synapses", "delay")}
    file = csv(tmp_path / "edges.csv", columns)
    rule = neuro.from_file(file, weight="synapses", delay="delay", transmitter="nt", signs=SIGNS, dale=True)
    np.testing.assert_allclose(synapses(diagram(tmp_path, rule, delay=2.0)), expected([0, 1, 2, 3, 4, 5], 1.0))
    file = csv(tmp_path / "edges.csv", EDGES)
    rule = neuro.from_file(file, transmitter="nt", signs={"ach": 1, "gaba": 0, "glut": 0})
    assert [edge[:2] for edge in synapses(diagram(tmp_path, rule))] == [(0, 2), (0, 2), (1, 0), (1, 1)]
    file = csv(tmp_path / "edges.csv", {**EDGES, "synapses": [0] * 6})
    rule = neuro.from_file(file, weight="synapses", transmitter="nt", signs=SIGNS)
    assert len(synapses(diagram(tmp_path, rule))) == 6


@pytest.mark.parametrize("kind", ["csv", "npy", "npz"])
def test_matrices_have_an_edge_for_each_entry(tmp_path: Path, kind: str) -> None:
    matrix = np.array([[0, 2, 0, 1], [0, 0, 0, 0], [5, 0, 3, 0], [0, 0, 0, -4]])
    if kind == "csv":
        lines = [("", *IDS), *((i, *row) for i, row in zip(IDS, matrix, strict=True))]
        (tmp_path / "m.csv").write_text("\n".join(",".join(map(str, line)) for line in lines))
        rule = neuro.from_file(tmp_path / "m.csv", layout="matrix")
    elif kind == "npy":
        np.save(tmp_path / "m.npy", matrix)
        rule = neuro.from_file(tmp_path / "m.npy")
    else:
        save_npz(tmp_path / "m.npz", coo_array(matrix))
        rule = neuro.from_file(tmp_path / "m.npz")
    found = [edge[:3] for edge in synapses(diagram(tmp_path, rule))]
    assert found == [(i, j, weight) for (i, j), weight in np.ndenumerate(matrix) if weight]


def test_views_are_chosen_by_columns(tmp_path: Path) -> None:
    net = diagram(tmp_path, neuro.from_file(csv(tmp_path / "edges.csv", EDGES)))
    brain = net.populations["brain"]
    assert brain.where(type="KC").ids.tolist() == [0, 1]
    assert brain.where(type=["KC", "APL"], side="left").ids.tolist() == [0, 3]
    assert brain.where(id=11).ids.tolist() == [3]
    sim = neuro.compile(net)
    sim.set("brain[type=KC, side=left]", V_m=-60.0)
    assert sim.get("brain", "V_m").tolist() == [-60.0, -70.0, -70.0, -70.0]
    assert error_of(brain.where, type="MBONs").suggestion == "MBON"


YAML = Path(__file__).with_name("views.yaml").read_text("utf-8")


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
    assert "expected a file in the folder of the description" in refused(net.save, tmp_path / "sub" / "again.yaml")


def test_results_hold_the_description_and_can_be_made_again(tmp_path: Path) -> None:
    from neuro.results import read

    csv(tmp_path / "neurons.csv", TABLE)
    (tmp_path / "sub").mkdir()
    csv(tmp_path / "sub" / "edges.csv", EDGES)
    (tmp_path / "net.yaml").write_text(YAML)
    neuro.compile(neuro.load(tmp_path / "net.yaml"), seed=3).run(5.0, out=tmp_path / "run.h5")
    assert synapses(read(tmp_path / "run.h5").network(), "out") == synapses(neuro.load(tmp_path / "net.yaml"), "out")
    (tmp_path / "moved").mkdir()
    (tmp_path / "sub").rename(tmp_path / "moved" / "sub")
    assert read(tmp_path / "run.h5").network(played=False).projections["out"].rule.name == "from_file"
    assert "edges.csv" in refused(read(tmp_path / "run.h5").network)


def test_ids(tmp_path):
    columns, net = {"pre": PRE, "post": POST, "synapses": SYNAPSES}, neuro.Network()
    net.population("a", 4, neuro.iaf_psc_exp())
    net.connect("a", "a", neuro.from_file(csv(tmp_path / "e.csv", columns), weight="synapses"))
    assert [edge[:2] for edge in synapses(net, "a_a")] == sorted(zip(PRE, POST, strict=True))
    table = neuro.neuron_table(csv(tmp_path / "n.csv", {"name": ["AVAL", "AVAR", "007"]}), id="name")
    net, columns = neuro.Network(), {"pre": ["AVAR", "007"], "post": ["AVAL", "AVAR"], "n": [2, 3]}
    net.wiring(
        neurons=table, edges=neuro.from_file(csv(tmp_path / "e.csv", columns), weight="n"), model=neuro.iaf_psc_exp()
    )
    assert [edge[:3] for edge in synapses(net)] == [(1, 0, 2.0), (2, 1, 3.0)]
    ids = [2**64 - 1, 2**64 - 2, 2**53 + 1, 2**53]
    table, net = neuro.neuron_table(csv(tmp_path / "n.csv", {"id": ids}), id="id"), neuro.Network()
    columns = {"pre": [ids[1], ids[3]], "post": [ids[0], ids[2]]}
    net.wiring(neurons=table, edges=csv(tmp_path / "e.csv", columns), model=neuro.iaf_psc_exp())
    assert [edge[:2] for edge in synapses(net)] == [(1, 0), (3, 2)]


def test_silenced_neurons_fire_and_reach_nobody(tmp_path: Path) -> None:
    net = diagram(tmp_path, neuro.from_file(csv(tmp_path / "edges.csv", EDGES)), weight=1000.0, drive=1e5)
    sim, brain = neuro.compile(net, seed=1), net.populations["brain"]
    sim.activate(brain.where(type="MBON"), 100.0)
    sim.run(500.0)
    fired = sim.counts().populations["brain"].spikes
    assert len(sim.spikes(brain[3])[0]) > 20
    sim.silence("brain[type=MBON]")
    assert sim.weights("brain_brain", pre="brain[type=MBON]")[2].tolist() == [0.0]
    sim.run(500.0)
    late, _ = sim.spikes(brain[3], since=550.0)
    assert len(late) == 0
    assert sim.counts().populations["brain"].spikes - fired > 20
    sim.activate(brain, 0.0)
    sim.run(50.0)
    before = sim.counts().populations["brain"].spikes
    sim.run(500.0)
    assert (sim.counts().populations["brain"].spikes, sim.steered.keys()) == (before, {"activate", "silence"})
    sim.reset(weights=True)
    assert sim.weights("brain_brain")[2].min() == 1000.0


@pytest.mark.parametrize("backend", ["reference", "loihi"])
def test_every_backend_silences_and_activates(tmp_path: Path, backend: str) -> None:
    net = neuro.Network(resolution=1.0)
    table = neuro.neuron_table(csv(tmp_path / "n.csv", {"id": [10, 20, 30], "type": ["KC", "KC", "MBON"]}), id="id")
    edges = neuro.from_file(csv(tmp_path / "e.csv", {"pre": [10, 20], "post": [20, 30], "n": [5, 6]}), weight="n")
    net.wiring(neurons=table, edges=edges, model=neuro.iaf_psc_exp(t_ref=2.0), weight=300.0, delay=2.0, drive=3000.0)
    sim = neuro.compile(net, backend=backend, seed=1)
    sim.activate("brain[type=KC]", 100.0)
    sim.run(300.0)
    assert len(sim.spikes("brain[type=MBON]")[0]) > 3
    sim.silence("brain[type=KC]")
    sim.run(200.0)
    assert len(sim.spikes("brain[type=MBON]", since=310.0)[0]) == 0
    assert len(sim.spikes("brain[type=KC]", since=310.0)[0]) > 3


@pytest.mark.parametrize("rule", ["stdp", "tsodyks2", "stddp"])
def test_weights_that_would_grow_again_are_not_silenced(rule: str) -> None:
    net = neuro.Network(resolution=1.0)
    for name in ("a", "b"):
        net.population(name, 2, neuro.iaf_psc_exp())
    net.connect("a", "b", neuro.all_to_all(), getattr(neuro, rule)(), weight=10.0, delay=1.0)
    sim = neuro.compile(net)
    if rule == "stdp":
        assert "'a_b' learns by stdp, so its weights would grow again" in refused(sim.silence, "a[0]")
    else:
        sim.silence("a[0]")
        assert sim.weights("a_b")[2].tolist() == [0.0, 0.0, 10.0, 10.0]
    sim.silence("b")


def test_what_a_simulation_holds_is_a_network_of_pairs(tmp_path: Path) -> None:
    net = diagram(tmp_path, neuro.from_file(csv(tmp_path / "edges.csv", EDGES), weight="synapses", delay="delay"))
    sim = neuro.compile(net)
    sim.silence("brain[type=KC]")
    again = sim.network()
    again.save(tmp_path / "again.yaml")
    mine, theirs = (neuro.compile(each).weights("brain_brain", delays=True) for each in (again, net))
    assert np.array_equal(mine[3], theirs[3])
    assert mine[2].tolist() == [0.0 if pre < 2 else weight for pre, weight in zip(theirs[0], theirs[2], strict=True)]


@pytest.mark.parametrize("rate", [0.0, 20.0])
def test_noise_is_not_taken_for_the_driver(rate: float) -> None:
    net = neuro.Network(resolution=1.0)
    net.population("cells", 2, neuro.iaf_psc_delta())
    for name, given in (("noise", 500.0), ("drive", rate)):
        net.population(name, 2, neuro.poisson_generator(rate=given))
        net.connect(name, "cells", neuro.one_to_one(), weight=1.0, delay=1.0)
    sim = neuro.compile(net)
    if rate:
        assert "'noise' and 'drive' are connected to 'cells' one_to_one" in refused(sim.activate, "cells", 100.0)
    else:
        sim.activate("cells", 100.0)
        assert [sim.get(name, "rate").tolist() for name in ("noise", "drive")] == [[500.0] * 2, [100.0] * 2]


def pairs_of(net: neuro.Network) -> tuple[Any, Any, Any]:
    return neuro.compile(net).weights("brain_brain")


@pytest.fixture
def larger(tmp_path: Path) -> neuro.Network:
    """300 neurons and 3,000 edges, no pair twice, no autapse."""
    rng = np.random.default_rng(0)
    pre, post = np.divmod(np.sort(rng.permutation(300 * 299)[:3000]), 299)
    post += post >= pre
    columns = {"pre": pre.tolist(), "post": post.tolist(), "n": rng.integers(1, 20, 3000).tolist()}
    nt = [("ach", "gaba")[k] for k in rng.integers(0, 2, 300)]
    table = neuro.neuron_table(csv(tmp_path / "n.csv", {"id": list(range(300)), "nt": nt}), id="id")
    rule = neuro.from_file(
        csv(tmp_path / "e.csv", columns), weight="n", transmitter="nt", signs={"ach": 1, "gaba": -1}, dale=True
    )
    net = neuro.Network()
    net.wiring(neurons=table, edges=rule, model=neuro.iaf_psc_exp())
    return net


def test_shuffles(larger, tmp_path):
    pre, post, weight = pairs_of(larger)
    new_pre, new_post, new_weight = pairs_of(neuro.shuffled(larger, "edges", seed=1))
    assert np.array_equal(np.bincount(pre), np.bincount(new_pre))
    assert np.array_equal(np.bincount(post), np.bincount(new_post))
    assert len(set(zip(new_pre, new_post, strict=True))) == 3000
    assert not (new_pre == new_post).any()
    assert np.mean(new_post == post) < 0.1
    assert sorted(zip(pre, weight, strict=True)) == sorted(zip(new_pre, new_weight, strict=True))
    pre, post, weight = pairs_of(larger)
    new_pre, new_post, new_weight = pairs_of(neuro.shuffled(larger, "signs", seed=1))
    assert np.array_equal(np.abs(weight), np.abs(new_weight))
    assert np.array_equal(post, new_post)
    signs = [{np.sign(w) for w in new_weight[new_pre == k]} for k in np.unique(pre)]
    assert {len(each) for each in signs} == {1}
    assert sum(1 in each for each in signs) == len({p for p, w in zip(pre, weight, strict=True) if w > 0})
    assert not np.array_equal(weight, new_weight)
    _, post, weight = pairs_of(larger)
    _, new_post, new_weight = pairs_of(neuro.shuffled(larger, "weights", seed=1))
    assert np.array_equal(post, new_post)
    assert np.array_equal(np.sign(weight), np.sign(new_weight))
    assert np.array_equal(np.sort(np.abs(weight)), np.sort(np.abs(new_weight)))
    assert np.mean(weight == new_weight) < 0.2
    control = neuro.shuffled(larger, "edges", seed=5)
    control.save(tmp_path / "control.yaml")
    assert np.array_equal(pairs_of(control)[1], pairs_of(neuro.load(tmp_path / "control.yaml"))[1])
    assert not np.array_equal(pairs_of(control)[1], pairs_of(neuro.shuffled(larger, "edges", seed=6))[1])
    assert larger.projections["brain_brain"].rule.shuffle is None


def test_what_is_refused(tmp_path: Path, messages: Messages) -> None:
    net, columns = neuro.Network(), {"pre": [0, 0, 1], "post": [1, 2, 2]}
    net.population("a", 3, neuro.iaf_psc_exp())
    net.connect("a", "a", neuro.from_file(csv(tmp_path / "e.csv", columns)))
    brain = diagram(tmp_path, neuro.from_file(csv(tmp_path / "edges.csv", EDGES))).populations["brain"]
    messages(refusals_of(messages.cases, globals() | locals() | {"brain": brain}, folder=tmp_path))


def test_neuro_check_tells_each_mistake_once(tmp_path: Path) -> None:
    from neuro.compiler.mistakes import mistakes

    csv(tmp_path / "neurons.csv", TABLE)
    (tmp_path / "sub").mkdir()
    csv(tmp_path / "sub" / "edges.csv", EDGES)
    text = YAML.replace(
        "kc: {model: iaf_psc_exp, neurons: {file: neurons", "kc: {model: iaf_psc_exp, neurons: {file: neuron"
    )
    (tmp_path / "net.yaml").write_text(text.replace("weight: synapses", "weight: n").replace("side: right", "side: up"))
    found = mistakes(tmp_path / "net.yaml", None, 0).mistakes
    assert [error.message.split(": ", 1)[1] for error in found] == [
        "no file 'neuron.csv' beside the description",
        f"{tmp_path}/sub/edges.csv: unknown column 'n'",
        f"to: {tmp_path}/neurons.csv: column 'side': unknown value 'up'",
    ]


@pytest.mark.parametrize("ascending", [False, True])
def test_a_file_is_the_same_network_as_listed_pairs(tmp_path: Path, ascending: bool, monkeypatch: Any) -> None:
    """Also of a network so large that synapses are ordered by delay, and of edges that are listed in that order."""
    monkeypatch.setattr("neuro.compiler.resolve.MANY", 1000)
    rng = np.random.default_rng(1)
    pre, post = rng.integers(0, 50, (2, 2000))
    n, late = rng.integers(1, 9, 2000), rng.integers(1, 30, 2000) / 10
    if ascending:
        order = np.lexsort((post, late, pre))
        pre, post, n, late = pre[order], post[order], n[order], late[order]
    columns = {"pre": pre.tolist(), "post": post.tolist(), "n": n.tolist(), "d": late.tolist()}
    file, spikes = neuro.from_file(csv(tmp_path / "e.csv", columns), weight="n", delay="d"), []
    for rule, weight, delay in ((file, 15.0, 1.0), (neuro.pairs(pre, post), 15.0 * n, late)):
        net = neuro.Network()
        net.population("a", 50, neuro.iaf_psc_exp(I_e=380.0), initial={"V_m": neuro.uniform(low=-70.0, high=-55.0)})
        net.connect("a", "a", rule, weight=weight, delay=delay, name="within")
        net.connect("a", "a", neuro.fixed_total_number(1000), weight=0.0, name="many")
        sim = neuro.compile(net, seed=2)
        sim.run(200.0)
        spikes.append((*sim.spikes("a"), *sim.weights("within", delays=True)))
    assert len(spikes[0][0]) > 100
    for mine, theirs in zip(*spikes, strict=True):
        np.testing.assert_array_equal(mine, theirs)
