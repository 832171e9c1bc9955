"""What is copied from Brian2, NESTML or Python ends in a message that tells our form."""

import pytest

import neuro
from refused import error_of

PARAMETERS = {"E_L": "-70 mV", "tau": "10 ms", "V_th": "-50 mV", "sigma": "2 mV"}
LEAK = {"V_m": "(E_L - V_m)/tau"}


def refused(**words):
    return error_of(neuro.equations, "m", **{"parameters": PARAMETERS, **words})


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
