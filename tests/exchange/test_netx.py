"""Networks of lava-dl for Loihi 2; other tools take no graded spikes."""

import contextlib
from pathlib import Path

import h5py
import numpy as np
import pytest

import neuro
from golden_traces import run_pair, run_sdnn, run_tinynet, stored, summary, unpacked
from neuro.chips import chip, place
from neuro.core.errors import ModelError
from neuro_exchange.netx import examine_netx
from refused import refused

CONV = {"type": b"conv", "shape": [2, 1, 1]}


CUBA = {"type": b"CUBA", "vThMant": 1, "iDecay": 1, "vDecay": 1}


def test_pilotnet_in_lif_neurons_takes_intels_cores_and_a_step_is_within_its_measurement(tmp_path):
    """A calibration, not a prediction: the ceilings follow from 68.3 uJ of dynamic energy a step."""
    costs = chip("loihi2").costs
    ends = [3.4e6 * costs["synaptic_op"].high, 158e3 * costs["neuron_update_active"].high]
    assert ends == pytest.approx([68.3e-6] * 2, rel=0.01)
    golden = stored("pilotnet_lif")
    sim = neuro.compile(unpacked(golden, tmp_path), "loihi2")
    cores = [len(np.unique(own[own >= 0])) for own in place(sim.program, chip("loihi2")).core_of]
    assert cores[1:6] == [25, 13, 3, 3, 2]  # as printed by its compiler
    assert cores[6] <= 12  # it cuts this dense layer into more pieces than it must
    assert cores[7:] == [1, 1, 1]
    steps, ids = np.nonzero(golden["input"])
    sim.inject("input", steps + 1.0, ids)
    sim.run(24.0)
    bill = sim.energy("loihi2")
    dynamic = [item for item in bill.items if item.what != "static_per_chip"]
    counted = {what: sum(i.count for i in dynamic if i.what.startswith(what)) / 24 for what in ("syn", "neuron")}
    assert counted["syn"] == pytest.approx(2.955e6, rel=1e-3)  # for another frame than the notebook's, of 3.4 million
    assert counted["neuron"] == 158_509 - 39_600  # the input is the host's here
    assert sum(i.low for i in dynamic) / 24 <= 68.3e-6 <= sum(i.high for i in dynamic) / 24
    assert bill.real_time.static_j == pytest.approx(0.232 * 24e-3)  # one chip


def test_pilotnet_sdnn_is_that_of_intels_test(tmp_path):
    golden = stored("pilotnet_sdnn")
    assert np.array_equal(run_sdnn(unpacked(golden, tmp_path), golden["image"], golden["s"].size), golden["s"])


def test_tinynet_is_that_of_intels_test(tmp_path):
    golden = stored("tinynet")
    assert np.array_equal(run_tinynet(unpacked(golden, tmp_path), golden["bias"]), golden["s"])


@pytest.mark.parametrize("target", ["conv-1", "fc-0"])
def test_pairs_of_layers_of_pilotnet_lif(tmp_path, target):
    golden = stored("pilotnet_lif")
    found = run_pair(unpacked(golden, tmp_path, target), golden[f"{target}/input"])
    assert found["s"].any()
    for name, values in summary(found).items():
        assert np.array_equal(values, golden[f"{target}/{name}"]), name


def netx_file(path, **changes):
    """A file of a small network, with some words of its second layer changed."""
    neuron = {"type": b"LOIHI", "iDecay": 4096, "vDecay": 1024, "vThMant": 25}
    layers = [
        {"type": b"input", "shape": [4, 1, 1], "neuron": neuron},
        {"type": b"dense", "shape": [2], "weight": np.array([[1.0, -3, 5, 7], [2, 4, -6, 8]]), "neuron": neuron},
    ]
    layers[1] = {**layers[1], **changes}
    with h5py.File(path, "w") as file:
        for number, layer in enumerate(layers):
            for word, value in layer.items():
                if isinstance(value, dict):
                    for inner, each in value.items():
                        file[f"layer/{number}/{word}/{inner}"] = each
                else:
                    file[f"layer/{number}/{word}"] = value
    return path


def test_odd_weights_lose_nothing(tmp_path):
    net = neuro.from_netx(netx_file(tmp_path / "odd.net"))
    part = net.projections["input_dense1"]
    assert part.synapse.weight_exp == -1
    assert np.ravel(part.weight).tolist() == [2, 4, -6, 8, 10, -12, 14, 16]


def test_what_netx_refuses_or_leaves_out(tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    messages.calls(globals())


def test_each_layer_of_a_file_has_a_verdict(tmp_path):
    net, table = examine_netx(netx_file(tmp_path / "net.net"), reset=5)
    assert [(each.node, each.kind, each.verdict) for each in table] == [
        ("input", "input, LOIHI", "exact"),
        ("dense1", "dense, LOIHI", "exact"),
    ]
    assert net.populations["dense1"].model.reset_interval == 5
    assert table["dense1"].how == "loihi2_lif, 8 weights without loss of bits"
    net, table = examine_netx(netx_file(tmp_path / "pool.net", type=b"pool"))
    assert net is None
    assert [each.node for each in table.refused] == ["pool1"]
    assert table["pool1"].how == "netx has no layer 'pool': expected input, conv, dense, flatten"


def test_layers_of_neurons_are_reset_one_after_the_other(tmp_path):
    with h5py.File(netx_file(tmp_path / "net.net"), "a") as file:
        file.move("layer/1", "layer/2")
        file["layer/1/type"], file["layer/1/shape"] = b"flatten", [4]
    net = neuro.from_netx(tmp_path / "net.net", reset=5)
    models = {name: part.model for name, part in net.populations.items()}
    assert {name: (model.reset_interval, model.reset_offset) for name, model in models.items()} == {
        "input": (5, 1),
        "dense2": (5, 2),
    }


def test_a_file_that_is_no_network(tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    Path("a.net").write_bytes(b"nothing")
    said = {"no HDF5": refused(neuro.from_netx, "a.net"), "a number": refused(neuro.from_netx, 3)}
    for name, layers in (("a number", {"0": 1, "1/shape": 4}), ("without a type", {"1/shape": 4}), ("no layer", {})):
        with h5py.File("b.net", "w") as file:
            file.create_group("layer")
            for word, value in layers.items():
                file[f"layer/{word}"] = value
        said[f"layers: {name}"] = refused(neuro.from_netx, "b.net")
    messages(said)


def test_damaged_files_are_read_or_refused(tmp_path):
    whole = netx_file(tmp_path / "net.net").read_bytes()
    rng = np.random.default_rng(0)
    for k in range(200):
        damaged = bytearray(whole[: rng.integers(len(whole))] if k % 4 == 0 else whole)
        for byte in rng.integers(len(damaged), size=rng.integers(1, 20)) if damaged else ():
            damaged[byte] = rng.integers(256)
        (tmp_path / "damaged.net").write_bytes(damaged)
        with contextlib.suppress(ModelError):
            neuro.from_netx(tmp_path / "damaged.net")


def test_other_tools_have_no_payloads(tmp_path):
    net = neuro.Network("graded", resolution=1.0)
    net.population("in", 2, neuro.graded_spike_train(spikes=[[1.0, 0, 4], [1.0, 0, -1], [2.0, 1, -7]]))
    net.population("out", 2, neuro.graded_vector())
    net.connect("in", "out", neuro.one_to_one(), weight=2.0, delay=1.0)
    with pytest.raises(ModelError) as error:
        neuro.to_pynn(net, tmp_path / "net.py")
    assert "graded_spike_train has no counterpart in PyNN" in str(error.value)
    verdict = neuro.save_sonata(neuro.compile(net), tmp_path / "net.json")["out"]
    assert verdict.verdict == "approximate"
    assert verdict.how.endswith("spikes are written without payloads")
