"""Where a model in equations does not run, and why; of chips `test_chips` tells."""

from pathlib import Path

import pytest
import yaml

import neuro
from neuro import ModelError

MODELS = yaml.safe_load(Path(__file__).with_name("models.yaml").read_text())["models"]


def network(name):
    net = neuro.Network()
    net.population("cells", 2, neuro.equations(name, **MODELS[name])())
    return net


def test_a_group_cannot_have_what_resets_itself():
    net = network("own_aeif_cond_exp")
    net.group("choice", neuro.winner_take_all(of="cells"))
    with pytest.raises(ModelError) as raised:
        neuro.compile(net)
    assert raised.value.message == (
        "group 'choice': winner_take_all of 'cells', an own_aeif_cond_exp, which resets itself before a group can "
        "choose: expected neurons that a group resets"
    )
