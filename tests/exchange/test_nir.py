"""Networks from NIR and back."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import neuro
from neuro.cli.commands import app
from refused import mistakes_of

nir = pytest.importorskip("nir", reason="nir is not installed")


def layers(**words):
    """Input -> Affine -> LIF -> Linear -> LIF -> Output."""
    rng = np.random.default_rng(1)
    return nir.NIRGraph.from_list(
        nir.Input({"input": np.array([6])}),
        nir.Affine(rng.normal(0.0, 2.0, (5, 6)), rng.normal(0.0, 0.3, 5)),
        nir.LIF(tau=np.full(5, 0.01), r=np.ones(5), v_leak=np.zeros(5), v_threshold=np.full(5, 0.1)),
        nir.Linear(rng.normal(0.0, 2.0, (4, 5))),
        nir.LIF(tau=np.full(4, 0.02), r=np.ones(4), v_leak=np.zeros(4), v_threshold=np.full(4, 0.1)),
    )


def run(net: neuro.Network, counts, output: str):
    """The counts of spikes of a population by step, for counts of input spikes by step."""
    sim = neuro.compile(net, seed=1)
    steps, ids = np.nonzero(counts)
    repeats = counts[steps, ids].astype(int)
    h = net.resolution
    sim.inject("input", np.repeat((steps + 1) * h, repeats), np.repeat(ids, repeats))
    sim.run(round(h * (len(counts) + 8), 6))
    times, ids = sim.spikes(output)
    out = np.zeros((len(counts) + 9, sim.network().populations[output].ids.size), int)
    np.add.at(out, (np.rint(times / h).astype(int), ids), 1)
    return out


def euler(graph, counts):
    """The spikes of `layers` in Norse's convention."""
    nodes = list(graph.nodes.values())
    v = [np.zeros(5), np.zeros(4)]
    out = []
    for x in counts:
        for k, (weights, cell) in enumerate(((nodes[1], nodes[2]), (nodes[3], nodes[4]))):
            drive = weights.weight @ x + getattr(weights, "bias", 0.0)
            v[k] += 0.001 / cell.tau * (drive - v[k])
            x = v[k] > cell.v_threshold
            v[k][x] = 0.0
        out.append(x)
    return np.array(out)


def test_two_layers_fire_as_in_norse_one_step_later_a_layer():
    graph = layers()
    counts = (np.random.default_rng(2).random((200, 6)) < 0.2) * 1
    net = neuro.from_nir(graph, dt=1.0, from_="norse")
    assert net.verdicts.exact
    expected = euler(graph, counts)
    assert expected.sum() > 50
    assert np.array_equal(run(net, counts, "lif_1")[4:204], expected)


@pytest.mark.parametrize("tool", [None, "norse", "snntorch", "spikingjelly"])
def test_a_network_that_is_written_and_read_fires_at_the_same_steps(tool, tmp_path):
    counts = (np.random.default_rng(3).random((200, 6)) < 0.2) * 1
    net = neuro.from_nir(layers(), dt=1.0, from_="norse")
    nir.write(tmp_path / "net.nir", neuro.to_nir(net, for_=tool))
    again = neuro.from_nir(tmp_path / "net.nir", dt=1.0)
    assert np.array_equal(run(net, counts, "lif_1"), run(again, counts, "lif_1"))


def test_the_command_converts_both_ways(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nir.write("a.nir", layers())
    assert (
        CliRunner().invoke(app, ["convert", "a.nir", "a.yaml", "--resolution", "1", "--from", "norse"]).exit_code == 0
    )
    done = CliRunner().invoke(app, ["convert", "a.yaml", "b.nir", "--to", "norse", "--json"])
    assert done.exit_code == 0, done.exception
    assert '"exact": true' in done.stdout
    refused = CliRunner().invoke(app, ["convert", "a.nir", "c.yaml", "--resolution", "20", "--from", "norse"])
    assert "lif     LIF     refused" in refused.stdout
    assert isinstance(refused.exception, neuro.ModelError)


@pytest.mark.parametrize("content", [b"no NIR", None])
def test_a_file_of_another_tool_is_not_replaced(content, tmp_path):
    file = tmp_path / "other.nir"
    if content is None:
        nir.write(file, layers())
    else:
        file.write_bytes(content)
    net = neuro.from_nir(layers(), dt=1.0, from_="norse")
    net.save(tmp_path / "net.yaml")
    done = CliRunner().invoke(app, ["convert", str(tmp_path / "net.yaml"), str(file)])
    assert str(done.exception) == f"{file}: exists and is not a NIR file of neuro: expected a new name"


def test_an_option_that_neither_file_uses_is_refused(messages, answer):
    messages(mistakes_of(answer, messages.cases))


@pytest.mark.parametrize(
    "rule", [neuro.grid(kernel=(2, 3), padding="same"), neuro.grid(kernel=(1, 3), column_padding=1)]
)
def test_borders_of_grids_are_written_and_read(rule, tmp_path):
    net = neuro.Network("sheet", resolution=1.0)
    net.population("input", (1, 4, 6), neuro.spike_generator())
    net.population("cells", (2, 4, 6), neuro.iaf_psc_delta(E_L=0.0, V_reset=0.0, V_th=1.0, t_ref=0.0))
    weight = np.random.default_rng(0).normal(0.0, 1.0, (2, 1, *rule.kernel))
    net.connect("input", "cells", rule, weight=weight, delay=1.0)
    nir.write(tmp_path / "net.nir", neuro.to_nir(net))
    again = neuro.from_nir(tmp_path / "net.nir", dt=1.0)
    counts = (np.random.default_rng(1).random((50, 24)) < 0.2) * 1
    assert again.projections["input_cells"].rule.name == "grid"
    assert run(net, counts, "cells").sum() > 50
    assert np.array_equal(run(net, counts, "cells"), run(again, counts, "cells"))


def driven(model: neuro.Model, rule) -> neuro.Network:
    """Two neurons that a generator of currents drives beside spikes."""
    net = neuro.Network("driven", resolution=1.0)
    net.population("input", 3, neuro.spike_generator())
    net.population("dc", 3, model)
    net.population("cells", 2, neuro.iaf_psc_delta(tau_m=20.0, C_m=1.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=15.0))
    net.connect("input", "cells", neuro.all_to_all(), weight=5.0, delay=2.0)
    net.connect("dc", "cells", rule, weight=1.0, delay=1.0)
    return net


def test_currents_of_some_generators_are_biases():
    rule = neuro.pairs([0, 1], [1, 1])
    graph = neuro.to_nir(driven(neuro.dc_generator(amplitude=[1.0, 2.0, 3.0]), rule))
    push = -20.0 * np.expm1(-1.0 / 20.0)
    assert graph.nodes["input_cells"].bias == pytest.approx([0.0, 3.0 * push])
    assert neuro.to_nir(driven(neuro.dc_generator(amplitude=1.0), neuro.pairs([], [])))


def test_a_current_that_begins_later_is_no_exact_bias():
    graph = neuro.to_nir(driven(neuro.dc_generator(amplitude=1.0, start=50.0), neuro.all_to_all()))
    assert '"begins 50 steps later here"' in graph.metadata["neuro_verdicts"]


def test_what_is_refused(messages):
    changing = neuro.step_current_generator(amplitude_times=[1.0], amplitude_values=[2.0])
    messages.calls(globals() | locals())
