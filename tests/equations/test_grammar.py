"""What is no expression ends in a message with its column; nothing in a text is ever run."""

import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

import neuro
from neuro import ModelError
from neuro.model.equations import functions
from neuro.model.equations.grammar import MAX_DEPTH, MAX_TOKENS, parse
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
