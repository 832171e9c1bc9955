import json

import pytest

from neuro_recognise.method import METHODS
from neuro_recognise.recogniser import method_of
from refused import refusals_of


@pytest.mark.parametrize("name", METHODS)
def test_every_setting_has_a_meaning_and_a_source_and_survives_a_file(name):
    method = method_of(name)
    for row in method.rows():
        assert row.doc, f"{name}: {row.name} has no meaning"
        assert row.source or row.name == "size", f"{name}: {row.name} has no source"
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
    assert method_of("edhmax_tempotron", "remus_front_end", {"representation": "leaky"}).called() == "edhmax_tempotron"
    assert method_of("hats", "poker").cell == 12


def test_wrong_values(messages):
    messages(refusals_of(messages.cases, globals()))
