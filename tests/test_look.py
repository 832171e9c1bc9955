"""All pages share the colours and fonts of tokens.css, which can be read in both schemes."""

import re
from itertools import product
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOKENS = ROOT / "neuro" / "core" / "tokens.css"
SHEETS = sorted(
    file
    for folder in ("neuro", "apps")
    for file in (ROOT / folder).rglob("*")
    if file.suffix in (".css", ".html", ".js") and file != TOKENS
)
LIGHT, DARK = (
    dict(re.findall(r"--(\w+): (#[0-9a-f]{6});", part)) for part in TOKENS.read_text().split("@media", maxsplit=1)
)
TEXT = ["ink", "soft", "accent", "bad", "over", "on", "off", "extra", "missing", "same", "spike"]
TEXT += [f"chip{k}" for k in range(3)] + [f"item{k}" for k in range(8)]


def luminance(colour):
    """Relative luminance, WCAG 2.2."""
    channels = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    darker, lighter = sorted(map(luminance, (one, other)))
    return (lighter + 0.05) / (darker + 0.05)


def test_both_schemes_have_all_colours():
    assert LIGHT.keys() == DARK.keys()
    assert set(TEXT) <= LIGHT.keys()


@pytest.mark.parametrize("scheme", [LIGHT, DARK], ids=["light", "dark"])
def test_text_can_be_read(scheme):
    unreadable = {
        (text, ground): round(ratio, 2)
        for text, ground in product(TEXT, ("paper", "card", "field"))
        if (ratio := contrast(scheme[text], scheme[ground])) < 4.5
    }
    assert unreadable == {}
    assert contrast(scheme["paper"], scheme["accent"]) >= 4.5, "text of a button"


@pytest.mark.parametrize("file", SHEETS, ids=lambda file: file.name)
def test_colours_and_fonts_are_tokens(file):
    text = re.sub(r"//.*", "", file.read_text())
    assert re.findall(r"#[0-9a-fA-F]{6}\b|#[0-9a-fA-F]{3}\b(?=[;\"'])|\b(?:sans-serif|monospace|serif)\b", text) == []


def test_tokens_that_are_used_exist():
    sources = [*SHEETS, *(ROOT / "neuro").rglob("*.py"), *(ROOT / "apps").rglob("*.py")]
    used = {name for file in sources for name in re.findall(r"var\(--(\w+)\)", file.read_text())}
    assert used - {"columns"} <= set(re.findall(r"--(\w+)", TOKENS.read_text()))
