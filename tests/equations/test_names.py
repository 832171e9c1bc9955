"""Names that authors choose: each works as any other does, or is refused in one sentence, wherever it stands."""

import builtins
import copy
import json
import keyword
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import neuro
from beside import beside
from neuro.model.equations import EquationNeuron, EquationSynapse
from neuro.model.equations.functions import ARGUMENTS, PUBLIC
from neuro.model.equations.rule import _Between
from refused import error_of

PYTHON = (*keyword.kwlist, *keyword.softkwlist, "self", "cls", "object", "MISSING", "field", "print", "float", "exec")
ATTRIBUTES = sorted({*dir(EquationNeuron), *dir(_Between), *EquationSynapse.__annotations__, "divisions"})
WORDS_HERE, CODE, READ, ODD, UNICODE = beside(__file__, "WORDS_HERE", "CODE", "READ", "ODD", "UNICODE")
LONG = ("a" * 300, "b" * 1999, "c" * 5000)
NAMES = tuple(
    dict.fromkeys((*PYTHON, *ATTRIBUTES, *WORDS_HERE, *CODE, *READ, *ODD, *UNICODE, *LONG, *ARGUMENTS, *PUBLIC))
)
CELL, PLACES = beside(__file__, "CELL", "PLACES")


def cell(**more: Any) -> dict[str, Any]:
    return {**CELL, **more}


def standing(place: str, name: str) -> dict[str, Any]:
    """The part of a description in which the name stands."""
    return json.loads(json.dumps(PLACES[place]).replace("@", json.dumps(name)[1:-1]))


def description(words: dict[str, Any]) -> dict[str, Any]:
    """A network in which a name stands at one place."""
    c, p = words.get("c", "cells"), words.get("p", "wires")
    models = dict(words.get("models", {"m": CELL}))
    if "rule" in words:
        models[words.get("rule_name", "r")] = words["rule"]
    wires = {"from": "first_input", "to": c, "rule": "all_to_all", "weight": 60.0}
    if "rule" in words:
        synapse = words.get("rule_name", "r")
        wires["synapse"] = {synapse: {"signal": "reward"}} if "on_signal" in words["rule"] else synapse
    return {
        "neuro": 1,
        "resolution": 0.5,
        "models": models,
        "populations": {
            "first_input": {
                "model": {"spike_generator": {"spike_times": [[1.0, 5.0, 9.0, 13.0], [2.0, 6.0, 9.5]]}},
                "shape": 2,
            },
            "drive": {"model": {"dc_generator": {"amplitude": 800.0}}, "shape": 1},
            c: {"model": words.get("cell", "m"), "shape": 2},
        },
        "projections": {
            p: wires,
            "pushing": {"from": "drive", "to": c, "rule": "all_to_all", "weight": 1.0},
        },
        "signals": {words.get("signal", "reward"): {"to": c}} if "signal" in words or "rule" in words else {},
        "probes": {words.get("probe", "seen"): {"of": c, "record": "V_m", "every": 1.0}},
    }


def outcome(net: neuro.Network) -> tuple[Any, ...]:
    sim = neuro.compile(net, "reference", seed=1)
    sim.run(8.0)
    c = next(name for name in net.populations if name not in ("first_input", "drive"))
    p = next(name for name in net.projections if name != "pushing")
    for word in (s for s in sim.states(c)):
        sim.get(c, word)
    for name in net.signals:
        sim.signal(name, 0.5)
    sim.run(8.0)
    seen = next(iter(net.probes))
    return tuple(np.asarray(x).tolist() for x in (*sim.spikes(c), sim.trace(seen)[1], sim.weights(p)[2]))


def used(place: str, name: str, folder: Path) -> tuple[Any, ...]:
    """What a network with the name does, read from a file, saved and read again, copied."""
    file = folder / "net.yaml"
    file.write_text(json.dumps(description(standing(place, name))))  # every JSON is YAML
    net = neuro.load(file)
    result = outcome(net)
    net.save(folder / "again.yaml")
    again = neuro.load(folder / "again.yaml")
    assert repr(net)
    assert str(net)
    assert net._repr_html_()
    for other in (again, copy.deepcopy(net)):
        other.save(folder / "other.yaml")
        assert (folder / "other.yaml").read_text() == (folder / "again.yaml").read_text()
    return result


def check(place: str, names: tuple[str, ...], folder: Path) -> set[str]:
    """The names that are refused; all others do what a neutral one does."""
    neutral = used(place, "neutral", folder)
    assert len(neutral[0]) > 2
    refused = set()
    for name in names:
        try:
            assert used(place, name, folder) == neutral, f"{place} '{name:.40}'"
        except neuro.ModelError:
            refused.add(name)
    return refused


@pytest.mark.parametrize("place", PLACES)
def test_names_that_python_has_work(place, tmp_path):
    assert not check(place, ("lambda", "None", "class", "cls", "self", "next_V_m", "h", "c3"), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_every_name_works_or_is_refused(place, tmp_path):
    refused = check(place, NAMES, tmp_path)
    assert not refused & {*keyword.kwlist, *dir(builtins)} - {*ARGUMENTS, *ODD, *dir(object), *ATTRIBUTES}


def refusal(words: dict[str, Any]) -> str:
    return error_of(neuro.equations, "m", **words).message


@pytest.mark.parametrize("name", ["definition", "divisions", "name", "equation", "twin", "states", "tau_minus"])
def test_attributes_of_the_class_are_no_parameters(name):
    expected = f"model 'm': parameters.{name}: '{name}' is reserved in every model: expected another name"
    assert refusal(standing("parameter", name)["models"]["m"]) == expected


def test_every_attribute_is_refused():
    """By the class itself: no list has to follow it."""
    for name in {name for name in dir(EquationNeuron) if not name.startswith("_")}:
        assert "is reserved in every model" in refusal(standing("parameter", name)["models"]["m"])
    for name in {name for name in dir(_Between) if not name.startswith("_")}:
        assert "is reserved in every model" in refusal(standing("signal_parameter", name)["rule"])


@pytest.mark.parametrize("name", ["part", "tau_minus", "rate"])
def test_names_of_other_states_are_no_states(name):
    assert f"'{name}' is " in refusal(standing("adaptive", name)["models"]["m"])


@pytest.mark.parametrize("section", ["parameters", "let", "equations"])
def test_the_slope_of_a_kernel_has_its_name_alone(section):
    words = standing("receptor", "g")["models"]["m"]
    more = {"parameters": "1 mV", "let": "2*leak", "equations": "-dg*leak"}[section]
    words = {**words, "initial": {"dg": "1 mV"} if section == "equations" else {}}
    words[section] = {**words.get(section, {}), "dg": more}
    assert refusal(words) == f"model 'm': {section}.dg: 'dg' is also the slope of g: expected another name"


def test_a_keyword_has_an_underscore_in_python():
    made = neuro.equations("m", **standing("parameter", "lambda")["models"]["m"])
    assert made(lambda_=0.2).lambda_ == 0.2
    assert "lambda" in made.quantities()
    net = neuro.Network()
    net.population("c", 1, made(lambda_=0.2))
    sim = neuro.compile(net, "reference")
    sim.set("c", lambda_=0.3)
    assert sim.get("c", "lambda").tolist() == [0.3]


def test_many_names_on_the_event_backend():
    """One model of many names, compiled."""
    names = ["lambda", "None", "class", "cls", "self", "h", "p", "math", "next_V_m", "k1_V_m"]
    words = cell(
        equations={"V_m": "(E_L - V_m)*(" + " + ".join(names) + ") + I/C_m + k2_V_m*leak", "k2_V_m": "-k2_V_m*leak"},
        parameters={**CELL["parameters"], "one": "1 mV", **dict.fromkeys(names, "0.01 1/ms")},
        initial={"k2_V_m": "one"},
        integrator="rk4",
    )
    made = neuro.equations("many", **words)

    def spikes(backend: str) -> list[float]:
        net = neuro.Network()
        net.population("drive", 1, neuro.dc_generator(amplitude=800.0))
        net.population("c", 1, made())
        net.connect("drive", "c", neuro.all_to_all(), weight=1.0)
        sim = neuro.compile(net, backend)
        sim.run(30.0)
        return sim.spikes("c")[0].tolist()

    assert spikes("event") == spikes("reference") != []
