"""How a bill is told: JSON, text with its sources, prefixes of units."""

import json

import pytest

from bills import counted, placed
from neuro.chips import chip, price
from neuro.chips.energy import quantity


@pytest.fixture(scope="module")
def run():
    return counted()


def test_json(run):
    energy = price(*counted(learns=False), placed(), chip("spinnaker"))
    told = json.loads(json.dumps(energy.as_dict()))
    assert told["total_j"] == energy.total_j == told["dynamic_j"] + told["static_j"]
    assert sum(item["joules"] or 0.0 for item in told["items"]) == pytest.approx(energy.total_j, rel=1e-12)
    assert (told["target"], told["of"], told["chips"], told["steps"]) == ("spinnaker", "run", 1, 10)
    assert told["items"][-1]["source"].startswith("Painkras")
    assert told["notes"] == list(energy.notes)


def test_what_is_not_known_is_null_in_json(run, tmp_path):
    dense = price(*run, None, chip("cpu"))
    assert (dense.static_j, dense.static_known) == (0.0, False)
    told = json.loads(json.dumps(dense.as_dict()))
    assert (told["static_j"], told["chip_time_s"], told["chips"]) == (None, None, None)
    assert told["total_j"] == told["dynamic_j"] == dense.total_j > 0.0
    (tmp_path / "free.yaml").write_text("like: truenorth\ncosts: {static_per_chip: {value: 0, source: me}}\n")
    free = price(*run, None, chip(tmp_path / "free.yaml"))  # its figure is 0 and published
    assert free.static_known
    assert (free.as_dict()["static_j"], free.as_dict()["chips"]) == (0.0, 1)
    assert [energy.cells()[-2:] for energy in (dense, free)] == [("-", "-"), ("10 ms of 10 ms", "1")]


HEAD = """\
SpiNNaker 2 (prototype) (spinnaker2), energy per half: 1 chip, 5 steps, 5 ms of chip time

"""
ROWS = """\
item                      of  count     each      energy
neuron_update_active *    a       6  2.19 nJ    13.14 nJ
neuron_update_inactive *  a       9  2.19 nJ    19.71 nJ
neuron_update_active *    b       6  2.19 nJ    13.14 nJ
neuron_update_inactive *  b       9  2.19 nJ    19.71 nJ
synaptic_op *             in      6   450 pJ      2.7 nJ
synaptic_op *             ab      6   450 pJ      2.7 nJ
learning_update           ab     12        -  not priced
"""
NOTES = """\
- static power is not in the sums: no figure is published
- generators are the host's: their spikes are priced, their updates are not
- not priced, as no figure is published: learning_update
- extrapolated (*): neuron_update_active, neuron_update_inactive, synaptic_op: a prototype of 4 cores in 28 nm, \
not the chip of 22 nm
"""
SUMS = """
              as fast as the chip can                in real time
chip time                        5 ms                        5 ms
dynamic                       71.1 nJ                     71.1 nJ
static                     not priced                  not priced
total      > 71.1 nJ (71.1 to 284 nJ)  > 71.1 nJ (71.1 to 284 nJ)
"""


def test_the_text(run):
    assert str(price(*run, None, chip("spinnaker2")).per(2, "half")) == HEAD + ROWS + SUMS + "\n" + NOTES.rstrip()


def test_the_text_with_sources(run):
    text = price(*run, None, chip("spinnaker2")).per(2, "half").told(sources=True)
    rows = ROWS.splitlines()
    marks = ["  source", *4 * ["  [1]"], *2 * ["  [2]"], ""]
    cited = "\n".join(row + mark for row, mark in zip(rows, marks, strict=True)) + "\n"
    assert text.startswith(HEAD + cited + SUMS)
    spread = "high: without that scaling the cores take four times as much: Höppner et al., abstract"
    ranges = f"\n- range of neuron_update_active, neuron_update_inactive, synaptic_op: {spread}"
    assert text.endswith(NOTES.rstrip() + ranges)
    foot = text.removeprefix(HEAD + cited + SUMS + "\n").removesuffix(NOTES.rstrip() + ranges).splitlines()
    assert foot[0].startswith("[1] Höppner et al., IEEE Trans. Circuits Syst. I 66:2973, 2019, as quoted by")
    assert foot[0].endswith("(prototype, 28 nm; every neuron is stepped alike)")
    assert foot[1].startswith("[2] Höppner")
    assert foot[2:] == [
        "",
        "- chip time: a step of 1 ms takes 1 ms on the chip: "
        "Höppner et al., IEEE Trans. Circuits Syst. I 66:2973, 2019 "
        "(biological real time)",
    ]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (23.6e-12, "23.6 pJ"),
        (0.0, "0 J"),
        (1.0, "1 J"),
        (0.0009999999, "1 mJ"),
        (1.7e-17, "0.017 fJ"),
        (12345.6, "1.235e+04 J"),
        (999.94e-9, "999.9 nJ"),
    ],
)
def test_prefixes(value, text):
    assert quantity(value, "J") == text
