import json

import pytest

from neuro_recognise.method import METHODS
from neuro_recognise.recogniser import method_of
from refused import refused


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


@pytest.mark.parametrize(
    ("method", "values", "message"),
    [
        ("hots1", {}, "unknown method 'hots1'"),
        ("boe", {"C": 0}, "readout 'svm': C = 0: expected a number > 0"),
        ("boe", {"treshold": 9}, "unknown setting of method 'boe' 'treshold'"),
        ("boe", {"segmenter": "msx"}, "unknown segmenter 'msx'"),
        ("boe", {"segmenter": "counts", "tau": 1}, "unknown setting of method 'boe' 'tau'"),
        ("tar_hats", {"cleaner.tau": -1}, "cleaner 'tar': tau = -1: expected a number > 0 s"),
        ("hats", {"size": [34]}, "method 'hats': size = [34]: expected width and height"),
        ("hats", {"cell": 2.5}, "method 'hats': cell = 2.5: expected a whole number >= 0"),
        ("remus", {"order": "days"}, "method 'remus': order = 'days': expected one of recordings, frames\n"),
        ("remus", {"vote": "loudest"}, "method 'remus': vote = 'loudest': expected one of majority, potentials\n"),
        ("remus", {"epochs": 0}, "method 'remus': epochs = 0: expected a whole number >= 1"),
        ("remus", {"rate_decay": 2}, "network 'remus': rate_decay = 2: expected a number > 0 and <= 1"),
        ("remus", {"maps": 9}, "'maps' cannot be set: it follows from the classes and per_class"),
        ("remus", {"tau": "long"}, "segmenter 'msd': tau = 'long': expected a number > 0 s"),
        ("remus", {"orientations": ["up"]}, "bank 'gabors': orientations[0] = 'up': expected a number degrees"),
        ("remus", {"size": 34}, "method 'remus': size = 34: expected a list, each of it a whole number >= 0"),
        ("remus", {"size": [34.5, 34]}, "method 'remus': size[0] = 34.5: expected a whole number >= 0"),
        ("remus", {"sizes": [3, 5]}, "sizes, sigmas and wavelengths: expected as many of each, one a scale"),
        ("remus", {"sizes": [3, 5, 6, 9]}, "sizes: found 6: expected odd numbers, so that a filter has a middle"),
        ("remus", {"min_response": 1}, "encoder 'log_latency': min_response = 1: expected a number > 0 and < 1"),
        ("remus", {"literal": 1}, "bank 'gabors': literal = 1: expected true or false"),
        ("remus", {"thet": 3}, "unknown setting of method 'remus' 'thet'\n  hint: did you mean 'theta'?"),
        ("edhmax_tempotron", {"representation": "leaky"},
         "method 'edhmax_tempotron': bank 'leaky_gabors' sees each event by itself: found representation 'leaky'\n"
         "  hint: representation=counts, or bank=gabors"),
    ],
)  # fmt: skip
def test_wrong_values(method, values, message):
    assert refused(method_of, method, values=values).startswith(message)


def test_a_field_that_is_smaller_than_a_cell():
    assert refused(method_of("remus").fitting, (1, 34)) == "size = [1, 34]: expected at least 2 px each, a cell"
    assert method_of("edhmax_tempotron", "remus_front_end", {"representation": "leaky"}).called() == "edhmax_tempotron"


def test_a_name_in_two_parts_is_asked_for():
    told = refused(method_of, "boe", values={"cleaner": "tar", "tau": 0.1})
    assert told == "'tau' could mean cleaner.tau or segmenter.tau: expected one of these"


def test_presets_are_named():
    assert method_of("hats", "poker").cell == 12
    told = "unknown settings of method 'hats' 'pokre'\n  hint: did you mean 'poker'?"
    assert refused(method_of, "hats", "pokre") == told
