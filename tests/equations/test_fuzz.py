"""Random expressions: refused by a message, or the same on both backends."""

from contextlib import suppress

import numpy as np
from hypothesis import Phase, given, settings, strategies as st

import neuro
from neuro import ModelError
from neuro.testing.case import run_on

STATES = 8
LEAVES = st.sampled_from([f"x{k}" for k in range(STATES)] + ["a", "b", "I*GOhm/mV"]) | st.floats(-3.0, 3.0).map(
    lambda x: f"{x:.3g}"
)


def _grown(inner):
    pair = st.tuples(inner, inner)
    return st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda parts: f"({' '.join(parts)})"),
        st.tuples(inner, st.sampled_from(["2", "3", "0.5", "-1", "a"])).map(lambda parts: f"({parts[0]})^({parts[1]})"),
        st.tuples(
            st.sampled_from(["exp", "expm1", "exprel", "log", "sqrt", "tanh", "sin", "cos", "abs", "-", "none"]), inner
        ).map(lambda parts: f"{parts[0]}({parts[1]})"),
        st.tuples(st.sampled_from(["min", "max"]), pair).map(lambda parts: f"{parts[0]}({', '.join(parts[1])})"),
        st.tuples(pair, pair).map(lambda parts: "where({0[0]} > {0[1]}, {1[0]}, {1[1]})".format(*parts)),
    )


EXPRESSIONS = st.recursive(LEAVES, _grown, max_leaves=7)


def made(expressions):
    states = [f"x{k}" for k in range(STATES)]
    return neuro.equations(
        "random",
        equations={name: f"({text})/ms" for name, text in zip(states, expressions, strict=False)},
        initial={name: 0.3 * k - 1 for k, name in enumerate(states)},
        parameters={"a": 0.7, "b": {"default": -1.3, "at_most": 5}},
        integrator="euler",
    )


def fits(text):
    """Whether an expression is taken; refused by anything but a message, the test ends here."""
    with suppress(ModelError):
        made([text, *(["0"] * (STATES - 1))])
        return True
    return False


@settings(max_examples=2, deadline=None, derandomize=True, phases=(Phase.generate,), database=None)
@given(st.lists(EXPRESSIONS, min_size=3 * STATES, max_size=3 * STATES))
def test_random_expressions_are_refused_or_run_alike(texts):
    taken = ([text for text in texts if fits(text)] + ["-x0"] * STATES)[:STATES]
    found = []
    for backend in ("reference", "event"):
        net = neuro.Network("random")
        net.population("dc", 1, neuro.dc_generator(amplitude=1.5))
        net.population("cells", 1, made(taken)())
        if any("I" in text for text in taken):
            net.connect("dc", "cells", neuro.all_to_all())
        for k in range(STATES):
            net.probe(f"x{k}", "cells", f"x{k}")
        sim = neuro.compile(net, backend)
        run_on(sim, 0.5)
        found.append(np.array([sim.trace(f"x{k}")[1][:, 0] for k in range(STATES)]))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6, atol=1e-9)
