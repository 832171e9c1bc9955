"""What is no expression ends in a message with its column; nothing in a text is ever run."""

import math
from contextlib import suppress

import pytest
from hypothesis import given, strategies as st

import neuro
from neuro import ModelError
from neuro.model.equations import functions
from neuro.model.equations.parameters import parse
from neuro.model.equations.writing import to_python


def with_equation(text):
    return neuro.equations(
        "attacked",
        equations={"V_m": text},
        parameters={"E_L": "-70 mV", "tau_m": "10 ms"},
        integrator={"rk4": {"substeps": 1}},
    )


def with_rule(text, word="on_signal"):
    return neuro.equations(
        "attacked",
        states={"z": {"tau": "tau_z"}},
        on_pre={"z": text if word == "on_pre" else "z + 1"},
        on_signal={"w": text if word == "on_signal" else "n*z/tau_z"},
        parameters={"E_L": 1, "tau_z": "10 ms"},
    )


USUAL = {"states": {"z": {"tau": "tau_z"}}, "on_pre": {}, "parameters": {"tau_z": "10 ms", "n0": 1}}


def test_an_attack_ends_in_a_message_with_its_column(messages):
    messages.calls(globals())


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
    return eval(to_python(tree, lambda part: None), vars(functions))


@given(SUMS)
def test_arithmetic_is_read_as_everywhere(text):
    assert math.isclose(value(parse(text).tree), eval(text), rel_tol=1e-12, abs_tol=1e-9)


@pytest.mark.parametrize(
    ("text", "expected"),
    [("-2^2", -4.0), ("2^-1", 0.5), ("2**3*2", 16.0), ("2*3^2", 18.0), ("8/2/2", 2.0), ("1-2-3", -4.0)],
)
def test_operators_bind_as_in_mathematics(text, expected):
    assert value(parse(text).tree) == expected
