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

PYTHON = (*keyword.kwlist, *keyword.softkwlist, "self", "cls", "object", "MISSING", "field", "print", "float", "exec")
ATTRIBUTES = sorted({*dir(EquationNeuron), *dir(_Between), *EquationSynapse.__annotations__, "divisions"})
WORDS_HERE, CODE, READ, ODD, UNICODE = beside(__file__, "WORDS_HERE", "CODE", "READ", "ODD", "UNICODE")
LONG = ("a" * 300, "b" * 1999, "c" * 5000)
NAMES = tuple(
    dict.fromkeys((*PYTHON, *ATTRIBUTES, *WORDS_HERE, *CODE, *READ, *ODD, *UNICODE, *LONG, *ARGUMENTS, *PUBLIC))
)
CELL, SPIKES_ONLY = beside(__file__, "CELL", "SPIKES_ONLY")


def cell(**more: Any) -> dict[str, Any]:
    return {**CELL, **more}


def parameter(name: str) -> dict[str, Any]:
    return {
        "models": {
            "m": cell(
                equations={"V_m": f"(E_L - V_m)*{name} + I/C_m"},
                parameters={**{k: v for k, v in CELL["parameters"].items() if k != "leak"}, name: "0.1 1/ms"},
            )
        }
    }


def state(name: str, integrator: str = "") -> dict[str, Any]:
    words = cell(
        equations={"V_m": f"(E_L - V_m)*leak + I/C_m + {name}*leak", name: f"(gap - {name})*leak"},
        reset={"V_m": "E_L", name: f"0.5*{name}"},
        initial={name: "0.5*gap"},
        parameters={**CELL["parameters"], "gap": "2 mV"},
    )
    return {"models": {"m": words | ({"integrator": integrator} if integrator else {})}}


def gate(name: str) -> dict[str, Any]:
    return state(name, "exponential_euler")


def adaptive(name: str) -> dict[str, Any]:
    return state(name, "rkf45")


def receptor(name: str) -> dict[str, Any]:
    equations = {"V_m": f"(E_L - V_m)*leak + (I + {name})/C_m"}
    return {"models": {"m": cell(equations=equations, receptors={name: {"kernel": "alpha", "tau": "3 ms"}})}}


def abbreviation(name: str) -> dict[str, Any]:
    return {"models": {"m": cell(equations={"V_m": f"{name} + I/C_m"}, let={name: "(E_L - V_m)*leak"})}}


def rule_parameter(name: str) -> dict[str, Any]:
    parameters = {"Wmax": 100.0, name: 0.02, "tau_plus": "20 ms"}
    return {"rule": {**SPIKES_ONLY, "on_post": {"w": f"min(Wmax, w + Wmax*{name}*trace)"}, "parameters": parameters}}


def rule_state(name: str) -> dict[str, Any]:
    changes = {"w": f"min(Wmax, w + Wmax*step*{name})"}
    states = {name: {"tau": "tau_plus"}}
    return {
        "rule": {**SPIKES_ONLY, "traces": {}, "states": states, "on_pre": {name: f"{name} + 1"}, "on_post": changes}
    }


def signal_parameter(name: str) -> dict[str, Any]:
    words = {**SPIKES_ONLY, "states": {"tag": {"tau": "tau_plus"}}, "on_post": {"tag": "tag + trace"}}
    parameters = {"Wmax": 100.0, name: "0.02 1/ms", "tau_plus": "20 ms"}
    return {"rule": {**words, "on_signal": {"w": f"n*Wmax*{name}*tag"}, "parameters": parameters}}


def trace(name: str) -> dict[str, Any]:
    words = {"traces": {name: {"of": "pre", "tau": "tau_plus"}}, "on_post": {"w": f"min(Wmax, w + Wmax*step*{name})"}}
    return {"rule": {**SPIKES_ONLY, **words}}


def model_name(name: str) -> dict[str, Any]:
    return {"models": {name: CELL}, "cell": name}


def rule_name(name: str) -> dict[str, Any]:
    return {"rule": SPIKES_ONLY, "rule_name": name}


def population(name: str) -> dict[str, Any]:
    return {"c": name}


def projection(name: str) -> dict[str, Any]:
    return {"p": name}


def signal(name: str) -> dict[str, Any]:
    return {"signal": name}


def probe(name: str) -> dict[str, Any]:
    return {"probe": name}


PLACES = (
    *(parameter, state, gate, adaptive, receptor, abbreviation, rule_parameter, rule_state, signal_parameter, trace),
    *(model_name, rule_name, population, projection, signal, probe),
)


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


def used(place: Any, name: str, folder: Path) -> tuple[Any, ...]:
    """What a network with the name does, read from a file, saved and read again, copied."""
    file = folder / "net.yaml"
    file.write_text(json.dumps(description(place(name))))  # every JSON is YAML
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


def check(place: Any, names: tuple[str, ...], folder: Path) -> set[str]:
    """The names that are refused; all others do what a neutral one does."""
    neutral = used(place, "neutral", folder)
    assert len(neutral[0]) > 2
    refused = set()
    for name in names:
        try:
            assert used(place, name, folder) == neutral, f"{place.__name__} '{name:.40}'"
        except neuro.ModelError:
            refused.add(name)
    return refused


@pytest.mark.parametrize("place", PLACES, ids=lambda place: place.__name__)
def test_names_that_python_has_work(place, tmp_path):
    assert not check(place, ("lambda", "None", "class", "cls", "self", "next_V_m", "h", "c3"), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES, ids=lambda place: place.__name__)
def test_every_name_works_or_is_refused(place, tmp_path):
    refused = check(place, NAMES, tmp_path)
    assert not refused & {*keyword.kwlist, *dir(builtins)} - {*ARGUMENTS, *ODD, *dir(object), *ATTRIBUTES}


def refusal(words: dict[str, Any]) -> str:
    with pytest.raises(neuro.ModelError) as error:
        neuro.equations("m", **words)
    return error.value.message


@pytest.mark.parametrize("name", ["definition", "divisions", "name", "equation", "twin", "states", "tau_minus"])
def test_attributes_of_the_class_are_no_parameters(name):
    expected = f"model 'm': parameters.{name}: '{name}' has a meaning in every model: expected another name"
    assert refusal(parameter(name)["models"]["m"]) == expected


def test_every_attribute_is_refused():
    """By the class itself: no list has to follow it."""
    for name in {name for name in dir(EquationNeuron) if not name.startswith("_")}:
        assert "has a meaning in every model" in refusal(parameter(name)["models"]["m"])
    for name in {name for name in dir(_Between) if not name.startswith("_")}:
        assert "has a meaning in every model" in refusal(signal_parameter(name)["rule"])


@pytest.mark.parametrize("name", ["part", "tau_minus", "rate"])
def test_names_of_other_states_are_no_states(name):
    assert f"'{name}' is " in refusal(adaptive(name)["models"]["m"])


@pytest.mark.parametrize("section", ["parameters", "let", "equations"])
def test_the_slope_of_a_kernel_has_its_name_alone(section):
    words = receptor("g")["models"]["m"]
    more = {"parameters": "1 mV", "let": "2*leak", "equations": "-dg*leak"}[section]
    words = {**words, "initial": {"dg": "1 mV"} if section == "equations" else {}}
    words[section] = {**words.get(section, {}), "dg": more}
    assert refusal(words) == f"model 'm': {section}.dg: 'dg' is the slope of g, too: expected another name"


def test_a_keyword_has_an_underscore_in_python():
    made = neuro.equations("m", **parameter("lambda")["models"]["m"])
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
