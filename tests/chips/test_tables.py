"""The tables of chips: what stands in them, tables of users, and what is said of mistakes."""

import math
from pathlib import Path

import pytest
import yaml

from neuro.chips import chip, chips
from neuro.chips.description import COSTS, LIMITS
from refused import refused

ROOT = Path(__file__).parents[2]
FIGURE = "{value: 1.0e-12, source: here}"


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write `my.yaml` in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def table(text):
        Path("my.yaml").write_text(text)
        return "my.yaml"

    return table


def test_the_targets_that_there_are():
    assert chips() == ("arm", "cpu", "gpu", "loihi", "loihi2", "spinnaker", "spinnaker2", "truenorth")
    assert {name: chip(name).arithmetic for name in chips() if chip(name).arithmetic} == {
        "loihi": "loihi",
        "loihi2": "loihi2",
        "spinnaker": "spinnaker",
    }


@pytest.mark.parametrize("name", chips())
def test_every_number_has_a_source_and_a_meaning(name):
    c = chip(name)
    assert c.name == name
    assert c.title
    assert set(c.limits) <= set(LIMITS)
    assert set(c.costs) <= set(COSTS)
    figures = [*c.limits.values(), *c.costs.values(), *([c.step_s] if c.step_s else [])]
    assert all(figure.source and math.isfinite(figure.value) for figure in figures)
    assert all(figure.conditions for figure in c.costs.values())


def test_limits():
    names = ("cores_per_chip", "neurons_per_core", "synapse_bytes_per_core", "delay_max", "populations_per_core")
    told = {name: [chip(name).limit(word) for word in names] for name in ("loihi", "loihi2", "spinnaker")}
    assert told == {
        "loihi": [128, 1024, 128 * 1024, 62, None],
        "loihi2": [128, 8192, 96_000, 63, 1],
        "spinnaker": [16, 256, None, 144, 1],
    }
    assert chip("spinnaker").limit("synapse_bytes_per_chip") == 128 * 2**20
    assert chip("spinnaker").limit("delay_native") == 16
    assert chip("spinnaker").step_s.value == 1e-3
    assert all(figure.guess for name, figure in chip("loihi2").costs.items() if name != "static_per_chip")


def test_a_table_of_a_user_starts_from_ours(write):
    path = write(
        "like: loihi\n"
        "title: Loihi at 0.6 V\n"
        "costs:\n"
        '  synaptic_op: {value: 15.0e-12, source: "my board", conditions: "0.6 V"}\n'
        "limits:\n"
        "  neurons_per_core: {value: 512, source: my board}\n"
    )
    mine, ours = chip(path), chip("loihi")
    assert (mine.name, mine.title, mine.arithmetic, mine.mesh) == ("my", "Loihi at 0.6 V", "loihi", ours.mesh)
    assert mine.costs == {**ours.costs, "synaptic_op": mine.costs["synaptic_op"]}
    assert (mine.costs["synaptic_op"].value, mine.costs["synaptic_op"].source) == (15e-12, "my board")
    assert mine.limits == {**ours.limits, "neurons_per_core": mine.limits["neurons_per_core"]}
    assert mine.path == "my.yaml"


def test_a_table_that_stands_alone(write):
    c = chip(write("name: abacus\nstep_s: {value: 2, source: watch}\ncosts:\n  mac: {value: 3, source: me}\n"))
    assert (c.name, c.title, c.arithmetic, c.limits, c.mesh) == ("abacus", "abacus", "", {}, None)
    assert (c.step_s.value, c.costs["mac"].value, c.costs["mac"].conditions) == (2.0, 3.0, "")
    assert chip(Path("my.yaml")) == c


def test_a_table_is_read_anew_each_time(write):
    assert chip(write(f"costs: {{mac: {FIGURE}}}")).costs["mac"].value == 1e-12
    assert chip(write("costs: {mac: {value: 5, source: x}}")).costs["mac"].value == 5


MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text())


def test_mistakes(write, messages):
    messages({text: refused(chip, write(text)) for text in MISTAKES})


def test_targets_that_are_not_there(write, messages):
    write("name: x")
    messages({name: refused(chip, name) for name in ("loihii", "mine.yaml")})


def test_the_page_names_every_limit_and_cost():
    page = (ROOT / "docs" / "reference" / "chips.md").read_text()
    for name, meaning in LIMITS.items():
        assert f"| `{name}` | {meaning} |" in page
    for name, (unit, meaning) in COSTS.items():
        assert f"| `{name}` | {unit} | {meaning} |" in page
    for name in chips():
        assert f"| `{name}` | {chip(name).title} |" in page
