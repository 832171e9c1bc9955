"""The tables of chips: what stands in them, tables of users, and what is said of mistakes."""

import math
from pathlib import Path

import pytest

from neuro.chips import chip, chips
from neuro.chips.description import COSTS, LIMITS, Mesh
from neuro.core.errors import ModelError

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


def refusal(path):
    with pytest.raises(ModelError) as caught:
        chip(path)
    return str(caught.value)


def test_the_targets_that_there_are():
    assert chips() == ("arm", "cpu", "gpu", "loihi", "loihi2", "spinnaker", "spinnaker2", "truenorth")
    assert {name: chip(name).arithmetic for name in chips() if chip(name).arithmetic} == {
        "loihi": "loihi",
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


def test_loihi_is_davies():
    c = chip("loihi")
    assert {name: figure.value for name, figure in c.costs.items()} == {
        "synaptic_op": 23.6e-12,
        "learning_update": 120e-12,
        "neuron_update_active": 81e-12,
        "neuron_update_inactive": 52e-12,
        "spike_in_tile": 1.7e-12,
        "hop_east_west": 3.0e-12,
        "hop_north_south": 4.0e-12,
        "static_per_chip": 0.104,
        "barrier_1_tile_time": 113e-9,
        "barrier_32_tiles_time": 465e-9,
        "barrier_768_chips_time": 16.2e-6,
        "synaptic_op_time": 3.5e-9,
        "learning_update_time": 6.1e-9,
        "neuron_update_active_time": 8.4e-9,
        "neuron_update_inactive_time": 5.3e-9,
        "spike_in_tile_time": 2.1e-9,
        "hop_east_west_time": 4.1e-9,
        "hop_north_south_time": 6.5e-9,
    }
    assert c.mesh == Mesh(8, 4, 4)
    assert "Table 2" in c.costs["synaptic_op"].source
    assert "0.75 V" in c.costs["synaptic_op"].conditions


def test_limits():
    names = ("cores_per_chip", "neurons_per_core", "synapse_bytes_per_core", "delay_max", "populations_per_core")
    told = {name: [chip(name).limit(word) for word in names] for name in ("loihi", "loihi2", "spinnaker")}
    assert told == {
        "loihi": [128, 1024, 128 * 1024, 62, None],
        "loihi2": [128, 8192, 192 * 1024, 63, None],
        "spinnaker": [16, 256, None, 144, 1],
    }
    assert chip("spinnaker").limit("synapse_bytes_per_chip") == 128 * 2**20
    assert chip("spinnaker").limit("delay_native") == 16
    assert chip("spinnaker").step_s.value == 1e-3
    assert chip("loihi2").costs == {}


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


MESH = "mesh: {columns: 2, rows: 2, cores_per_tile: 4"
MISTAKES = {
    "an unknown word": (
        "nane: x\n",
        "my.yaml:1:1: unknown word of a table of a chip 'nane'\n  hint: did you mean 'name'?",
    ),
    "an unknown cost": (
        f"costs:\n  synaptic_ops: {FIGURE}\n",
        "my.yaml:2:3: unknown cost 'synaptic_ops'\n  hint: did you mean 'synaptic_op'?",
    ),
    "an unknown limit": (
        "limits:\n  delay_maximum: {value: 3, source: x}\n",
        "my.yaml:2:3: unknown limit 'delay_maximum'\n  hint: did you mean 'delay_max'?",
    ),
    "an unknown word of a figure": (
        "costs:\n  mac: {value: 1, source: x, condition: y}\n",
        "my.yaml:2:30: unknown word of figure 'mac' 'condition'\n  hint: did you mean 'conditions'?",
    ),
    "no source": (
        "costs:\n  mac: {value: 1.0e-12}\n",
        "my.yaml:2:3: figure 'mac' needs 'source'",
    ),
    "an empty source": (
        "costs:\n  mac: {value: 1.0e-12, source: ''}\n",
        "my.yaml:2:33: mac: source: found '': expected text\n  hint: text that looks like a number needs quotes",
    ),
    "a year as source": (
        "costs:\n  mac: {value: 1.0e-12, source: 2018}\n",
        "my.yaml:2:33: mac: source: found 2018: expected text\n  hint: text that looks like a number needs quotes",
    ),
    "a bare number": (
        "costs:\n  mac: 1.0e-12\n",
        "my.yaml:2:8: mac: found 1e-12: expected a figure\n  hint: write {value: ..., source: ...}",
    ),
    "a negative cost": (
        "costs:\n  mac: {value: -1.0e-12, source: x}\n",
        "my.yaml:2:16: mac: value = -1e-12: expected a number >= 0 in J",
    ),
    "an infinite cost": (
        "costs:\n  synaptic_op_time: {value: .inf, source: x}\n",
        "my.yaml:2:29: synaptic_op_time: value = inf: expected a number >= 0 in s",
    ),
    "a cost that is not a number": (
        "costs:\n  static_per_chip: {value: .nan, source: x}\n",
        "my.yaml:2:28: static_per_chip: value = nan: expected a number >= 0 in W",
    ),
    "a cost with a unit": (
        "costs:\n  mac: {value: 4.6 pJ, source: x}\n",
        "my.yaml:2:16: mac: value: found '4.6 pJ': expected a number >= 0 in J\n  hint: 23.6 pJ is written 23.6e-12",
    ),
    "a limit of half a core": (
        "limits:\n  cores_per_chip: {value: 1.5, source: x}\n",
        "my.yaml:2:27: cores_per_chip: value = 1.5: expected a whole number >= 1",
    ),
    "a limit of nothing": (
        "limits:\n  cores_per_chip: {value: 0, source: x}\n",
        "my.yaml:2:27: cores_per_chip: value = 0: expected a whole number >= 1",
    ),
    "an unknown arithmetic": (
        "arithmetic: loihi1\n",
        "my.yaml:1:13: arithmetic: found 'loihi1': expected one of '', 'loihi', 'spinnaker'\n"
        "  hint: '' has limits and costs only",
    ),
    "a base that is not there": (
        "like: loihi3\n",
        "my.yaml:1:7: unknown target 'loihi3'\n  hint: did you mean 'loihi'?",
    ),
    "a mesh without source": (f"{MESH}}}\n", "my.yaml:1:1: a mesh needs 'source'"),
    "a mesh of half rows": (
        f"{MESH.replace('rows: 2', 'rows: 0.5')}, source: x}}\n",
        "my.yaml:1:26: mesh: rows: found 0.5: expected a whole number >= 1",
    ),
    "a mesh of another size": (
        f"limits: {{cores_per_chip: {{value: 128, source: x}}}}\n{MESH}, source: x}}\n",
        "my.yaml:2:1: mesh has 16 cores (columns x rows x cores_per_tile): expected cores_per_chip = 128",
    ),
    "cores that no longer fit the mesh": (
        "like: loihi\nlimits: {cores_per_chip: {value: 64, source: x}}\n",
        "my.yaml:2:1: mesh has 128 cores (columns x rows x cores_per_tile): expected cores_per_chip = 64",
    ),
    "a list": (
        "- loihi\n",
        "my.yaml:1:1: found [loihi]: expected the words of a table of a chip: "
        "like, name, title, arithmetic, limits, mesh, step_s, costs",
    ),
    "something else than YAML": (
        "costs: [mac: {\n",
        "my.yaml:2:1: not YAML: did not find expected node content",
    ),
    "nothing": ("", "my.yaml:1:1: the file is empty: expected a table of a chip\n  hint: begin: like: loihi"),
}


@pytest.mark.parametrize("what", MISTAKES)
def test_mistakes(write, what):
    text, message = MISTAKES[what]
    assert refusal(write(text)) == message


def test_targets_that_are_not_there(write):
    assert refusal("loihii") == "unknown target 'loihii'\n  hint: did you mean 'loihi'?"
    write("name: x")
    assert refusal("mine.yaml") == "mine.yaml: no such file\n  hint: did you mean 'my.yaml'?"


def test_the_page_names_every_limit_and_cost():
    page = (ROOT / "docs" / "reference" / "chips.md").read_text()
    for name, meaning in LIMITS.items():
        assert f"| `{name}` | {meaning} |" in page
    for name, (unit, meaning) in COSTS.items():
        assert f"| `{name}` | {unit} | {meaning} |" in page
    for name in chips():
        assert f"| `{name}` | {chip(name).title} |" in page
