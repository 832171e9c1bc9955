"""What is copied from Brian2, NESTML or Python ends in a message that tells our form."""

import pytest

import neuro
from neuro import ModelError

PARAMETERS = {"E_L": "-70 mV", "tau": "10 ms", "V_th": "-50 mV", "sigma": "2 mV"}
LEAK = {"V_m": "(E_L - V_m)/tau"}
ALONE = "write the right side alone, by the name of its state: {V_m: (E_L - V_m)/tau_m}"
UNIT = "leave the unit out: it follows from those of parameters, or 'initial' says it; refractoriness is a word"
CHOICE = "write where(a > b, value, other)"


def refused(**words):
    with pytest.raises(ModelError) as raised:
        neuro.equations("m", **{"parameters": PARAMETERS, **words})
    return raised.value


@pytest.mark.parametrize(
    ("text", "column", "hint"),
    [
        ("(E_L - V_m)/tau : volt", 17, UNIT),
        ("(E_L - V_m)/tau : volt (unless refractory)", 17, UNIT),
        ("dV_m/dt = (E_L - V_m)/tau", 9, f"{ALONE}; a comparison is < <= > or >="),
        ("V_m' = (E_L - V_m)/tau", 4, ALONE),
        ("(E_L - V_m)/tau; dw/dt = -w/tau", 16, "each state has an expression of its own: {V_m: ..., w: ...}"),
        (
            "(E_L - V_m)/tau + sigma*xi*tau**-0.5",
            25,
            "equations have no noise of their own: connect a poisson_generator",
        ),
        ("clip(V_m, E_L, V_th)/tau", 1, "write min(max(value, low), high)"),
        ("int(V_m > E_L)*E_L/tau", 9, CHOICE),
        ("E_L/tau if V_m > E_L else 0", 9, CHOICE),
        ("V_m > E_L ? 1 : 0", 11, CHOICE),
        ("where(V_m > E_L and V_m < V_th, 1, 0)", 17, "write min(where(a > b, 1, 0), where(c > d, 1, 0))"),
        ("E_L/tau*exp(t/tau)", 13, "equations do not depend on time: connect a generator"),
        ("convolve(K, spikes)*E_L/tau", 1, "spikes arrive in 'receptors', e.g. {g: {kernel: exp, tau: tau_syn}}"),
        ("3*volt/second", 3, "write mV or V"),
        ("pi*V_m/tau", 1, "write 3.141592653589793"),
    ],
)
def test_an_expression(text, column, hint):
    error = refused(equations={"V_m": text})
    assert f"equations.V_m, column {column}: " in error.message
    assert error.hint == hint


TRACES = {"K_plus": {"of": "pre", "tau": "tau_plus"}}
OF_RULES = "doc, initial, on_post, on_pre, on_signal, parameters, source, states, traces"
OF_NEURONS = "doc, equations, initial, integrator, let, parameters, receptors, refractory, reset, source, threshold"


@pytest.mark.parametrize("order", [("on_pre", "on_post"), ("on_post", "on_pre")])
def test_the_line_that_gives_the_weight_a_wrong_unit_is_named(order):
    said = {"on_pre": {"w": "w + tau_plus"}, "on_post": {"w": "w + K_plus"}}
    error = refused(**{word: said[word] for word in order}, traces=TRACES, parameters={"tau_plus": "20 ms"})
    assert error.message.splitlines()[0] == (
        "model 'm': on_pre.w, column 1: 'w' would be in ms: expected it in pA, nS or mV, or without unit"
    )


def model(**words):
    neuro.equations("m", **{"parameters": PARAMETERS, **words})


def test_words_and_values(messages):
    messages.calls(globals())


def test_none_is_as_left_out():
    said = {"equations": LEAK, "parameters": PARAMETERS}
    assert neuro.equations("m", **said, threshold=None, reset=None, refractory=None) is neuro.equations("m", **said)
