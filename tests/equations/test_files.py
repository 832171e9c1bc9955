"""Models of a network's own: in the file, back into a file, and nowhere else."""

from pathlib import Path

import pytest
import yaml

import neuro
from beside import beside
from neuro.model.language import schema
from neuro.model.neurons import MODELS
from refused import error_of, refused

(NET,) = beside(__file__, "NET")


def loaded(folder):
    (folder / "models.yaml").write_text(Path(__file__).with_name("models.yaml").read_text())
    (folder / "net.yaml").write_text(NET)
    return neuro.load(folder / "net.yaml")


def test_a_saved_network_has_its_models(tmp_path):
    net = loaded(tmp_path)
    net.save(tmp_path / "saved.yaml")
    again = neuro.load(tmp_path / "saved.yaml")
    assert again == net
    assert type(again.populations["cells"].model) is type(net.populations["cells"].model)
    assert net.populations["cells"].model == neuro.load(tmp_path / "net.yaml").populations["cells"].model


def test_they_are_known_in_their_network_only(tmp_path):
    loaded(tmp_path)
    assert "own_iaf_psc_exp" not in MODELS


def test_two_models_of_one_name_cannot_be_saved(tmp_path):
    net = neuro.Network()
    for k, text in enumerate(("(E_L - V_m)/tau", "(2*E_L - V_m)/tau")):
        words = {"equations": {"V_m": text}, "parameters": {"E_L": "0 mV", "tau": "10 ms"}}
        net.population(f"p{k}", 1, neuro.equations("one", **words)())
    error = error_of(net.save, tmp_path / "net.yaml")
    assert error.message == "population 'p1': another model of the network is also called 'one'"


def test_the_schema_takes_them():
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.validate(yaml.safe_load(Path(__file__).with_name("models.yaml").read_text()), schema())
    jsonschema.validate(yaml.safe_load(NET), schema())


def test_a_state_of_an_edited_model_is_refused(tmp_path):
    def made(rate):
        words = {"equations": {"V_m": f"{rate}*(E_L - V_m)/tau_m"}, "receptors": {"V_m": {"kernel": "delta"}}}
        words |= {"threshold": "V_m >= V_th", "reset": {"V_m": "E_L"}}
        words["parameters"] = {"tau_m": "10 ms", "E_L": "-70 mV", "V_th": "-55 mV"}
        net = neuro.Network("edited")
        net.population("cells", 2, neuro.equations("mine", doc=f"Written {rate} times.", **words)())
        return neuro.compile(net, "reference")

    made(1.0).save(tmp_path / "state.h5")
    made(1.0).restore(tmp_path / "state.h5")
    assert "a state of another network 'edited'" in refused(made(2.0).restore, tmp_path / "state.h5")
