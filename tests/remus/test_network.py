"""The networks of `neuro_models`."""

import pytest

import neuro
from neuro_models import names, path
from neuro_remus.model import network_of
from neuro_remus.settings import SETTINGS


def test_remus_is_the_thesis():
    assert "remus" in names()
    net = neuro.load(path("remus"))
    rule = net.projections["c1_s2"].synapse
    assert (rule.Ar_plus, rule.Ar_minus, rule.Ap_plus, rule.Ap_minus, rule.rescue) == (
        0.075,
        -0.025,
        0.005,
        -0.04,
        False,
    )
    assert net.trials_section.labels.maps_per_label == 2
    assert (net.trials_section.dropout.p, net.trials_section.dropout.decay) == (0.25, 0.7)
    assert net == network_of(SETTINGS["thesis"], classes=10)


@pytest.mark.parametrize("settings", SETTINGS)
def test_the_network_follows_the_front_end_and_the_classes(settings):
    net = network_of(SETTINGS[settings].changed({"size": [40, 30], "orientations": [0, 60, 120]}), classes=3)
    assert net.populations["c1"].shape == (3, 15, 20)
    assert net.populations["s2"].shape[0] == 3 * net.trials_section.labels.maps_per_label
    assert neuro.compile(net).weights("c1_s2").shape[1:] == (3, 11, 11)


def test_an_unknown_network():
    with pytest.raises(neuro.ModelError) as error:
        path("resnet")
    assert str(error.value) == f"unknown network 'resnet': expected one of {', '.join(names())}"
    assert {"masquelier_thorpe", "mozafari", "must", "remus"} <= set(names())
