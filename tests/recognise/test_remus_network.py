"""The networks of `neuro_models`."""

import pytest

import neuro
from neuro_models import names, path
from neuro_recognise.methods.remus import Remus
from neuro_recognise.parts.layers import Inputs


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
    assert net == Remus().preset("thesis").layer.network(Inputs((4, 17, 17), 64.0, 1.0), classes=10)


@pytest.mark.parametrize("settings", Remus.presets)
def test_the_network_follows_the_front_end_and_the_classes(settings):
    method = Remus().preset(settings).changed({"size": [40, 30], "orientations": [0, 60, 120]})
    net = method.layer.network(method.inputs, classes=3)
    assert net.populations["c1"].shape == (3, 15, 20)
    assert net.populations["s2"].shape[0] == 3 * net.trials_section.labels.maps_per_label
    assert neuro.compile(net).weights("c1_s2").shape[1:] == (3, 11, 11)


def test_an_unknown_network():
    with pytest.raises(neuro.ModelError) as error:
        path("resnet")
    assert str(error.value) == f"unknown network 'resnet': expected one of {', '.join(names())}"
    assert {"masquelier_thorpe", "mozafari", "must", "remus"} <= set(names())
