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


@pytest.mark.parametrize(
    ("equation", "mathml"),
    [
        ("V_m'", "<msubsup><mi>V</mi><mrow><mtext>m</mtext></mrow><mrow><mo>′</mo></mrow></msubsup>"),
        (
            "-(V_m - E)/tau_syn_ex",
            '<mo form="prefix">−</mo><mfrac><mrow><msub><mi>V</mi><mrow><mtext>m</mtext></mrow></msub>'
            '<mo form="infix">−</mo><mi>E</mi></mrow>'
            "<mrow><msub><mi>τ</mi><mrow><mtext>syn,ex</mtext></mrow></msub></mrow></mfrac>",
        ),
        (
            "rate h / 1000",
            '<mfrac><mrow><mi class="long">rate</mi><mspace width="0.22em"></mspace><mi>h</mi></mrow>'
            "<mrow><mn>1000</mn></mrow></mfrac>",
        ),
        (
            "2^(i phase)",
            '<msup><mn>2</mn><mrow><mi>i</mi><mspace width="0.22em"></mspace><mi class="long">phase</mi></mrow></msup>',
        ),
        ("a[k + 1]", '<msub><mi>a</mi><mrow><mi>k</mi><mo form="infix">+</mo><mn>1</mn></mrow></msub>'),
        ("K-3", '<msubsup><mi>K</mi><mrow><mn>3</mn></mrow><mrow><mo form="prefix">−</mo></mrow></msubsup>'),
        ("sqrt(x)", "<msqrt><mi>x</mi></msqrt>"),
    ],
)
def test_a_term(equation, mathml):
    assert site.typeset(equation) == f'<span class="equation"><math displaystyle="true">{mathml}</math></span>'


def test_lines_break_between_clauses_and_before_operators_and_words_stand_outside_of_formulas():
    assert re.sub(r"<math.*?>", "<math>", site.typeset("x = y + 1, t since a spike; spike at |x| >= 2 (pre)")) == (
        '<span class="equation"><math><mi>x</mi></math><wbr><math><mo form="infix">=</mo><mi>y</mi></math><wbr>'
        '<math><mo form="infix">+</mo><mn>1</mn><mo>,</mo></math> <math><mi>t</mi></math> since a spike</span>'
        '<span class="equation">spike at <math><mrow><mo form="prefix">|</mo><mi>x</mi><mo form="postfix">|</mo></mrow>'
        '</math><wbr><math><mo form="infix">≥</mo><mn>2</mn></math> (pre)</span>'
    )


@pytest.mark.parametrize("equation", ["x = (y", "x = y)", "x ^", "x = ", "x = y & z", "x[k", "x / / y"])
def test_what_cannot_be_read_is_refused(equation):
    with pytest.raises(ValueError, match=r"stands where|ends with|can't be read"):
        site.typeset(equation)


def test_signs_and_greek_letters():
    plain = "x <= y >= z != u ~ v -> w *= - tau; w -= +-lambda * Delta_plus, w += floor(eps)"
    assert re.sub(r"\s", "", text(plain)) == "x≤y≥z≠u∼v→w×=−τw−=±λ∗Δ+,w+=⌊ε⌋"
