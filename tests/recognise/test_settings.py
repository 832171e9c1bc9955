import json

import pytest

from neuro import ModelError
from neuro_recognise.method import METHODS
from neuro_recognise.recogniser import method_of


def error(call, *args, **words):
    with pytest.raises(ModelError) as caught:
        call(*args, **words)
    return str(caught.value)


@pytest.mark.parametrize("name", METHODS)
def test_every_setting_has_a_meaning_and_a_source(name):
    for row in method_of(name).rows():
        assert row.doc, f"{name}: {row.name} has no meaning"
        assert row.source or row.name == "size", f"{name}: {row.name} has no source"


@pytest.mark.parametrize("name", METHODS)
def test_settings_survive_a_file(name):
    method = method_of(name)
    assert type(method).from_words(json.loads(json.dumps(method.as_words()))) == method
    for preset in method.presets:
        other = method_of(name, preset)
        assert (other == method) == (not method.presets[preset]), f"{name}: preset {preset} changes nothing"
        assert type(method).from_words(json.loads(json.dumps(other.as_words()))) == other


def test_values_change_by_their_own_name_or_that_of_their_part():
    boe = method_of("boe", values={"threshold": 120, "segmenter.tau": 0.03, "C": 2})
    assert (boe.segmenter.threshold, boe.segmenter.tau, boe.readout.C) == (120.0, 0.03, 2.0)
    rbf = method_of("boe", values={"readout": "rbf", "readout.gamma": 0.5, "segmenter": "counts", "count": 99})
    assert (rbf.readout.called(), rbf.readout.gamma, rbf.segmenter.count) == ("rbf", 0.5, 99)
    assert method_of("boe", values={"readout": "svm"}) == method_of("boe")


@pytest.mark.parametrize(
    ("method", "values", "told"),
    [
        ("hots1", {}, "unknown method 'hots1'"),
        ("boe", {"C": 0}, "readout 'svm': C = 0: expected a number > 0"),
        ("boe", {"treshold": 9}, "unknown setting of method 'boe' 'treshold'"),
        ("boe", {"segmenter": "msx"}, "unknown segmenter 'msx'"),
        ("boe", {"segmenter": "counts", "tau": 1}, "unknown setting of method 'boe' 'tau'"),
        ("tar_hats", {"cleaner.tau": -1}, "cleaner 'tar': tau = -1: expected a number > 0 s"),
        ("hats", {"size": [34]}, "method 'hats': size = [34]: expected width and height"),
        ("hats", {"cell": 2.5}, "method 'hats': cell = 2.5: expected a whole number >= 0"),
    ],
)
def test_wrong_values_are_told(method, values, told):
    assert error(method_of, method, values=values).startswith(told)


def test_a_name_in_two_parts_is_asked_for():
    told = error(method_of, "boe", values={"cleaner": "tar", "tau": 0.1})
    assert told == "'tau' could mean cleaner.tau or segmenter.tau: expected one of these"


def test_presets_are_named():
    assert method_of("hats", "poker").cell == 12
    assert (
        error(method_of, "hats", "pokre") == "unknown settings of method 'hats' 'pokre'\n  hint: did you mean 'poker'?"
    )
