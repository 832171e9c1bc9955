"""Registers of chips that overflow while recordings are tested: reported once, with in how many of them."""

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import neuro as snn
from neuro.apps import warn_of_overflows
from neuro.events import recordings
from neuro_predict.showing import overflows_counted
from neuro_train.data import show
from neuro_train.plan import TrainingPlan
from neuro_train.tested import on_backend, summed

PLAN = TrainingPlan(input="pixels", output="out", duration=60.0)

pytestmark = [
    pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning"),
    pytest.mark.filterwarnings("always::neuro.OverflowWarning"),
]


@pytest.fixture
def spread(neuro, file):
    """Write a network whose weights to the hidden layer have a deviation."""

    def written(std):
        net = snn.load(file)
        net.projections["in_hidden"] = replace(net.projections["in_hidden"], weight=snn.normal(mean=0.0, std=std))
        net.save("spread.yaml")
        return "spread.yaml"

    return written


def wraps(err):
    """In how many of how many recordings; once."""
    assert err.count("input wraps") == 1
    some, every = re.search(r"input wraps of hidden in (\d+) of (\d+) recordings", err).groups()
    assert 0 < int(some) <= int(every)
    return int(some), int(every)


def test_weights_that_wrap_with_no_room_left_are_reported_once(neuro, spread, folder, monkeypatch):
    """Of all recordings that are tested on, and of all folds, also when these are there already."""
    monkeypatch.setattr("neuro_train.tested.MARGIN", 0.0)
    words = (spread(100.0), "--data", folder, "--for", 60, "--epochs", 0, "--backends", "loihi")
    status, _, err = neuro(*words, "--test", folder)
    assert (status, wraps(err)[1]) == (0, 9)
    status, _, err = neuro(*words, "--folds", 2)
    assert (status, wraps(err)[1], wraps(neuro(*words, "--folds", 2)[2])) == (0, 24, wraps(err))


def test_scales_leave_room_for_what_was_learnt_from(neuro, spread, folder):
    """The weights are small, but at the chip's own scale their sums wrap; folds keep how much room there is."""
    words = (spread(4.0), "--data", folder, "--for", 60, "--epochs", 1, "--bits", 8, "--backends", "loihi")
    status, out, err = neuro(*words, "--test", folder)
    assert (status, "input wraps" in err) == (0, False)
    net = snn.load("trained.yaml")
    shown = show(net, recordings(folder, part="Test"), PLAN, lambda *told: None)
    assert on_backend(net, "loihi", shown, PLAN).overflows["input wraps of hidden"][0] > 0
    told = r"loihi: input registers on the recordings learnt from: at most (\d+)% of that of 'hidden', (\d+)% of .*"
    some, scale = re.search(told + r"; scales=({'hidden': .*}) leaves this room", out).group(1, 3)
    assert 25 < int(some) <= 50
    assert "Room in registers" in Path("trained.html").read_text()
    snn.compile(net, backend="loihi", scales=eval(scale))
    status, out, err = neuro(*words, "--folds", 2)
    assert (status, "input wraps" in err) == (0, False)
    hidden, _ = json.loads(Path("trained-1.json").read_text())["room"]
    assert hidden["chosen"]
    assert 0.25 < hidden["share"] <= 0.5
    assert "input registers on the recordings learnt from: at most" in out


def test_each_kind_is_counted_and_reported_with_its_way_out():
    with pytest.warns(UserWarning, match="something else"), overflows_counted(found := {}):
        warnings.warn("something else", stacklevel=1)
    assert found == {}
    text = "backend 'loihi': {} {} up to step 12; counts().native has their number\n  hint: raise vth"
    for number, what in ((3, "input wraps of a"), (20, "input wraps of a"), (1, "current wraps of b")):
        with overflows_counted(found):
            warnings.warn(snn.OverflowWarning(text.format(number, what), what, "raise vth"), stacklevel=1)
    assert found == {"input wraps of a": (2, "raise vth"), "current wraps of b": (1, "raise vth")}
    both = summed([found, {"input wraps of a": [5, "raise vth"]}])
    with pytest.warns(snn.OverflowWarning) as told:
        warn_of_overflows("loihi", both, 9)
    assert [str(each.message) for each in told] == [
        f"backend 'loihi': {what} of 9 recordings\n  hint: raise vth"
        for what in ("input wraps of a in 7", "current wraps of b in 1")
    ]
