"""`$(...)` in a file: its values, and mistakes at the very character."""

import math

import pytest
from hypothesis import given, strategies as st

import neuro
from beside import beside, evaluated

(NET,) = beside(__file__, "NET")
COLUMN = NET.splitlines()[5].index("WEIGHT") + 1


def weight(folder, text: str, params=None) -> object:
    (folder / "net.yaml").write_text(NET.replace("WEIGHT", text))
    return neuro.load(folder / "net.yaml", params).projections["a_a"].weight


@pytest.mark.parametrize(("text", "expected"), evaluated(__file__, "VALUES", globals()))
def test_values(folder, text: str, expected: object):
    found = weight(folder, text)
    assert (found.tolist() if hasattr(found, "tolist") else found) == expected


def test_parameters_of_parameters_overrides_and_whole_numbers(folder):
    text = (
        "neuro: 1\nparameters: {order: 100, n_ex: $(4 * order), n_in: $(n_ex / 4), rate: $(2 * 8 Hz)}\npopulations:\n"
    )
    text += "  a: {model: {poisson_generator: {rate: $rate}}, shape: [$n_in, $(n_ex / n_in)]}\n"
    (folder / "net.yaml").write_text(text)
    assert neuro.load("net.yaml").populations["a"].shape == (100, 4)
    net = neuro.load("net.yaml", {"order": 30, "rate": "$(order * 1 Hz)"})
    assert (net.populations["a"].shape, net.populations["a"].model.rate) == ((30, 4), 30.0)
    net.save("saved.yaml")
    assert "shape: [30, 4]" in (folder / "saved.yaml").read_text()


@given(st.lists(st.sampled_from(["2", "0.5", "g", "(", ")", "+", "-", "*", "/", "**", "sqrt(", "1e300"]), max_size=12))
def test_it_gives_what_python_gives_or_a_mistake(tmp_path_factory, words: list[str]):
    inner = " ".join(words)
    folder = tmp_path_factory.mktemp("sums")
    try:
        found = weight(folder, f"$({inner})")
    except neuro.ModelError:
        found = None
    names = {"g": 5.0, "sqrt": math.sqrt, "__builtins__": {}}
    try:
        expected = eval(inner, names)  # these words only
        expected = None if isinstance(expected, complex) or not math.isfinite(expected) else float(expected)
    except (SyntaxError, TypeError, ValueError, ArithmeticError):
        expected = None
    if found is not None and expected is not None:
        assert found == pytest.approx(expected, rel=1e-12)
    else:
        assert found is None or "**" in words or "g (" in inner or expected is not None


def test_mistakes(message, messages):
    messages.of(lambda text: message(NET.replace("WEIGHT", text)))


def test_limits(message):
    deep = message(NET.replace("WEIGHT", f"$({'(' * 50}1{')' * 50})"))
    assert "found more than 40 levels: expected fewer" in deep
    long = message(NET.replace("WEIGHT", f"$({'+1' * 300})"))
    assert long.endswith("expected fewer\n  hint: split the expression into several parameters")


def test_a_name_is_set_before_it_is_used(message, messages):
    text = "neuro: 1\nparameters:\n  a: $(b + 1)\n  b: 2\npopulations: {}\n"
    messages({"b": message(text)})
