"""Mistakes in models as equations tell the file, the line and the column in the expression."""

import copy
import re
from pathlib import Path

import pytest

import neuro
from beside import beside
from neuro import ModelError
from neuro.compiler.mistakes import mistakes
from refused import error_of, refused

HERE = Path(__file__).parent


def changed(right: str, wrong: str) -> None:
    """Load the models with one text in place of another."""
    text = (HERE / "models.yaml").read_text()
    assert right in text
    Path("net.yaml").write_text(text.replace(right, wrong, 1))
    neuro.load("net.yaml")


def test_a_mistake_in_a_file(tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    messages.calls(globals())


(UNITLESS,) = beside(__file__, "UNITLESS")


@pytest.mark.parametrize(("name", "count"), [("izhikevich", 9), ("inner sums", 10), ("rule", 4)])
def test_all_mistakes_of_units_are_told_and_each_hint_repairs_one(name, count):
    words, counts = copy.deepcopy(UNITLESS[name]), []
    for _ in range(20):
        try:
            neuro.equations("m", **words)
            break
        except ModelError as error:
            counts.append(1 + len(error.others))
            repair(words, max((error, *error.others), key=place))
    assert counts == list(range(count, 0, -1))


def place(error):
    return error.message.partition(", column")[0], int(re.search(r"column (\d+)", error.message)[1])


def repair(words, error):
    """Do what the hint says, in the text behind the column."""
    where, column = place(error)
    part = words
    *path, last = where.split(": ")[-1].split(".")
    for word in path:
        part = part[word]
    begin, text = column - 1, str(part[last])
    if found := re.fullmatch(r"write (-?[\d.]+)(.*)", error.hint):
        old, new = found[1], f"{found[1]}{found[2]}"
    else:
        old, unit = re.fullmatch(r"multiply '?(.*?)'? by a number in ([^,]*).*", error.hint).groups()
        old = text if old == "the expression" else old
        new = (f"({old})" if " " in old else old) + f"*1*{unit}".replace("1*1/", "1/").replace(" ", "*")
    assert old in text[begin:], (error, text)
    part[last] = text[:begin] + text[begin:].replace(old, new, 1)


def test_each_of_several_mistakes_of_units_has_its_place(tmp_path):
    file = tmp_path / "net.yaml"
    text = (HERE / "models.yaml").read_text()
    file.write_text(text.replace("exp((V_m - V_th)/Delta_T)", "exp(V_m)", 1).replace("V_m >= V_peak", "V_m >= w", 1))
    with pytest.raises(ModelError) as raised:
        neuro.load(file)
    assert re.findall(r"^.*?:(\d+:\d+): model .* column (\d+)", str(raised.value), re.M) == [
        ("39:12", "33"),
        ("43:16", "5"),
    ]
    assert [str(error) for error in mistakes(file, None, 0).mistakes] == [
        str(raised.value).partition(f"\n{file}:43")[0],
        str(raised.value.others[0]),
    ]


def test_a_mistake_in_python_tells_the_line_of_the_call():
    with pytest.raises(
        ModelError, match=r"^test_mistakes.py:\d+: model 'm': equations.V_m, column 8: unknown name 'tau'"
    ):
        neuro.equations("m", equations={"V_m": "(-V_m)/tau"}, parameters={"tau_m": "10 ms"})


def test_a_state_of_which_nothing_tells_the_unit():
    error = error_of(neuro.equations, "m", equations={"u": "-u/tau"}, parameters={"tau": "10 ms"})
    assert error.message == "model 'm': nothing determines the unit of 'u'"
    assert error.hint == "write a value with a unit in 'initial', e.g. {u: 0 mV}"


def test_bounds_and_units_of_parameters():
    model = neuro.equations(
        "m",
        equations={"V_m": "(E_L - V_m)/tau + r*x*1 mV"},
        receptors={"x": {"kernel": "exp", "tau": "tau"}},
        parameters={
            "E_L": "-70 mV",
            "tau": "0.01 s",
            "r": {"default": "3 Hz", "at_least": 1, "at_most": 5, "doc": "rate"},
        },
        initial={"x": 0.0 + 1},
    )
    assert model.quantities()["r"].expected() == "a number >= 1 and <= 5 Hz"
    assert model.quantities()["tau"].above == 0
    assert [(state.name, state.unit) for state in model.states] == [("V_m", "mV"), ("x", "")]
    assert "m.r = 7: expected a number >= 1 and <= 5 Hz" in refused(model, r=7.0)


def test_a_current_needs_a_place_in_the_equations():
    model = neuro.equations("deaf", equations={"V_m": "(E_L - V_m)/tau"}, parameters={"E_L": "0 mV", "tau": "10 ms"})
    net = neuro.Network()
    net.population("dc", 1, neuro.dc_generator(amplitude=1.0))
    net.population("cells", 1, model())
    net.connect("dc", "cells", neuro.all_to_all())
    assert error_of(neuro.compile, net).message == (
        "projection 'dc_cells': a current from 'dc' into 'cells', a deaf, whose equations have no I: "
        "expected neurons that take currents"
    )
