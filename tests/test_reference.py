"""The reference pages say what the code says; `python tests/test_reference.py` writes the tables of models anew."""

import inspect
import re
import textwrap
from pathlib import Path

import neuro
from beside import beside
from neuro.cli.catalogue import body, bounds, catalogue, default_text, sentence
from neuro.model.language.including import SECTIONS
from neuro.model.parts import Trials

REFERENCE = Path(__file__).parents[1] / "docs" / "reference"
HEAD, PAGES = beside(__file__, "HEAD", "PAGES")


def pages() -> dict[str, str]:
    """The list of all models and the page of each kind, from the definitions, by path."""
    sections = {**catalogue(), "The section `trials`": {"trials": Trials}}
    index, texts = {title: [] for title in sections}, {}
    for file, page in PAGES.items():
        lines = [f"# {page['title']}\n", "`python tests/test_reference.py` writes this page.\n"]
        for title, modules in page["sections"].items():
            lines.append(f"## {title}\n")
            for name, choice in sections[title].items():
                if not modules or choice.__module__.rpartition(".")[2] in modules:
                    lines += described(name, choice)
                    index[title].append(wrapped(f"- [`{name}`](models/{file}.md#{name}): {sentence(choice)}"))
        texts[f"models/{file}.md"] = joined(lines)
    toctree = "\n".join(["```{toctree}", ":hidden:", "", *(f"models/{file}" for file in PAGES), "```"])
    lists = (line for title, rows in index.items() for line in (f"## {title}\n", *rows, ""))
    texts["models.md"] = joined([HEAD, *lists, toctree])
    return texts


def described(name, choice) -> list[str]:
    lines = [f"### {name}", *map(wrapped, body(choice).replace("\n\n", "\n").split("\n")), ""]
    if getattr(choice, "equation", ""):
        lines.append(wrapped(f"- equation: `{choice.equation}`"))
    if getattr(choice, "source", ""):
        lines.append(wrapped(f"- source: {choice.source}"))
    return [*lines, "", *parameters(choice), *states(choice)]


def joined(lines) -> str:
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
    kept = {str(file.relative_to(REFERENCE)): file.read_text() for file in REFERENCE.glob("models/*.md")}
    kept["models.md"] = (REFERENCE / "models.md").read_text()
    assert kept == pages(), "python tests/test_reference.py writes them anew"
    names = [name for section in catalogue().values() for name in section]
    assert sorted(re.findall(r"^- \[`(\w+)`\]", kept["models.md"], re.M)) == sorted([*names, "trials"])


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
    for path, text in pages().items():
        (REFERENCE / path).write_text(text)
