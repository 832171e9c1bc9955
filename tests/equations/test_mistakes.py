"""Mistakes in models as equations tell the file, the line and the column in the expression."""

import copy
import re
from pathlib import Path

import pytest

import neuro
from neuro import ModelError
from neuro.compiler.mistakes import mistakes

HERE = Path(__file__).parent
MISTAKES = {
    "unknown_name": (
        "(-g_L*(V_m - E_L)",
        "(-g_l*(V_m - E_L)",
        "39:12: model 'own_aeif_cond_exp': equations.V_m, column 3: unknown name 'g_l'\n"
        "    (-g_l*(V_m - E_L) + g_L*Delta_T*exp((V_m - V_th)/Delta_T) - \n"
        "      ^\n"
        "  hint: did you mean 'g_L'?",
    ),
    "both_operands": (
        "V_m >= V_peak",
        "V_m >= w",
        "43:16: model 'own_aeif_cond_exp': threshold, column 5: 'V_m' is in mV, 'w' in pA: expected the same unit\n"
        "    V_m >= w\n"
        "        ^\n"
        "  hint: multiply 'w' by a number in GOhm",
    ),
    "whole": (
        "C_m: 281 pF",
        "C_m: 281 ms",
        "39:12: model 'own_aeif_cond_exp': equations.V_m, column 2: the whole is in pA/ms: expected it in mV/ms\n"
        "    (-g_L*(V_m - E_L) + g_L*Delta_T*exp((V_m - V_th)/Delta_T) - \n"
        "     ^\n"
        "  hint: multiply the whole by a number in GOhm",
    ),
    "argument": (
        "exp((V_m - V_th)/Delta_T)",
        "exp(V_m - V_th)",
        "39:12: model 'own_aeif_cond_exp': equations.V_m, column 33: exp of 'V_m - V_th', which is in mV: "
        "expected a number without unit\n"
        "    g_L*(V_m - E_L) + g_L*Delta_T*exp(V_m - V_th) - w + I_syn + \n"
        "                                  ^\n"
        "  hint: multiply 'V_m - V_th' by a number in 1/mV",
    ),
    "unit": (
        "C_m: 281 pF",
        "C_m: 281 pG",
        "46:23: model 'own_aeif_cond_exp': parameters.C_m: column 1: expected a unit\n    pG\n    ^\n"
        "  hint: known: mV, V, uV, ms, s, us, pA, nA, uA, nS, uS, mS, pS, pF, nF, uF, GOhm, MOhm, kOhm, kHz, Hz, "
        "and their products with * / ^",
    ),
    "integrator": (
        "    integrator: euler\n",
        "",
        "29:12: model 'own_izhikevich': the equations are not linear, see V_m: expected an integrator\n"
        "  hint: write integrator: {rkf45: {tolerance: 1e-6}}, or {rk4: {substeps: 4}}, exponential_euler, euler",
    ),
    "substeps": (
        "integrator: euler",
        "integrator: {rk4: {substeps: 0}}",
        "36:34: model 'own_izhikevich': integrator: rk4.substeps = 0: expected a whole number >= 1 and <= 1000",
    ),
    "hold": (
        "hold: [V_m]",
        "hold: [V]",
        "9:37: model 'own_iaf_psc_exp': refractory: unknown state 'V'\n  hint: did you mean 'V_m'?",
    ),
    "name": (
        "own_izhikevich:",
        "izhikevich:",
        "28:5: model 'izhikevich': 'izhikevich' is a model of its own already: expected another name",
    ),
    "word": (
        "    let: {",
        "    lets: {",
        "41:11: model 'own_aeif_cond_exp': unknown word of a model 'lets'\n  hint: did you mean 'let'?",
    ),
    "current_in_reset": (
        "w: w + b}",
        "w: w + I}",
        "44:30: model 'own_aeif_cond_exp': reset.w: found I, the current from outside: expected states and parameters",
    ),
    "shadowed": (
        "C_m: 281 pF",
        "I: 281 pF",
        "46:21: model 'own_aeif_cond_exp': parameters.I: 'I' has a meaning in every model: expected another name",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_a_file(name, tmp_path):
    right, wrong, expected = MISTAKES[name]
    text = (HERE / "models.yaml").read_text()
    assert right in text
    file = tmp_path / "net.yaml"
    file.write_text(text.replace(right, wrong, 1))
    with pytest.raises(ModelError) as raised:
        neuro.load(file)
    assert str(raised.value) == f"{file}:{expected}"


UNITLESS = {
    "izhikevich": {
        "equations": {"V_m": "0.04*V_m^2 + 5*V_m + 140 - u + I", "u": "a*(b*V_m - u)"},
        "threshold": "V_m >= 30",
        "reset": {"V_m": "c", "u": "u + d"},
        "parameters": {"a": 0.02, "b": 0.2, "c": -65, "d": 8},
        "integrator": "euler",
    },
    "inner sums": {
        "let": {"x": "3*(V_m - 4)", "y": "max(5 pA, V_m)"},
        "equations": {"V_m": "(x + r*y)/tau + exp(V_m)", "z": "1 - z/tau", "q": "where(z > tau, q, x)/(2*z) - q"},
        "threshold": "V_m > y",
        "initial": {"z": "-1", "q": "tau + z_0"},
        "reset": {"q": "q + 5"},
        "parameters": {"tau": "10 ms", "z_0": "2 pF", "r": "1 GOhm"},
        "integrator": "euler",
    },
    "rule": {
        "states": {"e": {"tau": "tau"}},
        "on_pre": {"w": "w + e*step", "e": "e + log(tau)"},
        "on_post": {"w": "w*step + e", "e": "e - tau - 1"},
        "parameters": {"step": "3 pA", "tau": "10 ms"},
    },
}


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
        old = text if old == "the whole" else old
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
    with pytest.raises(ModelError) as raised:
        neuro.equations("m", equations={"u": "-u/tau"}, parameters={"tau": "10 ms"})
    assert raised.value.message == "model 'm': nothing tells the unit of 'u'"
    assert raised.value.hint == "write it in 'initial', e.g. {u: 0 mV}"


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
    with pytest.raises(ModelError, match=r"m.r = 7: expected a number >= 1 and <= 5 Hz"):
        model(r=7.0)


def test_a_current_needs_a_place_in_the_equations():
    model = neuro.equations("deaf", equations={"V_m": "(E_L - V_m)/tau"}, parameters={"E_L": "0 mV", "tau": "10 ms"})
    net = neuro.Network()
    net.population("dc", 1, neuro.dc_generator(amplitude=1.0))
    net.population("cells", 1, model())
    net.connect("dc", "cells", neuro.all_to_all())
    with pytest.raises(ModelError) as raised:
        neuro.compile(net)
    assert raised.value.message == (
        "projection 'dc_cells': a current from 'dc' into 'cells', a deaf, whose equations have no I: "
        "expected neurons that take currents"
    )
