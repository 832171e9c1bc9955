"""SONATA: what is written is read back, by our own reader and by libsonata (`make test-oracles`)."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import neuro
from neuro.cli.commands import app


def network() -> neuro.Network:
    net = neuro.Network("small")
    net.population("in", 5, neuro.poisson_generator(rate=800.0))
    net.population("exc", 8, neuro.iaf_psc_exp(tau_m=neuro.uniform(low=9.0, high=11.0)))
    net.connect("in", "exc", neuro.all_to_all(), weight=900.0, delay=0.3, name="input")
    weight, delay = neuro.normal(mean=20.0, std=5.0), neuro.uniform(low=0.5, high=3.0)
    net.connect("exc", "exc", neuro.fixed_indegree(3), weight=weight, delay=delay, name="within")
    net.connect("exc", "exc", neuro.one_to_one(), neuro.stdp(Wmax=100.0), weight=7.0, name="plastic")
    return net


@pytest.fixture
def written(tmp_path: Path) -> tuple[Any, Path]:
    sim = neuro.compile(network(), seed=4)
    sim.run(100.0)
    neuro.save_sonata(sim, tmp_path / "net.json")
    return sim, tmp_path


def test_our_own_reader_gives_the_same_synapses(written: tuple[Any, Path]) -> None:
    sim, folder = written
    net = neuro.Network()
    net.population("exc", "auto", neuro.iaf_psc_exp(), neurons=neuro.neuron_table(folder / "net_nodes.h5", key="exc"))
    rule = neuro.from_file(folder / "net_edges.h5", key="within", weight="syn_weight", delay="delay")
    net.connect("exc", "exc", rule, name="within")
    again = neuro.compile(net).weights("within", delays=True)
    for mine, theirs in zip(sim.weights("within", delays=True), again, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-15)


def test_verdicts_name_what_is_lost(written: tuple[Any, Path]) -> None:
    sim, folder = written
    table = neuro.save_sonata(sim, folder / "net.json")
    assert {each.node: each.verdict for each in table} == {
        "in": "exact",
        "exc": "exact",
        "input": "exact",
        "within": "exact",
        "plastic": "approximate",
    }


def test_a_shared_kernel_is_refused(tmp_path: Path) -> None:
    net = neuro.Network()
    net.population("a", (4, 4), neuro.poisson_generator(rate=1.0))
    net.population("b", (2, "auto", "auto"), neuro.iaf_psc_exp())
    net.connect("a", "b", neuro.grid((3, 3)), name="sheet")
    with pytest.raises(neuro.ModelError, match="its neurons share a kernel"):
        neuro.save_sonata(neuro.compile(net), tmp_path / "net.json")
    assert not list(tmp_path.iterdir())


def test_files_of_others_stay(written: tuple[Any, Path]) -> None:
    sim, folder = written
    with h5py.File(folder / "other_nodes.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(neuro.ModelError, match="exists and is not a SONATA file of neuro"):
        neuro.save_sonata(sim, folder / "other.json")
    with pytest.raises(neuro.ModelError, match=r"ending in \.json"):
        neuro.save_sonata(sim, folder / "net.h5")


def test_neuro_convert_writes_it(tmp_path: Path) -> None:
    network().save(tmp_path / "net.yaml")
    result = CliRunner().invoke(app, ["convert", str(tmp_path / "net.yaml"), str(tmp_path / "out.json")])
    assert result.exit_code == 0, result.output
    assert "plastic" in result.output
    config = json.loads((tmp_path / "out.json").read_text())
    assert config["networks"]["edges"][0]["edges_file"] == "$BASE_DIR/out_edges.h5"


def test_libsonata_reads_nodes_edges_and_spikes_equal(written: tuple[Any, Path]) -> None:
    libsonata = pytest.importorskip("libsonata", reason="make test-oracles installs libsonata")
    sim, folder = written
    config = libsonata.CircuitConfig.from_file(folder / "net.json")
    assert config.node_populations == {"in", "exc"}
    assert config.edge_populations == {"input", "within", "plastic"}
    nodes = libsonata.NodeStorage(folder / "net_nodes.h5").open_population("exc")
    assert nodes.size == 8
    assert np.array_equal(nodes.get_attribute("tau_m", nodes.select_all()), sim.get("exc", "tau_m"))
    storage = libsonata.EdgeStorage(folder / "net_edges.h5")
    for name in ("input", "within", "plastic"):
        edges, all_ = storage.open_population(name), storage.open_population(name).select_all()
        pre, post, weight, delay = sim.weights(name, delays=True)
        assert (edges.source, edges.target) == ("in" if name == "input" else "exc", "exc")
        assert np.array_equal(edges.source_nodes(all_), pre)
        assert np.array_equal(edges.target_nodes(all_), post)
        assert np.array_equal(edges.get_attribute("syn_weight", all_), weight)
        assert np.array_equal(edges.get_attribute("delay", all_), delay)
    spikes = libsonata.SpikeReader(str(folder / "net_spikes.h5"))["exc"]
    times, ids = sim.spikes("exc")
    assert len(times) > 50
    assert spikes.sorting == "by_time"
    assert spikes.get() == list(zip(ids.tolist(), times.tolist(), strict=True))


def test_listed_spikes_that_are_still_to_come_and_initial_states(tmp_path: Path) -> None:
    import h5py

    net = neuro.Network("listed")
    net.population("in", 2, neuro.spike_generator(spike_times=[[1.0, 5.0], [3.0]]))
    net.population("cells", 2, neuro.iaf_psc_exp(), initial={"V_m": [-60.0, -61.0]})
    sim = neuro.compile(net)
    sim.run(4.0)
    assert neuro.save_sonata(sim, tmp_path / "net.json")["in"].verdict == "approximate"
    sim.run(4.0)
    assert neuro.save_sonata(sim, tmp_path / "net.json").exact
    with h5py.File(tmp_path / "net_nodes.h5") as file:
        assert file["nodes/cells/0/V_m"][()].tolist() == [-60.0, -61.0]
