"""A chip of one's own: a table that `fit`, `run`, `compare` and Python know by its path, or by name if registered."""

import dataclasses
import math
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest
import yaml

import neuro
from neuro.chips import chip, chips, place
from neuro.chips.description import COSTS, LIMITS, Chip, Figure
from neuro.chips.fitting import too_late
from neuro.chips.incoming import synapse_bits
from neuro.chips.inputs import lag
from neuro.chips.known import ARITHMETICS, CHIPS
from neuro.chips.loihi import Loihi
from neuro.core import registry
from neuro.program.backend import find_backend
from neuro_chip.backend import ChipBackend
from neuro_chip.build import FAMILIES
from refused import error_of, refused

LONG = "like: loihi\ntitle: Loihi with long delays\nlimits:\n  delay_max: {value: 200, source: my board}\n"

NET = """\
neuro: 1
name: late
resolution: 1.0
populations:
  in: {model: {spike_generator: {spike_times: [[1.0]]}}, shape: 1}
  out: {model: {iaf_psc_delta: {tau_m: .inf}}, shape: 1}
projections:
  in_out: {from: in, to: out, rule: all_to_all, weight: 20.0, delay: 150.0}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty current folder with `long.yaml` and `net.yaml`."""
    monkeypatch.chdir(tmp_path)
    Path("long.yaml").write_text(LONG)
    Path("net.yaml").write_text(NET)
    return tmp_path


@pytest.fixture
def registered():
    """Forget what a test registers."""
    yield
    CHIPS._registered.clear()
    CHIPS._parts.pop("board", None)


@pytest.fixture
def late(folder):
    return neuro.load("net.yaml")


@pytest.mark.parametrize("given", ["long.yaml", Path("long.yaml"), "./long.yaml"])
def test_a_table_is_a_backend_of_its_family(late, given):
    sim = neuro.compile(late, backend=given)
    sim.run(200.0)
    assert sim.backend == "long"
    assert sim.spikes("out")[0].tolist() == [151.0]
    reference = neuro.compile(late, backend="reference")
    reference.run(200.0)
    assert reference.spikes("out")[0].tolist() == [151.0]


def test_what_is_refused(late, messages):
    told = {"ours": refused(neuro.compile, late, backend="loihi")}
    neuro.compile(late, backend="long.yaml")
    Path("long.yaml").write_text(LONG.replace("200", "100"))
    told["read anew"] = refused(neuro.compile, late, backend="long.yaml")
    for limit, like in (("delay_maks", "like: loihi\n"), ("delay_max", "")):
        Path("my.yaml").write_text(f"{like}limits:\n  {limit}: {{value: 3, source: x}}\n")
        told[limit] = refused(neuro.compile, late, backend="my.yaml")
    Path("lost.yaml").write_text("like: nowhere.yaml\n")
    messages(told | {"lost": refused(chip, "lost.yaml")})


def test_a_registered_chip_is_known_by_name(late, registered):
    registry.register(dataclasses.replace(chip("long.yaml"), name="board"))
    assert "board" in chips()
    assert chip("board").limit("delay_max") == 200
    sim = neuro.compile(late, backend="board")
    sim.run(200.0)
    assert (sim.backend, sim.spikes("out")[0].tolist()) == ("board", [151.0])
    assert [error_of(call, "boart").hint for call in (find_backend, chip)] == ["did you mean 'board'?"] * 2
    Path("mine.yaml").write_text("like: board\n")
    assert chip("mine.yaml").limit("delay_max") == 200


def test_a_chip_is_registered_once(late, registered):
    error = error_of(lambda: registry.register(chip("loihi")))
    assert str(error).startswith("test_own_chip.py:")
    assert "chip 'loihi' is registered twice" in error.message


def test_a_chip_of_an_installed_package(late, registered, monkeypatch):
    Path("board_package.py").write_text("import neuro\n\nboard = neuro.chips.chip('board.yaml')\n")
    Path("board.yaml").write_text(LONG)
    monkeypatch.syspath_prepend(Path.cwd())
    entries = EntryPoints([EntryPoint("board", "board_package:board", "neuro.chips")])
    monkeypatch.setattr(registry, "installed", lambda group: entries.select(group=group))
    assert "board" in chips()
    assert chip("board").limit("delay_max") == 200
    assert find_backend("board").name == "board"


def test_a_table_with_every_field_loads(folder):
    limits = {name: 2 + number for number, name in enumerate(LIMITS)} | {"cores_per_chip": 24}
    costs = {name: (1 + number) * 1e-12 for number, name in enumerate(COSTS)}
    told = 'source: "a page", conditions: "measured"'
    lines = [
        *("name: every", "title: Every field", "arithmetic: spinnaker", "limits:"),
        *(f"  {name}: {{value: {value}, {told}}}" for name, value in limits.items()),
        f"mesh: {{columns: 4, rows: 3, cores_per_tile: 2, {told}}}",
        f"step_s: {{value: 0.001, {told}}}",
        *("costs:", *(f"  {name}: {{value: {value!r}, {told}}}" for name, value in costs.items())),
    ]
    Path("every.yaml").write_text("\n".join(lines))
    found = chip("every.yaml")
    assert (found.name, found.title, found.arithmetic) == ("every", "Every field", "spinnaker")
    assert {name: figure.value for name, figure in found.limits.items()} == limits
    assert {name: figure.value for name, figure in found.costs.items()} == costs
    assert {(f.source, f.conditions) for f in (*found.limits.values(), *found.costs.values(), found.step_s)} == {
        ("a page", "measured")
    }
    assert (found.mesh.columns, found.mesh.rows, found.mesh.cores_per_tile, found.step_s.value) == (4, 3, 2, 0.001)


@pytest.mark.parametrize("model", ["izhikevich", "iaf_psc_delta", "iaf_psc_exp", "iaf_psc_alpha", "parrot_neuron"])
@pytest.mark.parametrize("steps", [4, 8, 9])
def test_memory_and_limits_agree_on_the_delay_register(model, steps, folder):
    """A delay that takes a register of R is stored in as many bits as R has, and refused where R is above the limit."""
    net = neuro.Network("net", resolution=1.0)
    net.population("in", 1, neuro.spike_generator())
    net.population("out", 1, getattr(neuro, model)())
    net.connect("in", "out", neuro.all_to_all(), weight=1.0, delay=float(steps), name="w")
    program = neuro.compile(net, backend="reference").program
    register = int(np.max(lag(program, 0))) - 1
    assert synapse_bits(program, 0) == 8 + register.bit_length()
    for most, problems in ((register, 0), (register - 1, 1)):
        small = Chip("small", "Small", "", {"delay_max": Figure(float(most), "here")})
        assert len(place(program, small).problems) == problems


def test_a_third_family_is_an_object_and_an_entry(folder, monkeypatch):
    """All that is done for every family asks the object: its own name occurs nowhere else."""

    class Toy(Loihi):
        name, title, one_bit, multicast, register_of_one = "toy", "Toy", False, True, 1

    toy = Toy()
    monkeypatch.setitem(ARITHMETICS, "toy", toy)
    monkeypatch.setitem(FAMILIES, "toy", FAMILIES["loihi"])
    Path("toy.yaml").write_text("like: loihi\narithmetic: toy\nlimits: {delay_max: {value: 150, source: me}}\n")
    found = chip("toy.yaml")
    Path("net.yaml").write_text(
        NET.replace("{spike_generator: {spike_times: [[1.0]]}}", "{poisson_generator: {rate: 400.0}}").replace(
            "20.0", "1"
        )
    )
    late = neuro.load("net.yaml")
    sim = neuro.compile(late, backend=ChipBackend(toy, "a toy", {}, found), seed=1)
    reference = neuro.compile(late, backend="reference", seed=1)
    for each in (sim, reference):
        each.run(300.0)
    assert sim.counts().spikes == reference.counts().spikes
    assert "merged spikes of in" not in sim.counts().native
    assert place(sim.program, found).multicast
    assert not place(sim.program, chip("loihi")).multicast
    tight = dataclasses.replace(found, limits=found.limits | {"delay_max": Figure(149.0, "me")})
    assert [problem.why for problem in too_late(sim.program, tight)] == [
        "150 steps in the delay register, which holds at most 149 on toy"
    ]


def test_a_table_is_like_another_that_lies_beside_it(folder):
    Path("long.yaml").write_text(LONG)
    Path("longer.yaml").write_text("like: long.yaml\nlimits: {delay_max: {value: 700, source: me}}\n")
    assert chip("longer.yaml").limits["delay_max"].value == 700
    assert chip("longer.yaml").arithmetic == chip("long.yaml").arithmetic == "loihi"
    Path("long.yaml").write_text(LONG.replace("like: loihi", "like: longer.yaml"))
    assert "like: 'longer.yaml' is like this table" in refused(chip, "long.yaml")


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
