"""What is no expression ends in a message with its column; nothing in a text is ever run."""

import math
from contextlib import suppress

import pytest
from hypothesis import given, strategies as st

import neuro
from neuro import ModelError
from neuro.core.grammar import MAX_DEPTH, MAX_TOKENS
from neuro.model.equations import functions
from neuro.model.equations.parameters import parse
from neuro.model.equations.writing import written

ATTACKS = [
    ("__import__('os').system('id')", 1),
    ("V_m.__class__", 4),
    ("().__class__.__bases__[0]", 3),
    ("open('/etc/passwd')", 6),
    ("lambda: 0", 7),
    ("exec(E_L)", 1),
    ("eval(E_L)", 1),
    ("globals()", 9),
    ("print(E_L)", 1),
    ("[0 for x in E_L]", 1),
    ("{E_L}", 1),
    ("f'{E_L}'", 2),
    ("E_L; import os", 4),
    ("E_L := 3", 5),
    ("E_L if E_L else E_L", 5),
    ("9**9**9**9", 1),
    ("V_m^999999999", 4),
    ("(" * 5000 + "1" + ")" * 5000, 2001),
    ("-" * 1999 + "1", 401),
    ("(" * 100 + "1" + ")" * 100, MAX_DEPTH + 2),
    ("V" * 1_000_000, 2001),
    ("1+" * 900 + "1", MAX_TOKENS + 1),
    ("1e999", 1),
    ("\uff36_m", 1),
    ("V\u200b_m", 2),
    ("\u212f", 1),
    ("E_L\n#", 5),
    ("True", 1),
    ("None", 1),
    ("E_L @ E_L", 5),
]


def with_equation(text):
    return neuro.equations(
        "attacked",
        equations={"V_m": text},
        parameters={"E_L": "-70 mV", "tau_m": "10 ms"},
        integrator={"rk4": {"substeps": 1}},
    )


@pytest.mark.parametrize(("text", "column"), ATTACKS, ids=range(len(ATTACKS)))
def test_an_attack_ends_in_a_message_with_its_column(text, column):
    with pytest.raises(ModelError) as raised:
        with_equation(text)
    assert f"equations.V_m, column {column}: " in raised.value.message
    assert len(raised.value.message) < 400


def with_rule(text, word="on_signal"):
    return neuro.equations(
        "attacked",
        states={"z": {"tau": "tau_z"}},
        on_pre={"z": text if word == "on_pre" else "z + 1"},
        on_signal={"w": text if word == "on_signal" else "n*z/tau_z"},
        parameters={"E_L": 1, "tau_z": "10 ms"},
    )


OF_RULES = [(text, column) for text, column in ATTACKS if text != "9**9**9**9"]
"""That one is a number, infinite; a potential has a unit."""


@pytest.mark.parametrize("word", ["on_pre", "on_signal"])
@pytest.mark.parametrize(("text", "column"), OF_RULES, ids=range(len(OF_RULES)))
def test_an_attack_on_a_rule_ends_likewise(text, column, word):
    with pytest.raises(ModelError) as raised:
        with_rule(text.replace("V_m", "z^5" if text == "V_m^999999999" else "E_L"), word)
    place = {"on_pre": "on_pre.z", "on_signal": "on_signal.w"}[word]
    assert f"{place}, column " in raised.value.message
    assert len(raised.value.message) < 400


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            {"states": {"__class__": {}}},
            "states.__class__, column 1: found '_': expected a number",
        ),
        ({"states": {"z" * 3000: {}}}, ", column 2001: found 3000 characters: expected at most 2000"),
        ({"states": {f"z{k}": {} for k in range(1000)}}, "found 1000 states: expected at most 8"),
        (
            {"states": {"z": {"tau": "tau_z", "__init__": 1}}},
            "unknown word of a state of a synapse '__init__'",
        ),
        ({"states": {"exp": {}}}, "states.exp: 'exp' means something else, too: expected another name"),
        ({"states": {"self_": {}}}, "states.self_: name 'self_': expected letters, digits and '_', a letter first"),
        (
            {"on_signal": {"w": "(n*z)^999999999/tau_z"}},
            "column 6: an exponent of 1e+09: expected at most 100",
        ),
        ({"on_signal": {"w": "((((z+n)^4)^4)^4)^4/tau_z"}}, "on_signal.w, column 12: found '(z + n)^4^4'"),
        (
            {"initial": {"z": "__import__('os')"}},
            "initial.z, column 1: found '_': expected a number",
        ),
    ],
    ids=range(9),
)
def test_an_attack_on_the_words_of_a_rule(words, message):
    usual = {"states": {"z": {"tau": "tau_z"}}, "on_pre": {}, "parameters": {"tau_z": "10 ms", "n0": 1}}
    with pytest.raises(ModelError) as raised:
        neuro.equations("attacked", **{**usual, **words})
    assert message in raised.value.message
    assert len(raised.value.message) < 3400


@given(st.text(max_size=60) | st.text("znwEL tau*/+-^()<>=.,0123456789e", max_size=60))
def test_random_text_in_a_rule_raises_nothing_but_model_errors(text):
    with suppress(ModelError):
        with_rule(text)


@given(st.text(max_size=60) | st.text("Vm_EL tau*/+-^()<>=.,0123456789e", max_size=60))
def test_random_text_raises_nothing_but_model_errors(text):
    with suppress(ModelError):
        with_equation(text)


NUMBERS = st.floats(0.1, 10.0).map(lambda x: repr(round(x, 3)))
SUMS = st.recursive(
    NUMBERS,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(" ".join),
        inner.map(lambda text: f"({text})"),
        inner.map(lambda text: f"-{text}"),
    ),
    max_leaves=8,
)


def value(tree):
    return eval(written(tree, lambda part: None), vars(functions))


@given(SUMS)
def test_arithmetic_is_read_as_everywhere(text):
    assert math.isclose(value(parse(text).tree), eval(text), rel_tol=1e-12, abs_tol=1e-9)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("-2^2", -4.0), ("2^-1", 0.5), ("2**3*2", 16.0), ("2*3^2", 18.0), ("8/2/2", 2.0), ("1-2-3", -4.0)],
)
def test_operators_bind_as_in_mathematics(text, expected):
    assert value(parse(text).tree) == expected
