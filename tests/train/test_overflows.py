"""Registers of chips that overflow while recordings are tested: told once, with in how many of them."""

import re
import warnings
from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import neuro as snn
from neuro_train.overflows import noted, summed, tell

pytestmark = [
    pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning"),
    pytest.mark.filterwarnings("always::neuro.OverflowWarning"),
]


@pytest.fixture
def wide(tmp_path, file):
    """A network whose weights lie so far above its threshold that sums of a step wrap on Loihi."""
    net = snn.load(file)
    net.projections["in_hidden"] = replace(net.projections["in_hidden"], weight=snn.normal(mean=0.0, std=100.0))
    net.save(tmp_path / "wide.yaml")
    return tmp_path / "wide.yaml"


def wraps(err):
    return re.findall(r"input wraps of hidden in (\d+) of (\d+) recordings", err)


def test_of_all_recordings_that_are_tested_on_it_is_told_once(neuro, wide, folder):
    words = ("--duration", 60, "--epochs", 0, "--test", folder, "--backends", "loihi")
    status, _, err = neuro(wide, "--data", folder, *words)
    assert status == 0
    ((some, all_),) = wraps(err)
    assert 0 < int(some) <= int(all_) == 9
    assert err.count("input wraps") == 1


def test_of_all_folds_it_is_told_once_also_when_they_are_there_already(neuro, wide, folder):
    words = (wide, "--data", folder, "--duration", 60, "--epochs", 0, "--folds", 2, "--backends", "loihi")
    status, _, err = neuro(*words)
    assert status == 0
    ((some, all_),) = wraps(err)
    assert 0 < int(some) <= int(all_) == 24
    assert err.count("input wraps") == 1
    assert wraps(neuro(*words)[2]) == [(some, all_)]


def test_other_warnings_are_told_as_they_come():
    with pytest.warns(UserWarning, match="something else"), noted(found := {}):
        warnings.warn("something else", stacklevel=1)
    assert found == {}


def test_each_kind_is_counted_and_told_with_its_way_out():
    text = "backend 'loihi': {} {} up to step 12; counts().native has their number\n  hint: raise vth"
    found = {}
    for number, what in ((3, "input wraps of a"), (20, "input wraps of a"), (1, "current wraps of b")):
        with noted(found):
            warnings.warn(text.format(number, what), snn.OverflowWarning, stacklevel=1)
    assert found == {"input wraps of a": (2, "raise vth"), "current wraps of b": (1, "raise vth")}
    both = summed([found, {"input wraps of a": [5, "raise vth"]}])
    assert both["input wraps of a"] == (7, "raise vth")
    with pytest.warns(snn.OverflowWarning) as told:
        tell("loihi", both, 9)
    assert [str(each.message) for each in told] == [
        "backend 'loihi': input wraps of a in 7 of 9 recordings\n  hint: raise vth",
        "backend 'loihi': current wraps of b in 1 of 9 recordings\n  hint: raise vth",
    ]
