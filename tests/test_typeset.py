"""The site shows the equations of models, which are plain text, as mathematics."""

import re
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from xml.etree import ElementTree

import pytest

from neuro.cli.catalogue import catalogue

_SPEC = spec_from_file_location("site_equations", Path(__file__).parents[1] / "docs" / "_site" / "equations.py")
site = module_from_spec(_SPEC)
_SPEC.loader.exec_module(site)

MODELS = {
    name: model for part in catalogue().values() for name, model in part.items() if getattr(model, "equation", "")
}
LAYOUT = re.compile(r"[\s_^/()\[\];,⌊⌋]|sqrt|floor")
"""What a fraction, a script or a line shows by its place."""


def shown(equation: str) -> ElementTree.Element:
    return ElementTree.fromstring(f"<p>{site.typeset(equation).replace('<wbr>', '')}</p>")


def text(equation: str) -> str:
    return "".join(shown(equation).itertext())


def signs(equation: str) -> str:
    """The same signs as in print, from left to right."""
    printed = re.sub(r"\bsum(?! of)(?=[ _])", "∑", equation)
    printed = re.sub(r"\bK([+-])3", r"K3\1", printed)  # of two scripts the lower comes first
    printed = re.sub(r"\bA(plus|minus)", r"A_\1", printed)
    printed = printed.replace("'", "′")
    printed = re.sub(r"[A-Za-z]+", lambda word: site.LABELS.get(word[0], word[0]), printed)
    for sign in sorted(site.SIGNS, key=len, reverse=True):
        printed = printed.replace(sign, site.SIGNS[sign])
    return LAYOUT.sub("", printed)


@pytest.mark.parametrize("name", MODELS)
def test_each_equation_is_typeset_with_all_its_signs(name):
    equation = MODELS[name].equation
    assert LAYOUT.sub("", text(equation)) == signs(equation)


def test_parameters_and_states_are_not_taken_for_english():
    spoken = {"move", "payloads", "signal", "times"}  # as in "emits payloads at the listed times"
    for name, model in MODELS.items():
        names = {*model.quantities(), *(state.name for state in getattr(model, "states", ()))} - spoken
        english = re.sub(r"<math.*?</math>|<.*?>", " ", site.typeset(model.equation)).split()
        assert names & {word.strip("(,:)") for word in english} == set(), name


def test_terms_and_lines(messages):
    messages.of(site.typeset)


@pytest.mark.parametrize("equation", ["x = (y", "x = y)", "x ^", "x = ", "x = y & z", "x[k", "x / / y"])
def test_what_cannot_be_read_is_refused(equation):
    with pytest.raises(ValueError, match=r"stands where|ends with|can't be read"):
        site.typeset(equation)


def test_signs_and_greek_letters():
    plain = "x <= y >= z != u ~ v -> w *= - tau; w -= +-lambda * Delta_plus, w += floor(eps)"
    assert re.sub(r"\s", "", text(plain)) == "x≤y≥z≠u∼v→w×=−τw−=±λ∗Δ+,w+=⌊ε⌋"
