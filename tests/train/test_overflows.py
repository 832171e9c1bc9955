"""Registers of chips that overflow while recordings are tested: told once, with in how many of them."""

import json
import re
import warnings
from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import neuro as snn
from neuro.events import recordings
from neuro_train.data import show
from neuro_train.plan import TrainingPlan
from neuro_train.tested import noted, on_backend, summed, warn_of_overflows

PLAN = TrainingPlan(input="pixels", output="out", duration=60.0)

pytestmark = [
    pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning"),
    pytest.mark.filterwarnings("always::neuro.OverflowWarning"),
]


@pytest.fixture
def wide(tmp_path, file, monkeypatch):
    """A network whose weights lie so far above its threshold that sums of a step wrap on Loihi, with no room left."""
    monkeypatch.setattr("neuro_train.room.MARGIN", 0.0)
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


@pytest.fixture
def strong(tmp_path, file):
    """A network whose sums of a step wrap on Loihi at the chip's own scale, though its weights are small."""
    net = snn.load(file)
    net.projections["in_hidden"] = replace(net.projections["in_hidden"], weight=snn.normal(mean=0.0, std=4.0))
    net.save(tmp_path / "strong.yaml")
    return tmp_path / "strong.yaml"


def wrapping(net, folder):
    """How often inputs wrap at the chip's own scale."""
    shown = show(net, recordings(folder, part="Test"), PLAN, lambda *told: None)
    return on_backend(net, "loihi", shown, PLAN).overflows.get("input wraps of hidden", (0, ""))[0]


def test_scales_leave_room_for_what_was_learnt_from(neuro, strong, folder):
    words = ("--duration", 60, "--epochs", 1, "--bits", 8, "--test", folder, "--backends", "loihi")
    status, out, err = neuro(strong, "--data", folder, *words)
    assert (status, wraps(err)) == (0, [])
    assert wrapping(snn.load("trained.yaml"), folder) > 0
    told = r"loihi: input registers on the recordings learnt from: at most (\d+)% of that of 'hidden', (\d+)% of .*"
    some, scale = re.search(told + r"; scales=({'hidden': .*}) leaves this room", out).group(1, 3)
    assert 25 < int(some) <= 50
    with open("trained.html", encoding="utf-8") as page:
        assert "Room in registers" in page.read()
    snn.compile(snn.load("trained.yaml"), backend="loihi", scales=eval(scale))


def test_folds_keep_how_much_room_there_is(neuro, strong, folder):
    words = ("--duration", 60, "--epochs", 1, "--bits", 8, "--folds", 2, "--backends", "loihi")
    status, out, err = neuro(strong, "--data", folder, *words)
    assert (status, wraps(err)) == (0, [])
    with open("trained-1.json", encoding="utf-8") as file:
        hidden, _ = json.load(file)["room"]
    assert hidden["chosen"]
    assert 0.25 < hidden["share"] <= 0.5
    assert "input registers on the recordings learnt from: at most" in out


def test_other_warnings_are_told_as_they_come():
    with pytest.warns(UserWarning, match="something else"), noted(found := {}):
        warnings.warn("something else", stacklevel=1)
    assert found == {}


def test_each_kind_is_counted_and_told_with_its_way_out():
    text = "backend 'loihi': {} {} up to step 12; counts().native has their number\n  hint: raise vth"
    found = {}
    for number, what in ((3, "input wraps of a"), (20, "input wraps of a"), (1, "current wraps of b")):
        with noted(found):
            warnings.warn(snn.OverflowWarning(text.format(number, what), what, "raise vth"), stacklevel=1)
    assert found == {"input wraps of a": (2, "raise vth"), "current wraps of b": (1, "raise vth")}
    both = summed([found, {"input wraps of a": [5, "raise vth"]}])
    assert both["input wraps of a"] == (7, "raise vth")
    with pytest.warns(snn.OverflowWarning) as told:
        warn_of_overflows("loihi", both, 9)
    assert [str(each.message) for each in told] == [
        "backend 'loihi': input wraps of a in 7 of 9 recordings\n  hint: raise vth",
        "backend 'loihi': current wraps of b in 1 of 9 recordings\n  hint: raise vth",
    ]
