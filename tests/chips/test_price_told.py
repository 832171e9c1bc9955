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


def test_the_text(run, messages):
    energy = price(*run, None, chip("spinnaker2")).per(2, "half")
    messages({"plain": str(energy), "with sources": energy.told(sources=True)})
    hand = price(*run, placed(), chip("loihi"))
    messages({"times of loihi": "\n".join(hand.notes[:6])})


def test_prefixes():
    values = {23.6e-12: "23.6 pJ", 0.0: "0 J", 1.0: "1 J", 0.0009999999: "1 mJ", 1.7e-17: "0.017 fJ"}
    for value, text in (values | {12345.6: "1.235e+04 J", 999.94e-9: "999.9 nJ"}).items():
        assert quantity(value, "J") == text
