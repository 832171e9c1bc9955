"""The reference pages say what the code says; `python tests/test_reference.py` writes the tables of models anew."""

import inspect
import re
import textwrap
from pathlib import Path

import neuro
from beside import beside
from neuro.cli.catalogue import body, bounds, catalogue, default_text
from neuro.model.language.including import SECTIONS
from neuro.model.parts import Trials

REFERENCE = Path(__file__).parents[1] / "docs" / "reference"
(HEAD,) = beside(__file__, "HEAD")


def page() -> str:
    """The whole page, from the definitions."""
    lines = [HEAD]
    for title, section in {**catalogue(), "The section `trials`": {"trials": Trials}}.items():
        lines.append(f"## {title}\n")
        for name, choice in section.items():
            lines += [f"### {name}", *map(wrapped, body(choice).replace("\n\n", "\n").split("\n")), ""]
            if getattr(choice, "equation", ""):
                lines.append(wrapped(f"- equation: `{choice.equation}`"))
            if getattr(choice, "source", ""):
                lines.append(wrapped(f"- source: {choice.source}"))
            lines += ["", *parameters(choice), *states(choice)]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def wrapped(line: str) -> str:
    """The same in lines of at most 128; none begins with a sign, which would make it an item of a list."""
    glued = re.sub(r" (?=[-+*>#])", "\0", line)
    later = "  " if line.startswith("- ") else ""
    lines = textwrap.fill(glued, 128, subsequent_indent=later, break_long_words=False, break_on_hyphens=False)
    return lines.replace("\0", " ")


def parameters(choice) -> list[str]:
    defaults = choice.defaults()
    rows = [
        (
            f"`{word}`",
            f"`{default_text(defaults[word])}`" if word in defaults else "required",
            q.unit,
            bounds(q),
            "yes" if q.arrays else "",
            q.doc,
        )
        for word, q in choice.quantities().items()
    ]
    return table(("parameter", "default", "unit", "accepts", "array", "meaning"), rows)


def states(choice) -> list[str]:
    rows = [(f"`{s.name}`", s.unit, s.doc) for s in getattr(choice, "states", ()) if not s.hidden]
    return table(("state", "unit", "meaning"), rows)


def table(head, rows) -> list[str]:
    if not rows:
        return []
    lines = [head, tuple("---" for _ in head), *rows]
    return [*(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in lines), ""]


def test_the_tables_of_models_are_those_of_the_code():
    assert (REFERENCE / "models.md").read_text() == page(), "python tests/test_reference.py writes it anew"


def test_the_page_of_the_language_names_every_section_and_word():
    text = (REFERENCE / "language.md").read_text()
    words = [*SECTIONS, *Trials.quantities(), "from", "to", "rule", "weight", "delay", "synapse", "model", "shape"]
    words += ["positions", "extent", "periodic", "of_distance"]
    words += ["initial", "of", "record", "every", "file", "key", "winner_take_all", "first_to_fire"]
    words += ["lateral_reset", "axis"]
    assert [word for word in words if f"`{word}`" not in text] == []


def test_the_page_of_python_names_every_public_name():
    text = (REFERENCE / "python.md").read_text()
    tables = {name for section in catalogue().values() for name in section}
    names = [n for n in neuro.__all__ if n not in tables and not n.startswith("__")]
    names += [f"sim.{n}" for n, _ in inspect.getmembers(neuro.Simulation) if not n.startswith("_")]
    names += [f"net.{n}" for n, _ in inspect.getmembers(neuro.Network, inspect.isfunction) if not n.startswith("_")]
    assert [name for name in names if name not in text] == []


if __name__ == "__main__":
    (REFERENCE / "models.md").write_text(page())
