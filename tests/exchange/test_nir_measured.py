"""By how much approximate nodes differ."""

from __future__ import annotations

import json

import numpy as np
import pytest

import neuro
import random_nir
from neuro_exchange.nir.importing import network_of
from neuro_exchange.nir.judging import judge
from neuro_exchange.nir.measured import measure

nir = pytest.importorskip("nir", reason="nir is not installed")

ZERO, ONE = np.zeros(5), np.ones(5)


def recurrent():
    rng = np.random.default_rng(0)
    cell = nir.LIF(tau=0.002 * ONE, r=20.0 * ONE, v_leak=ZERO, v_threshold=ONE, v_reset=ZERO)
    nodes = {
        "input": nir.Input({"input": np.array([5])}),
        "w": nir.Linear(rng.normal(0.3, 0.5, (5, 5))),
        "lif": cell,
        "back": nir.Linear(rng.normal(0.0, 0.5, (5, 5))),
        "output": nir.Output({"output": np.array([5])}),
    }
    edges = [("input", "w"), ("w", "lif"), ("lif", "back"), ("back", "lif"), ("lif", "output")]
    return nir.NIRGraph(nodes, edges)


@pytest.mark.parametrize("tool", ["norse", "snntorch", "nir", "spikingjelly", "sinabs", "spyx", "rockpool"])
@pytest.mark.parametrize("reset", [None, "subtract", "to_value_next"])
def test_the_equations_of_a_tool_fire_as_the_network_where_it_is_exact(tool, reset):
    compared = 0
    for seed in range(5):
        graph = random_nir.random_graph(nir, seed, "norse" if tool in ("norse", "nir", "spikingjelly") else "snntorch")
        found = judge(graph, 0.1 if tool == "snntorch" else 1.0, tool, reset)
        if found.table().refused or any(cell.differs for cell in found.cells.values()):
            continue
        if tool in ("sinabs", "rockpool") and any(node.recurrent for node in found.graph.nodes.values()):
            continue  # more than 255 spikes in a step
        said = measure(found, network_of(found), found.names, found.depths)
        compared += said.startswith("in 200")
        assert "100.0 %" in said or "no neuron fires" in said, seed
    assert compared >= 1


def test_what_snntorch_does_with_recurrent_weights_is_measured():
    table = neuro.check_nir(recurrent(), dt=0.1, from_="snntorch")
    back = table["back"]
    assert back.verdict == "approximate"
    spikes = "550 spikes in snntorch and 539 here, 71.1 % of them at the same step"
    assert back.measured == f"in 200 steps of random input {spikes}"
    assert back.measured in str(table)
    assert back.measured in [each["measured"] for each in json.loads(table.to_json())["nodes"]]
    assert not table["lif"].measured
    assert neuro.from_nir(recurrent(), dt=0.1, from_="snntorch").verdicts == table


def test_a_graph_that_the_tool_does_not_run_is_not_measured():
    nodes = [nir.Input({"input": np.array([5])}), nir.Linear(np.eye(5)), recurrent().nodes["lif"]]
    graph = nir.NIRGraph.from_list(*nodes, nir.Delay(np.full(5, 1e-3)), nir.Linear(np.eye(5)), nodes[2])
    for tool, does in (("norse", "runs only a part of the graph"), ("spikingjelly", "refuses the file")):
        delay = neuro.check_nir(graph, dt=1.0, from_=tool)["delay"]
        assert does in delay.how
        assert delay.measured == "not measured: the tool runs no such network"


def test_silence_is_no_measure():
    graph = recurrent()
    graph.nodes["w"].weight *= 0.0
    said = neuro.check_nir(graph, dt=0.1, from_="snntorch")["back"].measured
    assert said == "not measured: no neuron fires in 200 steps of random input"


def test_a_current_that_begins_later_in_the_graph_is_measured():
    net = neuro.Network("net", resolution=1.0)
    net.population("in", 5, neuro.spike_generator())
    net.population("one", 5, neuro.iaf_psc_delta(t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0, tau_m=10.0))
    net.population("two", 5, neuro.iaf_psc_delta(t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0, tau_m=10.0, I_e=20.0))
    net.connect("in", "one", neuro.one_to_one(), weight=0.6, delay=1.0)
    net.connect("one", "two", neuro.one_to_one(), weight=0.6, delay=1.0)
    table = json.loads(neuro.to_nir(net).metadata["neuro_verdicts"])
    two = next(each for each in table["nodes"] if each["node"] == "two")
    assert two["verdict"] == "approximate"
    assert two["measured"].startswith("in 200 steps of random input ")


def test_a_generator_that_draws_drives_both_alike():
    net = neuro.Network("net", resolution=0.1)
    net.population("in", 5, neuro.poisson_generator(rate=900.0))
    net.population("one", 5, neuro.iaf_psc_delta(t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0, tau_m=10.0))
    net.connect("in", "one", neuro.one_to_one(), weight=1.1, delay=0.1)
    net.connect("one", "one", neuro.one_to_one(), weight=-0.2, delay=0.1)
    table = json.loads(neuro.to_nir(net, for_="snntorch").metadata["neuro_verdicts"])
    assert any(each["measured"].startswith("in 200 steps") for each in table["nodes"])
    assert not net.probes
