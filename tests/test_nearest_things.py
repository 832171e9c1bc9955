"""Messages that name the nearest right thing."""

import pytest

import neuro
import neuro_models
from refused import refused


@pytest.fixture
def net() -> neuro.Network:
    net = neuro.Network("n")
    net.population("cells", [2, 3], neuro.iaf_psc_exp())
    net.connect("cells", "cells", neuro.all_to_all(), name="d")
    return net


@pytest.mark.parametrize("name", ["dense", "dense.yaml"])
def test_a_published_network_by_name(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    hint = "the published network is neuro.load(neuro_models.path('dense'))"
    assert refused(neuro.load, name).endswith(f": no such file\n  hint: {hint}")
    assert neuro.load(neuro_models.path("dense")).populations
    assert refused(neuro.load, "dens").endswith(": no such file")
    neuro.Network("mine").save(tmp_path / "mine.yaml")
    (tmp_path / "mine.yaml").rename(tmp_path / name)
    assert neuro.load(name).name == "mine"


PLACES = {
    "model": "populations: {{cells: {{shape: 3, {}}}}}",
    "rule": "populations: {{cells: {{shape: 3, model: iaf_psc_exp}}}}\n"
    "projections: {{p: {{from: cells, to: cells, {}}}}}",
    "to": "populations: {{cells: {{shape: 3, model: iaf_psc_exp}}}}\n"
    "projections: {{p: {{from: cells, rule: all_to_all, {}}}}}",
    "record_from": "populations: {{cells: {{shape: 3, model: iaf_psc_exp}}}}\nprobes: {{v: {{of: cells, {}}}}}",
}
PLACES["connect"] = PLACES["rule"]
PLACES["variables"] = PLACES["record_from"]


def test_habits_of_other_tools_in_a_file(tmp_path, messages):

    def of(written):
        (tmp_path / "net.yaml").write_text(PLACES.get(written.partition(":")[0], "{}").format(written), "utf-8")
        return refused(neuro.load, tmp_path / "net.yaml").removeprefix(f"{tmp_path}/")

    messages.of(of)


def test_the_nearest_right_thing(net, messages):
    messages.calls(globals() | {"net": net})
