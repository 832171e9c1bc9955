"""Views in YAML: of, from and to."""

import json
from pathlib import Path

import numpy as np
import pytest

import neuro
from beside import beside, evaluated
from neuro.model.language.json_schema import schema

(NETWORK,) = beside(__file__, "NETWORK")


def load(folder, source="exc", target="grid", of="exc"):
    np.save(folder / "ids.npy", np.array([4, 1, 7]))
    file = folder / "net.yaml"
    file.write_text(NETWORK.format(source=source, target=target, of=of))
    return neuro.load(file)


@pytest.mark.parametrize(("written", "index"), evaluated(__file__, "INDICES", globals()))
def test_neurons_in_yaml(tmp_path, written, index):
    net = load(tmp_path, source=written, of=written)
    expected = net.populations["exc"][index]
    assert net.projections["wires"].source_view == expected
    assert net.probes["v"].view == expected
    net.save(tmp_path / "saved.yaml")
    assert neuro.load(tmp_path / "saved.yaml") == net


@pytest.mark.parametrize(
    ("written", "index"),
    [
        ('{grid: "2:4, :"}', (slice(2, 4), slice(None))),
        ('{grid: " 1 ,::2"}', (1, slice(None, None, 2))),
        ('{grid: "1:3"}', (slice(1, 3),)),
        ("{grid: [11, 0]}", [11, 0]),
    ],
)
def test_neurons_by_shape_in_yaml(tmp_path, written, index):
    net = load(tmp_path, target=written)
    assert net.projections["wires"].target_view == net.populations["grid"][index]
    net.save(tmp_path / "saved.yaml")
    assert neuro.load(tmp_path / "saved.yaml") == net


def test_many_ids_go_to_a_file(tmp_path):
    net = neuro.Network()
    exc = net.population("exc", 1000, neuro.iaf_psc_exp())
    net.probe("v", exc[np.arange(1000) % 3 == 1], "V_m")
    net.save(tmp_path / "net.yaml")
    assert "v: {of: {exc: {file: net.h5, key: v.of}}, record: V_m}" in (tmp_path / "net.yaml").read_text()
    assert neuro.load(tmp_path / "net.yaml") == net


def test_a_saved_view_is_read_by_people(tmp_path):
    load(tmp_path, source='{exc: "0:5"}', target='{grid: "0:4, -1"}', of="{exc: [3, 5]}").save(tmp_path / "saved.yaml")
    lines = (tmp_path / "saved.yaml").read_text()
    assert 'wires: {from: {exc: ":5"}, to: {grid: ":, 2"}, rule: all_to_all' in lines
    assert "v: {of: {exc: [3, 5]}, record: V_m}" in lines


def test_an_index_may_be_a_parameter(tmp_path):
    file = tmp_path / "net.yaml"
    file.write_text("parameters: {seen: ':4'}\n" + NETWORK.format(source="exc", target="grid", of="{exc: $seen}"))
    assert repr(neuro.load(file).probes["v"].view) == "exc[:4]"
    assert len(neuro.load(file, {"seen": [1, 2]}).probes["v"].view) == 2


def test_mistakes(folder, messages):
    messages.calls(globals() | {"HERE": Path()})


def test_the_schema_takes_what_the_loader_takes():
    validator = pytest.importorskip("jsonschema").Draft202012Validator(schema())
    part = {"model": "iaf_psc_exp", "shape": [10]}
    for index in ("0:5", "::2", "2:4, :", "1 , -1", 7, [0, 5], {"file": "ids.npy"}, "$seen"):
        net = {"populations": {"exc": part}, "probes": {"v": {"of": {"exc": index}}}}
        assert validator.is_valid(net), json.dumps(index)
    for index in ("0-5", 1.5, [], [-1], "a:b", True, None):
        net = {"populations": {"exc": part}, "probes": {"v": {"of": {"exc": index}}}}
        assert not validator.is_valid(net), json.dumps(index)
